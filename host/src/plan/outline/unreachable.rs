//! Boundary that no placement inside can touch: F(p) is empty there (docs/design/heading-law.md).
//!
//! Input: a region about its local origin, its edge index, the aperture. Output: intervals of the boundary with their
//! length. Each edge is checked in parts of about half the minor semi-axis, and the ends of an interval are found by
//! bisection to `END`, of the aperture's unit; an interval within one such part is not found.

use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::plan::feasible::is_touchable;
use crate::plan::outline::trimmed_outline::is_beyond_reach;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How well the ends of a run are known, mm.
const END: f64 = 1e-3;

/// A run along one edge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnreachableRun {
    /// Where it begins, in the edge's direction.
    #[serde(with = "crate::geometry::as_numbers")]
    pub from: Point2,
    /// Where it ends.
    #[serde(with = "crate::geometry::as_numbers")]
    pub to: Point2,
}

impl UnreachableRun {
    /// Its length.
    pub fn length_mm(&self) -> f64 {
        (self.to - self.from).norm()
    }
}

/// All intervals, in the order of the region's edges; `hull` has the edges of its trimmed outline
/// (or its own).
pub fn unreachable_runs(
    aperture: &Aperture,
    walls: &EdgeIndex,
    hull: &EdgeIndex,
) -> Vec<UnreachableRun> {
    let piece_mm = aperture.minor_mm() / 2.0;
    walls
        .edges()
        .par_iter()
        .flat_map_iter(|edge| edge_runs(aperture, [walls, hull], edge, piece_mm))
        .collect()
}

fn edge_runs(
    aperture: &Aperture,
    [walls, hull]: [&EdgeIndex; 2],
    edge: &Edge,
    piece_mm: f64,
) -> Vec<UnreachableRun> {
    let length_mm = edge.length_mm();
    if length_mm <= 0.0 {
        return Vec::new();
    }
    let normal = edge.normal();
    let at = |t: f64| edge.a + (edge.b - edge.a) * t;
    let is_out = |t: f64| {
        is_beyond_reach(hull, at(t), aperture) || !is_touchable(aperture, walls, at(t), normal)
    };
    let pieces = (length_mm / piece_mm).ceil().max(1.0) as usize;
    let end_share = END * aperture.unit_mm() / length_mm;
    let middle = |k: usize| (k as f64 + 0.5) / pieces as f64;
    let mut runs = Vec::new();
    let mut start: Option<f64> = None;
    let mut before = (0.0, false);
    for k in 0..pieces {
        let t = middle(k);
        let out = is_out(t);
        if out && start.is_none() {
            let begins = if k == 0 {
                0.0
            } else {
                border(&is_out, [before.0, t], end_share)
            };
            start = Some(begins);
        }
        if let (false, Some(begins)) = (out, start) {
            let ends = border(&is_out, [t, before.0], end_share);
            runs.push(UnreachableRun {
                from: at(begins),
                to: at(ends),
            });
            start = None;
        }
        before = (t, out);
    }
    if let Some(begins) = start {
        runs.push(UnreachableRun {
            from: at(begins),
            to: at(1.0),
        });
    }
    runs
}

/// The place between `inside` (reachable) and `outside` (not) where that changes.
fn border(is_out: &impl Fn(f64) -> bool, ends: [f64; 2], end_share: f64) -> f64 {
    let [mut inside, mut outside] = ends;
    while (outside - inside).abs() > end_share {
        let t = (inside + outside) / 2.0;
        if is_out(t) {
            outside = t;
        } else {
            inside = t;
        }
    }
    (inside + outside) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::{ELLIPSE, SQUARE, walls};

    fn total_mm(walls: &EdgeIndex, major_mm: f64, minor_mm: f64) -> f64 {
        let aperture = Aperture::Ellipse { major_mm, minor_mm };
        unreachable_runs(&aperture, walls, walls)
            .iter()
            .map(UnreachableRun::length_mm)
            .sum()
    }

    /// A disk of radius R in a square corner touches no nearer than R to the vertex.
    #[test]
    fn round_nozzle_in_square_corners() {
        let square = walls(&[SQUARE]);
        let found = total_mm(&square, 0.4, 0.4);
        // Eight ends, each to END of 5 b.
        assert!((found - 8.0 * 0.4).abs() < 8.0 * END * 5.0 * 0.4, "{found}");
        // An ellipse reaches farther in: at most its minor axis from the vertex.
        let found = total_mm(&square, 0.6, 0.2);
        assert!(
            found > 0.1 && found < 8.0 * 0.2 + 8.0 * END * 5.0 * 0.2,
            "{found}"
        );
    }

    /// A slot narrower than the aperture's minor axis is out of reach, all of it.
    #[test]
    fn narrow_slots_are_out_of_reach() {
        let slot = walls(&[&[
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 4.0],
            [18.0, 4.0],
            [18.0, 4.3],
            [10.0, 4.3],
            [10.0, 10.0],
            [0.0, 10.0],
        ]]);
        let runs = unreachable_runs(&ELLIPSE, &slot, &slot);
        let in_slot: f64 = runs
            .iter()
            .filter(|run| run.from.x >= 10.0 - 1e-9 && run.to.x >= 10.0 - 1e-9)
            .filter(|run| (run.from.y - 4.15).abs() <= 0.15 + 1e-9)
            .map(UnreachableRun::length_mm)
            .sum();
        // Two walls of 8 mm and the end of 0.3 mm; the mouth may be touched from outside.
        assert!(in_slot > 15.5 && in_slot < 16.3 + 0.01, "{in_slot}");
    }
}
