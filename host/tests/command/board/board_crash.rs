//! Goal: a crash leaves a record that the next start reports, once. Method: the image as it is flashed, in QEMU, set up over
//! a model of the chip's registers, then alone; the debugger sets the program counter to where no memory is, to an undefined
//! instruction in RAM and to the panic handler; the chip is reset, as the watchdog does, which QEMU lacks; the command asks
//! the board that has started anew. Skipped, and said so, where QEMU or the target is missing.
#![cfg(unix)]

use crate::rig::{command, object, succeeded};
use headway_firmware::configuration::board_name::BoardName;
use headway_tests::elf::Elf;
use headway_tests::emulation::board_flash::named_flash;
use headway_tests::emulation::board_image::{alone, build, skipped};
use headway_tests::emulation::emulated_chip::{EmulatedChip, Start, with_chip_number};
use std::time::Duration;

/// Where the image's main loop begins.
const MAIN_LOOP: &str = "stm32f45serve17h";
/// The chip and the emulator have no memory there.
const NOWHERE: u32 = 0x0900_0000;
/// The link register, which a return would use.
const LR: u8 = 14;
/// The first argument of a function.
const R0: u8 = 0;
/// For what runs after a crash until it waits for the reset.
const STOPPING: Duration = Duration::from_millis(500);

fn started(elf: &Elf) -> EmulatedChip {
    let folder = crate::rig::folder("board-crash");
    let image = named_flash(elf, BoardName::Octopus11);
    let mut chip = EmulatedChip::start(Start {
        flash: vec![
            build("boot_loader", "").image(),
            with_chip_number(elf, image),
        ],
        folder: &folder,
    });
    chip.set_up(elf, MAIN_LOOP);
    chip
}

/// What `board info` says of the crash before; the chip runs meanwhile and stands still afterwards.
fn crash_of(chip: &mut EmulatedChip) -> serde_json::Value {
    chip.debugger.let_go();
    let info = command(&["board", "info", "--json", "--port", &chip.port()]);
    let text = object(&{ info }.output().expect("the command starts"));
    let info = command(&["board", "info", "--port", &chip.port()]).output();
    let said = succeeded(&info.expect("the command starts"));
    chip.debugger.halt();
    let crash = text["crash"].clone();
    assert_eq!(
        said.contains("the run before crashed"),
        !crash.is_null(),
        "{said}"
    );
    crash
}

/// Goes on there until the chip has stopped itself; then resets it and lets it set itself up.
fn crash_at(chip: &mut EmulatedChip, elf: &Elf, place: u32) {
    chip.debugger.set_place(place);
    chip.debugger.let_go();
    std::thread::sleep(STOPPING);
    chip.debugger.halt();
    chip.reset(elf, MAIN_LOOP);
}

#[test]
fn a_crash_is_reported_by_the_next_start_and_not_by_the_one_after() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let elf = build("octopus", "octopus");
    let mut chip = started(&elf);
    assert!(crash_of(&mut chip).is_null(), "nothing has crashed yet");
    // Nothing can be fetched: a bus fault of its instruction.
    chip.debugger.set_register(LR, 0x0801_2345);
    crash_at(&mut chip, &elf, NOWHERE);
    let crash = crash_of(&mut chip).to_string();
    println!("{crash}");
    for part in [
        "PC 0x09000000",
        "LR 0x08012345",
        "CFSR 0x00000100",
        "no instruction can be fetched",
    ] {
        assert!(crash.contains(part), "{part}: {crash}");
    }
    // It is told once: the next start was in order.
    chip.reset(&elf, MAIN_LOOP);
    assert!(crash_of(&mut chip).is_null());
    // `udf` in memory that nothing uses now: below the stack's end.
    let here = chip.debugger.register(13) - 0x4000;
    chip.debugger.set_half(here, 0xde00);
    crash_at(&mut chip, &elf, here);
    let crash = crash_of(&mut chip).to_string();
    println!("{crash}");
    for part in [
        &format!("PC {here:#010x}"),
        "CFSR 0x00010000",
        "undefined instruction",
    ] {
        assert!(crash.contains(part), "{part}: {crash}");
    }
    let tick: u32 = crash
        .rsplit(' ')
        .next()
        .and_then(|tick| tick.trim_end_matches('"').parse().ok())
        .expect("a tick");
    assert!(tick > 0, "the servo had run: {crash}");
    // The panic handler, with whatever lies where it looks for the place of the panic.
    let handler = elf.address_of("rust_begin_unwind").expect("it can panic");
    chip.debugger.set_register(R0, 0);
    crash_at(&mut chip, &elf, handler);
    let crash = crash_of(&mut chip).to_string();
    println!("{crash}");
    assert!(crash.contains("panic in line"), "{crash}");
}
