//! Real-time side of Headway (`no_std`, no heap, sans-IO).
#![no_std]
#![forbid(unsafe_code)]

pub mod configuration;
