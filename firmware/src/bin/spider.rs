//! Fysetc Spider v1.0 and v1.1 (STM32F446VE at 168 MHz): eight drivers by UART, SPI or stand-alone, USB CDC and USART 1.
//!
//! As `octopus.rs`, with a table of its own. Built and emulated: it has not run on hardware.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this binary is for the board: build it for thumbv7em-none-eabihf");
}

#[cfg(target_os = "none")]
use headway_firmware::board::spider::BOARD_1 as BOARD;

#[cfg(target_os = "none")]
#[path = "shared/stm32f4.rs"]
mod stm32f4;
