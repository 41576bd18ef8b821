//! Real-time side of Headway (`no_std`, no heap, sans-IO).
//!
//! ```text
//! bytes    line     -> queue -> interpolator -> pose -> kinematics -> steps -> pins
//!          frames      knots    channels        mm,     mm, rad       2^-31    step, direction
//!          checked     loads    0.1 um, urad    rad                   steps
//!                        ^ time warp (path rate)    + flow (extruder, mm^3)
//! ```
//! [`machine::Machine`] is the whole; its `servo_tick` reads as this picture. The rooms, each of which imports from those
//! above it alone (a test holds the order):
//!
//! | room | what flows through it |
//! | --- | --- |
//! | [`design`], [`configuration`], [`numbers`] | constants, what a machine and its board are, arithmetic |
//! | [`kinematics`] | poses to joints and back |
//! | [`steps`] | targets to steps |
//! | [`checks`] | configurations to the first number that cannot be |
//! | [`flow`] | volume, primes and retracts to the extruder's target |
//! | [`path`] | knots to targets of the joints at a segment time |
//! | [`motion`] | queued knots and commands to a step program each servo tick |
//! | [`heat`], [`drivers`] | conversions to duties, registers to states: beside the motion |
//! | [`settings`] | records to configurations and back |
//! | [`mod@line`] | bytes to requests, states to reports |
//! | [`machine`] | all of it at once |
//! | [`board`] | the same at the pins of a board |
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

#[macro_use]
mod log;

pub mod board;
pub mod checks;
pub mod configuration;
pub mod design;
pub mod drivers;
pub mod flow;
pub mod heat;
pub mod kinematics;
pub mod line;
pub mod machine;
pub mod motion;
pub mod numbers;
pub mod path;
pub mod settings;
pub mod steps;
