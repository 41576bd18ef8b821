//! Goal: a panic stops the machine wherever it comes: no step after it, heaters low, drivers off; a press of the
//! emergency input stops the steps, a spike does not. Method: the USB image as it is flashed, in QEMU, set up over a
//! model of the chip's registers, then alone; the command jogs; the debugger sets the program counter to the panic
//! handler in USB code (which has no privilege), the main loop, the servo and the step interrupt; QEMU's trace has every
//! write. Skipped, and said so, where QEMU or the target is missing.
#![cfg(unix)]

use crate::rig::{command, stderr};
use headway_firmware::board::octopus::BOARD;
use headway_firmware::board::table::STEP;
use headway_firmware::configuration::board_name::BoardName;
use headway_firmware::steps::output::Pin;
use headway_tests::elf::Elf;
use headway_tests::emulation::board_flash::named_flash;
use headway_tests::emulation::board_image::{alone, build, skipped};
use headway_tests::emulation::debugger::At;
use headway_tests::emulation::emulated_chip::{EmulatedChip, Start, Write, with_chip_number};
use std::process::Child;
use std::time::Duration;

const PORT_A: u32 = 0x4002_0000;
const PORT_BYTES: u32 = 0x400;
/// The emergency input.
const PROBE: Pin = BOARD.inputs[8];
/// Levels of port B, with it.
const LEVELS_B: u32 = PORT_A + PORT_BYTES + 0x10;
const WATCHDOG_KEY: u32 = 0x4000_3000;
/// A busy machine takes its time.
const PATIENCE: Duration = Duration::from_secs(60);
/// Nothing was written for so long: the chip writes thousands of times in it while it runs.
const SILENCE: Duration = Duration::from_millis(700);
/// Many times what a stop writes.
const WRITES_MAX: usize = 20_000;
/// Halts of which at least one comes where no pending step tick makes a step.
const TRIALS: usize = 3;
/// Steps after which it is certain that it moves.
const UNDER_WAY: usize = 20;

/// Pins that a write sets, and those that it clears.
fn set_and_cleared(write: &Write) -> Option<(usize, u32, u32)> {
    let offset = write.address.checked_sub(PORT_A)?;
    let is_set_reset = offset % PORT_BYTES == 0x18 && offset < 8 * PORT_BYTES;
    let port = (offset / PORT_BYTES) as usize;
    is_set_reset.then_some((port, write.value & 0xffff, write.value >> 16))
}

fn sets(write: &Write, pins: &[Pin]) -> bool {
    set_and_cleared(write).is_some_and(|(port, set, _)| {
        pins.iter()
            .any(|pin| pin.0 == port && set >> pin.1 & 1 == 1)
    })
}

fn clears(write: &Write, pin: Pin) -> bool {
    set_and_cleared(write)
        .is_some_and(|(port, _, cleared)| pin.0 == port && cleared >> pin.1 & 1 == 1)
}

/// True at the last of so many writes that `counts`.
fn after(number: usize, counts: impl Fn(&Write) -> bool) -> impl FnMut(&Write) -> bool {
    let mut left = number;
    move |write| {
        left -= usize::from(counts(write)).min(left);
        left == 0
    }
}

fn is_step(write: &Write) -> bool {
    sets(write, &BOARD.column(STEP))
}

fn steps(writes: &[Write]) -> usize {
    writes.iter().filter(|write| is_step(write)).count()
}

/// An Octopus that jogs, and the command that has told it to.
fn jogging(elf: &Elf, name: &str) -> (EmulatedChip, Child) {
    let folder = crate::rig::folder(name);
    let image = named_flash(elf, BoardName::Octopus11);
    let mut chip = EmulatedChip::start(Start {
        flash: vec![
            build("boot_loader", "").image(),
            with_chip_number(elf, image),
        ],
        folder: &folder,
    });
    chip.set_up(elf, "stm32f45serve17h");
    chip.debugger.let_go();
    let jog = ["board", "jog", "x", "200", "--port", &chip.port()];
    let jog = command(&jog).spawn().expect("the command starts");
    // Untraced until it has begun, surely.
    std::thread::sleep(Duration::from_secs(1));
    chip.trace_writes();
    let begun = chip.writes_until(after(UNDER_WAY, is_step), PATIENCE);
    assert_eq!(steps(&begun), UNDER_WAY, "the board moves");
    (chip, jog)
}

/// Halts a board that jogs there, sets its program counter to the panic handler, and looks at what is written from then
/// on. Both halves: what interrupts wrote that were pending at the halt, and what came from the handler's first write on.
fn written_after_panic(elf: &Elf, name: &str, at: At) -> (Vec<Write>, Vec<Write>) {
    let (mut chip, mut jog) = jogging(elf, name);
    chip.debugger.halt();
    chip.debugger.stop_at(at);
    chip.debugger.run();
    chip.debugger.pass_by(at);
    let handler = elf.address_of("rust_begin_unwind").expect("it can panic");
    let _before = chip.writes_until(|_| false, SILENCE);
    chip.debugger.set_place(handler);
    chip.debugger.let_go();
    let mut pending = chip.writes_until(after(WRITES_MAX, |_| true), SILENCE);
    // It has ended by itself, or waits for the board.
    let _ = jog.kill();
    let _ = jog.wait();
    let is_handler = |write: &Write| BOARD.off().any(|pin| clears(write, pin));
    let first = pending
        .iter()
        .position(is_handler)
        .expect("the handler writes");
    let later = pending.split_off(first);
    (pending, later)
}

/// A panic there stops the machine. The emulator takes an interrupt that was pending at the halt before the handler's
/// first instruction, which masks them; one step tick in a hundred that are pending makes a step, which says nothing of
/// the handler: such a trial is made again.
fn panics(elf: &Elf, name: &str, at: At) {
    let trial = |number| written_after_panic(elf, &format!("{name}-{number}"), at);
    let (pending, later) = (0..TRIALS)
        .map(trial)
        .find(|(pending, _)| steps(pending) == 0)
        .expect("in one trial no step comes before the handler");
    println!(
        "{name}: {} writes of interrupts before the handler",
        pending.len()
    );
    println!(
        "{name}: {} writes of the handler, {} steps",
        later.len(),
        steps(&later)
    );
    assert!(later.len() < WRITES_MAX, "{name}: it goes on");
    assert_eq!(steps(&later), 0, "{name}");
    for heater in BOARD.off() {
        assert!(
            later.iter().any(|write| clears(write, heater)),
            "{name}: {heater:?} stays"
        );
        assert!(
            !later.iter().any(|write| sets(write, &[heater])),
            "{name}: {heater:?}"
        );
    }
    for enable in BOARD.enables() {
        assert!(
            later.iter().any(|write| sets(write, &[enable])),
            "{name}: {enable:?} stays on"
        );
    }
    let feeds = later.iter().filter(|write| write.address == WATCHDOG_KEY);
    assert_eq!(
        feeds.count(),
        0,
        "{name}: the watchdog is fed, so it never starts anew"
    );
}

#[test]
fn a_panic_stops_the_machine_wherever_it_comes() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let elf = build("octopus", "octopus");
    let function = |name: &str| At::Instruction(elf.address_of(name).expect("it is there"));
    for (name, at) in [
        // What USB asks its core first, and what the main loop asks the converter.
        ("in-usb", At::Read(0x5000_0014, 4)),
        ("in-main-loop", At::Read(0x4001_2200, 4)),
        ("in-servo", function("PendSV")),
        ("in-steps", function("SysTick")),
    ] {
        panics(&elf, name, at);
    }
}

#[test]
fn a_press_of_the_emergency_input_stops_the_steps_and_a_spike_does_not() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let elf = build("octopus", "octopus");
    let (mut chip, jog) = jogging(&elf, "emergency");
    // The line goes up and down again, far quicker than its interrupt looks at the level.
    let line_7 = "set_irq_in /machine/unattached/device[0]/exti unnamed-gpio-in 7";
    let answer = chip.say("qtest", &format!("{line_7} 1\n{line_7} 0"));
    assert_eq!(answer.matches("OK").count(), 2, "{answer}");
    let later = chip.writes_until(after(UNDER_WAY, is_step), PATIENCE);
    assert_eq!(steps(&later), UNDER_WAY, "a spike stops nothing");
    // Pressed for as long as the servo and its six looks read it, and once more.
    chip.set_bits(LEVELS_B, 1 << PROBE.1, 14);
    let output = jog.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("emergency"), "{}", stderr(&output));
    // The trace may be seconds behind. What was written before the stop was reported, then what comes after that.
    chip.writes_so_far();
    let rest = chip.writes_until(after(10 * WRITES_MAX, |_| true), SILENCE);
    assert!(!rest.is_empty(), "its servo goes on");
    assert_eq!(steps(&rest), 0, "it stands");
}
