//! Pins of the BTT Octopus v1.0 and v1.1 (STM32F446ZE), after the board file that Klipper publishes
//! (`generic-bigtreetech-octopus-v1.1.cfg`); Marlin has the same for both (`pins_BTT_OCTOPUS_V1_common.h`).
//!
//! The Octopus Pro v1.1 may have the same chip and has some of them at other pins
//! (`generic-bigtreetech-octopus-pro-v1.1.cfg`): [`DIFFERS`].

use crate::board::sector_flash::Sector;
use crate::configuration::MOTORS_MAX;
use crate::configuration::board_name::BoardName;
use crate::configuration::heat::HEATERS_MAX;
use crate::configuration::wiring::BoardInputs;
use crate::heat::pwm::CHANNELS;
use crate::steps::output::Pin;

const A: usize = 0;
const B: usize = 1;
const C: usize = 2;
const D: usize = 3;
const E: usize = 4;
const F: usize = 5;
const G: usize = 6;

/// Sectors of the settings: sector 3, between the vectors and the code (`build.rs`), and the last one,
/// after the memory map.
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
/// Step pins of drivers 0 to 7.
pub const STEP: [Pin; MOTORS_MAX] = [
    (F, 13),
    (G, 0),
    (F, 11),
    (G, 4),
    (F, 9),
    (C, 13),
    (E, 2),
    (E, 6),
];
/// Direction pins. PA14 is also SWCLK: with eight motors there is no debugger.
pub const DIRECTION: [Pin; MOTORS_MAX] = [
    (F, 12),
    (G, 1),
    (G, 3),
    (C, 1),
    (F, 10),
    (F, 0),
    (E, 3),
    (A, 14),
];
/// Enable pins, low = on.
pub const ENABLE: [Pin; MOTORS_MAX] = [
    (F, 14),
    (F, 15),
    (G, 5),
    (A, 0),
    (G, 2),
    (F, 1),
    (D, 4),
    (E, 0),
];
/// UART of drivers 0 to 7, one wire each (`uart_pin` of the same file).
pub const UART: [Pin; MOTORS_MAX] = [
    (C, 4),
    (D, 11),
    (C, 6),
    (C, 7),
    (F, 2),
    (E, 4),
    (E, 1),
    (D, 3),
];
/// Switch of joint 0 to 7, STOP_0 to STOP_7: normally closed to ground, pulled up, pressed = high.
pub const SWITCHES: [Pin; MOTORS_MAX] = [
    (G, 6),
    (G, 9),
    (G, 10),
    (G, 11),
    (G, 12),
    (G, 13),
    (G, 14),
    (G, 15),
];
/// The signal pin of the probe port, pulled up: the emergency input, unless settings give it another role.
pub const PROBE: Pin = (B, 7);
/// The servo pin of the probe port (`control_pin` of a `[bltouch]` on this board in Klipper's documents): channel 1 of
/// timer 4, and that timer among the functions of the pin.
pub const PROBE_SERVO: (Pin, u32) = ((B, 6), 2);
/// Inputs by number: the switches, then the probe port. All of them are lines 5 to 15 of the external
/// interrupts.
pub const INPUTS: BoardInputs = BoardInputs {
    count: MOTORS_MAX as u8 + 1,
    emergency: MOTORS_MAX as u8,
    emergency_mask: 0x1ff,
};
/// Pin of an input.
pub fn input(number: u8) -> Option<Pin> {
    match SWITCHES.get(usize::from(number)) {
        Some(pin) => Some(*pin),
        None if usize::from(number) == SWITCHES.len() => Some(PROBE),
        None => None,
    }
}
/// Heaters 0 to 2, hot end, bed and second hot end (HE0, the bed's, HE1), then part, hot end and
/// controller fan (FAN0 to FAN2): the channels of the PWM.
pub const HEAT: [Pin; CHANNELS] = [(A, 2), (A, 1), (A, 3), (A, 8), (E, 5), (D, 12)];
/// Thermistors of these heaters (T0, TB, T1), 4.7 kOhm to 3.3 V, and their channels of converter 3, from
/// the data sheet of the STM32F446.
pub const SENSORS: [(Pin, u32); HEATERS_MAX] = [((F, 4), 14), ((F, 3), 9), ((F, 5), 15)];
/// PS-ON, high = the supply is on (`pins_BTT_OCTOPUS_V1_common.h` of Marlin).
pub const SUPPLY: Pin = (E, 11);
/// All heaters and fans: off until they are requested.
pub const OFF: [Pin; 11] = [
    (A, 1),
    (A, 2),
    (A, 3),
    (B, 10),
    (B, 11),
    (A, 8),
    (E, 5),
    (D, 12),
    (D, 13),
    (D, 14),
    (D, 15),
];
/// Pins of these that do something else on an Octopus Pro v1.1, where PA0 switches a hot end, PA2 enables motor 3 and
/// PB10 is a lamp's: inputs until the settings name the board.
pub const DIFFERS: [Pin; 3] = [(A, 0), (A, 2), (B, 10)];
/// What the settings may call it.
pub const NAMES: [BoardName; 2] = [BoardName::Octopus10, BoardName::Octopus11];
/// USART 2, the header for a single-board computer: TX, RX.
pub const SERIAL: [Pin; 2] = [(D, 5), (D, 6)];

#[cfg(test)]
mod tests {
    //! Goal: what an Octopus Pro v1.1 has elsewhere is not driven before the board is named. Method: its published
    //! outputs, against ours, each pin with its role.
    use super::*;

    /// Outputs with their roles, a letter and a number: enables, heaters and fans.
    fn roles(enable: &[Pin], heaters: &[(&'static str, Pin)]) -> Vec<(Pin, String)> {
        let enables = enable.iter().enumerate();
        let enables = enables.map(|(motor, pin)| (*pin, format!("enable {motor}")));
        let heaters = heaters.iter().map(|(role, pin)| (*pin, role.to_string()));
        enables.chain(heaters).collect()
    }

    use std::format;
    use std::string::{String, ToString};
    use std::vec::Vec;

    #[test]
    fn what_another_board_with_this_chip_has_elsewhere_is_known() {
        let ours = roles(
            &ENABLE,
            &[
                ("HE0", HEAT[0]),
                ("bed", HEAT[1]),
                ("HE1", HEAT[2]),
                ("HE2", (B, 10)),
                ("HE3", (B, 11)),
            ],
        );
        let mut pro_enable = ENABLE;
        pro_enable[3] = (A, 2);
        let pros = roles(
            &pro_enable,
            &[
                ("HE0", (A, 0)),
                ("bed", (A, 1)),
                ("HE1", (A, 3)),
                ("HE2", (B, 0)),
                ("HE3", (B, 11)),
                ("lamp", (B, 10)),
            ],
        );
        let differ = ours.iter().filter(|(pin, role)| {
            let there = pros.iter().find(|(other, _)| other == pin);
            there.is_none_or(|(_, other)| other != role)
        });
        let mut differ: Vec<Pin> = differ.map(|(pin, _)| *pin).collect();
        differ.sort_unstable();
        assert_eq!(differ, DIFFERS);
        // Every heater that a board may have is held low.
        assert!(
            ours.iter()
                .all(|(pin, role)| role.starts_with("enable") || OFF.contains(pin))
        );
        // And the Pro's hot end is none of them: low would let motor 3 of an Octopus hold.
        assert!(!OFF.contains(&(A, 0)));
    }
}
