//! Stepper drivers, set up and queried: TMC2209 over their one-wire UART, TMC5160 and TMC2240 over SPI.
//!
//! ```text
//! configuration -> registers     -> link           -> datagram  -> one_wire
//! mA, modes        32 bit           counted writes    bytes, CRC   levels of the pin
//!               -> spi_registers -> spi_link                    -> soft_spi
//!                  32 bit           mirrored writes                levels of four pins
//!                                     service: all motors
//! ```
//! In: each motor's configuration, the motion's rests. Out: datagrams; a status of each driver and the fault of one,
//! on the motion's [`DriverPanel`](crate::motion::driver_panel::DriverPanel). [`service::DriverService`] sets every
//! driver up before a motor is enabled, and reads one after another: those with UART while nothing moves, since at other
//! times a board has no time for it, those with SPI always. Register and bit numbers are those of the data sheet (ADI,
//! TMC2209 rev. 1.09, chapters 4, 5 and 9; the others' in `spi_registers`). Not covered: StallGuard and CoolStep, and a
//! driver's own reaction to a fault, which is to switch off.

pub mod datagram;
pub mod link;
pub mod one_wire;
pub mod registers;
pub mod service;
pub mod soft_spi;
pub mod spi_link;
pub mod spi_registers;

pub use link::{DriverLink, LinkError};
pub use service::DriverService;
pub use soft_spi::DATAGRAM_BYTES;
pub use spi_link::SpiLink;

/// Bytes to a driver and back on one wire.
pub trait DriverPort {
    /// Sends `request` to the driver of `motor` and receives its answer within a bounded time.
    /// Returns the number of bytes received, without the echo of the request. With an empty `reply`
    /// it does not wait.
    fn exchange(&mut self, motor: usize, request: &[u8], reply: &mut [u8]) -> usize;

    /// Exchanges a datagram over SPI; false if the board has no bus to this driver.
    fn transfer(
        &mut self,
        _motor: usize,
        _request: &[u8; DATAGRAM_BYTES],
        _reply: &mut [u8; DATAGRAM_BYTES],
    ) -> bool {
        false
    }

    /// From here on interrupts disturb it: a port by pins takes a rate that bears them.
    fn slow_down(&mut self) {}
}
