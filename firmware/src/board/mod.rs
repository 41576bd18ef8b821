//! The edge to the hardware: a board is a table, its chip's code implements some traits.
//!
//! ```text
//! which pin is what   -> BoardTable, checked when it is compiled
//! steps, directions   <- PortOutput (a StepOutput)
//! switches, emergency -> BoardPins::inputs, once a servo tick
//! enables             <- BoardPins::hold
//! heaters, fans       <- BoardPins::put_heat; their sensors -> HeatPort
//! bytes               <-> fetch, send (Read, Write and their readiness)
//! settings            <-> sector_flash (an STM32F4's), for the store
//! interrupts' times    -> gaps (BoardClock); a crash <-> words of memory that a reset leaves
//! ```
//! In: levels, conversions and bytes of a chip. Out: inputs, readings and requests of the library, and its steps,
//! duties and reports at the pins; the settings that a board uses (`built_in`). A board binary adds clocks and
//! interrupts. Not covered: the order of calls (`machine` and the boards' runtime); code for a single chip.

pub mod built_in;
mod crash;
pub mod gaps;
pub mod input_map;
mod line;
pub mod octopus;
mod pins;
mod ring;
pub mod sector_flash;
pub mod spider;
mod start;
pub mod table;

pub use crash::{KeptCrash, crash_of, kept_crash};
pub use line::{Incoming, Line, NoLine, fetch, send};
pub use pins::{BoardPins, HeatPort, INPUTS_SETTLE_MS};
pub use ring::ByteRing;
pub use start::{
    KEPT_WORDS, KeptFault, StartCounter, TIMER_CLOCKS_PER_HZ, chip_fault, crystal_fault,
    crystal_hz, mix_noise, serial_number, session_of,
};

#[cfg(test)]
mod tests;
