//! Joint targets at the servo rate -> steps at the step rate, in fixed point.
//!
//! In: targets of the joints and of the extruder, each servo tick. Out: steps and directions at a
//! [`output::StepOutput`], delayed as shapers and pressure advance require (`delay`), for motors that are joints,
//! pairs or copies (`motor_mix`).
//!
//! Positions are i64 in 2^-31 steps. Every servo tick a [`StepProgrammer`] turns the targets of
//! four successive servo ticks into the program of a [`StepBank`]: one parabola per motor for the
//! interval between the middle two, p(t) = q1 + (q2 - q1) t + A/2 t (t - 1), A = the mean of the
//! second differences at both ends, so that speed is nearly continuous and the ends are hit. The
//! [`StepEngine`] plays it with two additions per motor and step tick: `phase += v; v += a`, a step
//! where bit 31 toggles. A step is due when the position crosses n + 1/2 and is made in the last
//! tick before that, half a tick early on average; that half tick belongs to the constant delay
//! (`design::motion_delay_s`).
//!
//! The step tick has no counter: the programmer computes the exact count by formula, and starts
//! every interval from the real end of the last one, so rounding never accumulates.
//!
//! Source: the parabola is the quadratic through the averaged second difference (Catmull-Rom
//! slopes give the same to second order); phase accumulators as in direct digital synthesis.

mod bank;
pub mod delay;
mod engine;
mod interval;
pub mod motor_mix;
pub mod output;
mod player;
mod programmer;
mod shaper;
pub mod shaping;
mod track;
mod waiting_targets;

pub use bank::StepBank;
pub use engine::{Moment, StepEngine};
pub use player::StepPlayer;
pub use programmer::{NewTargets, StepProgrammer, StepRateExceeded};
pub use waiting_targets::{Places, WAIT_TICKS_MAX, WaitingTargets};

use crate::configuration::MOTORS_MAX;
use crate::design::STEP_THRESHOLD_BIAS;

/// Fraction bits of a position in steps.
pub const POSITION_FRACTION_BITS: u32 = 31;
/// One step.
pub const STEP: i64 = 1 << POSITION_FRACTION_BITS;
/// Maximum step ticks of a servo interval: its displacement, shifted by `WAY_SHIFT`, fits 32 bits.
pub const INTERVAL_TICKS_MAX: u32 = 256;
/// Fewest: the reciprocals fit 32 bits.
pub const INTERVAL_TICKS_MIN: u32 = 65;

/// Fraction bits of [`StepScale`].
const SCALE_BITS: u32 = 60;
/// Those of them that a position does not have.
const REST_BITS: u32 = SCALE_BITS - POSITION_FRACTION_BITS;
const REST_MASK: i64 = (1 << REST_BITS) - 1;

/// Converts channel units to positions in 2^-31 steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepScale {
    /// 2^-31 steps per channel unit, rounded down.
    per_unit: i64,
    /// What is left, 2^-60 steps.
    per_unit_rest: i32,
    /// Steps per channel unit, for offsets.
    per_unit_single: f32,
}

/// An integer number of units as a position, exact after any number of moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScaledUnits {
    /// 2^-31 steps, rounded down.
    pub position: i64,
    /// What is left, 2^-60 steps.
    rest: i32,
}

impl StepScale {
    /// `steps_per_unit`: motor steps per channel unit, below 4.
    pub fn new(steps_per_unit: f64) -> Self {
        const ONE: f64 = (1u64 << SCALE_BITS) as f64;
        let scaled = steps_per_unit * ONE;
        let half = if scaled < 0.0 { -0.5 } else { 0.5 };
        let whole = (scaled + half) as i64;
        Self {
            per_unit: whole >> REST_BITS,
            per_unit_rest: (whole & REST_MASK) as i32,
            per_unit_single: steps_per_unit as f32,
        }
    }

    /// For units coarser by two to this power, exactly: a count of them is at the same position as the equivalent
    /// count of base units. They must be below 4 steps too.
    #[must_use]
    pub fn coarser(&self, exponent: u8) -> Self {
        let whole = (self.per_unit << REST_BITS) | i64::from(self.per_unit_rest);
        let whole = whole << exponent;
        Self {
            per_unit: whole >> REST_BITS,
            per_unit_rest: (whole & REST_MASK) as i32,
            per_unit_single: self.per_unit_single * (1u32 << exponent) as f32,
        }
    }

    /// Exact position of an integer number of units.
    pub fn scaled(&self, units: i64) -> ScaledUnits {
        let per_unit = (i128::from(self.per_unit) << REST_BITS) + i128::from(self.per_unit_rest);
        let product = i128::from(units) * per_unit;
        ScaledUnits {
            position: (product >> REST_BITS) as i64,
            rest: (product as i64 & REST_MASK) as i32,
        }
    }

    /// A position moved by a number of units: the same as scaling the sum, at a quarter of the
    /// instructions.
    #[inline]
    pub fn advanced(&self, from: &ScaledUnits, units: i32) -> ScaledUnits {
        let rest = i64::from(units) * i64::from(self.per_unit_rest) + i64::from(from.rest);
        let whole = self.per_unit.wrapping_mul(i64::from(units));
        ScaledUnits {
            position: (from.position.wrapping_add(whole)).wrapping_add(rest >> REST_BITS),
            rest: (rest & REST_MASK) as i32,
        }
    }

    /// A small offset in steps.
    #[inline]
    pub fn steps(&self, units: f32) -> f32 {
        units * self.per_unit_single
    }
}

/// A number of steps as a position. Whole and fraction go separately, because the conversion to
/// 64 bits is slow software on a Cortex-M4F.
#[inline]
pub fn steps_to_position(steps: f32) -> i64 {
    let whole = steps as i32;
    let fraction = steps - whole as f32;
    (i64::from(whole) << POSITION_FRACTION_BITS) + i64::from((fraction * STEP as f32) as i32)
}

/// Bits that a [`Target`] has less than a position.
pub(crate) const TARGET_SHIFT: u32 = 9;
/// Fraction bits of a target: 2^-22 step.
const TARGET_FRACTION_BITS: u32 = POSITION_FRACTION_BITS - TARGET_SHIFT;

/// Fraction bits of a short displacement.
const NEAR_FRACTION_BITS: u32 = 16;
/// One step as a short displacement.
pub const NEAR_STEP: f32 = (1 << NEAR_FRACTION_BITS) as f32;
/// Maximum displacement in steps for [`Target::moved_near`].
pub const NEAR_STEPS_MAX: f32 = 32_000.0;

/// One step as a difference of targets, a displacement.
pub(crate) const ONE_STEP_WAY: f64 = (1u32 << TARGET_FRACTION_BITS) as f64;

/// A motor's target, in two words for speed: with `BIAS`, so that its integer part is the count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Target {
    /// Whole steps; may be one off.
    pub whole: i32,
    /// 2^-22 steps, wrapping at 1024 steps.
    fine: i32,
}

impl Target {
    /// Of a position in 2^-31 steps.
    #[inline]
    pub fn of_position(position: i64) -> Self {
        let biased = position.wrapping_add(BIAS);
        Self {
            whole: (biased >> POSITION_FRACTION_BITS) as i32,
            fine: (biased >> TARGET_SHIFT) as i32,
        }
    }

    /// The fine part: 2^-22 steps, wrapping at 1024 steps.
    #[cfg(test)]
    pub(crate) fn fine(self) -> i32 {
        self.fine
    }

    /// Replaces it by a new target. Returns the distance from the old one in whole steps, minus one
    /// if it is lower, to be combined by bitwise OR with that of other motors.
    #[inline(always)]
    pub fn replace(&mut self, new: Self) -> u32 {
        let jump = new.whole.wrapping_sub(self.whole);
        *self = new;
        (jump ^ (jump >> 31)) as u32
    }

    /// Moved by a number of steps, up to a million.
    #[inline(always)]
    pub fn moved(self, steps: f32) -> Self {
        let whole = steps as i32;
        let fraction = ((steps - whole as f32) * (1 << TARGET_FRACTION_BITS) as f32) as i32;
        let fine = self.fine.wrapping_add(whole << TARGET_FRACTION_BITS);
        Self {
            whole: self.whole.wrapping_add(whole),
            fine: fine.wrapping_add(fraction),
        }
    }

    /// Moved by up to [`NEAR_STEPS_MAX`], in 2^-16 step: at half the instructions.
    #[inline(always)]
    pub fn moved_near(self, way: f32) -> Self {
        let way = way as i32;
        Self {
            whole: self.whole.wrapping_add(way >> NEAR_FRACTION_BITS),
            fine: (self.fine).wrapping_add(way << (TARGET_FRACTION_BITS - NEAR_FRACTION_BITS)),
        }
    }

    /// A distance of this many 2^-31 steps, to be added to a target.
    #[inline]
    pub fn of_distance(distance: i64) -> Self {
        Self {
            whole: (distance >> POSITION_FRACTION_BITS) as i32,
            fine: (distance >> TARGET_SHIFT) as i32,
        }
    }

    /// Moved by a distance.
    #[inline(always)]
    pub fn plus(self, distance: Self) -> Self {
        Self {
            whole: self.whole.wrapping_add(distance.whole),
            fine: self.fine.wrapping_add(distance.fine),
        }
    }

    /// In 2^-16 steps, wrapping, from the same place for all targets.
    #[inline(always)]
    pub fn coarse(self) -> i32 {
        const BITS: u32 = 16;
        let above_whole = self.fine.wrapping_sub(self.whole << TARGET_FRACTION_BITS);
        (self.whole << BITS).wrapping_add(above_whole >> (TARGET_FRACTION_BITS - BITS))
    }

    /// As a distance, 2^-31 steps.
    pub fn distance(self) -> i64 {
        let above_whole = self.fine.wrapping_sub(self.whole << TARGET_FRACTION_BITS);
        (i64::from(self.whole) << POSITION_FRACTION_BITS)
            .wrapping_add(i64::from(above_whole) << TARGET_SHIFT)
    }

    /// The position, 2^-31 steps.
    pub fn position(self) -> i64 {
        self.distance().wrapping_sub(BIAS)
    }
}

/// Added to a position so that its whole part is the count, and bit 31 of it the engine's phase.
const BIAS: i64 = STEP / 2 + STEP_THRESHOLD_BIAS;
/// The same in a fine target.
pub(crate) const FINE_BIAS: i32 = (BIAS >> TARGET_SHIFT) as i32;

/// The whole number of steps at a position: rounded to nearest, halves up.
pub fn count(position: i64) -> i64 {
    position.wrapping_add(BIAS) >> POSITION_FRACTION_BITS
}

/// Where the engine was stopped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stopped {
    /// What was left of the program that played, 2^-31 steps.
    unplayed: [i64; MOTORS_MAX],
    /// Its number.
    serial: u32,
}

#[cfg(test)]
mod tests;
