//! Engine and banks in one structure, for simulation: servo and steps alternate, without
//! interrupts.

use super::{INTERVAL_TICKS_MAX, Moment, StepBank, StepEngine, Stopped};
use crate::steps::output::StepOutput;

/// Plays the programs written into its idle bank.
#[derive(Clone, Debug)]
pub struct StepPlayer {
    engine: StepEngine,
    playing: StepBank,
    idle: StepBank,
    /// The idle bank has been handed over.
    handed: bool,
    overruns: u32,
    /// Where it was stopped, until the servo reads it.
    stopped: Option<Stopped>,
}

impl StepPlayer {
    /// At rest; plays one idle interval first.
    pub fn new(interval_ticks: u32) -> Self {
        Self {
            engine: StepEngine::new(interval_ticks),
            playing: StepBank::default(),
            idle: StepBank::default(),
            handed: false,
            overruns: 0,
            stopped: None,
        }
    }

    /// Returns the engine, for boards where it belongs to the step interrupt.
    pub fn into_engine(self) -> StepEngine {
        self.engine
    }

    /// The bank to write, and then to hand over ([`Self::hand_over`]).
    pub fn idle_bank(&mut self) -> &mut StepBank {
        &mut self.idle
    }

    /// The idle bank is written: it plays when the present interval has ended.
    pub fn hand_over(&mut self) {
        self.handed = true;
    }

    /// How often an interval ended with no next one.
    pub fn overruns(&self) -> u32 {
        self.overruns
    }

    /// Step ticks of an interval.
    pub fn interval_ticks(&self) -> u32 {
        self.engine.interval_ticks()
    }

    /// Stops immediately, in the middle of an interval.
    pub fn stop(&mut self) {
        self.handed = false;
        self.stopped = Some(self.engine.stop(&mut self.playing));
    }

    /// Positions of the motors at a stop, once.
    pub fn take_stopped(&mut self) -> Option<Stopped> {
        self.stopped.take()
    }

    /// One step tick.
    pub fn tick<O: StepOutput>(&mut self, output: &mut O) {
        if self.engine.tick(&mut self.playing, output) == Moment::Ended {
            self.next_interval(output);
        }
    }

    fn next_interval<O: StepOutput>(&mut self, output: &mut O) {
        if core::mem::take(&mut self.handed) {
            core::mem::swap(&mut self.playing, &mut self.idle);
            self.engine.begin(&self.playing, output);
        } else {
            self.engine.idle(&mut self.playing);
            self.overruns = self.overruns.saturating_add(1);
        }
    }

    /// Runs the rest of the interval at once, with the same calls as [`Self::tick`], many times
    /// faster.
    pub fn run_interval<O: StepOutput>(&mut self, output: &mut O) {
        if self.playing.reverses() {
            for _ in 0..self.engine.ticks_left() {
                self.tick(output);
            }
            return;
        }
        let mut due = [0u8; INTERVAL_TICKS_MAX as usize];
        let left = self.engine.ticks_left() as usize;
        let due = due.get_mut(..left).unwrap_or_default();
        for (index, motor) in self.playing.motors.iter_mut().enumerate() {
            if motor.rests() {
                continue;
            }
            for slot in due.iter_mut() {
                *slot |= ((motor.advance() >> 31) as u8) << index;
            }
        }
        let first_tick = self.engine.now_tick();
        for (tick, &motors) in due.iter().enumerate() {
            if motors != 0 {
                output.step(first_tick + tick as u64, motors);
            }
        }
        self.next_interval(output);
    }
}
