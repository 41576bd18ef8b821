//! The smoothest heading profile in a corridor of feasible headings.
//!
//! Input: for each sample of a run the heading wanted of it, the interval that may be used instead,
//! and the way to the next sample. Output: the profile x that makes
//! sum(bend² way) + sum(pull (x - wanted)² way) + sum(wall dist(x, interval)² way) least, where
//! bend is the second difference of x by the way: a taut spline between the corridor's walls. A
//! heading axis is held back by its acceleration long before its speed (v² |bend|), so the bend
//! counts.
//!
//! Method: semi-smooth Newton. For a given set of samples beyond their walls the sum is quadratic,
//! one pentadiagonal system; the set is found again until it stays. Sequential, so the same for
//! any number of threads; time is linear in the samples.
//! Left out: the walls are springs, so that x may lie past them by a little.

/// One sample of the corridor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate {
    /// Heading wanted.
    pub wanted_rad: f64,
    /// Least and largest heading that may be used.
    pub range_rad: [f64; 2],
    /// Way from this sample to the next, mm, above 0.
    pub way_mm: f64,
}

/// What departing from the wanted heading costs against bending.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffness {
    /// Inside the corridor, mm⁻⁴.
    pub pull: f64,
    /// Beyond its walls, mm⁻⁴.
    pub wall: f64,
}

impl Stiffness {
    /// The same as wave lengths: bend and departure are in balance at 2 pi / stiffness^(1/4).
    pub fn of_waves(pull_mm: f64, wall_mm: f64) -> Stiffness {
        let of = |wave_mm: f64| (std::f64::consts::TAU / wave_mm).powi(4);
        Stiffness {
            pull: of(pull_mm),
            wall: of(wall_mm),
        }
    }
}

/// Rounds of finding the samples beyond their walls; the set settles in a few.
const ROUNDS_MAX: usize = 24;
/// Samples with which a closed run is lengthened at both ends, so that its seam is like any place.
const SEAM_SAMPLES: usize = 400;

/// The smoothest profile of an open run.
pub fn smoothest(gates: &[Gate], stiffness: Stiffness) -> Vec<f64> {
    let wanted: Vec<f64> = gates.iter().map(|g| g.wanted_rad).collect();
    if gates.len() < 4 {
        return wanted;
    }
    let bends = bend_weights(gates);
    let mut beyond = vec![Side::Within; gates.len()];
    let mut found = wanted;
    for _ in 0..ROUNDS_MAX {
        found = solve(gates, &bends, &beyond, stiffness);
        let now: Vec<Side> = gates
            .iter()
            .zip(&found)
            .map(|(gate, &x)| Side::of(gate, x))
            .collect();
        if now == beyond {
            break;
        }
        beyond = now;
    }
    found
}

/// The smoothest profile of a closed run whose heading turns by `lap_rad` over a lap.
pub fn smoothest_closed(gates: &[Gate], lap_rad: f64, stiffness: Stiffness) -> Vec<f64> {
    let count = gates.len();
    let pad = SEAM_SAMPLES.min(count);
    let turned = |gate: &Gate, by_rad: f64| Gate {
        wanted_rad: gate.wanted_rad + by_rad,
        range_rad: gate.range_rad.map(|r| r + by_rad),
        ..*gate
    };
    let long: Vec<Gate> = gates[count - pad..]
        .iter()
        .map(|g| turned(g, -lap_rad))
        .chain(gates.iter().copied())
        .chain(gates[..pad].iter().map(|g| turned(g, lap_rad)))
        .collect();
    let found = smoothest(&long, stiffness);
    found[pad..pad + count].to_vec()
}

/// Where a heading lies against its corridor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Below,
    Within,
    Above,
}

impl Side {
    fn of(gate: &Gate, x: f64) -> Side {
        if x < gate.range_rad[0] {
            Side::Below
        } else if x > gate.range_rad[1] {
            Side::Above
        } else {
            Side::Within
        }
    }
}

/// Factors of x[i - 1], x[i], x[i + 1] in the bend at each inner sample, times the root of the way
/// it stands for.
fn bend_weights(gates: &[Gate]) -> Vec<[f64; 3]> {
    (1..gates.len() - 1)
        .map(|i| {
            let (before, after) = (gates[i - 1].way_mm, gates[i].way_mm);
            let own = 0.5 * (before + after);
            let scale = own.sqrt() / own;
            let (b, a) = (scale / before, scale / after);
            [b, -(b + a), a]
        })
        .collect()
}

/// The profile for one set of samples beyond their walls: a symmetric positive definite system of
/// five diagonals, by LDLᵀ. Rows are made and eliminated in one go: only a few of them are looked
/// at again, and each waits for the division of the one before.
fn solve(gates: &[Gate], bends: &[[f64; 3]], beyond: &[Side], stiffness: Stiffness) -> Vec<f64> {
    let count = gates.len();
    // Of each row the diagonal and the factors of the next two.
    let mut rows: Vec<[f64; 3]> = Vec::with_capacity(count);
    let mut x: Vec<f64> = Vec::with_capacity(count);
    let bend_at = |i: Option<usize>| i.and_then(|i| bends.get(i)).copied().unwrap_or_default();
    // Of the two rows before: the factors, first and second off the diagonal, right side.
    let mut above = [[0.0; 5]; 2];
    for (i, gate) in gates.iter().enumerate() {
        let before = if i > 0 {
            gates[i - 1].way_mm
        } else {
            gate.way_mm
        };
        let own_mm = 0.5 * (before + gate.way_mm);
        let pull = stiffness.pull * own_mm;
        let wall = stiffness.wall * own_mm;
        let [low, high] = gate.range_rad;
        let (mut d, mut right) = (pull, pull * gate.wanted_rad);
        match beyond[i] {
            Side::Within => {}
            Side::Below => (d, right) = (d + wall, right + wall * low),
            Side::Above => (d, right) = (d + wall, right + wall * high),
        }
        let [_, _, back] = bend_at(i.checked_sub(2));
        let [_, own, next] = bend_at(i.checked_sub(1));
        let [first, second, third] = bend_at(Some(i));
        d = d + back * back + own * own + first * first;
        let mut l1 = own * next + first * second;
        let l2 = first * third;
        let [[_, f2, _, m2, x2], [f1, _, m1, n1, x1]] = above;
        d = d - f2 * m2 - f1 * m1;
        l1 -= f1 * n1;
        right = right - f2 * x2 - f1 * x1;
        rows.push([d, l1 / d, l2 / d]);
        x.push(right);
        above = [above[1], [l1 / d, l2 / d, l1, l2, right]];
    }
    for i in (0..count).rev() {
        let [d, f1, f2] = rows[i];
        let next = if i + 1 < count { f1 * x[i + 1] } else { 0.0 };
        let after = if i + 2 < count { f2 * x[i + 2] } else { 0.0 };
        x[i] = x[i] / d - next - after;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    const STIFFNESS: Stiffness = Stiffness {
        pull: 1e-3,
        wall: 1e6,
    };

    fn gates(count: usize, wanted: impl Fn(f64) -> f64, half_rad: f64) -> Vec<Gate> {
        (0..count)
            .map(|i| {
                let wanted_rad = wanted(i as f64 / count as f64);
                Gate {
                    wanted_rad,
                    range_rad: [wanted_rad - half_rad, wanted_rad + half_rad],
                    way_mm: 0.1,
                }
            })
            .collect()
    }

    fn bend_sum(x: &[f64]) -> f64 {
        x.windows(3)
            .map(|w| (w[0] - 2.0 * w[1] + w[2]).powi(2))
            .sum()
    }

    /// Goal: jitter within the corridor goes, the profile keeps inside, what need not bend is
    /// straight. Method: a slope with alternating noise half as large as the corridor.
    #[test]
    fn jitter_within_the_corridor_goes() {
        let mut gates = gates(300, |t| 2.0 * t, 0.05);
        for (i, gate) in gates.iter_mut().enumerate() {
            let noise = if i % 2 == 0 { 0.02 } else { -0.02 };
            gate.wanted_rad += noise;
            gate.range_rad = gate.range_rad.map(|r| r + noise);
        }
        let found = smoothest(&gates, STIFFNESS);
        let wanted: Vec<f64> = gates.iter().map(|g| g.wanted_rad).collect();
        assert!(bend_sum(&found) < 1e-4 * bend_sum(&wanted));
        for (gate, x) in gates.iter().zip(&found) {
            assert!(Side::of(gate, *x) == Side::Within, "{gate:?} {x}");
        }
    }

    /// Goal: a turn narrower than the corridor allows begins before it is due, never past the walls
    /// by more than the springs give. Method: a step of a quarter turn in a corridor of 0.1 rad.
    #[test]
    fn a_turn_begins_early_within_the_walls() {
        let gates = gates(200, |t| if t < 0.5 { 0.0 } else { PI / 2.0 }, 0.1);
        let found = smoothest(&gates, STIFFNESS);
        let before = found[..100].iter().fold(0.0f64, |most, x| most.max(*x));
        assert!(before > 0.08, "{before}");
        for (gate, x) in gates.iter().zip(&found) {
            assert!(*x > gate.range_rad[0] - 0.05 && *x < gate.range_rad[1] + 0.05);
        }
    }

    /// Goal: it is the least of its sum. Method: every perturbation of one sample makes it more.
    #[test]
    fn nothing_near_is_smoother() {
        let gates = gates(40, |t| (TAU * t).sin() + 0.05 * (40.0 * t).cos(), 0.03);
        let found = smoothest(&gates, STIFFNESS);
        let sum = |x: &[f64]| -> f64 {
            let bends = bend_weights(&gates);
            let bend: f64 = (0..bends.len())
                .map(|i| (0..3).map(|k| bends[i][k] * x[i + k]).sum::<f64>().powi(2))
                .sum();
            let departure = |(gate, x): (&Gate, &f64)| {
                let beyond = (gate.range_rad[0] - x).max(x - gate.range_rad[1]).max(0.0);
                gate.way_mm
                    * (STIFFNESS.pull * (x - gate.wanted_rad).powi(2)
                        + STIFFNESS.wall * beyond * beyond)
            };
            bend + gates.iter().zip(x).map(departure).sum::<f64>()
        };
        let least = sum(&found);
        for i in 0..found.len() {
            for step in [-1e-4, 1e-4] {
                let mut other = found.clone();
                other[i] += step;
                assert!(sum(&other) > least, "{i}");
            }
        }
    }

    /// Goal: a closed run has no seam. Method: the same ring begun at another place.
    #[test]
    fn a_ring_is_the_same_wherever_it_begins() {
        let ring = gates(500, |t| TAU * t + 0.3 * (5.0 * TAU * t).sin(), 0.02);
        let found = smoothest_closed(&ring, TAU, STIFFNESS);
        let mut turned = ring.clone();
        turned.rotate_left(200);
        for gate in &mut turned[300..] {
            gate.wanted_rad += TAU;
            gate.range_rad = gate.range_rad.map(|r| r + TAU);
        }
        let again = smoothest_closed(&turned, TAU, STIFFNESS);
        for i in 0..300 {
            assert!((found[200 + i] - again[i]).abs() < 1e-6, "{i}");
        }
    }
}
