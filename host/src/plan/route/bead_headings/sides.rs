//! Ranges of headings, and which of several each leg takes.
//!
//! In: for each leg the ranges that lay its bead, relative to any period of the nozzle. Out: one range a leg, its
//! angle counted on, so that the sum of turning from range to range is least (shortest path).

use crate::geometry::aperture::wrapped_rad;
use std::f64::consts::TAU;

/// A range of headings, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    pub low_rad: f64,
    pub high_rad: f64,
}

impl Range {
    pub fn new(low_rad: f64, high_rad: f64) -> Range {
        Range { low_rad, high_rad }
    }

    pub fn middle_rad(&self) -> f64 {
        0.5 * (self.low_rad + self.high_rad)
    }

    pub fn shifted(&self, by_rad: f64) -> Range {
        Range::new(self.low_rad + by_rad, self.high_rad + by_rad)
    }

    /// What holds both.
    pub fn hull(&self, other: &Range) -> Range {
        Range::new(
            self.low_rad.min(other.low_rad),
            self.high_rad.max(other.high_rad),
        )
    }

    /// How far the ranges overlap, rad; negative, how far they are apart.
    pub fn overlap_rad(&self, other: &Range) -> f64 {
        self.high_rad.min(other.high_rad) - self.low_rad.max(other.low_rad)
    }
}

/// Headings of a leg: on its straight middle, some way from its corners, and beside them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    pub exact: Range,
    pub far: Range,
    pub near: Range,
}

impl Choice {
    fn shifted(&self, by_rad: f64) -> Choice {
        Choice {
            exact: self.exact.shifted(by_rad),
            far: self.far.shifted(by_rad),
            near: self.near.shifted(by_rad),
        }
    }

    /// The same counted on from an angle.
    pub fn nearest_to(&self, angle_rad: f64, period_rad: f64) -> Choice {
        let turns = ((angle_rad - self.exact.middle_rad()) / period_rad).round();
        self.shifted(turns * period_rad)
    }
}

/// Turns to both sides that differ by less than twice this are alike, rad.
const ALIKE_RAD: f64 = 0.17;
/// What turning between the middles of ranges costs beside turning from range to range.
const MIDDLE_SHARE: f64 = 0.05;

/// The cost of going from one range to another one, in any period.
fn cost(from: &Choice, to: &Choice, period_rad: f64) -> f64 {
    let to = to.nearest_to(from.exact.middle_rad(), period_rad);
    let apart_rad = (-from.exact.overlap_rad(&to.exact)).max(0.0);
    let middles_rad = (from.exact.middle_rad() - to.exact.middle_rad()).abs();
    apart_rad + MIDDLE_SHARE * middles_rad
}

/// One choice a leg, counted on along the passes from `start_rad`.
pub fn least_turning(choices: &[Vec<Choice>], start_rad: f64, period_rad: f64) -> Vec<Choice> {
    let start = Range::new(start_rad, start_rad);
    let start = Choice {
        exact: start,
        far: start,
        near: start,
    };
    let at_start = |choice: &Choice| cost(&start, choice, period_rad);
    let Some(first) = choices.first() else {
        return Vec::new();
    };
    let mut sums: Vec<f64> = first.iter().map(at_start).collect();
    let mut came_from: Vec<Vec<usize>> = vec![vec![0; first.len()]];
    for pair in choices.windows(2) {
        let mut next = Vec::with_capacity(pair[1].len());
        let mut came = Vec::with_capacity(pair[1].len());
        for to in &pair[1] {
            let by = pair[0].iter().zip(&sums).enumerate();
            let by = by.map(|(i, (from, sum))| (i, sum + cost(from, to, period_rad)));
            let least = by.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0));
            came.push(least.0);
            next.push(least.1);
        }
        sums = next;
        came_from.push(came);
    }
    let least = sums.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
    let mut chosen = least.map_or(0, |(i, _)| i);
    let mut picks = vec![chosen; choices.len()];
    for leg in (1..choices.len()).rev() {
        chosen = came_from[leg][chosen];
        picks[leg - 1] = chosen;
    }
    let mut counted: Vec<Choice> = Vec::with_capacity(choices.len());
    let mut before: Option<(f64, f64)> = None;
    for (of_leg, pick) in choices.iter().zip(&picks) {
        let choice = of_leg[*pick];
        let own_rad = choice.exact.middle_rad();
        let to_rad = match before {
            Some((raw_rad, at_rad)) => at_rad + turn_rad(own_rad - raw_rad, period_rad),
            None => start_rad + wrapped_rad(own_rad - start_rad, period_rad),
        };
        before = Some((own_rad, to_rad));
        counted.push(choice.shifted(to_rad - own_rad));
    }
    counted
}

/// The turn of a nozzle of this period for a turn of the path: the shorter one; where both are about as long, to
/// the same side as the path, so that round a rectangle the nozzle turns on and on.
fn turn_rad(path_rad: f64, period_rad: f64) -> f64 {
    let shorter_rad = wrapped_rad(path_rad, period_rad);
    let path_rad = wrapped_rad(path_rad, TAU);
    let is_alike = shorter_rad.abs() > 0.5 * period_rad - ALIKE_RAD;
    match is_alike && path_rad.abs() < 0.5 * period_rad + ALIKE_RAD {
        true => path_rad,
        false => shorter_rad,
    }
}
