//! Parts with curved tops by formulas, as closed meshes, and how far layers stand off them: an evaluator of its own,
//! which shares no code with what it checks.

use headway::geometry::Point2;
use headway::geometry::polygon::Region;
use headway::mesh::{Mesh, Point3};

/// A part under a height function.
pub struct CurvedPart {
    pub mesh: Mesh,
    /// Height of the top; `None` beside the part.
    pub top_mm: Box<dyn Fn(f64, f64) -> Option<f64> + Sync>,
    /// The box from above: least x and y, greatest x and y.
    pub bounds_mm: [f64; 4],
}

/// The solid between z = 0 and heights over a sheet of places, the last row and column of which end it.
fn solid(columns: usize, rows: usize, place: impl Fn(usize, usize) -> [f64; 3]) -> Mesh {
    let top = (0..columns * rows).map(|k| place(k % columns, k / columns));
    let top: Vec<[f64; 3]> = top.collect();
    let bottom = top.iter().map(|[x, y, _]| Point3::new(*x, *y, 0.0));
    let mut mesh = Mesh {
        vertices: top
            .iter()
            .map(|[x, y, z]| Point3::new(*x, *y, *z))
            .chain(bottom)
            .collect(),
        triangles: Vec::new(),
    };
    let count = (columns * rows) as u32;
    let at = |i: usize, j: usize| (j * columns + i) as u32;
    let mut quad = |a: u32, b: u32, c: u32, d: u32| mesh.triangles.extend([[a, b, c], [a, c, d]]);
    for j in 0..rows - 1 {
        for i in 0..columns - 1 {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            quad(a, b, c, d);
            quad(count + d, count + c, count + b, count + a);
        }
    }
    let rim = (0..columns - 1)
        .map(|i| [at(i, 0), at(i + 1, 0)])
        .chain((0..rows - 1).map(|j| [at(columns - 1, j), at(columns - 1, j + 1)]))
        .chain(
            (0..columns - 1)
                .rev()
                .map(|i| [at(i + 1, rows - 1), at(i, rows - 1)]),
        )
        .chain((0..rows - 1).rev().map(|j| [at(0, j + 1), at(0, j)]));
    for [a, b] in rim.collect::<Vec<_>>() {
        quad(count + a, count + b, b, a);
    }
    mesh
}

/// A cap of a sphere of 60 mm on a square block; `scale` makes plan and sphere smaller.
pub fn dome(scale: f64, block_mm: f64, step_mm: f64) -> CurvedPart {
    let (half_mm, ball_mm, foot_mm) = (20.0 * scale, 60.0 * scale, 18.0 * scale);
    let top = move |x: f64, y: f64| {
        let off_mm = x.hypot(y);
        let cap = |r: f64| (ball_mm * ball_mm - r * r).max(0.0).sqrt();
        match off_mm < foot_mm {
            true => block_mm + cap(off_mm) - cap(foot_mm),
            false => block_mm,
        }
    };
    let count = (2.0 * half_mm / step_mm).round() as usize + 1;
    let mesh = solid(count, count, |i, j| {
        let [x, y] = [i, j].map(|k| 2.0 * half_mm * k as f64 / (count - 1) as f64 - half_mm);
        [x, y, top(x, y)]
    });
    CurvedPart {
        mesh,
        top_mm: Box::new(move |x, y| (x.abs().max(y.abs()) < half_mm).then(|| top(x, y))),
        bounds_mm: [-half_mm, -half_mm, half_mm, half_mm],
    }
}

/// A block with a slanted top: its height at the middle, its slope's tangent and direction.
pub fn ramp(size_mm: [f64; 2], middle_mm: f64, tangent: f64, turn_rad: f64) -> CurvedPart {
    let [half_x, half_y] = size_mm.map(|side| 0.5 * side);
    let (sin, cos) = turn_rad.sin_cos();
    let top = move |x: f64, y: f64| middle_mm + tangent * (x * cos + y * sin);
    let mesh = solid(9, 9, |i, j| {
        let [x, y] = [(i, half_x), (j, half_y)].map(|(k, half)| half * (0.25 * k as f64 - 1.0));
        [x, y, top(x, y)]
    });
    CurvedPart {
        mesh,
        top_mm: Box::new(move |x, y| (x.abs() < half_x && y.abs() < half_y).then(|| top(x, y))),
        bounds_mm: [-half_x, -half_y, half_x, half_y],
    }
}

/// Half of a tapered wing that lies on its chord: 24 % thick, from 0.6 to 4.3 mm.
pub fn wing() -> CurvedPart {
    let chord = |x: f64| 30.0 - 0.2 * x;
    let thick = move |x: f64, u: f64| {
        let (u2, u3) = (u * u, u * u * u);
        0.6 + 1.2
            * chord(x)
            * (0.2969 * u.sqrt() - 0.126 * u - 0.3516 * u2 + 0.2843 * u3 - 0.1036 * u2 * u2)
    };
    let (columns, rows) = (121, 121);
    let mesh = solid(columns, rows, |i, k| {
        let x = 60.0 * i as f64 / (columns - 1) as f64;
        // Closer at the nose, where it is steep.
        let u = 0.5 * (1.0 - (std::f64::consts::PI * k as f64 / (rows - 1) as f64).cos());
        [x, 0.1 * x + u * chord(x), thick(x, u)]
    });
    CurvedPart {
        mesh,
        top_mm: Box::new(move |x, y| {
            let u = (y - 0.1 * x) / chord(x);
            ((0.0..=60.0).contains(&x) && (0.0..=1.0).contains(&u)).then(|| thick(x, u))
        }),
        bounds_mm: [0.0, 0.0, 60.0, 30.0],
    }
}

/// A foot of 4.13 mm and a ramp of 6.5° from 6.07 mm on, each with a hole.
pub fn bracket() -> CurvedPart {
    let slope = 6.5f64.to_radians().tan();
    let foot = ring_plate([0.0, 14.0], 30.0, [7.0, 15.0, 2.5], |_, _| 4.13);
    let ramp = ring_plate([14.0, 50.0], 30.0, [34.0, 15.0, 5.0], move |x, _| {
        6.07 + (x - 14.0) * slope
    });
    CurvedPart {
        mesh: united(foot, ramp),
        top_mm: Box::new(move |x, y| {
            let is_in = (0.0..=50.0).contains(&x) && (0.0..=30.0).contains(&y);
            let is_hole = (x - 34.0).hypot(y - 15.0) < 5.0 || (x - 7.0).hypot(y - 15.0) < 2.5;
            let top_mm = match x < 14.0 {
                true => 4.13,
                false => 6.07 + (x - 14.0) * slope,
            };
            (is_in && !is_hole).then_some(top_mm)
        }),
        bounds_mm: [0.0, 0.0, 50.0, 30.0],
    }
}

/// A plate with a round hole: a sheet from the hole to the rim, closed around it.
fn ring_plate(
    x_mm: [f64; 2],
    width_mm: f64,
    [cx, cy, radius_mm]: [f64; 3],
    top: impl Fn(f64, f64) -> f64,
) -> Mesh {
    // Directions through the corners, and as many more between them.
    let mut turns: Vec<f64> = (0..96)
        .map(|k| std::f64::consts::TAU * f64::from(k) / 96.0)
        .collect();
    for (x, y) in [
        (x_mm[0], 0.0),
        (x_mm[1], 0.0),
        (x_mm[1], width_mm),
        (x_mm[0], width_mm),
    ] {
        turns.push((y - cy).atan2(x - cx).rem_euclid(std::f64::consts::TAU));
    }
    turns.sort_by(f64::total_cmp);
    turns.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
    let count = turns.len();
    let places: Vec<[[f64; 2]; 2]> = turns
        .iter()
        .map(|turn| {
            let (sin, cos) = turn.sin_cos();
            let to = |side: f64, middle: f64, along: f64| match along.abs() > 1e-12 {
                true => ((side - middle) / along).max(0.0),
                false => 0.0,
            };
            let ways = [
                to(x_mm[0], cx, cos),
                to(x_mm[1], cx, cos),
                to(0.0, cy, sin),
                to(width_mm, cy, sin),
            ];
            let way = ways
                .into_iter()
                .filter(|way| *way > 0.0)
                .fold(f64::INFINITY, f64::min);
            [
                [cx + radius_mm * cos, cy + radius_mm * sin],
                [cx + way * cos, cy + way * sin],
            ]
        })
        .collect();
    let mut mesh = Mesh::default();
    for place in &places {
        for [x, y] in place {
            mesh.vertices.push(Point3::new(*x, *y, top(*x, *y)));
            mesh.vertices.push(Point3::new(*x, *y, 0.0));
        }
    }
    // Four vertices a direction: inner top, inner bottom, outer top, outer bottom.
    for k in 0..count {
        let (here, next) = (4 * k as u32, 4 * ((k + 1) % count) as u32);
        let mut quad =
            |a: u32, b: u32, c: u32, d: u32| mesh.triangles.extend([[a, b, c], [a, c, d]]);
        quad(here, here + 2, next + 2, next);
        quad(here + 1, next + 1, next + 3, here + 3);
        quad(here + 2, here + 3, next + 3, next + 2);
        quad(here, next, next + 1, here + 1);
    }
    mesh
}

/// Two solids that touch, one shell each: what they have in common is inside.
fn united(mut one: Mesh, other: Mesh) -> Mesh {
    let first = one.vertices.len() as u32;
    one.vertices.extend(other.vertices);
    one.triangles.extend(
        other
            .triangles
            .iter()
            .map(|t| t.map(|vertex| vertex + first)),
    );
    one
}

/// Even-odd, by the crossings of a ray along x.
pub fn holds(regions: &[Region], x: f64, y: f64) -> bool {
    let mut crossings = 0;
    for ring in regions.iter().flat_map(Region::rings) {
        let points = &ring.points;
        for (k, p) in points.iter().enumerate() {
            let q: Point2 = points[(k + 1) % points.len()];
            if (p.y > y) != (q.y > y) && x < p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x) {
                crossings += 1;
            }
        }
    }
    crossings % 2 == 1
}
