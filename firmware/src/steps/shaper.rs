//! Shaped targets in the servo tick: a few taps of the delay line, in integers.
//!
//! A target is known modulo 1024 steps, so sums are over displacements from tick to tick and never over
//! targets: y = sum of A_k x(t - t_k) increases by the sum of A_k times the displacement at t_k, exactly,
//! since the weights are integers that add up to 2^30. An impulse between two ticks is split among them by
//! its position, which keeps the mean time. Averages work in the same way with weights 1, -2, 1 summed twice
//! more, minus the plain delay: the difference is 0 once all targets have left the line, so that rounding
//! never accumulates.
//! In: rows of the delay line. Out: 2^-22 steps. `steps/shaping.rs` gives the taps.

use crate::configuration::{JOINTS_MAX, MOTORS_MAX};
use crate::steps::delay::Delays;
use crate::steps::shaping::{IMPULSES_MAX, Shape};
use crate::steps::waiting_targets::{ROWS, Row};

/// Fraction bits of a weight.
const WEIGHT_BITS: u32 = 30;
const ONE: f64 = (1u32 << WEIGHT_BITS) as f64;

/// An impulse: a place in the line and what was last there.
#[derive(Clone, Copy, Debug, Default)]
struct Tap {
    back: usize,
    /// Weights of the displacement there and of the one a tick before it.
    near: i32,
    far: i32,
    last: i32,
    last_way: i32,
}

/// One motor's.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MotorShaper {
    motor: usize,
    taps: [Tap; IMPULSES_MAX],
    /// Impulses: y, 2^-52 steps. Averages: n² (y - what waited), 2^-22 steps.
    sum: i64,
    /// Averages: n² times the last displacement, 2^-22 steps, and its change.
    velocity: i64,
    bend: i64,
    /// What waited in the tick before.
    due: i32,
    /// n², 0 for impulses.
    square: i32,
    /// 2^(30 + cut) / n².
    per_square: i32,
    cut: u32,
}

impl MotorShaper {
    fn of_impulses(impulses: &[(f64, f64)], shift_ticks: f64) -> Self {
        let mut shaper = Self::default();
        let mut left = 1i32 << WEIGHT_BITS;
        for (tap, (weight, ticks)) in shaper.taps.iter_mut().zip(impulses) {
            let at = ticks + shift_ticks;
            let back = at as usize;
            let part = at - back as f64;
            tap.back = back;
            tap.far = (weight * part * ONE) as i32;
            tap.near = (weight * (1.0 - part) * ONE) as i32;
            left = left.wrapping_sub(tap.near).wrapping_sub(tap.far);
        }
        // What rounding down has left, so that they add up.
        shaper.taps[0].near = shaper.taps[0].near.wrapping_add(left);
        shaper
    }

    fn of_averages(ticks: u32, shift_ticks: f64) -> Self {
        let square = ticks.saturating_mul(ticks).clamp(1, 1 << 16);
        let cut = square.ilog2() + 1;
        let mut shaper = Self {
            square: square as i32,
            per_square: (ONE * f64::from(1u32 << cut) / f64::from(square)) as i32,
            cut,
            ..Self::default()
        };
        let first = shift_ticks as usize;
        for ((tap, weight), box_ends) in shaper.taps.iter_mut().zip([1, -2, 1]).zip(0..) {
            tap.back = first + box_ends * ticks as usize;
            tap.near = weight;
        }
        shaper
    }

    /// All rests at a target.
    fn rest(&mut self, row: &Row) {
        let fine = row[self.motor % MOTORS_MAX];
        for tap in &mut self.taps {
            tap.last = fine;
            tap.last_way = 0;
        }
        self.velocity = 0;
        self.bend = 0;
        self.due = fine;
        self.sum = match self.square {
            0 => i64::from(fine) << WEIGHT_BITS,
            _ => 0,
        };
    }

    /// Advances by a tick; `due` is the delayed target.
    #[inline(always)]
    fn follow(&mut self, rows: &[Row; ROWS], newest: usize, due: &mut Row) {
        let motor = self.motor % MOTORS_MAX;
        let mut grown = 0i64;
        for tap in &mut self.taps {
            let there = rows[newest.wrapping_sub(tap.back) % ROWS][motor];
            let way = there.wrapping_sub(tap.last);
            grown += i64::from(way) * i64::from(tap.near);
            grown += i64::from(tap.last_way) * i64::from(tap.far);
            tap.last = there;
            tap.last_way = way;
        }
        if self.square == 0 {
            self.sum = self.sum.wrapping_add(grown);
            due[motor] = (self.sum >> WEIGHT_BITS) as i32;
        } else {
            let waited = due[motor];
            let way = waited.wrapping_sub(self.due);
            self.due = waited;
            self.bend = self.bend.wrapping_add(grown);
            self.velocity = self.velocity.wrapping_add(self.bend);
            let off = self.velocity - i64::from(way) * i64::from(self.square);
            self.sum = self.sum.wrapping_add(off);
            let cut = i64::from((self.sum >> self.cut) as i32);
            let off = (cut * i64::from(self.per_square)) >> WEIGHT_BITS;
            due[motor] = waited.wrapping_add(off as i32);
        }
    }
}

/// Those of a machine.
#[derive(Clone, Debug)]
pub(super) struct Shapers {
    shapers: [MotorShaper; JOINTS_MAX],
    count: usize,
}

impl Shapers {
    /// Nothing is shaped.
    pub(super) const NONE: Self = Self {
        shapers: [MotorShaper {
            motor: 0,
            taps: [Tap {
                back: 0,
                near: 0,
                far: 0,
                last: 0,
                last_way: 0,
            }; IMPULSES_MAX],
            sum: 0,
            velocity: 0,
            bend: 0,
            due: 0,
            square: 0,
            per_square: 0,
            cut: 0,
        }; JOINTS_MAX],
        count: 0,
    };

    /// For a machine with this delay line.
    pub(super) fn new(shapes: &[Option<Shape>; JOINTS_MAX], delays: &Delays) -> Self {
        let mut shapers = Self::NONE;
        for (motor, shape) in shapes.iter().enumerate() {
            let Some(shape) = shape else { continue };
            // Never below 0: the line waits for the longest.
            let shift_ticks = f64::from(delays.line_ticks) - shape.delay_ticks();
            let made = match shape {
                Shape::Impulses(impulses) => MotorShaper::of_impulses(impulses, shift_ticks),
                Shape::Averages(ticks) => MotorShaper::of_averages(*ticks, shift_ticks),
            };
            if let Some(place) = shapers.shapers.get_mut(shapers.count) {
                *place = MotorShaper { motor, ..made };
                shapers.count += 1;
            }
        }
        shapers
    }

    /// True if no motor is shaped.
    pub(super) fn is_none(&self) -> bool {
        self.count == 0
    }

    /// All rest at a row.
    pub(super) fn rest(&mut self, row: &Row) {
        for shaper in &mut self.shapers {
            shaper.rest(row);
        }
    }

    /// Shapes what waited.
    #[inline(never)]
    pub(super) fn follow(&mut self, rows: &[Row; ROWS], newest: usize, due: &mut Row) {
        for shaper in self.shapers.iter_mut().take(self.count) {
            shaper.follow(rows, newest, due);
        }
    }
}

#[cfg(test)]
mod tests {
    //! Goal: a mean of a few places far apart is exact. Method: a steady motion far beyond where targets
    //! wrap, through every kind of tap.
    use super::*;

    #[test]
    fn a_steady_motion_comes_out_as_late_as_it_is_to_be() {
        let impulses = [(0.25, 0.0), (0.45, 20.3), (0.3, 41.7)];
        let delay_ticks: f64 = impulses.iter().map(|(a, t)| a * t).sum();
        for mut shaper in [
            MotorShaper::of_impulses(&impulses, 60.0 - delay_ticks),
            MotorShaper::of_averages(17, 60.0 - 16.0),
        ] {
            let mut rows = [[-5; MOTORS_MAX]; ROWS];
            shaper.rest(&rows[0]);
            // 60 steps a tick.
            let fine = |tick: i64| (tick.max(0) * (60 << 22) - 5) as i32;
            for tick in 0..5000i64 {
                let newest = tick as usize % ROWS;
                rows[newest][0] = fine(tick);
                let mut due = rows[newest.wrapping_sub(60) % ROWS];
                shaper.follow(&rows, newest, &mut due);
                if !(0..150).contains(&tick) {
                    let off = due[0].wrapping_sub(fine(tick - 60));
                    assert!(off.abs() < 40, "{tick}: {off} {shaper:?}");
                }
            }
        }
    }
}
