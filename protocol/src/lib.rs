//! Wire protocol of Headway (`no_std`, no heap): the messages between host and controller.
//!
//! - [`units`]: the integer units of the seven channels.
//! - [`segment`]: the motion as knots of a non-uniform cubic B-spline, and flow events tied to it.
//! - [`knot_block`]: knots as they are sent, predicted and bit-packed.
//! - [`control`]: the commands that overtake the stream.
//! - [`driver`]: the state of a motor's driver in a status.
//! - [`board_report`]: what a board has measured of itself, and how it crashed.
//! - [`fault`]: why a controller has stopped.
//! - [`message`]: all messages of both sides.
//! - [`frame`]: COBS framing, CRC-32 and sequence numbers.
//!
//! `WIRE.md` in this crate describes every byte.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod board_report;
mod cobs_decode;
pub mod control;
pub mod driver;
pub mod fault;
pub mod frame;
pub mod knot_block;
pub mod message;
pub mod segment;
pub mod settings;
pub mod units;

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
