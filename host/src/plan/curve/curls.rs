//! Curls: places where the tip runs once around a small circle and goes on.
//!
//! They are left of moves out and back to ground that the beads beside it have come to cover. In: the control points of
//! a curve, mm and rad. Out: those that are left without its curls. Whether it is better for that is the objective's
//! to say.

use crate::geometry::Point2;
use crate::geometry::edge_index::Edge;
use crate::geometry::plane_curve::{PlaneControl, curve_at};
use crate::geometry::tangle::crosses;

/// Length of a curl, least and most, against a: a corner that is turned at has a shorter one, and a longer one goes around
/// ground of its own.
const LENGTH_SHARES: [f64; 2] = [0.4, 2.5];
/// Most that the headings differ where the tip comes back, rad: else the curl is a turn of the nozzle.
const HEADING_MAX_RAD: f64 = 0.3;
/// Chords of a span.
const CHORDS: usize = 2;

/// Numbers of the control points without those of curls; `None` if there are none.
pub fn without_curls(control: &[PlaneControl], major_mm: f64) -> Option<Vec<usize>> {
    let chords = Chords::of(control);
    let lengths_mm = LENGTH_SHARES.map(|share| share * major_mm);
    let mut stays = vec![true; control.len()];
    let mut from = 0;
    while from < chords.edges.len() {
        let end = chords.end_of_curl(from, lengths_mm);
        if let Some(end) = end {
            stays[from / CHORDS + 1..=end / CHORDS].fill(false);
        }
        from = end.unwrap_or(from) + 1;
    }
    let kept = (0..control.len()).filter(|&i| stays[i]);
    stays.contains(&false).then(|| kept.collect())
}

/// A curve as chords.
struct Chords {
    edges: Vec<Edge>,
    headings_rad: Vec<f64>,
}

impl Chords {
    fn of(control: &[PlaneControl]) -> Chords {
        let count = CHORDS * control.len().saturating_sub(1);
        let share = |i: usize| (i % CHORDS) as f64 / CHORDS as f64;
        let poses: Vec<PlaneControl> = (0..count)
            .map(|i| curve_at(control, i / CHORDS, share(i)))
            .collect();
        let point = |[x, y, _]: PlaneControl| Point2::new(x, y);
        let edge = |ends: &[PlaneControl]| Edge {
            a: point(ends[0]),
            b: point(ends[1]),
        };
        Chords {
            edges: poses.windows(2).map(edge).collect(),
            headings_rad: poses.iter().map(|pose| pose[2]).collect(),
        }
    }

    /// The last chord that crosses this one after a length between these, where the nozzle stands much as before.
    fn end_of_curl(&self, from: usize, [least_mm, most_mm]: [f64; 2]) -> Option<usize> {
        let mut length_mm = 0.0;
        let mut end = None;
        for (i, edge) in self.edges.iter().enumerate().skip(from + 1) {
            if length_mm > most_mm {
                break;
            }
            if length_mm >= least_mm && crosses(&self.edges[from], edge) {
                end = Some(i);
            }
            length_mm += (edge.b - edge.a).norm();
        }
        let turned_rad = |end: usize| self.headings_rad[end] - self.headings_rad[from];
        end.filter(|&end| turned_rad(end).abs() <= HEADING_MAX_RAD)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAJOR_MM: f64 = 0.6;

    /// A straight line along x with a circle of this radius above x = 2 mm, in which the heading turns by `turned_rad`.
    fn line_with_circle(radius_mm: f64, turned_rad: f64) -> Vec<PlaneControl> {
        let line = |from: usize| (from..from + 10).map(|i| [0.2 * i as f64, 0.0, 1.0]);
        let circle = (0..12).map(|i| {
            let share = i as f64 / 11.0;
            let (sin, cos) = (share * std::f64::consts::TAU).sin_cos();
            [
                2.0 + radius_mm * sin,
                radius_mm * (1.0 - cos),
                1.0 + share * turned_rad,
            ]
        });
        let after = line(11).map(|[x, y, heading]| [x, y, heading + turned_rad]);
        line(0).chain(circle).chain(after).collect()
    }

    /// Goal: a curl goes, and nothing else. Method: a line with circles of several sizes; what is left is a line.
    #[test]
    fn a_small_circle_is_left_out() {
        let control = line_with_circle(0.12, 0.1);
        let kept = without_curls(&control, MAJOR_MM).expect("a curl");
        let left: Vec<PlaneControl> = kept.iter().map(|&i| control[i]).collect();
        assert!(kept.len() >= 20, "the line stays: {}", kept.len());
        assert!(left.iter().all(|[_, y, _]| *y < 0.05), "{left:?}");
        assert!(left.windows(2).all(|w| w[0][0] < w[1][0] + 0.1));
        // A corner's turn, a way around ground of its own, a turn of the nozzle; curves too short to have one.
        assert_eq!(without_curls(&line_with_circle(0.02, 0.1), MAJOR_MM), None);
        assert_eq!(without_curls(&line_with_circle(0.4, 0.1), MAJOR_MM), None);
        assert_eq!(without_curls(&line_with_circle(0.12, 3.1), MAJOR_MM), None);
        assert_eq!(without_curls(&control[..1], MAJOR_MM), None);
        assert_eq!(without_curls(&[], MAJOR_MM), None);
    }
}
