//! Waypoints at nearly the same position -> one waypoint.
//!
//! Published runs have neighbours some micrometres apart whose tool axes differ by degrees, where two
//! parts of a run were joined. A curve through both would have to turn the axis over almost no distance,
//! and overshoots. In: the waypoints (mm, input coordinates). Out: the waypoints with each such group
//! replaced by its mean, and the number removed. Positions that are the same to [`SAME_PLACE_MM`] are
//! kept: there the head is meant to turn in place.

use super::waypoints::{SAME_PLACE_MM, Waypoint};
use nalgebra::{Point3, Unit, Vector3};

/// Share of the usual spacing below which two waypoints are near.
const NEAR_SHARE: f64 = 0.05;
/// And no further apart than this, mm: below what a bead can show, so that a run which is dense only
/// where it bends loses nothing.
const NEAR_MAX_MM: f64 = 0.02;
/// Largest difference of two axes that are still meant to be the same, rad: 10°, more than the
/// error at a junction of two parts of a run, less than an intended difference.
const NEAR_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;

/// Chords of the usual length that make a jump, from how many chords on one is usual, and the least jump.
const GAP_CHORDS: f64 = 6.0;
const GAP_CHORDS_MIN: usize = 16;
const GAP_LEAST_MM: f64 = 2.0;

/// The waypoints with near ones made one; how many are fewer, and how near, mm, counts as one.
pub(super) fn joined(points: Vec<Waypoint>) -> (Vec<Waypoint>, usize, f64) {
    let near_mm = near_mm(&points);
    let count = points.len();
    let near = |first: &Waypoint, next: &Waypoint| {
        let apart_mm = (next.tip_mm - first.tip_mm).norm();
        (SAME_PLACE_MM..near_mm).contains(&apart_mm) && first.axis.angle(&next.axis) < NEAR_RAD
    };
    let mut kept: Vec<Waypoint> = Vec::with_capacity(count);
    let mut rest = points.as_slice();
    while let [first, following @ ..] = rest {
        let group = 1 + following
            .iter()
            .take_while(|next| near(first, next))
            .count();
        kept.push(middle(&rest[..group]));
        rest = &rest[group..];
    }
    // A run has two waypoints at least.
    if kept.len() < 2 {
        return (points, 0, near_mm);
    }
    let fewer = count - kept.len();
    (kept, fewer, near_mm)
}

fn near_mm(points: &[Waypoint]) -> f64 {
    let (usual_mm, _) = usual_spacing_mm(points);
    (NEAR_SHARE * usual_mm).min(NEAR_MAX_MM)
}

/// The median distance of neighbours that differ, mm, and of how many pairs it is.
pub fn usual_spacing_mm(points: &[Waypoint]) -> (f64, usize) {
    let mut chords: Vec<f64> = points
        .windows(2)
        .map(|pair| (pair[1].tip_mm - pair[0].tip_mm).norm())
        .filter(|chord| *chord > SAME_PLACE_MM)
        .collect();
    chords.sort_by(f64::total_cmp);
    let median_mm = chords.get(chords.len() / 2).copied().unwrap_or(0.0);
    (median_mm, chords.len())
}

/// Default jump that ends a pass: many times the usual spacing, and no less than any spacing of a
/// print path.
pub fn usual_gap_mm(points: &[Waypoint]) -> f64 {
    let (usual_mm, chords) = usual_spacing_mm(points);
    // So few points do not define a usual spacing.
    if chords < GAP_CHORDS_MIN {
        return f64::INFINITY;
    }
    (GAP_CHORDS * usual_mm).max(GAP_LEAST_MM)
}

/// The mean of a group; of one waypoint itself.
fn middle(group: &[Waypoint]) -> Waypoint {
    let first = group[0];
    if group.len() == 1 {
        return first;
    }
    let share = 1.0 / group.len() as f64;
    let tip: Vector3<f64> = group.iter().map(|point| share * point.tip_mm.coords).sum();
    let axis: Vector3<f64> = group
        .iter()
        .map(|point| share * point.axis.into_inner())
        .sum();
    let headings: Option<f64> = group.iter().map(|point| point.heading_rad).sum();
    Waypoint {
        line: first.line,
        tip_mm: Point3::from(tip),
        axis: Unit::new_normalize(axis),
        heading_rad: headings.map(|sum| share * sum),
        ..first
    }
}

#[cfg(test)]
mod tests {
    use crate::input::ReadOptions;
    use crate::input::waypoints::{WaypointRun, read};

    fn run(text: &str) -> WaypointRun {
        read(text.as_bytes(), "run", &ReadOptions::default()).unwrap()
    }

    /// Found in a published run: 8 um of way for 4 degrees of axis.
    #[test]
    fn waypoints_that_all_but_share_a_place_become_one() {
        let near = run("0 0 0 0 0 1\n1 0 0 0 0 1\n1.008 0 0 .07 0 .9975\n2 0 0 .07 0 .9975\n");
        assert_eq!(near.points.len(), 3);
        let middle = near.points[1];
        assert!((middle.tip_mm.x - 1.004).abs() < 1e-12, "{middle:?}");
        assert!((middle.axis.x - 0.035).abs() < 1e-4, "{middle:?}");
        assert_eq!(middle.line, 2);
        assert!(near.notes[0].contains("0.020 mm"), "{:?}", near.notes);
    }

    /// A turn on the spot, axes that differ widely, and detail that is dense on purpose all stay.
    #[test]
    fn what_is_meant_stays() {
        for text in [
            "0 0 0 0 0 1\n1 0 0 0 0 1\n1 0 0 .1 0 .995\n2 0 0 .1 0 .995\n",
            "0 0 0 0 0 1\n1 0 0 0 0 1\n1.008 0 0 .7 0 .7\n2 0 0 .7 0 .7\n",
            "0 0 0 0 0 1\n.01 0 0 0 0 1\n.02 .01 0 0 0 1\n.03 .02 0 0 0 1\n",
            "0 0 0 0 0 1\n.001 0 0 0 0 1\n",
        ] {
            let lines = text.lines().count();
            assert_eq!(run(text).points.len(), lines, "{text}");
        }
    }
}
