//! Roles of a board's inputs, which of them are normally open, and which motors are reversed.
//!
//! In: roles of a machine file, and the board's own: the number of its inputs, the default emergency input, and which
//! ones may be it. Out: a [`Wiring`], by which `board/input_map.rs` reads levels.

use crate::configuration::JOINTS_MAX;
use serde::{Deserialize, Serialize};

/// For a joint without a switch.
pub const NO_INPUT: u8 = u8::MAX;
/// Inputs of a board, at most: a bit each.
pub const INPUTS_MAX: u8 = 16;

/// Inputs and motors, as they are wired.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wiring {
    /// One bit for each reversed motor.
    pub reversed_motors: u8,
    /// Input of each joint's switch, or [`NO_INPUT`].
    pub switch_inputs: [u8; JOINTS_MAX],
    /// Emergency input; `None`: the board's own.
    pub emergency_input: Option<u8>,
    /// One bit for each input that is low while pressed: normally open to ground.
    pub open_inputs: u16,
    /// The probe's; `None`: that of Z's switch, which is then the probe.
    pub probe_input: Option<u8>,
    /// The probe has a pin that servo pulses deploy and stow (BLTouch).
    pub probe_servo: bool,
}

/// Inputs of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardInputs {
    /// How many it has.
    pub count: u8,
    /// The default emergency input.
    pub emergency: u8,
    /// A bit for each that may be the emergency input: those whose edges interrupt.
    pub emergency_mask: u16,
}

/// What of a wiring cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WrongWiring {
    /// Input of this joint's switch: it is the emergency input, or not on the board.
    Switch(usize),
    /// The emergency input: not on the board, or without an interrupt.
    Emergency,
    /// The probe's input: it is the emergency input, or not on the board.
    Probe,
}

impl Default for Wiring {
    fn default() -> Self {
        Self::STANDARD
    }
}

impl Wiring {
    /// Joint m's switch at input m, all normally closed to ground, no motor reversed.
    pub const STANDARD: Self = Self {
        reversed_motors: 0,
        switch_inputs: [0, 1, 2, 3, 4, 5, 6],
        emergency_input: None,
        open_inputs: 0,
        probe_input: None,
        probe_servo: false,
    };
}
