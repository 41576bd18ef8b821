//! Checks of a board at its start: the cause of the start, and whether it is the board that the
//! firmware is for.

use headway_protocol::message::{Fault, FaultCause};

/// Counts the starts of a controller, in memory that a reset does not change. After power-on its
/// contents are random.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct StartCounter {
    starts: u32,
    /// `starts` with all bits turned round, or the counter was never written.
    check: u32,
}

impl StartCounter {
    /// As it is found.
    pub fn from_memory(starts: u32, check: u32) -> Self {
        Self { starts, check }
    }

    /// The count of this start, from the value of the previous one: 1 if there is none.
    pub fn next(self) -> Self {
        let starts = if self.check == !self.starts {
            self.starts.wrapping_add(1)
        } else {
            1
        };
        Self {
            starts,
            check: !starts,
        }
    }

    /// Starts so far.
    pub fn starts(self) -> u32 {
        self.starts
    }
}

/// A fault of the heaters that a reset does not clear: it is latched again, until a host clears it. It is in memory
/// that a reset does not change; after power-on its contents are random.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeptFault([u32; KEPT_WORDS]);

/// The fault's bytes, and a check of them.
pub const KEPT_WORDS: usize = 3;
/// Cause, index and value, at their longest.
const FAULT_BYTES: usize = 8;

impl KeptFault {
    /// The data to keep of a latched fault: none if its cause is not a heater.
    pub fn of(fault: Option<Fault>) -> Self {
        let mut bytes = [0; FAULT_BYTES];
        let kept = fault.filter(|fault| is_of_heater(fault.cause));
        match kept.map(|fault| postcard::to_slice(&fault, &mut bytes).is_ok()) {
            Some(true) => {
                let [a, b, c, d, e, f, g, h] = bytes;
                let low = u32::from_le_bytes([a, b, c, d]);
                let high = u32::from_le_bytes([e, f, g, h]);
                Self([low, high, kept_check(low, high)])
            }
            _ => Self([0; KEPT_WORDS]),
        }
    }

    /// As it is found.
    pub fn from_memory(words: [u32; KEPT_WORDS]) -> Self {
        Self(words)
    }

    /// For the memory.
    pub fn words(self) -> [u32; KEPT_WORDS] {
        self.0
    }

    /// The fault of the run before, if it left one.
    pub fn fault(self) -> Option<Fault> {
        let Self([low, high, check]) = self;
        if check != kept_check(low, high) {
            return None;
        }
        let mut bytes = [0; FAULT_BYTES];
        let words = low.to_le_bytes().into_iter().chain(high.to_le_bytes());
        for (place, byte) in bytes.iter_mut().zip(words) {
            *place = byte;
        }
        let (fault, _): (Fault, _) = postcard::take_from_bytes(&bytes).ok()?;
        is_of_heater(fault.cause).then_some(fault)
    }

    /// What is left of it after a reset with these flags of an STM32F4 (RM0390, 6.3.21): power-on and the reset pin,
    /// which a person uses, give a heater its supply back; a watchdog, a program or flags that a boot loader has
    /// cleared do not.
    pub fn after_reset(self, flags: u32) -> Self {
        let by_hand = flags & BY_HAND != 0 && flags & BY_PROGRAM == 0;
        if by_hand && self.cuts_supply() {
            return Self([0; KEPT_WORDS]);
        }
        self
    }

    /// The supply of the heaters stays cut.
    pub fn cuts_supply(self) -> bool {
        let cause = self.fault().map(|fault| fault.cause);
        matches!(
            cause,
            Some(FaultCause::HeaterStuck | FaultCause::OverTemperature)
        )
    }
}

/// Brown-out, reset pin and power-on in the reset flags: the pin's is set with each of the others.
const BY_HAND: u32 = 0b111 << 25;
/// A program, both watchdogs, low power.
const BY_PROGRAM: u32 = 0b1111 << 28;

/// Never that of a memory full of zeros or ones.
fn kept_check(low: u32, high: u32) -> u32 {
    mix_noise(mix_noise(0x4865_6174, low), high)
}

/// A heater, its sensor or its fan is the cause.
fn is_of_heater(cause: FaultCause) -> bool {
    matches!(
        cause,
        FaultCause::SensorOpen
            | FaultCause::SensorShorted
            | FaultCause::SensorSilent
            | FaultCause::SensorFrozen
            | FaultCause::OverTemperature
            | FaultCause::UnderTemperature
            | FaultCause::HeatingSlow
            | FaultCause::TemperatureDrift
            | FaultCause::HeaterStuck
            | FaultCause::PowerMismatch
            | FaultCause::FanStalled
    )
}

/// Mixes one more word of uninitialised memory into `noise` (FNV-1a by words).
#[inline(always)]
pub fn mix_noise(noise: u32, word: u32) -> u32 {
    (noise ^ word).wrapping_mul(0x0100_0193).rotate_left(5)
}

/// A session number: a different one for each start, and for each chip. `noise` is the remaining
/// contents of memory, for when a power failure has destroyed the counter.
pub fn session_of(starts: u32, chip: [u32; 3], noise: u32) -> u32 {
    let mixed = chip.into_iter().fold(noise, mix_noise);
    // Odd factors lose nothing: two starts of the same noise differ.
    mixed.wrapping_add(starts.wrapping_mul(0x9e37_79b9))
}

/// Serial number of a USB device: the chip's id as text.
pub fn serial_number(chip: [u32; 3]) -> [u8; 24] {
    let mut text = [b'0'; 24];
    for (place, digit) in text.iter_mut().enumerate() {
        let word = chip.get(place / 8).copied().unwrap_or(0);
        let value = (word >> (28 - 4 * (place % 8)) & 0xf) as u8;
        *digit = if value < 10 {
            b'0' + value
        } else {
            b'A' + value - 10
        };
    }
    text
}

/// The fault of a chip whose device id is not the one that the firmware is for. 0 cannot be judged:
/// the register does not exist.
pub fn chip_fault(found: u32, expected: u32) -> Option<Fault> {
    (found != 0 && found != expected).then_some(Fault {
        cause: FaultCause::Board,
        index: 0,
        value: found as i32,
    })
}

/// Largest deviation of a crystal measured against a chip's internal oscillator, which is off by up to
/// 8 % hot: the next usual crystals are 30 % away.
const CRYSTAL_TOLERANCE_PERCENT: u32 = 12;

/// Timer clocks of 16 MHz, times this many Hz, in which 64 edges of the crystal divided by 16 pass.
pub const TIMER_CLOCKS_PER_HZ: u64 = 16_000_000 * 64 * 16;

/// Frequency of a crystal from a count of timer clocks; `None` if it is 0.
pub fn crystal_hz(timer_clocks: u32) -> Option<u32> {
    let hz = TIMER_CLOCKS_PER_HZ.checked_div(timer_clocks.into())?;
    u32::try_from(hz).ok()
}

/// The fault of a crystal that is not the one that the firmware is for, by its measured frequency; one
/// that could not be measured cannot be judged.
pub fn crystal_fault(measured_hz: Option<u32>, expected_hz: u32) -> Option<Fault> {
    let measured_hz = measured_hz?;
    let tolerance_hz = expected_hz / 100 * CRYSTAL_TOLERANCE_PERCENT;
    (measured_hz.abs_diff(expected_hz) > tolerance_hz).then_some(Fault {
        cause: FaultCause::Board,
        index: 1,
        value: measured_hz as i32,
    })
}
