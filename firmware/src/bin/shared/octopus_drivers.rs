//! Wires of the drivers' UARTs on the BTT Octopus, driven and read as pins, timed by the core's cycle
//! counter. Only used from the main loop: nothing else changes pin modes once interrupts are on.

use crate::pins::{input, is_high, output};
use crate::runtime;
use crate::stm32f4::{CORE_HZ, CoreClock, start};
use headway_firmware::board::gaps::BoardClock;
use headway_firmware::board::octopus::UART;
use headway_firmware::drivers::DriverPort;
use headway_firmware::drivers::one_wire::{BitClock, OneWire, Wires};
use headway_firmware::steps::output::Pin;

/// While nothing interrupts: a bit is 1,680 clocks.
const FAST_BITS_S: u32 = 100_000;
/// With interrupts on: the servo at rest takes a tenth of a bit.
const SLOW_BITS_S: u32 = 10_000;

pub struct OctopusWires;

fn pin(motor: usize) -> Option<Pin> {
    UART.get(motor).copied()
}

impl Wires for OctopusWires {
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

pub struct OctopusDrivers(OneWire<OctopusWires, CoreClock>);

impl DriverPort for OctopusDrivers {
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
pub fn set_up() -> OctopusDrivers {
    UART.into_iter().for_each(input);
    OctopusDrivers(OneWire::new(OctopusWires, CoreClock, CORE_HZ / FAST_BITS_S))
}
