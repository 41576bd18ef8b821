//! The rules of `space` once more, one function each, in plain loops that share nothing with it, and a random sample of
//! parts and machines. Lengths in mm, angles in rad; cells in steps of the grid.

use headway_reach::Vector3;
use headway_reach::profile::HeadProfile;
use headway_reach::space::{Aperture, Part, Reach, Rules, Space, directions};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// What rounding may decide, as the rules have it.
pub const EPSILON: f64 = 1e-9;

pub type Cell = [i32; 3];

pub fn plus(a: Cell, b: Cell) -> Cell {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub fn minus(a: Cell, b: Cell) -> Cell {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub fn along(cell: Cell, n: [f64; 3]) -> f64 {
    f64::from(cell[0]) * n[0] + f64::from(cell[1]) * n[1] + f64::from(cell[2]) * n[2]
}

pub fn square(cell: Cell) -> f64 {
    f64::from(cell[0] * cell[0] + cell[1] * cell[1] + cell[2] * cell[2])
}

/// All offsets of a cube, x fastest.
pub fn cube(half: i32) -> impl Iterator<Item = Cell> {
    let side = move || -half..=half;
    side().flat_map(move |z| side().flat_map(move |y| side().map(move |x| [x, y, z])))
}

/// A part and what stands beside it.
pub struct Shape {
    pub size: [usize; 3],
    pub solid: Vec<bool>,
    pub cells: Vec<Cell>,
    pub stands: Vec<Cell>,
}

impl Shape {
    pub fn of(size: [usize; 3], solid: impl Fn(Cell) -> bool) -> Shape {
        let [nx, ny, nz] = size.map(|count| count as i32);
        let grid = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
        let all: Vec<Cell> = grid.collect();
        Shape {
            size,
            solid: all.iter().map(|&cell| solid(cell)).collect(),
            cells: all.into_iter().filter(|&cell| solid(cell)).collect(),
            stands: Vec::new(),
        }
    }

    pub fn place(&self, cell: Cell) -> Option<usize> {
        let is_inside = (0..3).all(|axis| (0..self.size[axis] as i32).contains(&cell[axis]));
        let [x, y, z] = cell.map(|part| part.max(0) as usize);
        is_inside.then_some((z * self.size[1] + y) * self.size[0] + x)
    }

    pub fn holds(&self, cell: Cell) -> bool {
        self.place(cell).is_some_and(|place| self.solid[place])
    }

    pub fn turned(&self, [x, y, z]: Cell) -> Cell {
        [self.size[0] as i32 - 1 - x, y, z]
    }

    pub fn mirrored(&self) -> Shape {
        let mut shape = Shape::of(self.size, |cell| self.holds(self.turned(cell)));
        shape.stands = self.stands.iter().map(|&cell| self.turned(cell)).collect();
        shape
    }
}

/// A machine and its material.
#[derive(Clone)]
pub struct Setting {
    pub voxel_mm: f64,
    pub knots: Vec<[f64; 2]>,
    pub self_support_rad: f64,
    pub semi_mm: [f64; 2],
    pub directions: Vec<[f64; 3]>,
    pub usable: u128,
    /// The joints permit one pose in so many.
    pub one_in: usize,
}

impl Setting {
    pub fn allowed(&self, [x, y, z]: [usize; 3], direction: usize) -> bool {
        (7 * x + 5 * y + 3 * z + 11 * direction).is_multiple_of(self.one_in)
    }

    pub fn contains(&self, [x, y]: [f64; 2]) -> bool {
        (x / self.semi_mm[0]).powi(2) + (y / self.semi_mm[1]).powi(2) <= 1.0 + EPSILON
    }

    pub fn headings_rad() -> Vec<f64> {
        (0..8)
            .map(|k| f64::from(k) * 22.5f64.to_radians())
            .collect()
    }

    /// What the engine says.
    pub fn reach(&self, shape: &Shape) -> Reach {
        let is = |cells: &[Cell], at: [usize; 3]| cells.contains(&at.map(|part| part as i32));
        let part = Part::new(shape.size, self.voxel_mm, |at| {
            shape.holds(at.map(|part| part as i32))
        });
        let part = part.unwrap().with_obstacles(|at| is(&shape.stands, at));
        let numbered = part.cells().iter().map(|cell| cell.map(i32::from));
        assert!(numbered.eq(shape.cells.iter().copied()));
        let rules = Rules {
            head: &HeadProfile::new(&self.knots).unwrap(),
            slack_mm: 0.3 * self.voxel_mm,
            self_support_rad: self.self_support_rad,
            aperture: Aperture {
                headings_rad: Setting::headings_rad(),
                reach_mm: self.semi_mm[0].max(self.semi_mm[1]),
                contains: &|at| self.contains(at),
            },
            allowed: &|cell, direction| self.allowed(cell.map(usize::from), direction),
        };
        let normals: Vec<Vector3> = self.directions.iter().map(|&n| n.into()).collect();
        Space::new(&part, &normals, &rules)
            .unwrap()
            .reach(self.usable)
    }
}

/// The rules, one function each; what depends on a direction alone is made once.
pub struct Plain<'a> {
    pub set: &'a Setting,
    pub shape: &'a Shape,
    /// By direction and heading.
    pub footprints: Vec<Vec<Vec<Cell>>>,
    /// By direction: from a cell to what may support it.
    pub leans: Vec<Vec<Cell>>,
}

impl<'a> Plain<'a> {
    pub fn new(set: &'a Setting, shape: &'a Shape) -> Plain<'a> {
        let mut plain = Plain {
            set,
            shape,
            footprints: Vec::new(),
            leans: Vec::new(),
        };
        for &n in &set.directions {
            let headings = Setting::headings_rad();
            let footprints = headings.iter().map(|&psi| plain.footprint(n, psi));
            let footprints = footprints.collect();
            plain.footprints.push(footprints);
            let primitive = cube(7).filter(|&offset| is_primitive(offset));
            let near = primitive.filter(|&offset| square(offset) <= 7.3 * 7.3);
            let least = plain.lean_cos();
            let leans = near.filter(|&o| -along(o, n) / square(o).sqrt() >= least);
            plain.leans.push(leans.collect());
        }
        plain
    }

    pub fn lean_cos(&self) -> f64 {
        (self.set.self_support_rad + 0.5f64.to_radians()).cos() - EPSILON
    }

    pub fn is_usable(&self, k: usize) -> bool {
        self.set.usable >> k & 1 == 1
    }

    pub fn footprint(&self, n: [f64; 3], psi: f64) -> Vec<Cell> {
        let [nx, ny, nz] = n;
        let f = 1.0 / (1.0 + nz);
        let (u, w) = if nz < -0.999999 {
            ([1.0, 0.0, 0.0], [0.0, -1.0, 0.0])
        } else {
            (
                [1.0 - nx * nx * f, -nx * ny * f, -nx],
                [-nx * ny * f, 1.0 - ny * ny * f, -ny],
            )
        };
        let h = self.set.voxel_mm;
        let half = (self.set.semi_mm[0].max(self.set.semi_mm[1]) / h).ceil() as i32;
        let holds = |&o: &Cell| {
            let (across, up) = (h * along(o, u), h * along(o, w));
            let at = [
                across * psi.cos() + up * psi.sin(),
                -across * psi.sin() + up * psi.cos(),
            ];
            (h * along(o, n)).abs() < h / 2.0 - EPSILON && self.set.contains(at)
        };
        cube(half).filter(|o| *o == [0; 3] || holds(o)).collect()
    }

    /// What a pose covers, by all headings that fit.
    pub fn covered(&self, q: Cell, k: usize) -> Vec<Cell> {
        let mut cells = Vec::new();
        for footprint in &self.footprints[k] {
            if footprint.iter().all(|&o| self.shape.holds(plus(q, o))) {
                cells.extend(footprint.iter().map(|&o| plus(q, o)));
            }
        }
        cells
    }

    pub fn radius_mm(&self, t: f64) -> f64 {
        let knots = &self.set.knots;
        let widest = |radius: f64, knot: &[f64; 2]| {
            if knot[0] <= t {
                radius.max(knot[1])
            } else {
                radius
            }
        };
        let mut radius = knots.iter().fold(knots[0][1], widest);
        for pair in knots.windows(2) {
            let [[low, from], [high, to]] = [pair[0], pair[1]];
            if low <= t && t < high {
                radius = radius.max(from + (to - from) * (t - low) / (high - low));
            }
        }
        radius
    }

    pub fn meets(&self, q: Cell, k: usize, w: Cell) -> bool {
        let h = self.set.voxel_mm;
        let d = minus(w, q);
        let s = h * along(d, self.set.directions[k]);
        let t = s - h / 2.0;
        t > 0.3 * h + EPSILON && h * h * square(d) - s * s <= self.radius_mm(t).powi(2) + EPSILON
    }

    pub fn is_above_bed(&self, q: Cell, k: usize) -> bool {
        let (h, n) = (self.set.voxel_mm, self.set.directions[k]);
        let leaning = n[0].hypot(n[1]);
        let below = self
            .set
            .knots
            .iter()
            .map(|[height, radius]| radius * leaning - height * n[2]);
        let tip_z = h * (f64::from(q[2]) + 0.5) + n[2] * h / 2.0;
        let lowest = tip_z - below.fold(f64::NEG_INFINITY, f64::max);
        n[2] >= -EPSILON && lowest >= -0.3 * h - EPSILON
    }

    pub fn is_allowed(&self, q: Cell, k: usize) -> bool {
        self.set.allowed(q.map(|part| part as usize), k)
    }

    pub fn is_clear_of_obstacles(&self, q: Cell, k: usize) -> bool {
        !self.shape.stands.iter().any(|&w| self.meets(q, k, w))
    }

    pub fn stands_on_bed(&self, v: Cell, k: usize) -> bool {
        v[2] == 0 && self.set.directions[k][2] >= self.lean_cos()
    }

    /// Of each group, one cell stands if the offset supports a cell.
    pub fn groups(v: Cell, o: Cell) -> Vec<Vec<Cell>> {
        let far = o.iter().map(|part| part.abs()).max().unwrap();
        let mut groups = vec![vec![plus(v, o)]];
        for j in 1..far {
            let low = o.map(|part| (part * j).div_euclid(far));
            let high = o.map(|part| -(-part * j).div_euclid(far));
            let corner = |bits: usize| {
                let part = |axis: usize| {
                    if bits >> axis & 1 == 1 {
                        high[axis]
                    } else {
                        low[axis]
                    }
                };
                plus(v, [part(0), part(1), part(2)])
            };
            groups.push((0..8).map(corner).collect());
        }
        groups
    }

    pub fn is_supported(&self, v: Cell, k: usize, stands: impl Fn(Cell) -> bool) -> bool {
        let carries = |o: &Cell| {
            let mut groups = Plain::groups(v, *o).into_iter();
            stands(plus(v, *o)) && groups.all(|group| group.iter().any(|&cell| stands(cell)))
        };
        self.stands_on_bed(v, k) || self.leans[k].iter().any(carries)
    }
}

pub fn is_primitive([x, y, z]: Cell) -> bool {
    let divides = |by: i32| x % by == 0 && y % by == 0 && z % by == 0;
    [x, y, z] != [0; 3] && !(2..=7).any(divides)
}

pub fn unit(tilt_rad: f64, around_rad: f64) -> [f64; 3] {
    let (sin, cos) = tilt_rad.sin_cos();
    [sin * around_rad.cos(), sin * around_rad.sin(), cos]
}

pub fn ring_directions(knots: &[[f64; 2]], tilt_max_rad: f64) -> Vec<[f64; 3]> {
    let head = HeadProfile::new(knots).unwrap();
    let all = directions(tilt_max_rad, head.free_tilt_rad());
    all.iter().map(|&n| n.into()).collect()
}

/// Plausible machines, some with few directions, any of them, or joints that forbid much.
pub fn random_setting(random: &mut Pcg64Mcg) -> Setting {
    let heads: [&[[f64; 2]]; 4] = [
        &[[0.0, 0.4], [3.5, 3.5], [30.0, 3.5]],
        &[[0.0, 0.4], [3.0, 1.5], [3.0, 4.0], [20.0, 4.0]],
        &[[0.0, 0.8], [2.0, 5.0], [30.0, 6.0]],
        &[[0.0, 0.8], [20.0, 12.35], [20.0, 22.0], [70.0, 22.0]],
    ];
    let semis = [[0.9, 0.9], [0.9, 0.9], [2.2, 0.9], [1.5, 2.9]];
    let knots = heads[random.random_range(0..heads.len())].to_vec();
    let tilt_max_rad = [30.0f64, 60.0, 90.0][random.random_range(0..3)].to_radians();
    let mut all = ring_directions(&knots, tilt_max_rad);
    all.push([0.0, 0.0, -1.0]);
    for _ in 0..2 {
        all.push(unit(
            random.random_range(0.0..1.8),
            random.random_range(0.0..TAU),
        ));
    }
    let opposed = random.random_range(0..3) > 0;
    if opposed {
        let (tilt, turn) = (random.random_range(0.6..1.2), random.random_range(0.0..0.5));
        all = (0..4)
            .map(|k| unit(tilt, turn + f64::from(k) * TAU / 4.0))
            .collect();
        all.push([0.0, 0.0, 1.0]);
    }
    let few = (0..random.random_range(2..8)).fold(1, |few: u128, _| {
        few | 1 << random.random_range(0..all.len())
    });
    Setting {
        voxel_mm: 2.0,
        knots,
        self_support_rad: [30.0f64, 45.0, 60.0, 75.0][random.random_range(0..4)].to_radians(),
        semi_mm: semis[random.random_range(0..4)],
        directions: all,
        usable: if random.random_range(0..3) > 0 && !opposed {
            few
        } else {
            !0
        },
        one_in: [1, 2, 3, 8][random.random_range(0..4)],
    }
}

/// A hook, a cavity, a table with stubs or nothing to begin with, grown to at most 16 cells; some beside obstacles.
pub fn random_shape(random: &mut Pcg64Mcg, kind: u32) -> Shape {
    let size = [4, 4, 5];
    let seed = Shape::of(size, |[x, y, z]| match kind % 4 {
        0 => [x, y, z] == [1, 1, 0],
        1 => y == 1 && (x == 0 && z < 4 || z == 3 && x < 3 || x == 2 && z == 2),
        2 => y == 1 && (x == 0 || x == 3 || z == 0 || z == 3) && z < 4,
        _ => z == 2 && x < 3 && y < 3 || [x, y] == [1, 1] && z < 2 || z == 1 && [x, y] == [0, 2],
    });
    let mut cells = seed.cells;
    let most = random.random_range(cells.len().max(9)..=16);
    while cells.len() < most {
        let mut cell = cells[random.random_range(0..cells.len())];
        cell[random.random_range(0..3)] += if random.random_range(0..2) == 0 {
            1
        } else {
            -1
        };
        let is_inside = (0..3).all(|axis| (0..size[axis] as i32).contains(&cell[axis]));
        if is_inside && !cells.contains(&cell) {
            cells.push(cell);
        }
    }
    let mut shape = Shape::of(size, |cell| cells.contains(&cell));
    if random.random_range(0..4) == 0 {
        let any = [3, random.random_range(0..4), random.random_range(0..5)];
        shape.stands = Shape::of(size, |cell| cell == any && !cells.contains(&cell)).cells;
    }
    shape
}
