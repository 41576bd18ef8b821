//! Continuous refinement of a profile that is accurate to a bin.
//!
//! In: headings (rad), accurate to a bin. Out: the headings moved to the nearest minimum of the
//! cost (mm²). Newton's method over all together, then one by one.

use super::{BINS, ContactRun, lap_turn};
use rayon::prelude::*;

/// Rounds that move all headings together, and rounds that then try each by itself.
const NEWTON_ROUNDS: usize = 4;
const SEARCH_ROUNDS: usize = 2;
/// Headings move less and less far, by this from round to round.
const SHRINK: f64 = 0.6;

/// Moves the headings to the nearest minimum of the cost of placements and turning. First all
/// together: errors below a bin are spread along the run, where separate moves would stop half way.
/// Then each by itself, where the placements' costs are not smooth.
pub fn refine(run: &ContactRun, steps: &[f64], headings: &mut Vec<f64>) {
    let count = headings.len();
    let chain = Chain {
        steps,
        lap: if run.closed {
            lap_turn(headings, run.aperture.period_rad())
        } else {
            0.0
        },
        closed: run.closed,
        count,
    };
    // What each contact's placement costs at its heading; the neighbours have no effect on it.
    let mut placed: Vec<f64> = (0..count)
        .into_par_iter()
        .map(|i| run.place(i, headings[i]).cost)
        .collect();
    let mut width = std::f64::consts::PI / BINS as f64;
    for round in 0..NEWTON_ROUNDS {
        let pin = round * count / NEWTON_ROUNDS;
        together(run, &chain, pin, width, headings, &mut placed);
        width *= SHRINK;
    }
    for _ in 0..SEARCH_ROUNDS {
        one_by_one(run, &chain, width, headings, &mut placed);
        width *= SHRINK;
    }
}

/// The run as a chain of headings that turning ties together.
struct Chain<'a> {
    steps: &'a [f64],
    /// Turn of a closed run over a lap.
    lap: f64,
    closed: bool,
    count: usize,
}

impl Chain<'_> {
    /// The neighbours of contact `i`, as headings unwrapped about it, with the steps to them.
    fn beside(&self, headings: &[f64], i: usize) -> [Option<(f64, f64)>; 2] {
        let count = self.count;
        let before = match i {
            0 if self.closed => Some((headings[count - 1] - self.lap, self.steps[count - 1])),
            0 => None,
            _ => Some((headings[i - 1], self.steps[i - 1])),
        };
        let after = match i + 1 {
            n if n < count => Some((headings[n], self.steps[i])),
            _ if self.closed => Some((headings[0] + self.lap, self.steps[i])),
            _ => None,
        };
        [before, after]
    }
}

/// What turning to the neighbours costs at a heading.
fn turn_cost(beside: &[Option<(f64, f64)>; 2], heading: f64) -> f64 {
    let beside = beside.iter().flatten();
    beside
        .map(|(other, step)| (heading - other).powi(2) / step)
        .sum()
}

/// A Newton step for all headings, each by at most `width`; on a closed run `pin` stays.
fn together(
    run: &ContactRun,
    chain: &Chain,
    pin: usize,
    width: f64,
    headings: &mut [f64],
    placed: &mut [f64],
) {
    let count = chain.count;
    let probe = 0.5 * width;
    // Slope and curvature of the placement's cost.
    let slopes: Vec<[f64; 2]> = (0..count)
        .into_par_iter()
        .map(|i| {
            let [low, high] = [-probe, probe].map(|by| run.place(i, headings[i] + by).cost);
            let curvature = (low - 2.0 * placed[i] + high) / (probe * probe);
            [0.5 * (high - low) / probe, curvature.max(0.0)]
        })
        .collect();
    let (from, unknown) = if chain.closed {
        (pin + 1, count - 1)
    } else {
        (0, count)
    };
    // Diagonal, right side, and the tie to the next one.
    let mut rows: Vec<[f64; 3]> = Vec::with_capacity(unknown);
    for k in 0..unknown {
        let i = (from + k) % count;
        let beside = chain.beside(headings, i);
        let [slope, curvature] = slopes[i];
        let (mut diagonal, mut right) = (curvature + 1e-9, -slope);
        for (other, step) in beside.iter().flatten() {
            let tie = 2.0 / step;
            diagonal += tie;
            right += tie * (other - headings[i]);
        }
        let tie = beside[1].map_or(0.0, |(_, step)| 2.0 / step);
        rows.push([diagonal, right, tie]);
    }
    for k in 1..unknown {
        let [diagonal, right, tie] = rows[k - 1];
        rows[k][0] -= tie * tie / diagonal;
        rows[k][1] += tie * right / diagonal;
    }
    let mut moved = headings.to_vec();
    let mut next = 0.0;
    for k in (0..unknown).rev() {
        let [diagonal, right, tie] = rows[k];
        next = (right + tie * next) / diagonal;
        moved[(from + k) % count] += next.clamp(-width, width);
    }
    let updated: Vec<(f64, f64)> = (0..count)
        .into_par_iter()
        .map(|i| {
            let (own, there) = (headings[i], run.place(i, moved[i]).cost);
            let beside = chain.beside(&moved, i);
            let cost = |heading: f64, placed: f64| turn_cost(&beside, heading) + placed;
            if cost(moved[i], there) <= cost(own, placed[i]) {
                (moved[i], there)
            } else {
                (own, placed[i])
            }
        })
        .collect();
    for (i, (heading, cost)) in updated.into_iter().enumerate() {
        (headings[i], placed[i]) = (heading, cost);
    }
}

/// Pattern search on each heading with its neighbours fixed, even contacts then odd ones, so that
/// the result does not depend on the number of threads.
fn one_by_one(
    run: &ContactRun,
    chain: &Chain,
    width: f64,
    headings: &mut Vec<f64>,
    placed: &mut Vec<f64>,
) {
    let count = chain.count;
    for parity in 0..2 {
        let updated: Vec<(f64, f64)> = (0..count)
            .into_par_iter()
            .map(|i| {
                let own = (headings[i], placed[i]);
                // The odd contact out at the seam of a closed run keeps its heading.
                if i % 2 != parity || (chain.closed && count % 2 == 1 && i == count - 1) {
                    return own;
                }
                let beside = chain.beside(headings, i);
                let turn_cost = |heading: f64| turn_cost(&beside, heading);
                best_of_three(own, width, turn_cost, |heading| run.place(i, heading).cost)
            })
            .collect();
        (*headings, *placed) = updated.into_iter().unzip();
    }
}

/// One step of a parabola-guided pattern search around a heading and the cost of its placement;
/// returns the same.
fn best_of_three(
    (own, placed): (f64, f64),
    width: f64,
    turn_cost: impl Fn(f64) -> f64,
    place_cost: impl Fn(f64) -> f64,
) -> (f64, f64) {
    let (placed_low, placed_high) = (place_cost(own - width), place_cost(own + width));
    let low = turn_cost(own - width) + placed_low;
    let mid = turn_cost(own) + placed;
    let high = turn_cost(own + width) + placed_high;
    let curvature = low - 2.0 * mid + high;
    let shift = if curvature > 1e-15 {
        (0.5 * width * (low - high) / curvature).clamp(-width, width)
    } else if low < high {
        -width
    } else {
        width
    };
    let placed_there = if shift == -width {
        placed_low
    } else if shift == width {
        placed_high
    } else {
        place_cost(own + shift)
    };
    if turn_cost(own + shift) + placed_there < mid {
        (own + shift, placed_there)
    } else {
        (own, placed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::{ELLIPSE as APERTURE, walls};
    use crate::geometry::{Point2, Vector2};
    use crate::plan::headings::profile::{TURN_WEIGHT_MM4, all_ahead, turn_slacks_per_mm};
    use crate::plan::pass::Contact;

    /// Contacts along a straight wall whose beads widen and narrow again, slowly.
    fn waves() -> Vec<Contact> {
        (0..200)
            .map(|i| Contact {
                point: Point2::new(0.1 * (f64::from(i) + 0.5), 0.0),
                normal: Vector2::y(),
                length_mm: 0.1,
                extent_mm: 0.4 + 0.1 * (0.05 * f64::from(i)).sin(),
                on_axis: false,
            })
            .collect()
    }

    /// Goal: headings that are right to a bin come to the least cost of the whole run. Method:
    /// headings on bins of 3°, refined, against a thousand rounds of moving each by itself from
    /// there, whose steps shrink to 1e-6 rad.
    #[test]
    fn bins_leave_no_trace() {
        let contacts = waves();
        let walls = walls(&[&[[-5.0, 0.0], [30.0, 0.0], [30.0, 9.0], [-5.0, 9.0]]]);
        let ahead = all_ahead(&contacts, &APERTURE, &walls);
        let run = ContactRun::new(&contacts, false, &APERTURE, &walls, &ahead);
        let steps = turn_slacks_per_mm(&contacts, false, TURN_WEIGHT_MM4, &APERTURE);
        let bin_rad = std::f64::consts::PI / BINS as f64;
        // What gives the extent wanted: e² = a² sin² + b² cos² of the heading against the wall.
        let wanted = |c: &Contact| ((c.extent_mm.powi(2) - 0.04) / 0.32).sqrt().asin();
        let binned = contacts
            .iter()
            .map(|c| (wanted(c) / bin_rad).round() * bin_rad);
        let mut headings: Vec<f64> = binned.collect();
        let cost = |headings: &[f64]| -> f64 {
            let placed: f64 = (0..headings.len())
                .map(|i| run.place(i, headings[i]).cost)
                .sum();
            let turns = headings.windows(2).zip(&steps);
            placed
                + turns
                    .map(|(w, step)| (w[1] - w[0]).powi(2) / step)
                    .sum::<f64>()
        };
        let before = cost(&headings);
        let mut slowly = headings.clone();
        let chain = Chain {
            steps: &steps,
            lap: 0.0,
            closed: false,
            count: slowly.len(),
        };
        let mut placed: Vec<f64> = (0..slowly.len())
            .map(|i| run.place(i, slowly[i]).cost)
            .collect();
        let mut width = bin_rad;
        for _ in 0..1000 {
            one_by_one(&run, &chain, width, &mut slowly, &mut placed);
            width *= 0.99;
        }
        let least = cost(&slowly);
        refine(&run, &steps, &mut headings);
        let found = cost(&headings);
        assert!(before > 1.5 * least, "{before} {least}");
        assert!(found < 1.02 * least, "{found} {least}");
    }
}
