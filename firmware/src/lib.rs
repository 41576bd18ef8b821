//! Real-time side of Headway (`no_std`, no heap, sans-IO).
//!
//! ```text
//! bytes    receiver -> queue -> interpolator -> pose -> kinematics -> steps -> pins
//!          frames      knots    channels        mm,     mm, rad       2^-31    step, direction
//!          checked     loads    0.1 um, urad    rad                   steps
//!                        ^ time warp (path rate)    + flow (extruder, mm^3)
//! ```
//! [`machine::Machine`] is the whole; its `servo_tick` reads as this picture.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

#[macro_use]
mod log;

pub mod axis_family;
pub mod board;
pub mod board_name;
pub mod boards;
pub mod configuration;
pub mod delay;
pub mod design;
pub mod drivers;
pub mod event_queue;
pub mod extruder_limits;
pub mod flow;
pub mod heat;
pub mod hold;
pub mod homing;
pub mod inputs;
pub mod interpolator;
pub mod jet;
pub mod joint_channels;
pub mod joint_move;
pub mod joints;
pub mod kinematics;
pub mod load;
pub mod machine;
pub mod motion;
pub mod motor_matrix;
pub mod octopus;
pub mod output;
pub mod pose;
pub mod probe_pin;
pub mod queue;
pub mod real;
pub mod receiver;
pub mod settings;
pub mod shaping;
pub mod spline;
pub mod steps;
pub mod time_warp;
pub mod watchdog;
pub mod wiring;
