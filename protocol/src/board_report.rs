//! What a board has measured of itself, and what it recorded when it crashed.

use serde::{Deserialize, Serialize};

/// Durations of an interrupt, in clocks of [`BoardFigures::clock_hz`], with its entry and exit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TickFigures {
    /// Interrupts that were measured; 0: the others mean nothing.
    pub count: u32,
    /// Shortest.
    pub min_clocks: u32,
    /// Mean, in thousandths of a clock.
    pub mean_milliclocks: u32,
    /// Longest.
    pub max_clocks: u32,
}

/// What a board measures between two [`Control::Measure`](crate::message::Control::Measure).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BoardFigures {
    /// Clocks per second.
    pub clock_hz: u32,
    /// Step interrupt.
    pub step: TickFigures,
    /// Servo interrupt, without the steps that interrupted it.
    pub servo: TickFigures,
    /// Longest time for which the main loop held the servo up, steps included.
    pub lock_max_clocks: u32,
    /// Longest time between two rounds of the main loop, interrupts and measurement included.
    pub round_max_clocks: u32,
    /// Deepest stack since the start, bytes.
    pub stack_used_bytes: u32,
    /// Room for it, bytes.
    pub stack_bytes: u32,
    /// The supply below which the chip resets itself, as its maker numbers levels; 0: it does not.
    pub brown_out_level: Option<u8>,
}

/// What ended the run before a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CrashCause {
    /// A fault of the core, with its CFSR (Arm DDI 0403, B3.2.15).
    HardFault(u32),
    /// A panic, with its line in the source; `pc` and `lr` are 0.
    Panic(u32),
    /// An interrupt without a handler, by number; `pc` and `lr` are 0.
    Interrupt(u32),
}

/// The record of a crash.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Crash {
    /// What it was.
    pub cause: CrashCause,
    /// Address of the instruction.
    pub pc: u32,
    /// Where its function would have returned to.
    pub lr: u32,
    /// Servo tick since the start of that run.
    pub servo_tick: u32,
}

/// Bits of the CFSR that are causes.
const CFSR_NAMES: [(u32, &str); 10] = [
    (0, "execution is not allowed there"),
    (1, "access is not allowed"),
    (8, "no instruction can be fetched there"),
    (9, "no such memory"),
    (10, "no such memory, noticed late"),
    (12, "the stack is full"),
    (16, "undefined instruction"),
    (17, "no Thumb code"),
    (24, "unaligned access"),
    (25, "division by zero"),
];

impl core::fmt::Display for Crash {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.cause {
            CrashCause::Panic(line) => write!(f, "panic in line {line} of its source")?,
            CrashCause::Interrupt(number) => write!(f, "interrupt {number} has no handler")?,
            CrashCause::HardFault(cfsr) => {
                let named = CFSR_NAMES.iter().find(|(bit, _)| cfsr >> bit & 1 == 1);
                let name = named.map_or("fault of the core", |(_, name)| name);
                let (pc, lr) = (self.pc, self.lr);
                write!(
                    f,
                    "{name} (PC {pc:#010x}, LR {lr:#010x}, CFSR {cfsr:#010x})"
                )?;
            }
        }
        write!(f, ", at servo tick {}", self.servo_tick)
    }
}
