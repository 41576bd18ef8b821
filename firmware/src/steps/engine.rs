//! Plays step programs: the part that runs in the step interrupt.
//!
//! The next program is written into the bank that does not play. In the last tick of an interval
//! the phases go there instead of back, so that the change of banks costs next to nothing.

use super::{INTERVAL_TICKS_MAX, INTERVAL_TICKS_MIN, Rate, StepProgram, Stopped};
use crate::configuration::MOTORS_MAX;
use crate::output::StepOutput;

/// One motor as it is played, 2^-31 steps and step ticks. In this order, so that what is written
/// each tick lies side by side.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
struct Motor {
    phase: u32,
    velocity: i32,
    acceleration: i32,
}

impl Motor {
    /// The phase after one step tick of a second-order integrator.
    #[inline(always)]
    fn next_phase(&self) -> u32 {
        self.phase.wrapping_add(self.velocity as u32)
    }

    /// One step tick; bit 31 of the result says that a step is due.
    #[inline(always)]
    fn advance(&mut self) -> u32 {
        let (old, new) = (self.phase, self.next_phase());
        self.phase = new;
        self.velocity = self.velocity.wrapping_add(self.acceleration);
        old ^ new
    }

    /// Many step ticks of a motor that is known to take no step in them.
    fn skip(&mut self, ticks: u32) {
        let triangle = ticks.wrapping_mul(ticks.wrapping_sub(1)) / 2;
        self.phase = self
            .phase
            .wrapping_add((self.velocity as u32).wrapping_mul(ticks))
            .wrapping_add((self.acceleration as u32).wrapping_mul(triangle));
    }

    fn set(&mut self, rate: Rate) {
        self.velocity = rate.velocity;
        self.acceleration = rate.acceleration;
    }
}

/// One interval, as it is played.
#[derive(Clone, Debug, Default)]
struct Bank {
    motors: [Motor; MOTORS_MAX],
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
        for (motor, track) in bank.motors.iter_mut().zip(&program.tracks) {
            motor.set(track.rate);
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

    /// Step ticks of an interval.
    pub fn interval_ticks(&self) -> u32 {
        self.interval_ticks
    }

    /// Step ticks since start-up.
    pub fn now_tick(&self) -> u64 {
        self.interval_end_tick - u64::from(self.ticks_left)
    }

    /// Stops at once, in the middle of an interval.
    pub fn stop(&mut self) -> Stopped {
        let serial = self.playing().serial;
        for bank in &mut self.banks {
            for motor in &mut bank.motors {
                motor.set(Rate::default());
            }
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
    #[inline(always)]
    pub fn tick<O: StepOutput>(&mut self, output: &mut O) {
        if self.ticks_left == 1 {
            self.last_tick(output);
            return;
        }
        // The last motor first: each toggle moves the mask up, so that motor 0 ends in bit 0.
        let bank = &mut self.banks[usize::from(self.second)];
        let mut motors = 0;
        if bank.reversing == 0 {
            for motor in bank.motors.iter_mut().rev() {
                motors = motors << 1 | motor.advance() >> 31;
            }
            self.step(motors, output);
        } else {
            let (mut backward, reversing) = (0, bank.reversing);
            for motor in bank.motors.iter_mut().rev() {
                motors = motors << 1 | motor.advance() >> 31;
                backward = backward << 1 | motor.velocity as u32 >> 31;
            }
            self.step(motors, output);
            // The directions that the next tick's speeds need.
            let turned = (!backward as u8 ^ self.directions) & reversing;
            if turned != 0 {
                self.directions ^= turned;
                output.set_directions(self.directions);
            }
        }
        self.ticks_left -= 1;
    }

    #[inline(always)]
    fn step<O: StepOutput>(&self, motors: u32, output: &mut O) {
        if motors != 0 {
            output.step(self.now_tick(), motors as u8);
        }
    }

    /// The last tick of an interval: the phases go to the next one's bank.
    #[inline(always)]
    fn last_tick<O: StepOutput>(&mut self, output: &mut O) {
        let [first, second] = &mut self.banks;
        let (bank, next) = if self.second {
            (second, first)
        } else {
            (first, second)
        };
        let mut motors = 0;
        for (motor, after) in bank.motors.iter().zip(&mut next.motors).rev() {
            after.phase = motor.next_phase();
            motors = motors << 1 | (motor.phase ^ after.phase) >> 31;
        }
        self.step(motors, output);
        self.next_interval(output);
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
        let [first, second] = &mut self.banks;
        let (bank, next) = if self.second {
            (second, first)
        } else {
            (first, second)
        };
        let active = bank.active;
        let motors = bank.motors.iter_mut().zip(&mut next.motors).enumerate();
        for (index, (motor, after)) in motors {
            if active >> index & 1 == 1 {
                for slot in due.iter_mut() {
                    *slot |= ((motor.advance() >> 31) as u8) << index;
                }
            } else {
                motor.skip(due.len() as u32);
            }
            after.phase = motor.phase;
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

    /// Changes the banks; the phases are in the next one already.
    #[inline]
    fn next_interval<O: StepOutput>(&mut self, output: &mut O) {
        self.ticks_left = self.interval_ticks;
        self.interval_end_tick += u64::from(self.interval_ticks);
        let next = &mut self.banks[usize::from(!self.second)];
        if !next.ready {
            self.overrun();
            return;
        }
        next.ready = false;
        if let Some(phases) = next.phases {
            for (motor, phase) in next.motors.iter_mut().zip(phases) {
                motor.phase = phase;
            }
        }
        let directions = next.directions;
        self.second = !self.second;
        self.stopped_at = None;
        if self.directions != directions {
            self.directions = directions;
            output.set_directions(directions);
        }
    }

    /// Nothing to play: the motors stop where the interval ended.
    #[cold]
    fn overrun(&mut self) {
        let [first, second] = &mut self.banks;
        let (bank, next) = if self.second {
            (second, first)
        } else {
            (first, second)
        };
        for (motor, after) in bank.motors.iter_mut().zip(&next.motors) {
            motor.phase = after.phase;
        }
        self.stopped_at.get_or_insert(self.interval_ticks);
        self.stop();
        self.overruns = self.overruns.saturating_add(1);
    }
}
