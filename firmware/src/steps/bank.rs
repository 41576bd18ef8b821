//! One servo interval for all motors, written by the programmer and played by the engine.
//!
//! There are two: while one plays the next is written into the other. A bank is self-contained (it
//! begins at the phase where the previous one ends, which the programmer knows), so that a change
//! of banks moves nothing.

use super::{INTERVAL_TICKS_MAX, Stopped};
use crate::configuration::MOTORS_MAX;

/// One motor as it is played, 2^-31 steps and step ticks. In this order, so that the data written
/// each tick are adjacent.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub(super) struct Motor {
    /// Bit 31 is the parity of the count.
    pub(super) phase: u32,
    pub(super) velocity: i32,
    pub(super) acceleration: i32,
}

impl Motor {
    /// One step tick of a second-order integrator; bit 31 of the result means that a step is due.
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

    /// The displacement of this many more ticks, 2^-31 steps.
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

/// The direction bits change in the middle of an interval. In one word, which is quickly moved, and whose
/// order is that of the ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Turn(u32);

impl Turn {
    /// No turn.
    const NONE: Self = Self(0);

    #[inline(always)]
    fn new(ticks_left: u32, directions: u32) -> Self {
        Self(ticks_left << 8 | directions)
    }

    /// Ticks of the interval that are left when they do; 0 for no turn.
    #[inline(always)]
    pub(super) fn ticks_left(self) -> u32 {
        self.0 >> 8
    }

    /// All of them, from then on; while turns are put in order, those that change.
    #[inline(always)]
    pub(super) fn directions(self) -> u8 {
        self.0 as u8
    }
}

/// Places for turns: one for each motor and at least one more, a power of two, so that a masked
/// index needs no check.
pub(super) const TURNS: usize = (MOTORS_MAX + 1).next_power_of_two();

/// Inserts a reversal into its place among the earlier ones, or into one of the same tick. Returns
/// their number.
#[inline(always)]
fn insert(turns: &mut [Turn; TURNS], count: usize, mut new: Turn) -> usize {
    let mut place = 0;
    while place < count {
        let there = &mut turns[place % TURNS];
        if there.ticks_left() == new.ticks_left() {
            *there = Turn(there.0 | new.0);
            return count;
        }
        if *there < new {
            core::mem::swap(there, &mut new);
        }
        place += 1;
    }
    turns[count % TURNS] = new;
    count + 1
}

/// One interval.
#[derive(Clone, Debug, Default)]
// Fields that every tick uses are first.
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
        self.turns[0] != Turn::NONE
    }

    /// No motor turns round in this interval.
    #[inline(always)]
    pub(super) fn turn_nowhere(&mut self) {
        self.turns[0] = Turn::NONE;
    }

    /// Computes when each of the `reversing` motors reverses, in an interval of this many ticks.
    // Few intervals have a turn: its registers are not to be theirs.
    #[inline(never)]
    pub(super) fn plan_turns(&mut self, reversing: u8, interval_ticks: u32) {
        let mut count = 0;
        let mut left = u32::from(reversing);
        while left != 0 {
            let motor = left.trailing_zeros() as usize % MOTORS_MAX;
            left &= left - 1;
            let ticks = self.motors[motor].ticks_until_turn();
            // At least 1: the velocity of the last tick is already on the other side.
            let turn = Turn::new(interval_ticks.wrapping_sub(ticks), 1 << motor);
            count = insert(&mut self.turns, count, turn);
        }
        // With all directions from then on.
        let mut directions = self.directions;
        for place in 0..count {
            let turn = &mut self.turns[place % TURNS];
            directions ^= turn.directions();
            *turn = Turn::new(turn.ticks_left(), u32::from(directions));
        }
        self.turns[count % TURNS] = Turn::NONE;
    }

    /// Stops from here on.
    pub(super) fn stop(&mut self) {
        self.motors.iter_mut().for_each(Motor::stop);
        self.turns[0] = Turn::NONE;
    }

    /// The same, with this many ticks left: the part that is not played.
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

#[cfg(test)]
mod tests {
    //! Goal: the direction pins change in the tick in which each motor does. Method: random motors that all
    //! turn round, many of them in the same tick, against the sign of every tick's velocity.
    use super::*;

    #[test]
    fn turns_are_in_order_and_those_of_one_tick_are_one() {
        const TICKS: i32 = 100;
        let (mut state, mut merged) = (7u32, 0);
        let mut random = |below: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % below
        };
        for _ in 0..2000 {
            let mut bank = StepBank {
                directions: random(256) as u8,
                ..StepBank::default()
            };
            let mut reversing = 0u8;
            for (index, motor) in bank.motors.iter_mut().enumerate() {
                // Turns after 1 to 4 ticks, or after up to 99.
                let latest = if random(2) == 0 { 4 } else { TICKS as u32 - 1 };
                let after = 1 + random(latest) as i32;
                let acceleration = 2 + random(1000) as i32;
                motor.acceleration = acceleration;
                motor.velocity = 1 - acceleration * after;
                if random(2) == 0 {
                    (motor.acceleration, motor.velocity) =
                        (-acceleration, acceleration * after - 1);
                }
                reversing |= u8::from(random(3) > 0) << index;
            }
            bank.plan_turns(reversing, TICKS as u32);
            let (mut directions, mut turns) = (bank.directions, bank.turns.iter());
            let mut next = turns.next().copied().unwrap_or_default();
            for tick in 1..TICKS {
                let mut expected = directions;
                for (index, motor) in bank.motors.iter().enumerate() {
                    let at = |tick: i32| motor.velocity + tick * motor.acceleration;
                    let turns =
                        at(tick - 1) < 0 && at(tick) >= 0 || at(tick - 1) >= 0 && at(tick) < 0;
                    if reversing >> index & 1 != 0 && turns {
                        expected ^= 1 << index;
                    }
                }
                merged += u32::from((expected ^ directions).count_ones() > 1);
                if expected != directions {
                    assert_eq!(next, Turn::new((TICKS - tick) as u32, u32::from(expected)));
                    next = turns.next().copied().unwrap_or_default();
                }
                directions = expected;
            }
            assert_eq!(next, Turn::NONE);
        }
        assert!(merged > 500, "{merged}");
    }
}
