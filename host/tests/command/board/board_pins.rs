//! Goal: when the set-up of an image is over, every pin is what it is meant to be: heaters and fans outputs and low,
//! drivers off, steps and directions outputs, nothing else driven; no peripheral was used without its clock; and no pin
//! is driven that may be something else as long as nobody has said which board it is. Method: each image as it is
//! flashed, in QEMU, with a model of the chip's registers behind it (`register_model`). Skipped, and said so, where
//! QEMU or the target is missing; `HEADWAY_DEMAND_EMULATOR=1` makes that a failure.
#![cfg(unix)]

use headway_firmware::board::table::BoardTable;
use headway_firmware::board::{octopus, spider};
use headway_firmware::configuration::board_name::BoardName;
use headway_firmware::steps::output::Pin;
use headway_tests::emulation::board_flash::named_flash;
use headway_tests::emulation::board_image::{alone, build, skipped};
use headway_tests::emulation::emulated_chip::{EmulatedChip, Start, with_chip_number};
use headway_tests::emulation::register_model::{PinState, RegisterModel};
use std::collections::BTreeMap;

/// Motors of the machine that is built in.
const MOTORS: usize = 5;
const PULLED_UP: PinState = PinState::Input(1);
/// Pins of the chip's debugger after a reset: 13 to 15 of port A, 3 and 4 of port B.
const DEBUGGER: [Pin; 5] = [(0, 13), (0, 14), (0, 15), (1, 3), (1, 4)];

/// The registers when the main loop of a board begins.
fn set_up(bin: &str, features: &str, name: Option<BoardName>) -> RegisterModel {
    let elf = build(bin, features);
    let image = name.map_or_else(|| elf.image(), |name| named_flash(&elf, name));
    let loader = build("boot_loader", "").image();
    let flash = vec![loader, with_chip_number(&elf, image)];
    let name = format!("{bin}-{features}-{name:?}");
    let folder = crate::rig::folder(&name);
    let mut chip = EmulatedChip::start(Start {
        flash,
        folder: &folder,
    });
    chip.set_up(&elf, "stm32f45serve17h");
    let model = std::mem::take(&mut chip.model);
    println!("{name}: {:?}", model.used);
    assert_eq!(model.wrong, Vec::<String>::new(), "{name}");
    model
}

/// Every pin of the ports, against what is meant; all others as after a reset.
fn assert_pins(model: &RegisterModel, meant: &BTreeMap<Pin, PinState>, name: &str) {
    for port in 0..8 {
        for pin in (0..16).map(|number| (port, number)) {
            let found = model.pin(pin);
            let is_debuggers = DEBUGGER.contains(&pin);
            let reset = if is_debuggers {
                PinState::Alternate(0)
            } else {
                PinState::Input(0)
            };
            let expected = meant.get(&pin).copied().unwrap_or(reset);
            assert_eq!(found, expected, "{name}: {pin:?}");
        }
    }
}

/// What a board's pins are meant to be before anything is asked of it.
fn meant(board: &BoardTable, has_usb: bool) -> BTreeMap<Pin, PinState> {
    let motors = board.drivers.iter().take(MOTORS);
    let low = motors.flat_map(|[step, direction, ..]| [*step, *direction]);
    let low = low.chain(board.off());
    // An enable is on while it is low; the supply is on while it is high.
    let high = board.enables().chain(board.supply);
    let wires = (0..board.drivers.len()).filter_map(|motor| board.wire(motor));
    let inputs = board.inputs.iter().copied().chain(wires);
    let mut meant = BTreeMap::new();
    meant.extend(low.map(|pin| (pin, PinState::Output(false))));
    meant.extend(high.map(|pin| (pin, PinState::Output(true))));
    meant.extend(inputs.map(|pin| (pin, PULLED_UP)));
    let sensors = board.heaters.iter().map(|[_, sensor]| *sensor);
    meant.extend(sensors.map(|pin| (pin, PinState::Analog)));
    meant.extend(board.serial.map(|pin| (pin, PinState::Alternate(7))));
    if let Some((servo, function, ..)) = board.servo {
        meant.insert(servo, PinState::Alternate(function));
    }
    if has_usb {
        // D- and D+.
        meant.extend([11, 12].map(|pin| ((0, pin), PinState::Alternate(10))));
    }
    meant
}

/// What the model finds wrong: the whole test hangs on it.
#[test]
fn the_model_finds_a_clock_that_is_not_waited_for_and_a_port_that_is_reset() {
    let (ports_reset, clocks_ahb1, clocks_apb1) = (0x4002_3810, 0x4002_3830, 0x4002_3840);
    let (modes_a, set_a, timer_4) = (0x4002_0000, 0x4002_0018, 0x4000_0800);
    let mut model = RegisterModel::default();
    model.write(modes_a, 1);
    assert!(
        model.wrong[0].contains("without its clock"),
        "{:?}",
        model.wrong
    );
    model.wrong.clear();
    // Timer 4's clock, not waited for, then read back.
    model.write(clocks_apb1, 1 << 2);
    model.write(timer_4, 1);
    assert!(model.wrong[0].contains("too soon"), "{:?}", model.wrong);
    model.wrong.clear();
    model.read(clocks_apb1);
    model.write(timer_4, 1);
    // Port A's by the word of its bit, and a barrier behind it.
    model.write(0x4200_0000 + (0x2_3830 * 8) * 4, 1);
    model.waited(clocks_ahb1);
    model.write(set_a, 1 << 1);
    model.write(modes_a, 0xa800_0004);
    assert_eq!(model.pin((0, 1)), PinState::Output(true));
    model.write(ports_reset, 1);
    model.write(modes_a, 4);
    assert!(model.wrong[0].contains("in reset"), "{:?}", model.wrong);
    model.wrong.clear();
    model.write(ports_reset, 0);
    model.write(ports_reset, 1);
    model.write(ports_reset, 0);
    assert_eq!(model.pin((0, 1)), PinState::Input(0));
    assert_eq!(model.pin((0, 14)), PinState::Alternate(0));
    assert_eq!(model.wrong, Vec::<String>::new());
}

#[test]
fn every_pin_of_an_octopus_is_as_meant_when_its_set_up_is_over() {
    if skipped() {
        return;
    }
    let _alone = alone();
    for (features, has_usb) in [("octopus", true), ("octopus-serial", false)] {
        let model = set_up("octopus", features, Some(BoardName::Octopus11));
        assert_pins(&model, &meant(&octopus::BOARD, has_usb), features);
        assert_eq!(model.used.contains("USB"), has_usb);
        for used in ["timer 4", "timer 11", "converter 3", "USART 2", "SYSCFG"] {
            assert!(model.used.contains(used), "{features}: {used}");
        }
    }
}

#[test]
fn every_pin_of_a_spider_is_as_meant_when_its_set_up_is_over() {
    if skipped() {
        return;
    }
    let _alone = alone();
    for (bin, board) in [("spider", spider::BOARD_1), ("spider22", spider::BOARD_2)] {
        let model = set_up(bin, "octopus", board.names.first().copied());
        assert_pins(&model, &meant(&board, true), bin);
        for used in ["USB", "timer 11", "converter 1", "USART 1", "SYSCFG"] {
            assert!(model.used.contains(used), "{bin}: {used}");
        }
        // The other version's name is no name of it: as without.
        let other = BoardName::Spider11 as usize + BoardName::Spider22 as usize;
        let other = BoardName::ALL[other - board.names[0] as usize];
        let model = set_up(bin, "octopus", Some(other));
        assert_unnamed(&model, &board, bin);
    }
}

/// Pins that another board has elsewhere are inputs.
fn assert_unnamed(model: &RegisterModel, board: &BoardTable, name: &str) {
    let mut meant = meant(board, true);
    for pin in board.differs {
        assert!(meant.remove(pin).is_some(), "{pin:?} has a use");
    }
    assert_pins(model, &meant, name);
}

#[test]
fn pins_that_another_board_has_elsewhere_stay_inputs_until_the_board_is_named() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let model = set_up("octopus", "octopus", None);
    assert_unnamed(&model, &octopus::BOARD, "unnamed");
}
