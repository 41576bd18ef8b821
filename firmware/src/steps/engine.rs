//! Plays step programs in the step interrupt.
//!
//! It counts the ticks and stores the state of the direction pins; the current bank is an argument.
//! The owner of the banks chooses the next one: [`super::StepPlayer`] in a single context, the
//! boards' runtime where servo and steps are interrupts of their own.

use super::bank::TURNS;
use super::{INTERVAL_TICKS_MAX, INTERVAL_TICKS_MIN, StepBank, Stopped};
use crate::configuration::MOTORS_MAX;
use crate::steps::output::StepOutput;
use core::sync::atomic::{Ordering, compiler_fence};

/// Events of a step tick other than steps, for the owner of the banks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// Nothing to do.
    Within,
    /// The first tick of an interval: the servo is due.
    Begun,
    /// The last but one: the next bank must be there now.
    Ending,
    /// The last one: [`StepEngine::begin`] or [`StepEngine::idle`] must follow in the same tick.
    Ended,
}

/// Plays one bank after another, one step tick at a time. Other work is spread over the ticks
/// around the change of banks, so that no tick has all of it.
#[derive(Clone, Debug)]
pub struct StepEngine {
    /// Ticks until something happens besides steps.
    until_event: u32,
    /// Step ticks that are left of the interval then.
    event_left: u32,
    /// Number of the next turn.
    turn: u32,
    interval_ticks: u32,
    /// Intervals that have begun.
    intervals: u32,
    directions: u8,
}

impl StepEngine {
    /// In the state before its first interval, which is idle.
    pub fn new(interval_ticks: u32) -> Self {
        let interval_ticks = interval_ticks.clamp(INTERVAL_TICKS_MIN, INTERVAL_TICKS_MAX);
        Self {
            until_event: 1,
            event_left: interval_ticks - 1,
            turn: 0,
            interval_ticks,
            intervals: 1,
            directions: 0,
        }
    }

    /// Step ticks of an interval.
    pub fn interval_ticks(&self) -> u32 {
        self.interval_ticks
    }

    /// Step ticks of the present interval that are left.
    #[inline(always)]
    pub(super) fn ticks_left(&self) -> u32 {
        self.until_event + self.event_left
    }

    /// Step ticks since start-up; from 0 again after 2^32 intervals (25 days).
    #[inline(always)]
    pub fn now_tick(&self) -> u64 {
        let end = u64::from(self.intervals) * u64::from(self.interval_ticks);
        end - u64::from(self.ticks_left())
    }

    /// One step tick. Deadline on a board: one step period; nothing here waits or loops further than
    /// the motors.
    #[inline(always)]
    pub fn tick<O: StepOutput>(&mut self, bank: &mut StepBank, output: &mut O) -> Moment {
        output.end_pulses();
        let mut signs = [0; MOTORS_MAX];
        for (sign, motor) in signs.iter_mut().zip(&mut bank.motors) {
            *sign = motor.advance();
            // A motor's words stay together, and are moved two or three at once: that is eight
            // instructions less than in the order that the compiler would choose.
            compiler_fence(Ordering::SeqCst);
        }
        output.begin_pulses_by_sign(self.now_tick(), &signs);
        self.until_event -= 1;
        if self.until_event != 0 {
            return Moment::Within;
        }
        match self.event_left {
            0 => Moment::Ended,
            left => self.turn(left, bank, output),
        }
    }

    /// Within the interval: motors may turn round, all that do in this tick.
    #[inline(always)]
    fn turn<O: StepOutput>(&mut self, left: u32, bank: &StepBank, output: &mut O) -> Moment {
        let mut next = bank.turns[self.turn as usize % TURNS];
        if next.ticks_left() == left {
            self.directions = next.directions();
            output.set_directions(next.directions());
            self.turn += 1;
            next = bank.turns[self.turn as usize % TURNS];
        }
        if left == 1 {
            self.event_in(1, 0);
            return Moment::Ending;
        }
        let next_left = next.ticks_left().max(1);
        self.event_in(left - next_left, next_left);
        if left + 1 == self.interval_ticks {
            Moment::Begun
        } else {
            Moment::Within
        }
    }

    #[inline(always)]
    fn event_in(&mut self, ticks: u32, left: u32) {
        self.until_event = ticks;
        self.event_left = left;
    }

    /// Begins an interval: `bank` plays from the next tick on.
    #[inline(always)]
    pub fn begin<O: StepOutput>(&mut self, bank: &StepBank, output: &mut O) {
        self.next_interval();
        if self.directions != bank.directions {
            self.directions = bank.directions;
            output.set_directions(bank.directions);
        }
    }

    /// Begins an interval without a program: the motors stop where the last one ended, in `bank`.
    #[cold]
    pub fn idle(&mut self, bank: &mut StepBank) {
        self.next_interval();
        bank.stop();
    }

    #[inline(always)]
    fn next_interval(&mut self) {
        self.event_in(1, self.interval_ticks - 1);
        self.turn = 0;
        self.intervals = self.intervals.wrapping_add(1);
    }

    /// Stops the current bank immediately, in the middle of its interval.
    pub fn stop(&mut self, bank: &mut StepBank) -> Stopped {
        bank.stopped(self.ticks_left())
    }
}
