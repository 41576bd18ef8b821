//! The faults of a servo tick.

use super::Motion;
use crate::steps::StepRateExceeded;
use headway_protocol::message::{Fault, FaultCause};

/// The emergency input, or the same command of a host.
pub const EMERGENCY: Fault = Fault {
    cause: FaultCause::Emergency,
    index: 0,
    value: 0,
};

pub(super) fn step_rate_fault(exceeded: StepRateExceeded, servo_hz: u32) -> Fault {
    Fault {
        cause: FaultCause::StepRate,
        index: exceeded.motor,
        value: exceeded.steps_per_interval.saturating_mul(servo_hz) as i32,
    }
}

impl Motion {
    /// Examines an extruder beyond a plan's limits: all targets are withdrawn.
    #[cold]
    pub(super) fn check_extruder(&mut self, ways: [i32; 2]) -> Result<(), Fault> {
        // What the path rate did lasts as long as pressure advance remembers, and moves the flow against
        // the events that it met.
        let since_ticks = (self.now_ticks as u32).wrapping_sub(self.off_plan_ticks);
        let met_ticks = self.flow.longest_active_ticks() + self.flow.memory_ticks();
        let in_ramp = since_ticks <= met_ticks;
        let Some(value) = self.extruder_guard.exceeded(ways, in_ramp) else {
            return Ok(());
        };
        self.programmer.take_back(&self.waiting);
        Err(Fault {
            cause: FaultCause::Limit,
            index: self.joints.count() as u8,
            value,
        })
    }
}
