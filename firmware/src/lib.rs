//! Real-time side of Headway (`no_std`, no heap, sans-IO).
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod configuration;
pub mod kinematics;
pub mod pose;
pub mod real;
pub mod spline;
