//! Probing: homing's approach until the probe triggers, with a reported end position; no position
//! changes.
//!
//! In: a command with distance and speeds. Out: [`ProbeResult`] for the status. Not covered: the use of
//! the result, which is up to the host.

use super::jog::units_per_natural;
use super::state::State;
use super::{CommandError, Motion};
use crate::configuration::homing::JointHoming;
use crate::motion::homing::{Homing, HomingOutcome};
use crate::motion::probe_pin::{ProbePin, pulse_us};
use headway_protocol::message::{Control, PROBE_BIT, PinPosition, ProbeResult};

impl Motion {
    /// What the newest probing found.
    pub fn probe_result(&self) -> ProbeResult {
        self.probe
    }

    /// The probe has a pin that is deployed and stowed; it may be Z's switch.
    pub fn fit_probe_pin(&mut self, pin: ProbePin) {
        self.pin = pin;
    }

    /// Length of the pulses that the probe's pin is to have, us; 0 without one.
    pub fn probe_pulse_us(&self) -> u16 {
        if !self.pin.fitted {
            return 0;
        }
        let homing = self
            .jog
            .homing
            .as_ref()
            .filter(|_| matches!(self.state, State::Jog { .. }));
        let is_out = homing.is_some_and(|homing| homing.pin_is_out());
        pulse_us(if is_out {
            PinPosition::Deploy
        } else {
            self.pin.by_hand
        })
    }

    /// Moves the pin by hand.
    pub(super) fn move_pin(&mut self, position: PinPosition) -> Result<(), CommandError> {
        if !self.pin.fitted {
            return Err(CommandError::Invalid);
        }
        self.pin.by_hand = position;
        Ok(())
    }

    /// Begins a probing; with a probe that is pressed already nothing moves.
    pub(super) fn probe(&mut self, order: &Control) -> Result<(), CommandError> {
        let (joint, touch) = self.probe_touch(order).ok_or(CommandError::Invalid)?;
        let homing = Homing::new(&touch, &self.jog.machine).ok_or(CommandError::Invalid)?;
        self.pin.by_hand = PinPosition::Stow;
        if self.inputs.switches >> PROBE_BIT & 1 == 1 {
            self.probe = ProbeResult::Pressed;
            return Ok(());
        }
        self.probe = ProbeResult::None;
        self.begin_jog();
        self.rest_mover(joint);
        let pin_ticks = self.pin.ticks(self.servo_hz);
        self.jog.homing = Some(homing.with_pin(pin_ticks).with_mark(false));
        self.jog.probing = true;
        Ok(())
    }

    /// The command as the approach to a switch; `None` if it does not fit the joint, or the joint's
    /// position is not known.
    fn probe_touch(&self, order: &Control) -> Option<(usize, JointHoming)> {
        let Control::Probe {
            joint,
            distance_units,
            fast_units_s,
            slow_units_s,
            back_off_units,
        } = *order
        else {
            return None;
        };
        let number = usize::from(joint);
        let limits = self.jog.machine.joints.get(number)?;
        let natural = |units: f64| units / units_per_natural(limits.rotary);
        let touch = JointHoming {
            joint,
            towards_max: distance_units > 0,
            fast_natural_s: natural(fast_units_s.into()),
            slow_natural_s: natural(slow_units_s.into()),
            back_off_natural: natural(back_off_units.into()),
            travel_max_natural: natural(distance_units.unsigned_abs().into()),
            position_natural: 0.0,
            guards: false,
        };
        // Whole ways, not those of the joint: the range is looked at for both ends of what may move.
        let way = self.jog.position_of(number, distance_units)?;
        let back_units = i32::try_from(back_off_units).ok()?;
        let back = self.jog.position_of(number, back_units)? * -way.signum();
        let here = self.joint_position(number);
        let in_range = |way: i64| self.joints.is_in_range(number, here.saturating_add(way));
        let known = self.reference.known >> number & 1 == 1;
        let fits = known && touch.wrong(limits).is_none() && in_range(way) && in_range(back);
        fits.then_some((number, touch))
    }

    /// Copies the progress of a probing.
    pub(super) fn note_probe(&mut self, outcome: HomingOutcome, joint: usize, pressed: bool) {
        self.probe = match outcome {
            HomingOutcome::Moving => return,
            // The shift that would have made its place 0.
            HomingOutcome::Homed(shift) => {
                ProbeResult::Touched(self.joints.units_of(joint, shift.saturating_neg()))
            }
            HomingOutcome::Failed if pressed => ProbeResult::StaysPressed,
            HomingOutcome::Failed => ProbeResult::NotFound,
        };
        self.jog.clear();
    }
}
