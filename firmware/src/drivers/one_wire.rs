//! A UART of one wire by a pin that is set and read: 8 bits, lowest first, no parity, one stop bit.
//!
//! Edges are due at times counted from the start of each byte, so that an interrupt delays one of them and
//! never those after it. In: bytes and a clock that counts. Out: levels; bytes, sampled in the middle of
//! their bits. A driver takes the rate from the first byte of a datagram (data sheet, chapter 4.1: 9,600 bit/s
//! and more), so the clock need not be right, only even. Left out: echo, as the pin is not read while it sends.

use super::DriverPort;

/// Pins of the wires, pulled up on the board.
pub trait Wires {
    /// Drives a wire.
    fn drive(&mut self, motor: usize, high: bool);
    /// Lets it go.
    fn release(&mut self, motor: usize);
    /// Its level.
    fn is_high(&mut self, motor: usize) -> bool;
}

/// A clock that counts and wraps.
pub trait BitClock {
    /// Now.
    fn now_clocks(&mut self) -> u32;
}

/// Bits from a question's end until its answer begins: 8 of the driver, and as many again.
const ANSWER_BITS_MAX: u32 = 32;
/// Bits between the bytes of an answer.
const GAP_BITS_MAX: u32 = 12;
/// Looks at the clock within a wait: at ten clocks a look more than the longest wait takes, and an end if the
/// clock stands.
const LOOKS_MAX: u32 = 2_000_000;
const BITS: u32 = 8;

/// Wires with their clock.
#[derive(Debug)]
pub struct OneWire<W, C> {
    wires: W,
    clock: C,
    bit_clocks: u32,
}

impl<W: Wires, C: BitClock> OneWire<W, C> {
    /// All wires let go.
    pub fn new(wires: W, clock: C, bit_clocks: u32) -> Self {
        Self {
            wires,
            clock,
            bit_clocks,
        }
    }

    /// Another rate, from the next datagram on.
    pub fn set_bit_clocks(&mut self, bit_clocks: u32) {
        self.bit_clocks = bit_clocks;
    }

    /// Until so many clocks are over since `start`.
    fn wait(&mut self, start: u32, clocks: u32) {
        for _ in 0..LOOKS_MAX {
            if self.clock.now_clocks().wrapping_sub(start) >= clocks {
                return;
            }
        }
    }

    /// Until the wire is low; when that was, or `None` after so many bits.
    fn falls(&mut self, motor: usize, bits_max: u32) -> Option<u32> {
        let start = self.clock.now_clocks();
        for _ in 0..LOOKS_MAX {
            if !self.wires.is_high(motor) {
                return Some(self.clock.now_clocks());
            }
            let waited = self.clock.now_clocks().wrapping_sub(start);
            if waited > bits_max * self.bit_clocks {
                return None;
            }
        }
        None
    }

    fn send(&mut self, motor: usize, byte: u8) {
        let start = self.clock.now_clocks();
        // Start bit, the byte, stop bit.
        let mut levels = u32::from(byte) << 1 | 1 << (BITS + 1);
        for bit in 1..=BITS + 2 {
            self.wires.drive(motor, levels & 1 == 1);
            levels >>= 1;
            self.wait(start, bit * self.bit_clocks);
        }
    }

    /// A byte; `None` where none comes, or its stop bit is missing.
    fn receive(&mut self, motor: usize, bits_max: u32) -> Option<u8> {
        let start = self.falls(motor, bits_max)?;
        let mut byte = 0u8;
        for bit in 0..BITS {
            self.wait(start, self.bit_clocks * (2 * bit + 3) / 2);
            byte |= u8::from(self.wires.is_high(motor)) << bit;
        }
        self.wait(start, self.bit_clocks * (2 * BITS + 3) / 2);
        self.wires.is_high(motor).then_some(byte)
    }
}

impl<W: Wires, C: BitClock> DriverPort for OneWire<W, C> {
    fn exchange(&mut self, motor: usize, request: &[u8], reply: &mut [u8]) -> usize {
        // Idle for more than a byte: the driver forgets what noise may have begun.
        let idle_from = self.clock.now_clocks();
        self.wires.drive(motor, true);
        self.wait(idle_from, GAP_BITS_MAX * self.bit_clocks);
        for byte in request {
            self.send(motor, *byte);
        }
        self.wires.release(motor);
        let mut bits_max = ANSWER_BITS_MAX;
        let mut came = 0;
        for place in reply {
            let Some(byte) = self.receive(motor, bits_max) else {
                break;
            };
            *place = byte;
            came += 1;
            bits_max = GAP_BITS_MAX;
        }
        came
    }
}
