//! The Fysetc Spider v1.0 and v1.1, and v2.2 (STM32F446VE), after the pin definitions that Fysetc publishes (README of
//! FYSETC-SPIDER, 3.7.1 and 3.7.2) and Klipper's `generic-fysetc-spider.cfg`; Marlin has the same
//! (`pins_FYSETC_SPIDER.h`, `pins_FYSETC_SPIDER_V2_2.h`).
//!
//! Version 2.2 has the fans of version 1 at the pins of the debugger, and thermistors where those were. Its servo pin is
//! published at two places, so there is none here.

use crate::board::octopus::SETTINGS_SECTORS;
use crate::board::table::{BoardTable, pins};
use crate::configuration::board_name::BoardName;

/// Version 1.0 and 1.1.
pub const BOARD_1: BoardTable = BoardTable {
    names: &[BoardName::Spider11],
    // STM32F446.
    chip_id: 0x421,
    crystal_hz: 12_000_000,
    settings_sectors: SETTINGS_SECTORS,
    // X, Y, Z, E0 to E4.
    drivers: &[
        pins(["PE11", "PE10", "PE9", "PE7"]),
        pins(["PD8", "PB12", "PD9", "PE15"]),
        pins(["PD14", "PD13", "PD15", "PD10"]),
        pins(["PD5", "PD6", "PD4", "PD7"]),
        pins(["PE6", "PC13", "PE5", "PC14"]),
        pins(["PE2", "PE4", "PE3", "PC15"]),
        pins(["PD12", "PC4", "PE8", "PA15"]),
        pins(["PE1", "PE0", "PC5", "PD11"]),
    ],
    // SPI 4.
    bus: Some(pins(["PE12", "PE14", "PE13"])),
    // X-, Y-, Z-, X+, Y+, and Z+, which is the probe's and the emergency input.
    inputs: &pins(["PB14", "PB13", "PA0", "PA1", "PA2", "PA3"]),
    emergency: 5,
    // E0 with TE0, the bed with TB, E1 with TE1.
    heaters: &[
        pins(["PB15", "PC0"]),
        pins(["PB4", "PC3"]),
        pins(["PC8", "PC1"]),
    ],
    // FAN0 to FAN2.
    fans: &pins(["PB0", "PB1", "PB2"]),
    converter: 1,
    // E2, and the strips' R, G and B, which may be fans.
    held_low: &pins(["PB3", "PB6", "PB5", "PB7"]),
    supply: None,
    servo: None,
    // The header for a single-board computer.
    usart: 1,
    serial: pins(["PA9", "PA10"]),
    differs: &pins(["PB0", "PB1"]),
};

/// Version 2.2.
pub const BOARD_2: BoardTable = BoardTable {
    names: &[BoardName::Spider22],
    heaters: &[
        pins(["PB15", "PC0"]),
        pins(["PB4", "PB0"]),
        pins(["PC8", "PC1"]),
    ],
    fans: &pins(["PA13", "PA14", "PB2"]),
    differs: &pins(["PA13", "PA14"]),
    ..BOARD_1
};

const _: () = BOARD_1.check();
const _: () = BOARD_2.check();
