//! The heading along a run of contacts: dynamic programming over the corridor of feasible
//! headings, then continuous refinement.
//!
//! The state is phi modulo the aperture's symmetry. Each contact and heading has one placement:
//! tangent to the wall at the contact (centre = p + support point), slid off any other wall that
//! it would cut. The cost of a placement is (e - wanted extent)² plus (slide)², per mm of wall;
//! the cost of turning is lambda dphi² / ds. The best closed or open profile is found exactly over
//! the bins (Viterbi), then refined between them.

use super::contacts::Contact;
use crate::geometry::Vector2;
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

/// Rounds of smoothing: they halve the print time of turned corners for 0.1 % of coverage.
const SMOOTHING_ROUNDS: usize = 6;

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
    let run = Run::new(contacts, closed, aperture, walls);
    let costs: Vec<Vec<f32>> = (0..contacts.len())
        .into_par_iter()
        .map(|i| {
            (0..bins)
                .map(|bin| run.place(i, bin as f64 * bin_rad).cost as f32)
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
        refine(&run, &steps, &mut headings);
    }
    run.placements(&headings)
}

/// The profile again for slightly other contacts, starting from the headings of `before`.
pub fn refined(
    contacts: &[Contact],
    closed: bool,
    before: &[Placement],
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Vec<Placement> {
    let mut headings: Vec<f64> = before.iter().map(|p| p.at.heading_rad).collect();
    let run = Run::new(contacts, closed, aperture, walls);
    if !aperture.is_round() && contacts.len() > 1 {
        let steps = steps_mm(contacts, closed, aperture);
        refine(&run, &steps, &mut headings);
    }
    run.placements(&headings)
}

/// Smooths a run by rounds of [1 2 1] / 4 over centres and headings; the ends of an open one stay.
pub fn smooth(placements: &mut [Placement], closed: bool, aperture: &Aperture) {
    let count = placements.len();
    if count < 4 {
        return;
    }
    let headings: Vec<f64> = placements.iter().map(|p| p.at.heading_rad).collect();
    let lap = if closed {
        lap_turn(&headings, aperture.period_rad())
    } else {
        0.0
    };
    for _ in 0..SMOOTHING_ROUNDS {
        let before: Vec<Configuration> = placements.iter().map(|p| p.at).collect();
        for i in 0..count {
            if !closed && (i == 0 || i + 1 == count) {
                continue;
            }
            let own = before[i];
            let (p, q) = (before[(i + count - 1) % count], before[(i + 1) % count]);
            let back = if i == 0 { lap } else { 0.0 };
            let ahead = if i + 1 == count { lap } else { 0.0 };
            let sum = p.center.coords + own.center.coords * 2.0 + q.center.coords;
            placements[i].at = Configuration {
                center: (sum / 4.0).into(),
                heading_rad: (p.heading_rad - back + 2.0 * own.heading_rad + q.heading_rad + ahead)
                    / 4.0,
            };
        }
    }
}

/// A run of contacts with what placing the aperture on them needs.
struct Run<'a> {
    contacts: &'a [Contact],
    closed: bool,
    aperture: &'a Aperture,
    walls: &'a EdgeIndex,
    /// Position of each contact along the run, mm.
    positions_mm: Vec<f64>,
    /// Wanted extents at equal steps along the run, mm.
    extents_mm: Vec<f64>,
    length_mm: f64,
}

impl<'a> Run<'a> {
    fn new(
        contacts: &'a [Contact],
        closed: bool,
        aperture: &'a Aperture,
        walls: &'a EdgeIndex,
    ) -> Run<'a> {
        let mut length_mm = 0.0;
        let mut positions_mm = Vec::with_capacity(contacts.len());
        for contact in contacts {
            positions_mm.push(length_mm + 0.5 * contact.length_mm);
            length_mm += contact.length_mm;
        }
        let known: Vec<(f64, f64)> = contacts
            .iter()
            .zip(&positions_mm)
            .filter(|(c, _)| c.length_mm > 0.0)
            .map(|(c, &s)| (s, c.extent_mm))
            .collect();
        let count = (contacts.len() * EXTENTS_PER_CONTACT).max(1);
        Run {
            contacts,
            closed,
            aperture,
            walls,
            positions_mm,
            extents_mm: interpolated(&known, length_mm / count as f64, count),
            length_mm,
        }
    }

    /// The extent wanted `along_mm` further along the run than contact `i`.
    fn wanted_mm(&self, i: usize, along_mm: f64) -> f64 {
        if self.contacts[i].length_mm <= 0.0 || self.length_mm <= 0.0 {
            return self.contacts[i].extent_mm;
        }
        let count = self.extents_mm.len();
        let at = (self.positions_mm[i] + along_mm) / self.length_mm;
        let at = if self.closed {
            at.rem_euclid(1.0)
        } else {
            at.clamp(0.0, 1.0)
        };
        self.extents_mm[((at * count as f64) as usize).min(count - 1)]
    }

    /// The placement of one contact at one heading, slid inside where it would cut a wall. A turned
    /// aperture touches the inner side of its bead ahead of the contact or behind it: that is where
    /// the width counts.
    fn place(&self, i: usize, heading_rad: f64) -> Candidate {
        let (c, aperture) = (&self.contacts[i], self.aperture);
        let extent = aperture.extent_mm(heading_rad, c.normal);
        let along = Vector2::new(c.normal.y, -c.normal.x);
        let support = aperture.support_point(heading_rad, c.normal);
        let (tangent, wanted) = if c.on_axis {
            let center = aperture.center_on_axis(heading_rad, c.point, c.normal);
            let ahead_mm = support.dot(&along);
            let both = self.wanted_mm(i, ahead_mm) + self.wanted_mm(i, -ahead_mm);
            (center, 0.5 * both)
        } else {
            let center = aperture.center_on_wall(heading_rad, c.point, c.normal);
            let ahead_mm = (center + support - c.point).dot(&along);
            (center, self.wanted_mm(i, ahead_mm))
        };
        let at = Configuration {
            center: tangent,
            heading_rad,
        };
        let slid = slide_inside(at, aperture, self.walls, SLIDES_MAX, CUT_SHARE_MAX);
        let misfit = (extent - wanted).powi(2);
        let excess = slid.map_or(INFEASIBLE, |s| (s.center - tangent).norm_squared());
        Candidate {
            at: slid.unwrap_or(at),
            cost: (misfit + excess) * c.length_mm.max(0.01),
            feasible: slid.is_some(),
        }
    }

    fn placements(&self, headings: &[f64]) -> Vec<Placement> {
        (0..self.contacts.len())
            .into_par_iter()
            .map(|i| {
                let found = self.place(i, headings[i]);
                Placement {
                    at: found.at,
                    feasible: found.feasible,
                    contact: self.contacts[i],
                }
            })
            .collect()
    }
}

/// Entries of the table of wanted extents for each contact.
const EXTENTS_PER_CONTACT: usize = 2;

/// Values known at rising positions, linear at `count` equal steps (their middles).
fn interpolated(known: &[(f64, f64)], step: f64, count: usize) -> Vec<f64> {
    let mut next = 0;
    (0..count)
        .map(|i| {
            let s = (i as f64 + 0.5) * step;
            while next < known.len() && known[next].0 < s {
                next += 1;
            }
            match (
                next.checked_sub(1).and_then(|n| known.get(n)),
                known.get(next),
            ) {
                (Some(p), Some(q)) if q.0 > p.0 => p.1 + (q.1 - p.1) * (s - p.0) / (q.0 - p.0),
                (Some(p), _) => p.1,
                (None, Some(q)) => q.1,
                (None, None) => 0.0,
            }
        })
        .collect()
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
fn refine(run: &Run, steps: &[f64], headings: &mut Vec<f64>) {
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
