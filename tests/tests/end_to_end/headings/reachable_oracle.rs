//! Oracle of what is reachable: a grid of configurations (x, y, phi), the method's own way, on a
//! small shape with corners, a reflex vertex, a narrowing passage and a hole.
//!
//! Shares no code with the planner: a placement is inside where no edge meets the ellipse (a
//! quadratic in the edge's parameter) and its centre is inside (even-odd).

use headway::geometry::Point2;
use headway::geometry::aperture::Aperture;
use headway::geometry::edge_index::EdgeIndex;
use headway::geometry::polygon::{Region, Ring};
use headway::plan::headings::headings_table::{HeadingsRequest, headings_table};
use headway::plan::outline::reachable::covering_configuration;
use headway::settings::{HeadingLaw, PassMode};

type Pair = [f64; 2];

const A: f64 = 0.6;
const B: f64 = 0.2;
/// Grid steps; a configuration lies within half of each of a grid point.
const STEP_MM: f64 = 0.025;
const HEADINGS: usize = 72;
/// How far a point of the aperture moves over half a grid cell, in all three directions.
const CELL_MM: f64 =
    STEP_MM * std::f64::consts::FRAC_1_SQRT_2 + A * std::f64::consts::PI / HEADINGS as f64 / 2.0;

fn rings() -> Vec<Vec<Pair>> {
    vec![
        vec![
            [0.0, 0.0],
            [2.6, 0.0],
            [4.6, 0.57],
            [4.6, 0.63],
            [2.4, 1.1],
            [1.9, 2.6],
            [0.9, 1.5],
            [0.0, 2.2],
        ],
        vec![[1.2, 0.9], [1.35, 1.0], [1.4, 0.8]],
    ]
}

fn edges() -> Vec<[Pair; 2]> {
    let pairs = |ring: Vec<Pair>| {
        (0..ring.len())
            .map(move |i| [ring[i], ring[(i + 1) % ring.len()]])
            .collect::<Vec<_>>()
    };
    rings().into_iter().flat_map(pairs).collect()
}

fn contains(edges: &[[Pair; 2]], p: Pair) -> bool {
    let mut inside = false;
    for [q, r] in edges {
        if (q[1] > p[1]) != (r[1] > p[1]) {
            inside ^= p[0] < q[0] + (p[1] - q[1]) / (r[1] - q[1]) * (r[0] - q[0]);
        }
    }
    inside
}

/// The ellipse's equation less 1, at q from the centre, for semi-axes a, b: negative inside.
fn ellipse(q: Pair, (sin, cos): (f64, f64), a: f64, b: f64) -> f64 {
    let (u, v) = (q[0] * cos + q[1] * sin, q[1] * cos - q[0] * sin);
    (u / a).powi(2) + (v / b).powi(2) - 1.0
}

/// True where the edge meets the open ellipse: the least value of the quadratic along it.
fn meets(edge: &[Pair; 2], center: Pair, turn: (f64, f64), a: f64, b: f64) -> bool {
    let at = |t: f64| {
        let x = |k: usize| edge[0][k] + t * (edge[1][k] - edge[0][k]) - center[k];
        ellipse([x(0), x(1)], turn, a, b)
    };
    let (f0, f1, fm) = (at(0.0), at(1.0), at(0.5));
    // f = f0 + s t + c t² through the three values.
    let c = 2.0 * (f0 + f1 - 2.0 * fm);
    let s = f1 - f0 - c;
    let t = if c > 0.0 {
        (-s / (2.0 * c)).clamp(0.0, 1.0)
    } else {
        0.0
    };
    f0.min(f1).min(at(t)) < 0.0
}

/// All grid configurations whose ellipse of semi-axes A - shrink, B - shrink lies inside.
fn inside_grid(edges: &[[Pair; 2]], shrink: f64) -> Vec<(Pair, (f64, f64))> {
    let mut found = Vec::new();
    for i in 0..(4.6 / STEP_MM) as usize {
        for j in 0..(2.6 / STEP_MM) as usize {
            let center = [(i as f64 + 0.5) * STEP_MM, (j as f64 + 0.5) * STEP_MM];
            if !contains(edges, center) {
                continue;
            }
            for k in 0..HEADINGS {
                let turn = (std::f64::consts::PI * k as f64 / HEADINGS as f64).sin_cos();
                if !edges
                    .iter()
                    .any(|e| meets(e, center, turn, A - shrink, B - shrink))
                {
                    found.push((center, turn));
                }
            }
        }
    }
    found
}

/// Which raster points the configurations cover, with semi-axes A + grow, B + grow.
fn covered(configurations: &[(Pair, (f64, f64))], points: &[Pair], grow: f64) -> Vec<bool> {
    let reach = A + grow;
    points
        .iter()
        .map(|p| {
            configurations.iter().any(|(c, turn)| {
                let q = [p[0] - c[0], p[1] - c[1]];
                q[0].abs() < reach
                    && q[1].abs() < reach
                    && ellipse(q, *turn, A + grow, B + grow) <= 0.0
            })
        })
        .collect()
}

fn region() -> Region {
    let ring = |points: &Vec<Pair>| Ring {
        points: points.iter().map(|p| Point2::from(*p)).collect(),
    };
    Region {
        exterior: ring(&rings()[0]),
        holes: rings()[1..].iter().map(ring).collect(),
    }
}

/// Goal: `covering_configuration` and the table's `reachable` are what the grid of configurations says, but
/// for one cell along the border. Method: what a grid configuration inside covers is reachable;
/// what none covers that is shrunk by a cell where it must be inside and grown by one where it
/// must cover, is not.
#[test]
fn reachable_agrees_with_the_grid() {
    let edges = edges();
    // A raster over all, and a finer one over the passage that gets too narrow.
    let mut points = Vec::new();
    for (columns, rows, from, step) in [(184, 104, [0.0, 0.0], 0.025), (110, 60, [3.5, 0.3], 0.01)]
    {
        for i in 0..columns {
            for j in 0..rows {
                let p = [
                    from[0] + (f64::from(i) + 0.37) * step,
                    from[1] + (f64::from(j) + 0.41) * step,
                ];
                if contains(&edges, p) {
                    points.push(p);
                }
            }
        }
    }
    let exact = inside_grid(&edges, 0.0);
    let loose = inside_grid(&edges, CELL_MM);
    let surely = covered(&exact, &points, 0.0);
    let perhaps = covered(&loose, &points, CELL_MM);
    let aperture = Aperture::Ellipse {
        major_mm: A,
        minor_mm: B,
    };
    let index = EdgeIndex::of_region(&region(), A);
    let (mut yes, mut no, mut border, mut missed) = (0, 0, 0, 0);
    for (k, p) in points.iter().enumerate() {
        let found = covering_configuration(&aperture, Point2::from(*p), &index).is_some();
        if surely[k] {
            yes += 1;
            missed += u32::from(!found);
        } else if perhaps[k] {
            border += 1;
        } else {
            no += 1;
            assert!(!found, "{p:?} cannot be reached");
        }
    }
    println!(
        "{} configurations; {yes} surely reachable, {missed} missed, {no} not, {border} border",
        exact.len()
    );
    assert!(yes > 3000 && no > 50, "{yes} {no}");
    assert_eq!(missed, 0);

    let request = HeadingsRequest {
        aperture,
        spacing_mm: 0.05,
        pass: PassMode::Two,
        law: HeadingLaw::Tangent,
    };
    let rows = headings_table(&region(), &request);
    let samples: Vec<Pair> = rows.iter().map(|r| [r.point.x, r.point.y]).collect();
    let perhaps = covered(&loose, &samples, CELL_MM);
    let (mut reached, mut not) = (0, 0);
    for (row, perhaps) in rows.iter().zip(perhaps) {
        if row.reached.is_some() {
            reached += 1;
            assert!(perhaps, "{}: reachable, but nothing near it is", row.point);
        } else {
            not += 1;
        }
    }
    println!("{} samples, {reached} reached, {not} not", rows.len());
    assert!(reached > 100 && not > 10);
}
