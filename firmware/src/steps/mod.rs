//! Joint targets at the servo rate -> steps at the step rate, in fixed point.
//!
//! Positions are i64 in 2^-31 steps. Every servo tick a [`StepProgrammer`] turns the targets of
//! four successive servo ticks into a [`StepProgram`]: one parabola per motor for the interval
//! between the middle two,
//! p(t) = q1 + (q2 - q1) t + A/2 t (t - 1), A = the mean of the second differences at both ends,
//! so that speed is nearly continuous and the ends are hit. The [`StepEngine`] plays it with two
//! additions per motor and step tick: `phase += v; v += a`, a step where bit 31 toggles. A step is
//! due when the position crosses n + 1/2 and comes in the last tick before that, half a tick early
//! on average; that half tick belongs to the constant delay (`design::motion_delay_s`).
//!
//! No counter runs in the step tick: the programmer knows the exact count by formula, and aims
//! every interval from where the last one really ended, so rounding never adds up.
//!
//! Source: the parabola is the quadratic through the averaged second difference (Catmull-Rom
//! slopes give the same to second order); phase accumulators as in direct digital synthesis.

mod engine;
mod programmer;

pub use engine::StepEngine;
pub use programmer::{StepProgrammer, StepRateExceeded};

use crate::configuration::MOTORS_MAX;
use crate::design::STEP_THRESHOLD_BIAS;

/// Fraction bits of a position in steps.
pub const POSITION_FRACTION_BITS: u32 = 31;
/// One step.
pub const STEP: i64 = 1 << POSITION_FRACTION_BITS;
/// Most step ticks of a servo interval: its way, cut by [`WAY_SHIFT`], fits 32 bits.
pub const INTERVAL_TICKS_MAX: u32 = 256;
/// Fewest: the reciprocals fit 32 bits.
pub const INTERVAL_TICKS_MIN: u32 = 65;

/// Converts channel units to positions in 2^-31 steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepScale {
    /// Steps per channel unit, 60 fraction bits.
    per_unit_q60: i64,
    /// The same for offsets.
    per_unit: f32,
}

impl StepScale {
    /// `steps_per_unit`: motor steps per channel unit (0.1 µm, µrad, 10⁻⁶ mm³), below 4.
    pub fn new(steps_per_unit: f64) -> Self {
        const ONE_Q60: f64 = (1u64 << 60) as f64;
        let scaled = steps_per_unit * ONE_Q60;
        let half = if scaled < 0.0 { -0.5 } else { 0.5 };
        Self {
            per_unit_q60: (scaled + half) as i64,
            per_unit: steps_per_unit as f32,
        }
    }

    /// Exact position of an integer number of units, to the last of its 31 fraction bits.
    pub fn position(&self, units: i64) -> i64 {
        let product = i128::from(units) * i128::from(self.per_unit_q60);
        (product >> (60 - POSITION_FRACTION_BITS)) as i64
    }

    /// Position of a small offset in units.
    #[inline]
    pub fn offset(&self, units: f32) -> i64 {
        steps_to_position(units * self.per_unit)
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

/// The whole number of steps at a position: rounded to nearest, halves up.
pub fn count(position: i64) -> i64 {
    biased(position) >> POSITION_FRACTION_BITS
}

/// The position whose whole part is the count.
#[inline]
fn biased(position: i64) -> i64 {
    position + (STEP / 2 + STEP_THRESHOLD_BIAS)
}

/// The engine's phase at a position: bit 31 is the parity of the count.
fn phase(position: i64) -> u32 {
    biased(position) as u32
}

/// One servo interval for all motors, in 2^-31 steps and step ticks.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StepProgram {
    velocity: [i32; MOTORS_MAX],
    acceleration: [i32; MOTORS_MAX],
    /// Direction bits at the interval's start.
    directions: u8,
    /// Motors whose direction changes within the interval.
    reversing: u8,
    /// Motors that take steps or reverse.
    active: u8,
    /// Phases to take over at the start: the position was declared anew, at rest.
    phases: Option<[u32; MOTORS_MAX]>,
    /// Number of the program, to find it again after a stop.
    serial: u32,
}

/// Where the engine was stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stopped {
    /// Ticks of the interval that were played.
    pub ticks_played: u32,
    /// Program that was being played.
    serial: u32,
}

impl StepProgram {
    /// Cleared for a new interval; velocities and accelerations are all written anew.
    fn begin(&mut self, serial: u32) {
        self.serial = serial;
        self.reversing = 0;
        self.active = 0;
        self.phases = None;
    }

    #[inline]
    fn set_direction(
        &mut self,
        directions: &mut u8,
        motor: usize,
        (velocity, last): (i32, i32),
        moves: bool,
    ) {
        let bit = 1u8 << motor;
        let reversing = (velocity ^ last) < 0;
        if reversing {
            self.reversing |= bit;
        }
        // A motor that only creeps within one count keeps its direction pin.
        if reversing || moves {
            self.active |= bit;
            if velocity < 0 {
                *directions &= !bit;
            } else {
                *directions |= bit;
            }
        }
    }
}

#[cfg(test)]
mod tests;
