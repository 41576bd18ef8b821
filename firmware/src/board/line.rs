//! Non-blocking transfer of bytes between a line and the machine, through `embedded-io`.

use core::convert::Infallible;
use embedded_io::{ErrorType, Read, ReadReady, Write, WriteReady};

/// A line that reports whether it has bytes, or room for some.
pub trait Line: Read + ReadReady + Write + WriteReady {}

impl<L: Read + ReadReady + Write + WriteReady> Line for L {}

/// Bytes that are read at once: a packet of USB at full speed.
const PACKET_BYTES: usize = 64;

/// Bytes of a line that have arrived and have not been read yet.
#[derive(Clone, Debug, Default)]
pub struct Incoming {
    packet: Packet,
    from: usize,
    to: usize,
}

impl Incoming {
    /// Nothing.
    pub const fn new() -> Self {
        Self {
            packet: Packet([0; PACKET_BYTES]),
            from: 0,
            to: 0,
        }
    }
}

impl Iterator for Incoming {
    type Item = u8;

    fn next(&mut self) -> Option<u8> {
        let byte = *self.packet.0.get(self.from..self.to)?.first()?;
        self.from += 1;
        Some(byte)
    }
}

/// Bytes of a packet.
#[derive(Clone, Debug)]
struct Packet([u8; PACKET_BYTES]);

impl Default for Packet {
    fn default() -> Self {
        Self([0; PACKET_BYTES])
    }
}

/// Fills `incoming` with bytes that have arrived, once all earlier ones have been read. A line with an
/// error has none.
pub fn fetch<L: Line>(line: &mut L, incoming: &mut Incoming) {
    // It is queried in each round, whether or not there is room: a USB device answers its host by
    // it.
    if let Ok(true) = line.read_ready()
        && incoming.from == incoming.to
        && let Ok(length) = line.read(&mut incoming.packet.0)
    {
        incoming.from = 0;
        incoming.to = length.min(PACKET_BYTES);
    }
}

/// Sends as much of `pending` as a line accepts, and returns the number of bytes. A line with an
/// error accepts none.
pub fn send<L: Line>(line: &mut L, pending: &[u8]) -> usize {
    if pending.is_empty() || !line.write_ready().unwrap_or(false) {
        return 0;
    }
    line.write(pending).unwrap_or(0).min(pending.len())
}

/// The line of a board without one.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoLine;

impl ErrorType for NoLine {
    type Error = Infallible;
}

impl Read for NoLine {
    fn read(&mut self, _bytes: &mut [u8]) -> Result<usize, Infallible> {
        Ok(0)
    }
}

impl ReadReady for NoLine {
    fn read_ready(&mut self) -> Result<bool, Infallible> {
        Ok(false)
    }
}

impl Write for NoLine {
    fn write(&mut self, _bytes: &[u8]) -> Result<usize, Infallible> {
        Ok(0)
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl WriteReady for NoLine {
    fn write_ready(&mut self) -> Result<bool, Infallible> {
        Ok(false)
    }
}
