//! F(p) of slots, rectangles and polygons against brute force on the example shapes.
//!
//! Goal: what F(p) offers lies inside and touches p; what brute force finds, F(p) has. Method: an
//! outline of points that the oracle draws itself, placed and looked at by even-odd rule.

use headway::geometry::aperture::Aperture;
use headway::geometry::clearance::Configuration;
use headway::geometry::edge_index::EdgeIndex;
use headway::geometry::{Point2, Vector2};
use headway::plan::feasible::feasible_angles;
use headway::settings::aperture_text::parse_aperture;
use headway_tests::dense_search::holds;
use headway_tests::layer_oracle::{OracleAperture, Rings};
use headway_tests::outlines::{example, region};
use rayon::prelude::*;

/// The oracle's own arcs: a sample may miss the lowest point by R (pi/192)²/2 in height.
const LIFT_MM: f64 = 1e-4;
/// Step of the angles tried; half a step off, so that no flat side lies on the wall exactly.
const STEP_DEG: f64 = 1.0;

/// One aperture as the planner and as the oracle have it.
struct Case {
    aperture: Aperture,
    oracle: OracleAperture,
    outline: Vec<[f64; 2]>,
}

fn cases() -> Vec<(&'static str, Case)> {
    let drop = vec![
        [-0.35, -0.25],
        [0.1, -0.3],
        [0.6, 0.0],
        [0.1, 0.3],
        [-0.35, 0.25],
    ];
    let box_of = |x: f64, y: f64| vec![[x, -y], [x, y], [-x, y], [-x, -y]];
    [
        ("stadium:1.2x0.4", vec![[0.4, 0.0], [-0.4, 0.0]], 0.2),
        ("rect:1.2x0.4x0.1", box_of(0.5, 0.1), 0.1),
        ("rect:1.2x0.4x0", box_of(0.6, 0.2), 0.0),
        (
            "polygon:[[-0.35,-0.25],[0.1,-0.3],[0.6,0],[0.1,0.3],[-0.35,0.25]]",
            drop,
            0.0,
        ),
    ]
    .into_iter()
    .map(|(text, corners, radius)| {
        let oracle = OracleAperture::Grown(corners, radius);
        let case = Case {
            aperture: parse_aperture(text).expect(text),
            outline: oracle.outline(),
            oracle,
        };
        (text, case)
    })
    .collect()
}

impl Case {
    fn placed(&self, at: Configuration) -> impl Iterator<Item = [f64; 2]> + '_ {
        let (sin, cos) = at.heading_rad.sin_cos();
        self.outline.iter().map(move |[u, v]| {
            [
                at.center.x + u * cos - v * sin,
                at.center.y + u * sin + v * cos,
            ]
        })
    }

    /// How far the placed outline leaves the part or a wall's corner is in it: 0 where neither.
    fn outside_mm(&self, rings: &Rings, walls: &EdgeIndex, at: Configuration) -> f64 {
        let mut worst: f64 = 0.0;
        for p in self.placed(at) {
            if !holds(rings, p) {
                let near = |e: &headway::geometry::edge_index::Edge| {
                    (e.foot(Point2::from(p)) - Point2::from(p)).norm()
                };
                let distance = walls.edges().iter().map(near).fold(f64::MAX, f64::min);
                worst = worst.max(distance);
            }
        }
        let (sin, cos) = at.heading_rad.sin_cos();
        for corner in rings.iter().flatten() {
            let d = Point2::from(*corner) - at.center;
            // Shrunk towards the axis: a corner of the wall in contact is not in it.
            let shrunk = Vector2::new(d.x * cos + d.y * sin, d.y * cos - d.x * sin) * (1.0 + 1e-5);
            if self.oracle.contains(shrunk.x, shrunk.y) {
                worst = worst.max(1.0);
            }
        }
        worst
    }

    /// The placement whose lowest point stands on p, lifted a little.
    fn leaning(&self, p: Point2, normal: Vector2, alpha_rad: f64) -> Configuration {
        let heading_rad = normal.y.atan2(normal.x) + alpha_rad;
        let origin = Configuration {
            center: Point2::origin(),
            heading_rad,
        };
        let height = |q: &[f64; 2]| q[0] * normal.x + q[1] * normal.y;
        let lowest = self
            .placed(origin)
            .min_by(|a, b| height(a).total_cmp(&height(b)))
            .expect("points");
        Configuration {
            center: p - Vector2::from(lowest) + normal * LIFT_MM,
            heading_rad,
        }
    }
}

/// Checks one boundary point; returns whether it is reachable and whether brute force disagrees
/// with F(p) by no more than its own coarseness.
fn check(
    place: &str,
    case: &Case,
    rings: &Rings,
    walls: &EdgeIndex,
    number: usize,
) -> (bool, bool) {
    let edge = walls.edges()[number];
    let p = edge.a + (edge.b - edge.a) * (0.2 + 0.13 * (number % 5) as f64);
    let normal = edge.normal();
    let angles = feasible_angles(&case.aperture, walls, p, normal);
    let middles = angles
        .intervals()
        .iter()
        .map(|[low, high]| (low + high) / 2.0);
    let offered = angles.intervals().iter().flatten().copied().chain(middles);
    for alpha in offered {
        let at = angles.placement(&case.aperture, p, normal, alpha);
        let outside = case.outside_mm(rings, walls, at);
        assert!(
            outside < 1e-6,
            "{place} {p}: {outside} mm outside at {alpha}"
        );
        // It touches p: from p, a step out of the wall is not in it, a step in is.
        let (sin, cos) = at.heading_rad.sin_cos();
        let d = p + normal * 2e-6 - at.center;
        let grown = 1.0 - 1e-5;
        let (u, v) = (d.x * cos + d.y * sin, d.y * cos - d.x * sin);
        assert!(
            case.oracle.contains(u * grown, v * grown),
            "{place} {p}: no touch at {alpha}"
        );
    }
    let mut missed = false;
    let steps = (case.aperture.period_rad().to_degrees() / STEP_DEG).round() as i32;
    for k in 0..steps {
        let alpha = ((f64::from(k) + 0.5) * STEP_DEG).to_radians();
        let at = case.leaning(p, normal, alpha);
        if case.outside_mm(rings, walls, at) == 0.0 {
            missed |= !angles.contains_rad(alpha, STEP_DEG.to_radians());
        }
    }
    (!angles.is_empty(), missed)
}

#[test]
fn agrees_with_brute_force() {
    for name in ["u-part", "bracket", "taper", "letter"] {
        let rings = example(name);
        let walls = EdgeIndex::of_region(&region(&rings), 0.6);
        let count = walls.edges().len();
        for (text, case) in cases() {
            let place = format!("{name} {text}");
            let numbers: Vec<usize> = (0..count).step_by(count.div_ceil(30)).collect();
            let results: Vec<(bool, bool)> = numbers
                .par_iter()
                .map(|&number| check(&place, &case, &rings, &walls, number))
                .collect();
            let reached = results.iter().filter(|r| r.0).count();
            let missed = results.iter().filter(|r| r.1).count();
            println!(
                "{place}: {} points, {reached} reachable, {missed} missed",
                results.len()
            );
            assert!(reached * 3 > results.len(), "{place}");
            assert_eq!(missed, 0, "{place}");
        }
    }
}
