//! Plays step programs: the part that runs in the step interrupt.
//!
//! The next program is written into the bank that does not play, so that the tick in which the
//! intervals change only swaps the banks.

use super::{INTERVAL_TICKS_MAX, INTERVAL_TICKS_MIN, Rate, StepProgram, Stopped};
use crate::configuration::MOTORS_MAX;
use crate::output::StepOutput;

impl Rate {
    /// One step tick of a second-order integrator; bit 31 of the result says that a step is due.
    #[inline(always)]
    fn advance(&mut self, phase: &mut u32) -> u32 {
        let old = *phase;
        let new = old.wrapping_add(self.velocity as u32);
        *phase = new;
        self.velocity = self.velocity.wrapping_add(self.acceleration);
        old ^ new
    }
}

/// One interval, as it is played.
#[derive(Clone, Debug, Default)]
struct Bank {
    rates: [Rate; MOTORS_MAX],
    directions: u8,
    reversing: u8,
    active: u8,
    ready: bool,
    phases: Option<[u32; MOTORS_MAX]>,
    serial: u32,
}

/// Plays programs, one step tick at a time. On a board it belongs to the step interrupt.
#[derive(Clone, Debug)]
pub struct StepEngine {
    phases: [u32; MOTORS_MAX],
    banks: [Bank; 2],
    /// Which bank plays.
    second: bool,
    ticks_left: u32,
    directions: u8,
    /// Ticks that the last program was played for, if it is not playing any more.
    stopped_at: Option<u32>,
    interval_ticks: u32,
    /// Step tick at which the interval ends.
    interval_end_tick: u64,
    overruns: u32,
}

impl StepEngine {
    /// At rest; plays one idle interval first.
    pub fn new(interval_ticks: u32) -> Self {
        let interval_ticks = interval_ticks.clamp(INTERVAL_TICKS_MIN, INTERVAL_TICKS_MAX);
        Self {
            phases: [0; MOTORS_MAX],
            banks: Default::default(),
            second: false,
            ticks_left: interval_ticks,
            directions: 0,
            stopped_at: None,
            interval_ticks,
            interval_end_tick: u64::from(interval_ticks),
            overruns: 0,
        }
    }

    /// Hands over the next interval. It starts when the one that plays now has ended.
    pub fn load(&mut self, program: &StepProgram) {
        let [first, second] = &mut self.banks;
        let bank = if self.second { first } else { second };
        for (rate, track) in bank.rates.iter_mut().zip(&program.tracks) {
            *rate = track.rate;
        }
        bank.directions = program.directions;
        bank.reversing = program.reversing;
        bank.active = program.active;
        bank.phases = None;
        if let Some(phases) = &program.phases {
            bank.phases = Some(*phases);
        }
        bank.serial = program.serial;
        bank.ready = true;
    }

    #[inline(always)]
    fn playing(&self) -> &Bank {
        &self.banks[usize::from(self.second)]
    }

    /// How often an interval ended with no next one: the servo was late, or step ticks were lost.
    pub fn overruns(&self) -> u32 {
        self.overruns
    }

    /// True if a motor turns round within the interval that plays now.
    pub fn reverses(&self) -> bool {
        self.playing().reversing != 0
    }

    /// Step ticks since start-up.
    pub fn now_tick(&self) -> u64 {
        self.interval_end_tick - u64::from(self.ticks_left)
    }

    /// Stops at once, in the middle of an interval.
    pub fn stop(&mut self) -> Stopped {
        let serial = self.playing().serial;
        for bank in &mut self.banks {
            bank.rates = Default::default();
            bank.reversing = 0;
            bank.active = 0;
            bank.ready = false;
        }
        let played = self.interval_ticks - self.ticks_left;
        Stopped {
            ticks_played: *self.stopped_at.get_or_insert(played),
            serial,
        }
    }

    /// One step tick. Deadline on a board: one step period; nothing here waits or loops further
    /// than the motors.
    #[inline]
    pub fn tick<O: StepOutput>(&mut self, output: &mut O) {
        // Each motor's toggle enters at bit 31 and moves down: motor 0 ends in bit 24.
        let bank = &mut self.banks[usize::from(self.second)];
        let mut toggles = 0u32;
        for (rate, phase) in bank.rates.iter_mut().zip(&mut self.phases) {
            toggles = (toggles >> 1) | (rate.advance(phase) & 0x8000_0000);
        }
        let reversing = bank.reversing;
        let motors = (toggles >> 24) as u8;
        if motors != 0 {
            output.step(self.now_tick(), motors);
        }
        self.ticks_left -= 1;
        if self.ticks_left == 0 {
            self.next_interval(output);
        } else if reversing != 0 {
            self.turn(reversing, output);
        }
    }

    /// Sets the directions that the next tick's speeds need.
    fn turn<O: StepOutput>(&mut self, reversing: u8, output: &mut O) {
        let mut backward = 0u32;
        for rate in &self.playing().rates {
            backward = (backward >> 1) | (rate.velocity as u32 & 0x8000_0000);
        }
        let forward = !(backward >> 24) as u8;
        let turned = (forward ^ self.directions) & reversing;
        if turned != 0 {
            self.directions ^= turned;
            output.set_directions(self.directions);
        }
    }

    /// The rest of the interval at once, with the same calls as [`Self::tick`] would make: for the
    /// simulator, many times faster.
    pub fn run_interval<O: StepOutput>(&mut self, output: &mut O) {
        if self.reverses() {
            for _ in 0..self.ticks_left {
                self.tick(output);
            }
            return;
        }
        let mut due = [0u8; INTERVAL_TICKS_MAX as usize];
        let due = due.get_mut(..self.ticks_left as usize).unwrap_or_default();
        let bank = &mut self.banks[usize::from(self.second)];
        let active = bank.active;
        for (motor, (rate, phase)) in bank.rates.iter_mut().zip(&mut self.phases).enumerate() {
            if active >> motor & 1 == 1 {
                for slot in due.iter_mut() {
                    *slot |= ((rate.advance(phase) >> 31) as u8) << motor;
                }
            } else {
                rate.skip(phase, due.len() as u32);
            }
        }
        let first_tick = self.now_tick();
        if active != 0 {
            for (tick, &motors) in due.iter().enumerate() {
                if motors != 0 {
                    output.step(first_tick + tick as u64, motors);
                }
            }
        }
        self.next_interval(output);
    }

    fn next_interval<O: StepOutput>(&mut self, output: &mut O) {
        self.ticks_left = self.interval_ticks;
        self.interval_end_tick += u64::from(self.interval_ticks);
        let [first, second] = &mut self.banks;
        let next = if self.second { first } else { second };
        if !next.ready {
            self.stopped_at.get_or_insert(self.interval_ticks);
            self.stop();
            self.overruns = self.overruns.saturating_add(1);
            return;
        }
        next.ready = false;
        if let Some(phases) = next.phases {
            self.phases = phases;
        }
        let directions = next.directions;
        self.second = !self.second;
        self.stopped_at = None;
        if self.directions != directions {
            self.directions = directions;
            output.set_directions(directions);
        }
    }
}

impl Rate {
    /// Many step ticks of a motor that is known to take no step in them.
    fn skip(&mut self, phase: &mut u32, ticks: u32) {
        let triangle = ticks.wrapping_mul(ticks.wrapping_sub(1)) / 2;
        *phase = phase
            .wrapping_add((self.velocity as u32).wrapping_mul(ticks))
            .wrapping_add((self.acceleration as u32).wrapping_mul(triangle));
    }
}
