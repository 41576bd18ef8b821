//! Commands that overtake the stream -> the motion.

use crate::design::{QUEUE_EVENTS, QUEUE_KNOTS, ticks_of_ms};
use crate::line::{Conversation, Receiver, reason_of};
use crate::motion::Motion;
use crate::settings::BoardLimits;
use headway_protocol::message::{
    Control, DeviceState, RefusalReason, RefusedNumber, SettingsProblem, SettingsRefusal,
};

/// Frames that a host may have sent and the controller has not accepted: one for each place in the queues, and
/// the end.
const FRAMES_AHEAD_MAX: u32 = (QUEUE_KNOTS + QUEUE_EVENTS + 1) as u32;

impl Receiver {
    pub(super) fn control(
        &mut self,
        talk: &mut Conversation,
        sequence: u16,
        control: Control,
        motion: &mut Motion,
    ) {
        // An order to heat claims the machine, too, even where it only lowers a target.
        let is_for_all = is_for_every_line(&control, motion);
        let asks = !is_for_all || takes_heat(&control);
        let before = self.owner;
        let may_have_it = asks && self.claim(talk, motion);
        if !is_for_all && !may_have_it {
            talk.refuse_control(sequence, RefusalReason::Busy);
            return;
        }
        match self.execute(talk, sequence, control, motion) {
            Ok(()) if takes_heat(&control) && self.owner.is(talk) => self.owner.take_heat(talk),
            Ok(()) => {}
            Err(reason) => {
                // What is refused takes the machine from nobody.
                self.owner = before;
                talk.refuse_control(sequence, reason);
            }
        }
    }

    fn execute(
        &mut self,
        talk: &mut Conversation,
        sequence: u16,
        control: Control,
        motion: &mut Motion,
    ) -> Result<(), RefusalReason> {
        match control {
            Control::Pause => motion.pause(),
            Control::Resume => motion.resume(),
            Control::Override(percent) => motion.set_override(percent),
            Control::Abort => {
                motion.abort();
                self.leave_stream();
            }
            // Where it is received.
            Control::EmergencyStop => {}
            Control::ClearFault => {
                if !motion.clear_fault() {
                    return Err(RefusalReason::Busy);
                }
                self.leave_stream();
                // The same one again is news.
                talk.last_fault = None;
            }
            Control::StatusRequest => talk.due.status = true,
            Control::Measure(begin) => {
                if !self.measurement.order(begin) {
                    return Err(RefusalReason::Invalid);
                }
                talk.due.measured = !begin;
            }
            Control::ReportPeriod(period_ms) => {
                talk.status_period_ticks = ticks_of_ms(period_ms.into(), self.servo_hz).into();
            }
            Control::FlowOverride(percent) => motion.set_flow_override(percent),
            Control::Heat {
                heater,
                decidegrees,
                wait,
            } => {
                // Who only lowers it does not end the owner's wait.
                let wait = wait || !self.owner.is(talk) && motion.heat().is_awaited(heater);
                return motion
                    .set_heater(heater, decidegrees, wait)
                    .map_err(reason_of);
            }
            Control::Fan(permille) => {
                return motion.heat_mut().set_fan(permille).map_err(reason_of);
            }
            Control::ExtrudeCold(allowed) => motion.heat_mut().allow_cold(allowed),
            Control::SettingsBegin { .. } | Control::SettingsPart { .. } | Control::SettingsEnd => {
                return self.take_settings(sequence, &control, motion);
            }
            Control::SetPosition(_)
            | Control::SetJoint { .. }
            | Control::Jog { .. }
            | Control::GoTo(_)
            | Control::MotorsOff
            | Control::Home(_)
            | Control::Probe { .. }
            | Control::ProbePin(_)
            | Control::Extrude { .. } => {
                return motion.command_at_rest(&control).map_err(reason_of);
            }
        }
        Ok(())
    }

    /// Forgets the stream. Frames of it may still be in transit, no more than fit the queues: the next
    /// one's numbers begin after those.
    fn leave_stream(&mut self) {
        self.unpacking = None;
        if let Some(stream) = self.stream.take() {
            self.next_first_sequence = Some(stream.next_sequence.wrapping_add(FRAMES_AHEAD_MAX));
        }
    }

    /// New settings, in parts: only while nothing moves, nothing is hot by our doing and no stream is open,
    /// since flash that is written holds the core up.
    fn take_settings(
        &mut self,
        sequence: u16,
        control: &Control,
        motion: &Motion,
    ) -> Result<(), RefusalReason> {
        let is_free = matches!(
            motion.state(),
            DeviceState::Idle | DeviceState::Finished | DeviceState::Faulted
        );
        if !is_free || !motion.is_at_rest() || motion.heat().is_on() {
            return Err(RefusalReason::Busy);
        }
        let taken = match control {
            Control::SettingsBegin { length } => self.settings.begin(*length),
            Control::SettingsPart { offset, bytes } => self.settings.part(*offset, bytes),
            _ => {
                self.settings_sequence = sequence;
                self.settings.end()
            }
        };
        taken.map_err(RefusalReason::Settings)
    }

    /// The active settings came from a record with this CRC; 0: they are built in.
    pub fn settings_in_force(&mut self, hash: u32) {
        self.settings_hash = hash;
    }

    /// The board has a store for settings that it can run: without one they are refused.
    pub fn keep_settings(&mut self, board: BoardLimits) {
        self.settings.keep(board);
    }

    /// Stores received settings, if there are any: to be called after [`Self::apply`], with the same line, and before
    /// reports are requested, with a function that writes a record and returns whether it succeeded.
    pub fn store_settings(&mut self, talk: &mut Conversation, put: impl FnOnce(&[u8]) -> bool) {
        let stored = self.settings.take().map(put);
        if stored == Some(false) {
            let reason = RefusalReason::Settings(SettingsRefusal {
                problem: SettingsProblem::NotStored,
                index: 0,
                item: 0,
                value: RefusedNumber(0.0),
            });
            talk.refuse_control(self.settings_sequence, reason);
        }
    }
}

/// Queries, and commands that make a machine slower, cooler or stop: all others are for one host at a time.
fn is_for_every_line(control: &Control, motion: &Motion) -> bool {
    match *control {
        Control::Pause
        | Control::Resume
        | Control::Override(_)
        | Control::FlowOverride(_)
        | Control::Abort
        | Control::EmergencyStop
        | Control::ClearFault
        | Control::StatusRequest
        | Control::Measure(_)
        | Control::ReportPeriod(_) => true,
        Control::Heat {
            heater,
            decidegrees,
            ..
        } => decidegrees == 0 || decidegrees <= motion.heat().target_decidegrees(heater),
        _ => false,
    }
}

/// Heat is for the host that has ordered it, or that moves: from then on its silence ends it.
fn takes_heat(control: &Control) -> bool {
    matches!(
        control,
        Control::Heat {
            decidegrees: 1..,
            ..
        } | Control::Jog { .. }
            | Control::GoTo(_)
            | Control::Home(_)
            | Control::Probe { .. }
            | Control::Extrude { .. }
    )
}
