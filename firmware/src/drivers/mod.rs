//! Stepper drivers of type TMC2209, set up and queried over their one-wire UART.
//!
//! ```text
//! configuration -> registers -> link            -> datagram  -> one_wire
//! mA, modes        32 bit       counted writes     bytes, CRC   levels of the pin
//!                                     service: all motors
//! ```
//! In: each motor's configuration, the motion's rests. Out: datagrams; a status of each driver and the fault of one,
//! on the motion's [`DriverPanel`](crate::motion::driver_panel::DriverPanel). [`service::DriverService`] sets every
//! driver up before a motor is enabled, and reads one after another while nothing moves: at other times a board has
//! no time for it. Register and bit numbers are those of the data sheet (ADI, TMC2209 rev. 1.09, chapters 4, 5 and
//! 9). Not covered: StallGuard and CoolStep, and a driver's own reaction to a fault, which is to switch off.

pub mod datagram;
pub mod link;
pub mod one_wire;
pub mod registers;
pub mod service;

pub use link::{DriverLink, LinkError};
pub use service::DriverService;

/// Bytes to a driver and back on one wire.
pub trait DriverPort {
    /// Sends `request` to the driver of `motor` and receives its answer within a bounded time.
    /// Returns the number of bytes received, without the echo of the request. With an empty `reply`
    /// it does not wait.
    fn exchange(&mut self, motor: usize, request: &[u8], reply: &mut [u8]) -> usize;

    /// From here on interrupts disturb it: a port by pins takes a rate that bears them.
    fn slow_down(&mut self) {}
}

/// Of a board without such drivers.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoDrivers;

impl DriverPort for NoDrivers {
    fn exchange(&mut self, _motor: usize, _request: &[u8], _reply: &mut [u8]) -> usize {
        0
    }
}
