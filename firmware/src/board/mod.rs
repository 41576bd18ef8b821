//! The edge to the hardware, for any microcontroller: `embedded-hal` 1.0 and `embedded-io`.
//!
//! ```text
//! steps, directions   -> PinOutput (OutputPin)      or the port-wide PortOutput
//! switches, emergency -> PinBoard (InputPin)        -> inputs, once a servo tick
//! enables, lamp       <- PinBoard (OutputPin), Lamp (SetDutyCycle)
//! heaters, fans       <- BoardPins::put_heat; their sensors -> HeatPort
//! bytes               <-> fetch, send (Read, Write and their readiness)
//! settings            <-> sector_flash (an STM32F4's), for the store
//! interrupts' times    -> gaps (BoardClock); a crash <-> words of memory that a reset leaves
//! ```
//! In: levels, conversions and bytes of a chip. Out: inputs, readings and requests of the library, and its steps,
//! duties and reports at the pins; the settings that a board uses (`built_in`). A board binary adds clocks,
//! interrupts and the pin assignment. Faster replacements by a board have the same contract: `PortOutput` and
//! `PinOutput` are both [`StepOutput`]s, and a test plays the same random interval on both and compares the levels.
//! Not covered: the order of calls (`machine` and the boards' runtime); code for a single chip.
//!
//! [`StepOutput`]: crate::steps::output::StepOutput

pub mod built_in;
mod crash;
pub mod gaps;
mod heat_port;
pub mod input_map;
mod lamp;
mod line;
pub mod octopus;
mod pins;
mod ring;
pub mod sector_flash;
pub mod spider;
mod start;
pub mod table;

pub use crash::{KeptCrash, crash_of, kept_crash};
pub use heat_port::{HeatPort, NoHeat};
pub use lamp::Lamp;
pub use line::{Incoming, Line, NoLine, fetch, send};
pub use pins::{BoardPins, INPUTS_SETTLE_MS, PinBoard, PinOutput};
pub use ring::ByteRing;
pub use start::{
    KEPT_WORDS, KeptFault, StartCounter, TIMER_CLOCKS_PER_HZ, chip_fault, crystal_fault,
    crystal_hz, mix_noise, serial_number, session_of,
};

#[cfg(test)]
mod tests;
