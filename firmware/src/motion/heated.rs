//! Effects of heaters on the motion: a stream that waits for them, and retraction of hot melt after
//! a fault.

use super::state::{Demand, Stream};
use super::{CommandError, Motion};
use crate::motion::heat_panel::{HeatPanel, Melt};
use headway_protocol::message::FaultCause;

impl Motion {
    /// Orders and readings of the heaters.
    pub fn heat(&self) -> &HeatPanel {
        &self.heat
    }

    /// The same, to write to.
    pub fn heat_mut(&mut self) -> &mut HeatPanel {
        &mut self.heat
    }

    /// Sets a heater's target, tenths of a degree; the stream `wait`s for it.
    ///
    /// # Errors
    /// [`CommandError`]: a fault is latched, or the target is invalid for the heater.
    pub fn set_heater(
        &mut self,
        heater: u8,
        decidegrees: u16,
        wait: bool,
    ) -> Result<(), CommandError> {
        if self.fault.is_some() && decidegrees > 0 {
            return Err(CommandError::Faulted);
        }
        self.heat.set_target(heater, decidegrees, wait)?;
        self.note_heat();
        Ok(())
    }

    /// Takes over whether the stream waits for a heater, and stops melt that would move cold.
    // Once in the image.
    #[inline(never)]
    pub fn note_heat(&mut self) {
        let is_left = self.spans_done() >= self.melt_until_span;
        let Some(stream) = self.state.stream_mut() else {
            return;
        };
        let Demand::Go { heats, .. } = &mut stream.demand else {
            return;
        };
        *heats = self.heat.holds_stream();
        if is_left {
            return;
        }
        match self.heat.melt() {
            Melt::Ready => {}
            Melt::Warming(_) => *heats = true,
            Melt::Cold(heater) => self.fail_softly(heater.fault()),
        }
    }

    /// Melt moves in a span before this one, or with an event there.
    pub fn note_melt(&mut self, until_span: u32) {
        self.melt_until_span = self.melt_until_span.max(until_span);
        self.note_heat();
    }

    /// Nothing holds the stream.
    #[inline(always)]
    pub(super) fn may_move(&self, stream: &Stream) -> bool {
        stream.demand.moves() && self.fault.is_none()
    }

    /// At rest, before a faulty stream is left: pulls the melt back where a heater was the cause, which
    /// is still hot then. True while that continues.
    pub(super) fn pulls_back(&mut self) -> bool {
        let hot = self.fault.is_some_and(|fault| {
            matches!(
                fault.cause,
                FaultCause::SensorOpen
                    | FaultCause::SensorShorted
                    | FaultCause::SensorSilent
                    | FaultCause::SensorFrozen
                    | FaultCause::OverTemperature
                    | FaultCause::TemperatureDrift
                    | FaultCause::HeaterStuck
                    | FaultCause::PowerMismatch
                    | FaultCause::HostSilent
                    | FaultCause::FanStalled
            )
        });
        // Without a stream there is nothing that it was primed for, and the motors may have been let go.
        if !hot || self.state.stream().is_none() {
            return false;
        }
        let active = self.flow.is_active();
        if let Some(retract) = self.hold.leave(active) {
            return self.flow.begin(&retract);
        }
        active
    }
}
