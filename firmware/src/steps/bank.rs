//! One servo interval for all motors, as the programmer writes it and the engine plays it.
//!
//! There are two: while one plays the next is written into the other. A bank is whole in itself (it
//! begins at the phase where the one before it ends, which the programmer knows), so that a change
//! of banks moves nothing.

use super::{INTERVAL_TICKS_MAX, Stopped};
use crate::configuration::MOTORS_MAX;

/// One motor as it is played, 2^-31 steps and step ticks. In this order, so that what is written
/// each tick lies side by side.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub(super) struct Motor {
    /// Bit 31 is the parity of the count.
    pub(super) phase: u32,
    pub(super) velocity: i32,
    pub(super) acceleration: i32,
}

impl Motor {
    /// One step tick of a second-order integrator; bit 31 of the result says that a step is due.
    #[inline(always)]
    pub(super) fn advance(&mut self) -> u32 {
        let old = self.phase;
        self.phase = old.wrapping_add(self.velocity as u32);
        self.velocity = self.velocity.wrapping_add(self.acceleration);
        old ^ self.phase
    }

    /// True if it stays where it is.
    pub(super) fn rests(&self) -> bool {
        self.velocity == 0 && self.acceleration == 0
    }

    fn stop(&mut self) {
        self.velocity = 0;
        self.acceleration = 0;
    }

    /// What so many more ticks make, 2^-31 steps.
    fn way(&self, ticks: i32) -> i64 {
        let triangle = i64::from(ticks * (ticks - 1) / 2);
        i64::from(self.velocity) * i64::from(ticks) + i64::from(self.acceleration) * triangle
    }

    /// Ticks after which the velocity, which changes its sign within the interval, has done so: the
    /// least k with v + k a on the other side, 0 counting as forward.
    fn ticks_until_turn(&self) -> u32 {
        // |v|, less one where v is negative.
        let speed = (self.velocity ^ (self.velocity >> 31)) as u32;
        let ticks = speed.checked_div(self.acceleration.unsigned_abs());
        ticks.map_or(1, |ticks| ticks + 1)
    }
}

/// The direction bits change in the middle of an interval.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Turn {
    /// Ticks of the interval that are left when they do; 0 for no turn.
    pub(super) ticks_left: u32,
    /// All of them, from then on.
    pub(super) directions: u8,
}

/// Places for turns: one for each motor and at least one more, a power of two, so that a masked
/// index needs no check.
pub(super) const TURNS: usize = (MOTORS_MAX + 1).next_power_of_two();

/// One interval.
#[derive(Clone, Debug, Default)]
// What every tick uses comes first.
#[repr(C)]
pub struct StepBank {
    pub(super) motors: [Motor; MOTORS_MAX],
    /// In their order; after the last one an entry of 0 ticks.
    pub(super) turns: [Turn; TURNS],
    /// Direction bits at the start.
    pub(super) directions: u8,
    /// Number of the program.
    pub(super) serial: u32,
}

impl StepBank {
    /// True if a motor turns round within the interval.
    pub fn reverses(&self) -> bool {
        self.turns[0].ticks_left != 0
    }

    /// Says when which of the `reversing` motors turn round, in an interval so many ticks long.
    // Few intervals have a turn: its registers are not to be theirs.
    #[inline(never)]
    pub(super) fn plan_turns(&mut self, reversing: u8, interval_ticks: u32) {
        let turns = &mut self.turns;
        let mut count = 0;
        let mut left = reversing;
        while left != 0 {
            let motor = left.trailing_zeros() as usize % MOTORS_MAX;
            left &= left - 1;
            let ticks = self.motors[motor].ticks_until_turn();
            let ticks_left = interval_ticks.saturating_sub(ticks).max(1);
            // Into its place among those before it, with the bit that changes.
            let mut place = count;
            while place > 0 && turns[(place - 1) % TURNS].ticks_left < ticks_left {
                turns[place % TURNS] = turns[(place - 1) % TURNS];
                place -= 1;
            }
            turns[place % TURNS] = Turn {
                ticks_left,
                directions: 1 << motor,
            };
            count += 1;
        }
        // All that turn in the same tick as one, with all directions from then on.
        let (mut directions, mut last) = (self.directions, 0);
        for index in 0..count {
            let turn = turns[index % TURNS];
            directions ^= turn.directions;
            if index > 0 && turns[last].ticks_left != turn.ticks_left {
                last = (last + 1) % TURNS;
            }
            turns[last] = Turn { directions, ..turn };
        }
        turns[(last + 1) % TURNS].ticks_left = 0;
    }

    /// Stands still from here on.
    pub(super) fn stop(&mut self) {
        self.motors.iter_mut().for_each(Motor::stop);
        self.turns[0].ticks_left = 0;
    }

    /// The same, with so many ticks left: what is not played.
    pub(super) fn stopped(&mut self, ticks_left: u32) -> Stopped {
        let ticks_left = ticks_left.min(INTERVAL_TICKS_MAX) as i32;
        let stopped = Stopped {
            unplayed: self.motors.map(|motor| motor.way(ticks_left)),
            serial: self.serial,
        };
        self.stop();
        stopped
    }
}
