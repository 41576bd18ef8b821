//! Commands that overtake the stream -> the motion.

use super::{Receiver, reason_of};
use crate::design::ticks_of_ms;
use crate::motion::{EMERGENCY, Motion};
use headway_protocol::message::{Control, RefusalReason};

impl Receiver {
    pub(super) fn control(&mut self, sequence: u16, control: Control, motion: &mut Motion) {
        match control {
            Control::Pause => motion.pause(),
            Control::Resume => motion.resume(),
            Control::Override(percent) => motion.set_override(percent),
            Control::Abort => {
                motion.abort();
                self.stream = None;
            }
            Control::EmergencyStop => motion.fail_at_once(EMERGENCY),
            Control::ClearFault => {
                if motion.clear_fault() {
                    self.stream = None;
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
            Control::SetPosition(_)
            | Control::SetJoint { .. }
            | Control::Jog { .. }
            | Control::GoTo(_)
            | Control::MotorsOff
            | Control::Home(_)
            | Control::Extrude { .. } => {
                if let Err(error) = motion.command_at_rest(&control) {
                    self.refuse_control(sequence, reason_of(error));
                }
            }
        }
    }
}
