//! The heading along a run of contacts: dynamic programming over the corridor of feasible
//! headings, then continuous refinement.
//!
//! The state is phi modulo the aperture's symmetry. Each contact and heading has one placement:
//! tangent to the wall at the contact (centre = p + support point), slid off any other wall that
//! it would cut. The cost of a placement is (e - wanted extent)² plus (slide)², per mm of wall;
//! the cost of turning is lambda dphi² / ds. The best closed or open profile is found exactly over
//! the bins (Viterbi), then refined between them.

use super::contacts::Contact;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::{Configuration, contact};
use crate::geometry::edge_index::EdgeIndex;
use rayon::prelude::*;

/// Heading bins over the 180° of a symmetric aperture: 3° each, refined afterwards.
const BINS: usize = 60;
/// Weight of turning, mm²: from trials on real slices.
const TURN_WEIGHT: f64 = 0.01;
/// Largest turn from one contact to the next, bins.
const TURN_BINS_MAX: usize = 12;
/// Slides of one placement before it counts as infeasible.
const SLIDES_MAX: usize = 4;
/// Cost of an infeasible placement, mm² (per mm of wall): far above any misfit.
const INFEASIBLE: f64 = 25.0;
/// A placement may cut by this share of the aperture before the final push-off.
const CUT_SHARE_MAX: f64 = 2e-3;

/// One placement of the profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Centre and heading (unwrapped along the profile).
    pub at: Configuration,
    /// False where no heading fits at this contact.
    pub feasible: bool,
    /// The contact it belongs to.
    pub contact: Contact,
}

struct Candidate {
    at: Configuration,
    cost: f64,
    feasible: bool,
}

/// Finds the profile along `contacts`; `closed` where the last one meets the first.
pub fn profile(
    contacts: &[Contact],
    closed: bool,
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Vec<Placement> {
    if contacts.is_empty() {
        return Vec::new();
    }
    let period_rad = aperture.period_rad();
    let bins = match (aperture.is_round(), period_rad > std::f64::consts::PI) {
        (true, _) => 1,
        (false, false) => BINS,
        (false, true) => 2 * BINS,
    };
    let bin_rad = period_rad / bins as f64;
    let costs: Vec<Vec<f32>> = contacts
        .par_iter()
        .map(|c| {
            (0..bins)
                .map(|bin| place(c, bin as f64 * bin_rad, aperture, walls).cost as f32)
                .collect()
        })
        .collect();
    let steps = steps_mm(contacts, closed, aperture);
    let start = if closed {
        closed_start(&costs, &steps, bin_rad)
    } else {
        None
    };
    let chosen = viterbi(&costs, &steps, bin_rad, start);
    let mut headings = unwrap_bins(&chosen, bins, bin_rad);
    if !aperture.is_round() {
        refine(contacts, closed, aperture, walls, &steps, &mut headings);
    }
    contacts
        .par_iter()
        .zip(&headings)
        .map(|(c, &heading)| {
            let found = place(c, heading, aperture, walls);
            Placement {
                at: found.at,
                feasible: found.feasible,
                contact: *c,
            }
        })
        .collect()
}

/// The placement of one contact at one heading, slid inside where it would cut a wall.
fn place(c: &Contact, heading_rad: f64, aperture: &Aperture, walls: &EdgeIndex) -> Candidate {
    let extent = aperture.extent_mm(heading_rad, c.normal);
    let tangent = if c.on_axis {
        aperture.center_on_axis(heading_rad, c.point, c.normal)
    } else {
        aperture.center_on_wall(heading_rad, c.point, c.normal)
    };
    let slid = slide_inside(
        Configuration {
            center: tangent,
            heading_rad,
        },
        aperture,
        walls,
        SLIDES_MAX,
        CUT_SHARE_MAX,
    );
    let misfit = (extent - c.extent_mm).powi(2);
    let weight = c.length_mm.max(0.01);
    match slid {
        Some(at) => {
            let slide2 = (at.center - tangent).norm_squared();
            Candidate {
                at,
                cost: (misfit + slide2) * weight,
                feasible: true,
            }
        }
        None => Candidate {
            at: Configuration {
                center: tangent,
                heading_rad,
            },
            cost: (misfit + INFEASIBLE) * weight,
            feasible: false,
        },
    }
}

/// Slides a placement off the walls along their contact normals, at most `rounds` times, until it
/// cuts no deeper than `cut_share`; `None` where that does not succeed or it is outside.
pub fn slide_inside(
    at: Configuration,
    aperture: &Aperture,
    walls: &EdgeIndex,
    rounds: usize,
    cut_share: f64,
) -> Option<Configuration> {
    let mut at = at;
    for _ in 0..rounds {
        let found = contact(aperture, at, walls, 1.0);
        let Some(found) = found.filter(|f| f.scaled < 1.0 - cut_share) else {
            return walls.contains(at.center).then_some(at);
        };
        at.center -= found.outward * (found.depth_mm + 1e-6);
    }
    let cut = contact(aperture, at, walls, 1.0).is_some_and(|f| f.scaled < 1.0 - cut_share);
    (!cut && walls.contains(at.center)).then_some(at)
}

/// Distance that the turning between contact i and i + 1 can use, mm.
fn steps_mm(contacts: &[Contact], closed: bool, aperture: &Aperture) -> Vec<f64> {
    let count = contacts.len();
    let swing = 0.5 * (aperture.major_mm() + aperture.minor_mm());
    (0..if closed { count } else { count - 1 })
        .map(|i| {
            let (c, d) = (&contacts[i], &contacts[(i + 1) % count]);
            let angle = c
                .normal
                .perp(&d.normal)
                .atan2(c.normal.dot(&d.normal))
                .abs();
            ((d.point - c.point).norm() + swing * angle).max(0.01)
        })
        .collect()
}

/// Best bin of each contact; `start` fixes the first and last bin of a closed run.
fn viterbi(costs: &[Vec<f32>], steps: &[f64], bin_rad: f64, start: Option<usize>) -> Vec<usize> {
    let bins = costs[0].len();
    let reach = TURN_BINS_MAX.min(bins / 2);
    let mut from: Vec<Vec<u16>> = Vec::with_capacity(costs.len());
    let mut total: Vec<f32> = costs[0].clone();
    if let Some(s) = start {
        for (bin, value) in total.iter_mut().enumerate() {
            if bin != s {
                *value = f32::INFINITY;
            }
        }
    }
    from.push(vec![0; bins]);
    for i in 1..costs.len() {
        let (next, best) = viterbi_step(&total, &costs[i], steps[i - 1], bin_rad, reach);
        total = next;
        from.push(best);
    }
    let last = match start {
        Some(s) if costs.len() > 1 => {
            let (closing, best) = viterbi_step(
                &total,
                &vec![0.0; bins],
                steps[costs.len() - 1],
                bin_rad,
                reach,
            );
            if closing[s].is_finite() {
                best[s] as usize
            } else {
                argmin(&total)
            }
        }
        _ => argmin(&total),
    };
    let mut chosen = vec![last; costs.len()];
    for i in (1..costs.len()).rev() {
        chosen[i - 1] = from[i][chosen[i]] as usize;
    }
    chosen
}

fn viterbi_step(
    total: &[f32],
    costs: &[f32],
    step_mm: f64,
    bin_rad: f64,
    reach: usize,
) -> (Vec<f32>, Vec<u16>) {
    let bins = total.len();
    let turn: Vec<f32> = (0..=reach)
        .map(|n| (TURN_WEIGHT * (n as f64 * bin_rad).powi(2) / step_mm) as f32)
        .collect();
    let mut next = vec![f32::INFINITY; bins];
    let mut best = vec![0u16; bins];
    for bin in 0..bins {
        for (n, &cost) in turn.iter().enumerate() {
            for other in [(bin + n) % bins, (bin + bins - n) % bins] {
                let found = total[other] + cost;
                if found < next[bin] {
                    next[bin] = found;
                    best[bin] = other as u16;
                }
            }
        }
        next[bin] += costs[bin];
    }
    (next, best)
}

/// The bin in which a closed run should start: run one and a half laps and look at the middle.
fn closed_start(costs: &[Vec<f32>], steps: &[f64], bin_rad: f64) -> Option<usize> {
    let count = costs.len();
    let tail = (count / 2).min(400);
    let order: Vec<usize> = (count - tail..count)
        .chain(0..(tail + 1).min(count))
        .collect();
    let lap: Vec<Vec<f32>> = order.iter().map(|&i| costs[i].clone()).collect();
    let lap_steps: Vec<f64> = order.iter().map(|&i| steps[i]).collect();
    let chosen = viterbi(&lap, &lap_steps, bin_rad, None);
    chosen.get(tail).copied()
}

fn argmin(values: &[f32]) -> usize {
    (0..values.len()).fold(0, |best, i| if values[i] < values[best] { i } else { best })
}

/// Bins to unwrapped angles, each step the shorter way round.
fn unwrap_bins(chosen: &[usize], bins: usize, bin_rad: f64) -> Vec<f64> {
    let mut headings = Vec::with_capacity(chosen.len());
    let mut last = chosen[0] as i64;
    let bins = bins as i64;
    for &bin in chosen {
        let mut delta = (bin as i64 - last).rem_euclid(bins);
        if delta > bins / 2 {
            delta -= bins;
        }
        last += delta;
        headings.push(last as f64 * bin_rad);
    }
    headings
}

/// Pattern search on each heading with its neighbours fixed, even contacts then odd ones, so that
/// the result does not depend on the number of threads.
fn refine(
    contacts: &[Contact],
    closed: bool,
    aperture: &Aperture,
    walls: &EdgeIndex,
    steps: &[f64],
    headings: &mut Vec<f64>,
) {
    let count = contacts.len();
    let lap = if closed {
        lap_turn(headings, aperture.period_rad())
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
                        turn + place(&contacts[i], heading, aperture, walls).cost
                    };
                    best_of_three(own, width, cost)
                })
                .collect();
            *headings = updated;
        }
    }
}

/// The turn of a closed run over one lap: the multiple of the period that makes its ends meet.
fn lap_turn(headings: &[f64], period_rad: f64) -> f64 {
    let (Some(first), Some(last)) = (headings.first(), headings.last()) else {
        return 0.0;
    };
    ((last - first) / period_rad).round() * period_rad
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
