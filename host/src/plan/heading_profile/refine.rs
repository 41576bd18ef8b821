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
    let mut width = std::f64::consts::PI / BINS as f64;
    for _ in 0..5 {
        width *= 0.6;
        for parity in 0..2 {
            let updated: Vec<f64> = (0..count)
                .into_par_iter()
                .map(|i| {
                    let own = headings[i];
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
                    let cost = |heading: f64| {
                        let turn: f64 = [before, after]
                            .iter()
                            .flatten()
                            .map(|(other, step)| TURN_WEIGHT * (heading - other).powi(2) / step)
                            .sum();
                        turn + run.place(i, heading).cost
                    };
                    best_of_three(own, width, cost)
                })
                .collect();
            *headings = updated;
        }
    }
}

/// One step of a parabola-guided pattern search around `own`.
fn best_of_three(own: f64, width: f64, cost: impl Fn(f64) -> f64) -> f64 {
    let (low, mid, high) = (cost(own - width), cost(own), cost(own + width));
    let curvature = low - 2.0 * mid + high;
    let shift = if curvature > 1e-15 {
        (0.5 * width * (low - high) / curvature).clamp(-width, width)
    } else if low < high {
        -width
    } else {
        width
    };
    if cost(own + shift) < mid {
        own + shift
    } else {
        own
    }
}
