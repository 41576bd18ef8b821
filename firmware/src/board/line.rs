//! Bytes between a line and the machine, without waiting, through `embedded-io`.

use core::convert::Infallible;
use embedded_io::{ErrorType, Read, ReadReady, Write, WriteReady};

/// A line that says whether it has bytes, or room for some.
pub trait Line: Read + ReadReady + Write + WriteReady {}

impl<L: Read + ReadReady + Write + WriteReady> Line for L {}

/// Bytes that are taken at once: a packet of USB at full speed.
const PACKET_BYTES: usize = 64;

/// Hands what has arrived to `take` and sends what it can of `pending`: how many bytes of it. A line
/// in trouble has nothing and takes nothing.
pub fn exchange<L: Line>(line: &mut L, pending: &[u8], mut take: impl FnMut(u8)) -> usize {
    let mut packet = [0; PACKET_BYTES];
    if let Ok(true) = line.read_ready()
        && let Ok(length) = line.read(&mut packet)
    {
        packet.iter().take(length).for_each(|byte| take(*byte));
    }
    if pending.is_empty() || !line.write_ready().unwrap_or(false) {
        return 0;
    }
    line.write(pending).unwrap_or(0).min(pending.len())
}

/// The line of a board that has none.
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
