//! BTT Octopus v1.0 and v1.1 (STM32F446ZE at 168 MHz): eight drivers by UART, SPI or stand-alone, USB CDC and USART 2.
//!
//! All that is the board's is its table, `headway_firmware::board::octopus`; `shared/stm32f4.rs` is compiled for it.
//! `docs/guide/boards.md` describes how to build, flash and wire it. Built and emulated: it has not run on hardware.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this binary is for the board: build it for thumbv7em-none-eabihf");
}

#[cfg(target_os = "none")]
use headway_firmware::board::octopus::BOARD;

#[cfg(target_os = "none")]
#[path = "shared/stm32f4.rs"]
mod stm32f4;
