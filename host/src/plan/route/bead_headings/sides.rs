//! Ranges of headings, and the choice among several for each leg.
//!
//! In: for each leg the ranges that print its bead, relative to any period of the nozzle. Out: one range for each
//! leg, with its angle unwrapped, for the least sum of turns from range to range and of turns back on short legs
//! (shortest path).

use crate::geometry::aperture::wrapped_rad;

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

    /// The smallest range that contains both.
    pub fn hull(&self, other: &Range) -> Range {
        Range::new(
            self.low_rad.min(other.low_rad),
            self.high_rad.max(other.high_rad),
        )
    }

    /// Overlap of the ranges, rad; negative for their distance.
    pub fn overlap_rad(&self, other: &Range) -> f64 {
        self.high_rad.min(other.high_rad) - self.low_rad.max(other.low_rad)
    }
}

/// Headings of a leg: on its straight middle, at some distance from its corners, and close to them.
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

/// Cost of turning between the middles of ranges relative to turning from range to range.
const MIDDLE_SHARE: f64 = 0.05;
/// Cost of turning back on a leg without a straight middle, rad: the nozzle comes to rest there.
const BACK_RAD: f64 = 0.7;
/// Directions of the last turn.
const SIDES: usize = 2;

/// A state of the search: the choice of a leg, counted on, and the last direction of the nozzle's
/// turn.
#[derive(Clone, Copy, Debug)]
struct State {
    cost: f64,
    /// The state of the leg before.
    from: usize,
    /// By how much the middle of the range turns from there, rad.
    turn_rad: f64,
}

/// One choice for each leg, unwrapped along the passes from `start_rad`.
pub fn least_turning(choices: &[Vec<Choice>], start_rad: f64, period_rad: f64) -> Vec<Choice> {
    let Some(first) = choices.first() else {
        return Vec::new();
    };
    let at_start = first.iter().flat_map(|choice| {
        let turn_rad = wrapped_rad(choice.exact.middle_rad() - start_rad, period_rad);
        let state = State {
            cost: MIDDLE_SHARE * turn_rad.abs(),
            from: 0,
            turn_rad,
        };
        [state; SIDES]
    });
    let mut legs: Vec<Vec<State>> = vec![at_start.collect()];
    for pair in choices.windows(2) {
        let before = legs.last().map_or(&[][..], |before| before.as_slice());
        let next = next_states(before, &pair[0], &pair[1], period_rad);
        legs.push(next);
    }
    let last = legs.last().map_or(&[][..], |last| last.as_slice());
    let least = (0..last.len()).min_by(|a, b| last[*a].cost.total_cmp(&last[*b].cost));
    let mut state = least.unwrap_or(0);
    let mut picks = vec![(0, 0.0); choices.len()];
    for (leg, pick) in picks.iter_mut().enumerate().rev() {
        let of_leg = &legs[leg][state];
        *pick = (state / SIDES, of_leg.turn_rad);
        state = of_leg.from;
    }
    let mut at_rad = start_rad;
    let counted = choices
        .iter()
        .zip(&picks)
        .map(|(of_leg, (pick, turn_rad))| {
            let choice = of_leg[*pick];
            at_rad += turn_rad;
            choice.shifted(at_rad - choice.exact.middle_rad())
        });
    counted.collect()
}

/// The states of a leg, each with the cheapest path from those of the previous leg.
fn next_states(before: &[State], from: &[Choice], to: &[Choice], period_rad: f64) -> Vec<State> {
    let none = State {
        cost: f64::INFINITY,
        from: 0,
        turn_rad: 0.0,
    };
    let mut next = vec![none; to.len() * SIDES];
    for (state, came) in before.iter().enumerate() {
        let (choice, side) = (&from[state / SIDES], state % SIDES);
        let is_long = choice.exact != choice.far;
        for (pick, other) in to.iter().enumerate() {
            let middle_rad = choice.exact.middle_rad();
            let shorter_rad = wrapped_rad(other.exact.middle_rad() - middle_rad, period_rad);
            let longer_rad = shorter_rad - period_rad.copysign(shorter_rad);
            for turn_rad in [shorter_rad, longer_rad] {
                let there = other
                    .exact
                    .shifted(middle_rad + turn_rad - other.exact.middle_rad());
                let apart_rad = (-choice.exact.overlap_rad(&there)).max(0.0);
                let turns = usize::from(turn_rad < 0.0);
                let (new_side, back_rad) = match apart_rad > 0.0 {
                    true if turns != side && !is_long => (turns, BACK_RAD),
                    true => (turns, 0.0),
                    false => (side, 0.0),
                };
                let cost = came.cost + apart_rad + back_rad + MIDDLE_SHARE * turn_rad.abs();
                let best = &mut next[pick * SIDES + new_side];
                if cost < best.cost {
                    *best = State {
                        cost,
                        from: state,
                        turn_rad,
                    };
                }
            }
        }
    }
    next
}
