//! The least time along a path within speed, acceleration and jerk: a reference of its own.
//!
//! In: the channels' derivatives at even places of the path, limits of x, y and heading and of the
//! tip. Out: seconds from rest to rest. Unknown is b, the squared rate of the path's parameter, at the
//! places; its derivatives are differences, so that each limit is a row over three neighbours. A
//! logarithmic barrier (Boyd and Vandenberghe, "Convex Optimization", 11.3) and Newton's method with
//! one step length for all: slow, plain, and nothing of it is the planner's. Left out: flow.

use headway::plan::route::moves::PathCurve;
use headway::settings::Settings;

/// First to third derivatives of (x, y, heading) by the path's parameter, places one apart.
pub type Derivatives = [[f64; 3]; 3];

/// Limits of what the path moves.
pub struct ReferenceLimits {
    /// Speed, acceleration and jerk of x, y and heading.
    pub joints: [[f64; 3]; 3],
    /// Tip speed and acceleration.
    pub tip: [f64; 2],
}

/// One row of a place: bound - weights . (b, b', b'') > 0, the bound by 1 / sqrt(b) for a jerk.
struct Row {
    weights: [f64; 3],
    bound: f64,
    is_jerk: bool,
}

fn rows_of(d: &Derivatives, limits: &ReferenceLimits) -> Vec<Row> {
    let mut rows = Vec::new();
    let [first, second, third] = d;
    let mut push = |weights: [f64; 3], bound: f64, is_jerk: bool| {
        rows.push(Row {
            weights,
            bound,
            is_jerk,
        });
    };
    for joint in 0..3 {
        let [v, a, j] = limits.joints[joint];
        let (q1, q2, q3) = (first[joint], second[joint], third[joint]);
        push([q1 * q1 / (v * v), 0.0, 0.0], 1.0, false);
        for sign in [1.0, -1.0] {
            push([sign * q2 / a, sign * 0.5 * q1 / a, 0.0], 1.0, false);
            push(
                [sign * q3 / j, sign * 1.5 * q2 / j, sign * 0.5 * q1 / j],
                1.0,
                true,
            );
        }
    }
    let speed = first[0].hypot(first[1]) / limits.tip[0];
    push([speed * speed, 0.0, 0.0], 1.0, false);
    // Tangents of the circle of accelerations: 24 leave at most 0.9 % beyond it.
    for k in 0..24 {
        let (sin, cos) = (f64::from(k) * std::f64::consts::PI / 12.0).sin_cos();
        let along = |q: &[f64; 3]| (q[0] * cos + q[1] * sin) / limits.tip[1];
        push([along(second), 0.5 * along(first), 0.0], 1.0, false);
    }
    push([-1.0, 0.0, 0.0], 0.0, false);
    rows.retain(|row| row.weights.iter().any(|w| w.abs() > 1e-15));
    rows
}

impl Row {
    /// Room and its slope by (b, b', b'').
    fn room(&self, at: &[f64; 3]) -> (f64, [f64; 3]) {
        let [w0, w1, w2] = self.weights;
        let used = w0 * at[0] + w1 * at[1] + w2 * at[2];
        if !self.is_jerk {
            return (self.bound - used, [-w0, -w1, -w2]);
        }
        let bound = self.bound / at[0].max(1e-300).sqrt();
        (bound - used, [-w0 - 0.5 * bound / at[0], -w1, -w2])
    }
}

/// (b, b', b'') at inner place `i` of b with its two ends, which are 0.
fn values_at(b: &[f64], i: usize) -> [f64; 3] {
    [
        b[i],
        0.5 * (b[i + 1] - b[i - 1]),
        b[i - 1] - 2.0 * b[i] + b[i + 1],
    ]
}

fn time_s(b: &[f64]) -> f64 {
    b.windows(2)
        .map(|b| 2.0 / (b[0].sqrt() + b[1].sqrt()))
        .sum()
}

fn barrier(b: &[f64], rows: &[Vec<Row>], weight: f64) -> f64 {
    let mut value = weight * time_s(b);
    for (i, rows) in (1..).zip(rows) {
        let at = values_at(b, i);
        for row in rows {
            let (room, _) = row.room(&at);
            if room.is_nan() || room <= 0.0 {
                return f64::INFINITY;
            }
            value -= room.ln();
        }
    }
    value
}

/// Newton direction of the barrier.
fn direction(b: &[f64], rows: &[Vec<Row>], weight: f64) -> (Vec<f64>, f64) {
    let count = b.len() - 2;
    let mut matrix = vec![[1e-12; 3]; count];
    let mut right = vec![0.0; count];
    let mut add = |i: usize, slope: [f64; 3], scale: f64, force: f64| {
        // slope by (b_{i-1}, b_i, b_{i+1}), i from 1.
        for k in 0..3 {
            let Some(row) = (i + k).checked_sub(2).filter(|&row| row < count) else {
                continue;
            };
            right[row] += force * slope[k];
            for l in k..3 {
                if row + l - k < count {
                    matrix[row][l - k] += scale * slope[k] * slope[l];
                }
            }
        }
    };
    for (i, rows) in (1..).zip(rows) {
        let at = values_at(b, i);
        for row in rows {
            let (room, [s0, s1, s2]) = row.room(&at);
            let slope = [s2 - 0.5 * s1, s0 - 2.0 * s2, s2 + 0.5 * s1];
            add(i, slope, 1.0 / (room * room), 1.0 / room);
        }
    }
    for i in 0..b.len() - 1 {
        let (p, q) = (b[i].sqrt(), b[i + 1].sqrt());
        let sum = p + q;
        for (index, root) in [(i, p), (i + 1, q)] {
            if index == 0 || index > count {
                continue;
            }
            let slope = -1.0 / (sum * sum * root);
            right[index - 1] -= weight * slope;
            matrix[index - 1][0] +=
                weight * (1.0 / (sum.powi(3) * root * root) + 0.5 / (sum * sum * root.powi(3)));
        }
        if i >= 1 && i < count {
            matrix[i - 1][1] += weight / (sum.powi(3) * p * q);
        }
    }
    let force = right.clone();
    solve(&mut matrix, &mut right);
    let decrement = force.iter().zip(&right).map(|(f, d)| f * d).sum();
    (right, decrement)
}

fn solve(matrix: &mut [[f64; 3]], right: &mut [f64]) {
    let count = right.len();
    for i in 0..count {
        let row = matrix[i];
        for k in 1..3 {
            if i + k >= count {
                break;
            }
            let factor = row[k] / row[0];
            for l in k..3 {
                matrix[i + k][l - k] -= factor * row[l];
            }
            right[i + k] -= factor * right[i];
        }
    }
    for i in (0..count).rev() {
        for k in 1..3 {
            if i + k < count {
                right[i] -= matrix[i][k] * right[i + k];
            }
        }
        right[i] /= matrix[i][0];
    }
}

/// Derivatives of x, y and heading at the curve's control points and halfway between.
pub fn derivatives_of(curve: &PathCurve) -> Vec<Derivatives> {
    let step = 0.5;
    let places = 2 * curve.span_count();
    let at = |place: usize| {
        let point = curve.evaluate(place as f64 * step);
        let of = |values: &[f64; 7], scale: f64| [0, 1, 5].map(|c| values[c] * scale);
        [
            of(&point.first, step),
            of(&point.second, step * step),
            of(&point.third, step * step * step),
        ]
    };
    (0..=places).map(at).collect()
}

impl ReferenceLimits {
    /// What the plan may use of the built-in machine.
    pub fn of(settings: &Settings) -> Self {
        let share = settings.plan_share;
        Self {
            joints: [0, 1, 3].map(|joint| {
                let limit = &settings.machine.joints[joint];
                [limit.speed_max, limit.acceleration_max, limit.jerk_max].map(|max| max * share)
            }),
            tip: [settings.speed_mm_s, settings.tip_acceleration_mm_s2].map(|max| max * share),
        }
    }
}

/// Least time from rest to rest, s, within 0.2 %, by differences of the places given.
pub fn least_time_s(path: &[Derivatives], limits: &ReferenceLimits) -> f64 {
    let last = path.len() - 1;
    let rows: Vec<Vec<Row>> = path[1..last].iter().map(|d| rows_of(d, limits)).collect();
    // A slow start that is feasible: the shape that a bounded jerk gives near rests.
    let mut b: Vec<f64> = (0..=last)
        .map(|i| (i.min(last - i) as f64).min(50.0).powf(4.0 / 3.0))
        .collect();
    while barrier(&b, &rows, 0.0).is_infinite() {
        for b in &mut b {
            *b *= 0.5;
        }
    }
    let count: usize = rows.iter().map(Vec::len).sum();
    let mut weight = count as f64 / time_s(&b);
    while count as f64 / weight > 0.002 * time_s(&b) {
        for _ in 0..60 {
            let (step, decrement) = direction(&b, &rows, weight);
            let share = stepped(&mut b, &rows, weight, &step, decrement);
            if decrement < 1e-4 * count as f64 || share < 1e-8 {
                break;
            }
        }
        weight *= 4.0;
    }
    time_s(&b)
}

/// Goes as much of a step as lowers the barrier; how much that was.
fn stepped(b: &mut Vec<f64>, rows: &[Vec<Row>], weight: f64, step: &[f64], fall: f64) -> f64 {
    let last = b.len() - 1;
    let now = barrier(b, rows, weight);
    let mut share = 1.0;
    loop {
        let mut next = b.clone();
        for (next, step) in next[1..last].iter_mut().zip(step) {
            *next += share * step;
        }
        let is_lower = barrier(&next, rows, weight) <= now - 0.1 * share * fall;
        if is_lower || share < 1e-9 {
            *b = next;
            return share;
        }
        share *= 0.6;
    }
}
