//! Continuous refinement of a profile that is right to a bin.

use super::{BINS, Run, TURN_WEIGHT, lap_turn};
use rayon::prelude::*;

/// Pattern search on each heading with its neighbours fixed, even contacts then odd ones, so that
/// the result does not depend on the number of threads.
pub fn refine(run: &Run, steps: &[f64], headings: &mut Vec<f64>) {
    let (contacts, closed) = (run.contacts, run.closed);
    let count = contacts.len();
    let lap = if closed {
        lap_turn(headings, run.aperture.period_rad())
    } else {
        0.0
    };
    // What each contact's placement costs at its heading; the neighbours have no say in it.
    let mut placed: Vec<f64> = (0..count)
        .into_par_iter()
        .map(|i| run.place(i, headings[i]).cost)
        .collect();
    let mut width = std::f64::consts::PI / BINS as f64;
    for _ in 0..5 {
        width *= 0.6;
        for parity in 0..2 {
            let updated: Vec<(f64, f64)> = (0..count)
                .into_par_iter()
                .map(|i| {
                    let own = (headings[i], placed[i]);
                    // The odd contact out at the seam of a closed run keeps its heading.
                    if i % 2 != parity || (closed && count % 2 == 1 && i == count - 1) {
                        return own;
                    }
                    let before = match i {
                        0 if closed => Some((headings[count - 1] - lap, steps[count - 1])),
                        0 => None,
                        _ => Some((headings[i - 1], steps[i - 1])),
                    };
                    let after = match i + 1 {
                        n if n < count => Some((headings[n], steps[i])),
                        _ if closed => Some((headings[0] + lap, steps[i])),
                        _ => None,
                    };
                    let turn_cost = |heading: f64| -> f64 {
                        [before, after]
                            .iter()
                            .flatten()
                            .map(|(other, step)| TURN_WEIGHT * (heading - other).powi(2) / step)
                            .sum()
                    };
                    best_of_three(own, width, turn_cost, |heading| run.place(i, heading).cost)
                })
                .collect();
            (*headings, placed) = updated.into_iter().unzip();
        }
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
