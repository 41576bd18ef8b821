//! Headings within their ranges that need the least acceleration of the nozzle's turn.
//!
//! In: nodes with ranges (rad), speeds of the tip (mm/s). Out: a heading for each node. The integral of the squared
//! acceleration over time is minimised within the ranges (a primal-dual interior-point method on a banded matrix),
//! where the time between nodes is that of a tip which slows at corners. If the heading's limits require more time,
//! it is stretched and the headings are found again.

use super::BeadLines;
use super::nodes::Node;
use super::sides::Range;
use crate::geometry::aperture::wrapped_rad;
use crate::geometry::banded::Band;
use crate::plan::route::bead_curve::CORNER;
use crate::settings::Settings;
use std::f64::consts::TAU;

/// How often times and headings are found.
const ROUNDS: usize = 2;
/// Iterations of the interior-point method, and the mean product of slack and multiplier at which it ends,
/// relative to the initial one.
const ITERATIONS: usize = 30;
const GAP_SHARE: f64 = 1e-6;
/// Share of the distance to the next bound that a step covers, and the factor by which the products
/// shrink.
const STEP_SHARE: f64 = 0.98;
const CENTRING: f64 = 0.15;
/// Least speed of the tip near a corner, relative to that for printing.
const SPEED_MIN_SHARE: f64 = 1.0 / 15.0;
/// Least time of a travel.
const TRAVEL_MIN_S: f64 = 0.02;

/// All passes in one row.
struct Row {
    ranges: Vec<Range>,
    /// Times from node to node; of travel between passes.
    times_s: Vec<f64>,
    is_travel: Vec<bool>,
    /// The heading before the first, and the time from there.
    start_rad: f64,
    start_s: f64,
}

/// Headings of the nodes of all passes in a row, rad.
pub fn smoothed(
    passes: &[BeadLines],
    nodes: &[Vec<Node>],
    start_rad: f64,
    settings: &Settings,
) -> Vec<f64> {
    let mut row = Row {
        ranges: Vec::new(),
        times_s: Vec::new(),
        is_travel: Vec::new(),
        start_rad,
        start_s: passes.first().map_or(1.0, |first| first.arrival_s),
    };
    for (lines, nodes) in passes.iter().zip(nodes) {
        if !row.ranges.is_empty() {
            row.times_s.push(lines.arrival_s);
            row.is_travel.push(true);
        }
        row.ranges.extend(nodes.iter().map(|node| node.range));
        let of_pass = times_s(lines, nodes, settings);
        row.is_travel.extend(of_pass.iter().map(|_| false));
        row.times_s.extend(of_pass);
    }
    let fastest_s = row.times_s.clone();
    let mut headings_rad = Problem::new(&row).solved(&row);
    for _ in 1..ROUNDS {
        row.times_s = stretched(&row, &fastest_s, &headings_rad, settings);
        headings_rad = Problem::new(&row).solved(&row);
    }
    headings_rad
}

/// Time from node to node of the tip alone.
fn times_s(lines: &BeadLines, nodes: &[Node], settings: &Settings) -> Vec<f64> {
    let acceleration_mm_s2 = settings.tip_acceleration_mm_s2 * settings.plan_share;
    let corner_mm_s = |turn_rad: f64| {
        let cos = (0.5 * turn_rad).cos();
        let radius_mm = CORNER * settings.aperture.unit_mm() * cos / (1.0 - cos).max(1e-9);
        (acceleration_mm_s2 * radius_mm).sqrt()
    };
    let mut speeds_mm_s: Vec<f64> = Vec::with_capacity(nodes.len());
    for (i, node) in nodes.iter().enumerate() {
        let mut speed_mm_s = lines.speeds_mm_s[node.leg].min(settings.speed_mm_s);
        let next = nodes.get(i + 1).map_or(node.leg, |next| next.leg);
        for leg in node.leg..next {
            let turn = lines.travel_rad[leg + 1] - lines.travel_rad[leg];
            speed_mm_s = speed_mm_s.min(corner_mm_s(wrapped_rad(turn, TAU).abs()));
        }
        if i == 0 || i + 1 == nodes.len() {
            speed_mm_s = 0.0;
        }
        speeds_mm_s.push(speed_mm_s.max(SPEED_MIN_SHARE * settings.speed_mm_s));
    }
    let way_mm = |i: usize| nodes[i + 1].place_mm - nodes[i].place_mm;
    let reached = |from: f64, way_mm: f64| (from * from + 2.0 * acceleration_mm_s2 * way_mm).sqrt();
    for i in 1..nodes.len() {
        speeds_mm_s[i] = speeds_mm_s[i].min(reached(speeds_mm_s[i - 1], way_mm(i - 1)));
    }
    for i in (1..nodes.len()).rev() {
        speeds_mm_s[i - 1] = speeds_mm_s[i - 1].min(reached(speeds_mm_s[i], way_mm(i - 1)));
    }
    let steps = 0..nodes.len().saturating_sub(1);
    steps
        .map(|i| 2.0 * way_mm(i) / (speeds_mm_s[i] + speeds_mm_s[i + 1]))
        .collect()
}

/// Times with which the headings keep the limits of their axis, or nearly.
fn stretched(row: &Row, fastest_s: &[f64], headings_rad: &[f64], settings: &Settings) -> Vec<f64> {
    let Some(axis) = settings.machine.joints.last() else {
        return fastest_s.to_vec();
    };
    let share = settings.plan_share;
    let (speed_max, acceleration_max) = (share * axis.speed_max, share * axis.acceleration_max);
    let times_s = &row.times_s;
    let bend = |i: usize| {
        let Some(weights) = row.weights_at(i) else {
            return 0.0;
        };
        let of_node = |(k, weight): (usize, &f64)| weight * headings_rad[weights.first + k];
        let sum: f64 = weights.of_nodes.iter().enumerate().map(of_node).sum();
        sum.abs()
    };
    let steps = 0..times_s.len();
    steps
        .map(|i| {
            if row.is_travel[i] {
                return fastest_s[i];
            }
            let rate = (headings_rad[i + 1] - headings_rad[i]).abs() / times_s[i];
            let mean = 0.5 * (bend(i) + bend(i + 1));
            let by_acceleration = (mean / acceleration_max).sqrt();
            (times_s[i] * by_acceleration.max(rate / speed_max)).max(fastest_s[i])
        })
        .collect()
}

/// The acceleration at a node as a sum of headings.
struct Weights {
    /// The first node that it is of.
    first: usize,
    of_nodes: Vec<f64>,
    /// The time that it represents.
    mean_s: f64,
}

impl Row {
    /// The acceleration at a node; at both ends of a pass the nozzle rests.
    fn weights_at(&self, i: usize) -> Option<Weights> {
        let within = |step: usize| {
            let is_within = step < self.times_s.len() && !self.is_travel[step];
            is_within.then(|| self.times_s[step])
        };
        let before = i.checked_sub(1).and_then(within);
        let (first, of_nodes, mean_s) = match (before, within(i)) {
            (Some(before_s), Some(after_s)) => {
                let mean_s = 0.5 * (before_s + after_s);
                let [before, after] = [before_s, after_s].map(|s| 1.0 / (s * mean_s));
                (i - 1, vec![before, -before - after, after], mean_s)
            }
            // From rest or to it with this acceleration for half the step's time.
            (Some(step_s), None) | (None, Some(step_s)) => {
                let weight = 2.0 / (step_s * step_s);
                let first = if before.is_some() { i - 1 } else { i };
                (first, vec![-weight, weight], 0.5 * step_s)
            }
            (None, None) => return None,
        };
        Some(Weights {
            first,
            of_nodes,
            mean_s,
        })
    }
}

/// Least squares with bounds: ½ xᵀ H x - gᵀ x.
struct Problem {
    hessian: Vec<[f64; 4]>,
    gradient: Vec<f64>,
}

/// Slacks to both bounds with their multipliers.
struct Bounds {
    slack: [f64; 2],
    multiplier: [f64; 2],
}

impl Problem {
    fn new(row: &Row) -> Problem {
        let count = row.ranges.len();
        let mut hessian = vec![[0.0; 4]; count];
        let mut gradient = vec![0.0; count];
        for i in 0..count {
            let Some(weights) = row.weights_at(i) else {
                continue;
            };
            for (a, of_a) in weights.of_nodes.iter().enumerate() {
                for (b, of_b) in weights.of_nodes.iter().enumerate().skip(a) {
                    hessian[weights.first + a][b - a] += weights.mean_s * of_a * of_b;
                }
            }
        }
        // From rest to rest the least integral is 12 turn² / time³.
        let of_turn = |seconds: f64| 12.0 / seconds.max(TRAVEL_MIN_S).powi(3);
        for i in (0..row.times_s.len()).filter(|i| row.is_travel[*i]) {
            let weight = of_turn(row.times_s[i]);
            hessian[i][0] += weight;
            hessian[i][1] -= weight;
            hessian[i + 1][0] += weight;
        }
        if count > 0 {
            let weight = of_turn(row.start_s);
            hessian[0][0] += weight;
            gradient[0] += weight * row.start_rad;
        }
        // Numbers about 1.
        let sum: f64 = hessian.iter().map(|row| row[0]).sum();
        let scale = count as f64 / sum.max(f64::MIN_POSITIVE);
        hessian.iter_mut().flatten().for_each(|h| *h *= scale);
        gradient.iter_mut().for_each(|g| *g *= scale);
        Problem { hessian, gradient }
    }

    /// H x - g.
    fn slope(&self, x: &[f64]) -> Vec<f64> {
        let mut slope: Vec<f64> = self.gradient.iter().map(|g| -g).collect();
        for (i, row) in self.hessian.iter().enumerate() {
            slope[i] += row[0] * x[i];
            for k in 1..3.min(x.len() - i) {
                slope[i] += row[k] * x[i + k];
                slope[i + k] += row[k] * x[i];
            }
        }
        slope
    }

    fn solved(&self, row: &Row) -> Vec<f64> {
        let mut x: Vec<f64> = row.ranges.iter().map(Range::middle_rad).collect();
        let mut bounds: Vec<Bounds> = row
            .ranges
            .iter()
            .map(|range| {
                let half_rad = 0.5 * (range.high_rad - range.low_rad);
                Bounds {
                    slack: [half_rad; 2],
                    multiplier: [1.0 / half_rad; 2],
                }
            })
            .collect();
        let mut gap = 1.0;
        for _ in 0..ITERATIONS {
            gap *= CENTRING;
            gap = self.step(&mut x, &mut bounds, gap);
            if gap < GAP_SHARE {
                break;
            }
        }
        x
    }

    /// A step towards products of slack and multiplier of `aim`; returns their mean.
    fn step(&self, x: &mut [f64], bounds: &mut [Bounds], aim: f64) -> f64 {
        let mut band = Band {
            rows: self.hessian.clone(),
        };
        let mut right: Vec<[f64; 1]> = self.slope(x).into_iter().map(|g| [-g]).collect();
        for ((row, right), bound) in band.rows.iter_mut().zip(&mut right).zip(&*bounds) {
            let ([low, high], [at_low, at_high]) = (bound.slack, bound.multiplier);
            row[0] += at_low / low + at_high / high;
            right[0] += aim / low - aim / high;
        }
        band.factored().solve(&mut right);
        let mut share = 1.0_f64;
        let mut changes = Vec::with_capacity(x.len());
        for ([dx], bound) in right.iter().zip(&*bounds) {
            let moves = [*dx, -*dx];
            let change: [[f64; 2]; 2] = std::array::from_fn(|side| {
                let (slack, multiplier) = (bound.slack[side], bound.multiplier[side]);
                [
                    moves[side],
                    (aim - multiplier * moves[side]) / slack - multiplier,
                ]
            });
            for (side, [of_slack, of_multiplier]) in change.iter().enumerate() {
                let within = |value: f64, change: f64| match change < 0.0 {
                    true => -STEP_SHARE * value / change,
                    false => 1.0,
                };
                share = share.min(within(bound.slack[side], *of_slack));
                share = share.min(within(bound.multiplier[side], *of_multiplier));
            }
            changes.push(change);
        }
        let mut sum = 0.0;
        for (i, bound) in bounds.iter_mut().enumerate() {
            x[i] += share * right[i][0];
            for (side, [of_slack, of_multiplier]) in changes[i].iter().enumerate() {
                bound.slack[side] += share * of_slack;
                bound.multiplier[side] += share * of_multiplier;
                sum += bound.slack[side] * bound.multiplier[side];
            }
        }
        sum / (2.0 * bounds.len() as f64)
    }
}
