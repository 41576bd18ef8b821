//! The pin of a probe that is deployed and stowed by the length of servo pulses: a BLTouch or a similar
//! one.
//!
//! In: the probing, or a manual command. Out: the pulse's length for the board's timer, every [`PULSE_PERIOD_US`].
//! Lengths and times are those of Klipper's `bltouch.py` and of Antclabs' manual. The pin retracts by itself when it
//! touches, with a pulse of some ms on the probe's input, and is deployed again after a stow command in between. Not
//! covered: its touch switch mode, and verification of a command.

use crate::design::ticks_of_ms;
use headway_protocol::message::PinPosition;

/// Time from pulse to pulse: 50 Hz.
pub const PULSE_PERIOD_US: u16 = 20_000;
/// Time for the pin to go out: Klipper's `pin_move_time`, 0.68 s, and a little.
pub const PIN_MS: u32 = 700;

/// The joint whose switch the probe may be.
const Z: u8 = 2;

/// Where pulses go.
pub trait PulsePort {
    /// Sets the pulse length, us; 0 for no pulses.
    fn put(&mut self, pulse_us: u16);
}

/// Length of the pulses, us.
pub const fn pulse_us(position: PinPosition) -> u16 {
    match position {
        PinPosition::Deploy => 650,
        PinPosition::Stow => 1475,
        PinPosition::SelfTest => 1780,
        PinPosition::Reset => 2190,
    }
}

/// Whether there is one, and its last manual command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProbePin {
    /// There is one.
    pub fitted: bool,
    /// The probe is Z's switch too.
    pub is_switch_of_z: bool,
    /// By manual command, and before any command.
    pub by_hand: PinPosition,
}

impl ProbePin {
    /// Time to go out, servo ticks; 0 without one.
    pub fn ticks(&self, servo_hz: u32) -> u32 {
        if self.fitted {
            ticks_of_ms(PIN_MS, servo_hz)
        } else {
            0
        }
    }

    /// The same before a touch of this joint's switch.
    pub fn ticks_for(&self, joint: u8, servo_hz: u32) -> u32 {
        if self.is_switch_of_z && joint == Z {
            self.ticks(servo_hz)
        } else {
            0
        }
    }
}
