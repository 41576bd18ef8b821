//! Goal: the boards' tables are what their makers and other firmware publish, and a table that cannot be is refused.
//! Method: pins written from the published files, role by role, against the tables; tables with one mistake each.

use super::{BoardTable, DIRECTION, NO_PIN, STEP, pin, pins};
use crate::board::{octopus, spider};
use crate::steps::output::Pin;
use std::collections::BTreeMap;
use std::format;
use std::panic::catch_unwind;
use std::string::{String, ToString};
use std::vec::Vec;

/// Klipper, `config/generic-bigtreetech-octopus-v1.1.cfg`: a line for each driver with `step_pin`, `dir_pin`,
/// `enable_pin` and `uart_pin` (`cs_pin`), then `endstop_pin` and `switch_pin`, `[bltouch]`, heaters with sensors, fans;
/// PS-ON and SPI (`TMC_SW_SCK`, `_MOSI`, `_MISO`) from Marlin's `pins_BTT_OCTOPUS_V1_common.h`.
const OCTOPUS: &str = "
    driver 0 PF13 PF12 PF14 PC4
    driver 1 PG0 PG1 PF15 PD11
    driver 2 PF11 PG3 PG5 PC6
    driver 3 PG4 PC1 PA0 PC7
    driver 4 PF9 PF10 PG2 PF2
    driver 5 PC13 PF0 PF1 PE4
    driver 6 PE2 PE3 PD4 PE1
    driver 7 PE6 PA14 PE0 PD3
    spi PA5 PA7 PA6
    inputs PG6 PG9 PG10 PG11 PG12 PG13 PG14 PG15 PB7
    servo PB6
    heater 0 PA2 PF4
    heater 1 PA1 PF3
    heater 2 PA3 PF5
    fans PA8 PE5 PD12
    held PB10 PB11 PD13 PD14 PD15
    supply PE11";

/// Fysetc, README of FYSETC-SPIDER, 3.7.1 (version 1), as Klipper's `config/generic-fysetc-spider.cfg`.
const SPIDER_1: &str = "
    driver 0 PE11 PE10 PE9 PE7
    driver 1 PD8 PB12 PD9 PE15
    driver 2 PD14 PD13 PD15 PD10
    driver 3 PD5 PD6 PD4 PD7
    driver 4 PE6 PC13 PE5 PC14
    driver 5 PE2 PE4 PE3 PC15
    driver 6 PD12 PC4 PE8 PA15
    driver 7 PE1 PE0 PC5 PD11
    spi PE12 PE14 PE13
    inputs PB14 PB13 PA0 PA1 PA2 PA3
    heater 0 PB15 PC0
    heater 1 PB4 PC3
    heater 2 PC8 PC1
    fans PB0 PB1 PB2
    held PB3 PB6 PB5 PB7";

/// The same README, 3.7.2 (version 2.2), as Marlin's `pins_FYSETC_SPIDER_V2_2.h`: what is not as in version 1.
const SPIDER_2: [(&str, &str); 2] = [
    ("heater 1 PB4 PC3", "heater 1 PB4 PB0"),
    ("fans PB0 PB1 PB2", "fans PA13 PA14 PB2"),
];

/// A pin's name, the other way round than the tables'.
fn name((port, number): Pin) -> String {
    format!("P{}{number}", char::from(b'A' + port as u8))
}

fn line(role: &str, pins: impl IntoIterator<Item = Pin>) -> String {
    pins.into_iter()
        .fold(role.to_string(), |line, pin| line + " " + &name(pin))
}

/// A table as the published ones are written above.
fn written(board: &BoardTable) -> Vec<String> {
    let drivers = board.drivers.iter().enumerate();
    let drivers = drivers.map(|(motor, pins)| line(&format!("driver {motor}"), *pins));
    let heaters = board.heaters.iter().enumerate();
    let heaters = heaters.map(|(number, pins)| line(&format!("heater {number}"), *pins));
    let mut lines: Vec<String> = drivers.collect();
    lines.extend(board.bus.map(|bus| line("spi", bus)));
    lines.push(line("inputs", board.inputs.iter().copied()));
    lines.extend(board.servo.map(|servo| line("servo", [servo.0])));
    lines.extend(heaters);
    lines.push(line("fans", board.fans.iter().copied()));
    lines.push(line("held", board.held_low.iter().copied()));
    lines.extend(board.supply.map(|supply| line("supply", [supply])));
    lines
}

#[test]
fn tables_are_those_that_are_published() {
    let version_2 = SPIDER_2
        .iter()
        .fold(SPIDER_1.to_string(), |text, (old, new)| {
            assert!(text.contains(old));
            text.replace(old, new)
        });
    for (board, published) in [
        (&octopus::BOARD, OCTOPUS),
        (&spider::BOARD_1, SPIDER_1),
        (&spider::BOARD_2, &version_2),
    ] {
        let published: Vec<&str> = published.trim().lines().map(str::trim).collect();
        assert_eq!(written(board), published);
    }
    // Their serial lines: the header of the Octopus for a Raspberry Pi, and Pi_PWR/UART of the Spider.
    let serial = |board: &BoardTable| (board.usart, line("", board.serial));
    assert_eq!(serial(&octopus::BOARD), (2, " PD5 PD6".to_string()));
    assert_eq!(serial(&spider::BOARD_1), (1, " PA9 PA10".to_string()));
    assert_eq!(serial(&spider::BOARD_2), serial(&spider::BOARD_1));
}

/// Outputs with their roles, by pin.
fn outputs(board: &BoardTable) -> BTreeMap<Pin, String> {
    let enables = board.enables().enumerate();
    let enables = enables.map(|(motor, pin)| (pin, format!("enable {motor}")));
    let heaters = board.heaters.iter().enumerate();
    let heaters = heaters.map(|(number, [output, _])| (*output, format!("heater {number}")));
    let fans = board.fans.iter().enumerate();
    let fans = fans.map(|(number, pin)| (*pin, format!("fan {number}")));
    let held = board
        .held_low
        .iter()
        .map(|pin| (*pin, format!("held {}", name(*pin))));
    enables.chain(heaters).chain(fans).chain(held).collect()
}

/// Pins of `ours` that are another thing, or nothing that is known, on the other board.
fn differing(ours: &BoardTable, others: &BTreeMap<Pin, String>) -> Vec<Pin> {
    let ours = outputs(ours);
    let differs = ours
        .iter()
        .filter(|(pin, role)| others.get(pin) != Some(role));
    differs.map(|(pin, _)| *pin).collect()
}

fn sorted(pins: &[Pin]) -> Vec<Pin> {
    let mut pins = pins.to_vec();
    pins.sort_unstable();
    pins
}

/// What another board with this chip has elsewhere is not driven before the board is named.
#[test]
fn what_a_similar_board_has_elsewhere_is_known() {
    // `generic-bigtreetech-octopus-pro-v1.1.cfg`: HE0 is PA0, HE2 is PB0, PB10 is a lamp, PA2 enables driver 3.
    let mut pro = outputs(&octopus::BOARD);
    pro.insert(pin("PA0"), "heater 0".to_string());
    pro.insert(pin("PA2"), "enable 3".to_string());
    pro.insert(pin("PB10"), "lamp".to_string());
    let differs = differing(&octopus::BOARD, &pro);
    assert_eq!(differs, sorted(octopus::BOARD.differs));
    // Its hot end is not held low either: that would let motor 3 of an Octopus hold.
    assert!(octopus::BOARD.off().all(|heater| heater != pin("PA0")));
    let versions = [&spider::BOARD_1, &spider::BOARD_2];
    for [ours, other] in [versions, [versions[1], versions[0]]] {
        assert_eq!(differing(ours, &outputs(other)), sorted(ours.differs));
    }
}

/// Every heater and fan of a board is held low before it is used.
#[test]
fn all_that_heats_or_turns_is_off_at_first() {
    for board in [&octopus::BOARD, &spider::BOARD_1, &spider::BOARD_2] {
        let off: Vec<Pin> = board.off().collect();
        let outputs = outputs(board);
        let others = outputs.iter().filter(|(pin, _)| !off.contains(pin));
        assert!(others.clone().all(|(_, role)| role.starts_with("enable")));
        assert_eq!(others.count(), board.drivers.len());
        let channels: Vec<Pin> = board.channels().into_iter().flatten().collect();
        assert_eq!(channels, off[..6]);
    }
}

#[test]
fn a_table_that_cannot_be_is_refused() {
    octopus::BOARD.check();
    const CLASH: &[[Pin; 4]] = &[pins(["PF13", "PF12", "PF14", "PA2"])];
    const USB: &[Pin] = &[(0, 12)];
    const NO_CHANNEL: &[[Pin; 2]] = &[pins(["PA2", "PG4"])];
    const UNUSED: &[Pin] = &[(7, 0)];
    let timer = (pin("PB6"), 2, 1, 1);
    let board = octopus::BOARD;
    let wrong = [
        (
            "a pin is used twice",
            BoardTable {
                drivers: CLASH,
                ..board
            },
        ),
        (
            "one driver to eight",
            BoardTable {
                drivers: &[],
                ..board
            },
        ),
        ("a pin is used twice", BoardTable { fans: USB, ..board }),
        (
            "no channel",
            BoardTable {
                heaters: NO_CHANNEL,
                ..board
            },
        ),
        (
            "no channel",
            BoardTable {
                converter: 1,
                ..board
            },
        ),
        (
            "one of them",
            BoardTable {
                emergency: 9,
                ..board
            },
        ),
        (
            "has no use",
            BoardTable {
                differs: UNUSED,
                ..board
            },
        ),
        (
            "timer 2 to 5",
            BoardTable {
                servo: Some(timer),
                ..board
            },
        ),
        ("USART 1 to 3", BoardTable { usart: 4, ..board }),
        (
            "three fans",
            BoardTable {
                fans: &[(7, 0), (7, 1), (7, 2), (7, 3)],
                ..board
            },
        ),
    ];
    for (part, table) in wrong {
        let refused = catch_unwind(|| table.check()).expect_err(part);
        let text = refused.downcast_ref::<&str>().expect("a text");
        assert!(text.contains(part), "{text}");
    }
    for name in ["P", "PA", "A13", "PA16", "PI1", "PA1x", "PA123"] {
        assert!(catch_unwind(|| pin(name)).is_err(), "{name}");
    }
}

/// One enable for several drivers is no clash, and holds all of them.
#[test]
fn drivers_may_share_an_enable() {
    const SHARED: &[[Pin; 4]] = &[
        pins(["PF13", "PF12", "PF14", ""]),
        pins(["PG0", "PG1", "PF15", ""]),
        pins(["PF11", "PG3", "PF14", ""]),
    ];
    let board = BoardTable {
        drivers: SHARED,
        differs: &[],
        ..octopus::BOARD
    };
    board.check();
    assert_eq!(board.enabled_together()[..4], [5, 2, 5, 0]);
    // Motors without a driver have the last one's pins.
    assert_eq!(board.column(STEP)[2..], [pin("PF11"); 6]);
    assert_eq!(board.column(DIRECTION)[..2], pins(["PF12", "PG1"]));
    assert_eq!(
        (board.wire(0), board.wire(3), pin("")),
        (None, None, NO_PIN)
    );
    assert_eq!((board.drivers.len(), board.board_inputs().count), (3, 9));
}
