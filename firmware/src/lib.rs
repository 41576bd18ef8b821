//! Real-time side of Headway (`no_std`, no heap, sans-IO).
//!
//! ```text
//! bytes    line     -> queue -> interpolator -> pose -> kinematics -> steps -> pins
//!          frames      knots    channels        mm,     mm, rad       2^-31    step, direction
//!          checked     loads    0.1 um, urad    rad                   steps
//!                        ^ time warp (path rate)    + flow (extruder, mm^3)
//! ```
//! [`machine::Machine`] is the complete controller; its `servo_tick` reads like this diagram. The modules, each of
//! which imports only from those above it (a test checks the order):
//!
//! | module | data that flow through it |
//! | --- | --- |
//! | [`design`], [`configuration`], [`numbers`] | constants, descriptions of a machine and its board, arithmetic |
//! | [`kinematics`] | poses to joints and back |
//! | [`steps`] | targets to steps |
//! | [`checks`] | configurations to the first invalid number |
//! | [`flow`] | volume, primes and retracts to the extruder's target |
//! | [`path`] | knots to targets of the joints at a segment time |
//! | [`motion`] | queued knots and commands to a step program each servo tick |
//! | [`heat`], [`drivers`] | conversions to duties, registers to states, parallel to the motion |
//! | [`settings`] | records to configurations and back |
//! | [`mod@line`] | bytes to requests, states to reports |
//! | [`machine`] | all of it together |
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
