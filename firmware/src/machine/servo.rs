//! The servo tick, common to a board's interrupt and a simulation.
//!
//! ```text
//! what the steps have met -> inputs -> motion -> bank, handed over -> watchdog, drivers
//! ```
//! In: levels of the inputs, the steps' side of the hand-over ([`StepSide`]), the count of main-loop rounds. Out: the
//! program of the next interval; whether the watchdog may be fed and the drivers are energised. Not covered: the lock
//! by which a main loop accesses the motion, which the board provides.

use super::watchdog::ServoHealth;
use crate::motion::inputs::Inputs;
use crate::motion::{EMERGENCY, Motion};
use crate::steps::{StepBank, StepPlayer, Stopped};
use headway_protocol::message::{Fault, FaultCause};

/// Location of the bank that the servo writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handover {
    /// The servo's.
    Empty,
    /// Handed over, and not played yet.
    Handed,
    /// The steps were stopped: the servo has to find the motors.
    Stopped,
}

/// The steps as the servo sees them: on a board they interrupt it.
pub trait StepSide {
    /// The owner of the bank.
    fn handover(&self) -> Handover;
    /// Intervals that had no program.
    fn overruns(&self) -> u32;
    /// True once after the emergency input has stopped the steps.
    fn take_emergency(&mut self) -> bool;
    /// The bank to write, where it is [`Handover::Empty`].
    fn idle_bank(&mut self) -> &mut StepBank;
    /// It is written: it plays when the present interval has ended, unless the steps are stopped before.
    fn hand_over(&mut self);
    /// Stops the steps: no step follows.
    fn stop(&mut self);
    /// Tells, once, where the motors were when the steps were stopped.
    fn tell_stopped(&mut self, tell: impl FnOnce(&Stopped));
}

/// Result of a servo tick for its board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServoDone {
    /// The watchdog may be fed.
    pub healthy: bool,
    /// Motors whose drivers have to be energised, one bit each.
    pub held_motors: u8,
}

/// What the servo owns.
// The motion is large: fields after it are far away.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Servo {
    overruns_seen: u32,
    health: ServoHealth,
    motion: Motion,
}

impl Servo {
    /// Before the first tick.
    // Built where a board needs it, it is not copied.
    #[inline(always)]
    pub fn new(motion: Motion) -> Self {
        Self {
            overruns_seen: 0,
            health: ServoHealth::new(),
            motion,
        }
    }

    /// The machine that it moves.
    #[inline(always)]
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// The same, to write to.
    #[inline(always)]
    pub fn motion_mut(&mut self) -> &mut Motion {
        &mut self.motion
    }

    /// One servo tick; `link_passes`: rounds of the main loop so far.
    #[inline(always)]
    pub fn tick(
        &mut self,
        inputs: Inputs,
        steps: &mut impl StepSide,
        link_passes: u32,
    ) -> ServoDone {
        self.program(inputs, steps);
        ServoDone {
            healthy: self.health.tick(self.overruns_seen, link_passes),
            held_motors: self.motion.held_motors(),
        }
    }

    fn program(&mut self, inputs: Inputs, steps: &mut impl StepSide) {
        let handover = steps.handover();
        let overruns = steps.overruns();
        if handover != Handover::Empty || overruns != self.overruns_seen {
            self.note_stops(steps, overruns);
            if handover == Handover::Handed {
                // The last program came late and is not played yet; that it is a fault has been noted.
                return;
            }
        }
        self.motion.set_inputs(inputs);
        if self.motion.tick(steps.idle_bank()) {
            steps.hand_over();
        } else {
            stop_if_due(&mut self.motion, steps);
        }
    }

    /// Finds out what the steps have met since the last servo tick.
    #[cold]
    fn note_stops(&mut self, steps: &mut impl StepSide, overruns: u32) {
        let motion = &mut self.motion;
        if steps.take_emergency() {
            motion.fail_at_once(EMERGENCY);
        } else if overruns != self.overruns_seen && !motion.is_at_rest() {
            // At rest the engine has nothing to play before the first servo tick, and after a stop.
            motion.fail_at_once(Fault {
                cause: FaultCause::StepOverrun,
                index: 0,
                value: overruns as i32,
            });
        }
        self.overruns_seen = overruns;
        stop_if_due(motion, steps);
    }
}

/// Stops the steps if a fault requires it, and recovers the motors' positions: called from the servo, or
/// where it cannot interrupt.
pub fn stop_if_due(motion: &mut Motion, steps: &mut impl StepSide) {
    if motion.take_stop() {
        steps.stop();
    }
    // After a stop the motion continues from the motors' positions.
    steps.tell_stopped(|stopped| motion.engine_stopped(stopped));
}

/// Servo and steps take turns, nothing interrupts.
impl StepSide for StepPlayer {
    fn handover(&self) -> Handover {
        Handover::Empty
    }

    fn overruns(&self) -> u32 {
        StepPlayer::overruns(self)
    }

    fn take_emergency(&mut self) -> bool {
        false
    }

    fn idle_bank(&mut self) -> &mut StepBank {
        StepPlayer::idle_bank(self)
    }

    fn hand_over(&mut self) {
        StepPlayer::hand_over(self);
    }

    fn stop(&mut self) {
        StepPlayer::stop(self);
    }

    fn tell_stopped(&mut self, tell: impl FnOnce(&Stopped)) {
        if let Some(stopped) = self.take_stopped() {
            tell(&stopped);
        }
    }
}
