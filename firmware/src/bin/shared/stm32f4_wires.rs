//! Wires of the drivers' UARTs, driven and read as pins, timed by the core's cycle counter. Only used from the main
//! loop: nothing else changes pin modes once interrupts are on.

use super::pins::{input, is_high, output};
use super::{CORE_HZ, CoreClock, runtime, start};
use crate::BOARD;
use headway_firmware::board::gaps::BoardClock;
use headway_firmware::drivers::DriverPort;
use headway_firmware::drivers::one_wire::{BitClock, OneWire, Wires};
use headway_firmware::steps::output::Pin;

/// While nothing interrupts: a bit is 1,680 clocks.
const FAST_BITS_S: u32 = 100_000;
/// With interrupts on: the servo at rest takes a tenth of a bit.
const SLOW_BITS_S: u32 = 10_000;

pub struct PinWires;

fn pin(motor: usize) -> Option<Pin> {
    BOARD.drivers.get(motor)?.wire
}

impl Wires for PinWires {
    fn drive(&mut self, motor: usize, high: bool) {
        if let Some(pin) = pin(motor) {
            output(pin, high);
        }
    }

    fn release(&mut self, motor: usize) {
        if let Some(pin) = pin(motor) {
            input(pin);
        }
    }

    fn is_high(&mut self, motor: usize) -> bool {
        pin(motor).is_none_or(is_high)
    }
}

impl BitClock for CoreClock {
    fn now_clocks(&mut self) -> u32 {
        <CoreClock as BoardClock>::now_clocks()
    }
}

pub struct DriverWires(OneWire<PinWires, CoreClock>);

impl DriverPort for DriverWires {
    fn exchange(&mut self, motor: usize, request: &[u8], reply: &mut [u8]) -> usize {
        // A datagram takes its time; before interrupts are on the watchdog is fed here.
        runtime::note_pass();
        start::feed_if_early();
        self.0.exchange(motor, request, reply)
    }

    fn slow_down(&mut self) {
        self.0.set_bit_clocks(CORE_HZ / SLOW_BITS_S);
    }
}

/// Wires let go: the boards' pull-ups are on, and those of the chip.
pub fn set_up() -> DriverWires {
    let wires = BOARD.drivers.iter().filter_map(|driver| driver.wire);
    wires.for_each(input);
    DriverWires(OneWire::new(PinWires, CoreClock, CORE_HZ / FAST_BITS_S))
}
