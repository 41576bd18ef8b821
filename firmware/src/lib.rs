//! Real-time side of Headway (`no_std`, no heap, sans-IO).
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod configuration;
pub mod design;
pub mod flow;
pub mod interpolator;
pub mod kinematics;
pub mod load;
pub mod output;
pub mod pose;
pub mod queue;
pub mod real;
pub mod spline;
pub mod steps;
pub mod time_warp;
