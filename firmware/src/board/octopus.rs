//! The BTT Octopus v1.0 and v1.1 (STM32F446ZE), after the board file that Klipper publishes
//! (`generic-bigtreetech-octopus-v1.1.cfg`); Marlin has the same for both (`pins_BTT_OCTOPUS_V1_common.h`).
//!
//! The Octopus Pro v1.1 may have the same chip and has some of them at other pins
//! (`generic-bigtreetech-octopus-pro-v1.1.cfg`): PA0 switches a hot end there, PA2 enables motor 3 and PB10 is a
//! lamp's.

use crate::board::sector_flash::Sector;
use crate::board::table::{BoardTable, pin, pins};
use crate::configuration::board_name::BoardName;

/// Sectors of the settings of a chip of 512 KiB: sector 3, between the vectors and the code (`build.rs`), and the last
/// one, after the memory map.
pub const SETTINGS_SECTORS: [Sector; 2] = [
    Sector {
        number: 3,
        address: 0x0800_c000,
    },
    Sector {
        number: 7,
        address: 0x0806_0000,
    },
];

/// The board.
pub const BOARD: BoardTable = BoardTable {
    names: &[BoardName::Octopus10, BoardName::Octopus11],
    // STM32F446.
    chip_id: 0x421,
    crystal_hz: 12_000_000,
    settings_sectors: SETTINGS_SECTORS,
    drivers: &[
        pins(["PF13", "PF12", "PF14", "PC4"]),
        pins(["PG0", "PG1", "PF15", "PD11"]),
        pins(["PF11", "PG3", "PG5", "PC6"]),
        pins(["PG4", "PC1", "PA0", "PC7"]),
        pins(["PF9", "PF10", "PG2", "PF2"]),
        pins(["PC13", "PF0", "PF1", "PE4"]),
        pins(["PE2", "PE3", "PD4", "PE1"]),
        // PA14 is also SWCLK: with eight motors there is no debugger.
        pins(["PE6", "PA14", "PE0", "PD3"]),
    ],
    // SPI 1, which the sockets share with EXP2.
    bus: Some(pins(["PA5", "PA7", "PA6"])),
    // STOP_0 to STOP_7, and the signal pin of the probe port, which is the emergency input.
    inputs: &pins([
        "PG6", "PG9", "PG10", "PG11", "PG12", "PG13", "PG14", "PG15", "PB7",
    ]),
    emergency: 8,
    // HE0 with T0, the bed with TB, HE1 with T1.
    heaters: &[
        pins(["PA2", "PF4"]),
        pins(["PA1", "PF3"]),
        pins(["PA3", "PF5"]),
    ],
    // FAN0 to FAN2.
    fans: &pins(["PA8", "PE5", "PD12"]),
    converter: 3,
    // HE2, HE3, FAN3 to FAN5.
    held_low: &pins(["PB10", "PB11", "PD13", "PD14", "PD15"]),
    // PS-ON.
    supply: Some(pin("PE11")),
    // The servo pin of the probe port (`control_pin` of a `[bltouch]`).
    servo: Some((pin("PB6"), 2, 4, 1)),
    // The header for a single-board computer.
    usart: 2,
    serial: pins(["PD5", "PD6"]),
    differs: &pins(["PA0", "PA2", "PB10"]),
};

const _: () = BOARD.check();
