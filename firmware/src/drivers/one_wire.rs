//! A one-wire UART in software on one pin: 8 bits, lowest first, no parity, one stop bit.
//!
//! Edges are due at times counted from the start of each byte, so that an interrupt delays one of them and never the
//! later ones. In: bytes and a cycle counter. Out: levels; bytes, sampled in the middle of their bits. A driver
//! derives the rate from the first byte of a datagram (data sheet, chapter 4.1: 9,600 bit/s and more), so the clock
//! need not be exact; an interrupt that delays that byte's edges changes the rate, so the rest of the datagram and
//! its answer use the timing of the actual edges. Not covered: echo, as the pin is not read while it sends.

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
/// Most readings of the clock in one wait: at ten clocks each, more than the longest wait takes; they end the
/// wait if the clock has stopped.
const LOOKS_MAX: u32 = 2_000_000;
const BITS: u32 = 8;
/// Bits between the first and the third falling edge of a sync byte (0x05), which a driver takes the rate from.
const SYNC_BITS: u32 = 4;

/// What an answer has next.
enum Heard {
    Byte(u8),
    /// Its stop bit is missing.
    Broken,
    Nothing,
}

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

    /// Waits until this many clocks have passed since `start`; returns the actual time.
    fn wait(&mut self, start: u32, clocks: u32) -> u32 {
        for _ in 0..LOOKS_MAX {
            let now = self.clock.now_clocks();
            if now.wrapping_sub(start) >= clocks {
                return now;
            }
        }
        start.wrapping_add(clocks)
    }

    /// Waits until the wire is low; returns the time, or `None` after this many bits.
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

    /// Sends a byte at this many clocks per bit. The datagram's first byte is the sync byte: from its third
    /// falling edge on, the rate is the one at which the driver reads the rest. Returns that rate.
    fn send(&mut self, motor: usize, byte: u8, mut bit_clocks: u32, is_sync: bool) -> u32 {
        let start = self.clock.now_clocks();
        // Start bit, the byte, stop bit.
        let mut levels = u32::from(byte) << 1 | 1 << (BITS + 1);
        for bit in 1..=BITS + 2 {
            self.wires.drive(motor, levels & 1 == 1);
            levels >>= 1;
            let now = self.wait(start, bit * bit_clocks);
            if is_sync && bit == SYNC_BITS {
                bit_clocks = now.wrapping_sub(start) / SYNC_BITS;
            }
        }
        bit_clocks
    }

    /// The next byte, if it arrives within this many bits.
    fn receive(&mut self, motor: usize, bit_clocks: u32, bits_max: u32) -> Heard {
        let Some(start) = self.falls(motor, bits_max) else {
            return Heard::Nothing;
        };
        let mut byte = 0u8;
        for bit in 0..BITS {
            self.wait(start, bit_clocks * (2 * bit + 3) / 2);
            byte |= u8::from(self.wires.is_high(motor)) << bit;
        }
        self.wait(start, bit_clocks * (2 * BITS + 3) / 2);
        if self.wires.is_high(motor) {
            Heard::Byte(byte)
        } else {
            Heard::Broken
        }
    }
}

impl<W: Wires, C: BitClock> DriverPort for OneWire<W, C> {
    fn exchange(&mut self, motor: usize, request: &[u8], reply: &mut [u8]) -> usize {
        // Idle for more than a byte: the driver forgets what noise may have begun.
        let idle_from = self.clock.now_clocks();
        self.wires.drive(motor, true);
        self.wait(idle_from, GAP_BITS_MAX * self.bit_clocks);
        let mut bit_clocks = self.bit_clocks;
        for (place, byte) in request.iter().enumerate() {
            bit_clocks = self.send(motor, *byte, bit_clocks, place == 0);
        }
        self.wires.release(motor);
        let mut bits_max = ANSWER_BITS_MAX;
        let (mut came, mut is_whole) = (0, true);
        // Bytes after a broken one are received too, so that there is no collision with them.
        for place in reply {
            match self.receive(motor, bit_clocks, bits_max) {
                Heard::Byte(byte) if is_whole => {
                    *place = byte;
                    came += 1;
                }
                Heard::Nothing => break,
                Heard::Byte(_) | Heard::Broken => is_whole = false,
            }
            bits_max = GAP_BITS_MAX;
        }
        // The last stop bit is heard at its middle.
        let heard = self.clock.now_clocks();
        self.wait(heard, bit_clocks);
        came
    }
}
