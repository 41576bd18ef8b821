//! A move of a file's axes -> short legs of the tip between which it is as good as straight.
//!
//! In: the places of all axes at the ends of a move (mm, degrees). Out: places in between, evenly by the axes, so
//! close that the tip's way, the tool axis and the heading are within tolerances of what is straight between them.

use super::{At, FileAxes, FilePose, SLOTS, TURNS_FROM};
use std::f64::consts::TAU;

/// How far the tip may be beside a straight leg, mm: as far as curves of files (G2, G5) become chords.
pub const LEG_TIP_MM: f64 = 1e-3;
/// The same of the tool axis and the heading, rad: 0.02°. Finer legs on straight ways of the tip would make corners of
/// what a program meant as a curve.
pub const LEG_TURN_RAD: f64 = 3.5e-4;
/// Most legs that a move becomes: a turn of 1000 mm radius in legs of 1 µm has 2,200.
pub const LEGS_MAX: usize = 1 << 13;

impl FileAxes {
    /// The places of a move behind its first one, its end among them.
    pub fn legs(&self, from: &At, to: &At) -> Vec<At> {
        let turns = (TURNS_FROM..SLOTS).any(|slot| from[slot] != to[slot]);
        let mut count = 1;
        while turns && count < LEGS_MAX && !self.is_straight(from, to, count) {
            count *= 2;
        }
        (1..=count)
            .map(|k| match k == count {
                true => *to,
                false => between(from, to, k as f64 / count as f64),
            })
            .collect()
    }

    fn is_straight(&self, from: &At, to: &At, count: usize) -> bool {
        let pose = |share: f64| self.pose(&between(from, to, share / count as f64));
        let mut before = pose(0.0);
        (0..count).all(|k| {
            let (middle, after) = (pose(k as f64 + 0.5), pose(k as f64 + 1.0));
            let is_near = middle.is_between(&before, &after, self.heading.is_some());
            before = after;
            is_near
        })
    }
}

impl FilePose {
    fn is_between(&self, before: &FilePose, after: &FilePose, has_heading: bool) -> bool {
        let beside_mm = (self.tip_mm - 0.5 * (before.tip_mm + after.tip_mm)).norm();
        let meant = (before.axis.into_inner() + after.axis.into_inner()).normalize();
        let beside_rad = (self.axis.into_inner() - meant).norm();
        let near = |to: f64| to - TAU * ((to - self.heading_rad) / TAU).round();
        let heading_rad = 0.5 * (near(before.heading_rad) + near(after.heading_rad));
        let turned_rad = (self.heading_rad - heading_rad).abs();
        // A half turn or more between neighbours is no leg, whatever its middle is.
        let is_short = before.axis.dot(&after.axis) > 0.5;
        is_short
            && beside_mm <= LEG_TIP_MM
            && beside_rad <= LEG_TURN_RAD
            && (!has_heading || turned_rad <= LEG_TURN_RAD)
    }
}

fn between(from: &At, to: &At, share: f64) -> At {
    std::array::from_fn(|slot| from[slot] + share * (to[slot] - from[slot]))
}
