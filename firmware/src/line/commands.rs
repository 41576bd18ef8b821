//! Commands that overtake the stream -> the motion.

use crate::design::{QUEUE_EVENTS, QUEUE_KNOTS, ticks_of_ms};
use crate::line::{Receiver, reason_of};
use crate::motion::{EMERGENCY, Motion};
use crate::settings::BoardLimits;
use headway_protocol::message::{
    Control, DeviceState, RefusalReason, RefusedNumber, SettingsProblem, SettingsRefusal,
};

/// Frames that a host may have sent and the controller has not accepted: one for each place in the queues, and
/// the end.
const FRAMES_AHEAD_MAX: u32 = (QUEUE_KNOTS + QUEUE_EVENTS + 1) as u32;

impl Receiver {
    pub(super) fn control(&mut self, sequence: u16, control: Control, motion: &mut Motion) {
        match control {
            Control::Pause => motion.pause(),
            Control::Resume => motion.resume(),
            Control::Override(percent) => motion.set_override(percent),
            Control::Abort => {
                motion.abort();
                self.leave_stream();
            }
            Control::EmergencyStop => motion.fail_at_once(EMERGENCY),
            Control::ClearFault => {
                if motion.clear_fault() {
                    self.leave_stream();
                    // The same one again is news.
                    self.last_fault = None;
                } else {
                    self.refuse_control(sequence, RefusalReason::Busy);
                }
            }
            Control::StatusRequest => self.due.status = true,
            Control::ReportPeriod(period_ms) => {
                self.status_period_ticks = ticks_of_ms(period_ms.into(), self.servo_hz).into();
            }
            Control::FlowOverride(percent) => motion.set_flow_override(percent),
            Control::Heat {
                heater,
                decidegrees,
                wait,
            } => {
                if let Err(error) = motion.set_heater(heater, decidegrees, wait) {
                    self.refuse_control(sequence, reason_of(error));
                }
            }
            Control::Fan(permille) => {
                if let Err(error) = motion.heat_mut().set_fan(permille) {
                    self.refuse_control(sequence, reason_of(error));
                }
            }
            Control::ExtrudeCold(allowed) => motion.heat_mut().allow_cold(allowed),
            Control::SettingsBegin { .. } | Control::SettingsPart { .. } | Control::SettingsEnd => {
                if let Err(reason) = self.take_settings(sequence, &control, motion) {
                    self.refuse_control(sequence, reason);
                }
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
                if let Err(error) = motion.command_at_rest(&control) {
                    self.refuse_control(sequence, reason_of(error));
                }
            }
        }
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

    /// Stores received settings, if there are any: to be called after [`Self::apply`] and before
    /// reports are requested, with a function that writes a record and returns whether it succeeded.
    pub fn store_settings(&mut self, put: impl FnOnce(&[u8]) -> bool) {
        let stored = self.settings.take().map(put);
        if stored == Some(false) {
            let reason = RefusalReason::Settings(SettingsRefusal {
                problem: SettingsProblem::NotStored,
                index: 0,
                item: 0,
                value: RefusedNumber(0.0),
            });
            self.refuse_control(self.settings_sequence, reason);
        }
    }
}
