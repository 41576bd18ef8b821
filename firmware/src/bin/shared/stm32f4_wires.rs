//! Drivers, set up before interrupts are on, then queried by the main loop; wires of their UARTs and of their SPI, driven
//! and read as pins. Only used from the main loop: nothing else changes pin modes once interrupts are on.

use super::pins::{input, is_high, output, put};
use super::runtime::with_motion;
use super::{CORE_HZ, CoreClock, runtime, start};
use crate::BOARD;
use headway_firmware::board::gaps::BoardClock;
use headway_firmware::configuration::drivers::DriversConfiguration;
use headway_firmware::drivers::one_wire::{BitClock, OneWire, Wires};
use headway_firmware::drivers::soft_spi::{BusWires, transfer};
use headway_firmware::drivers::{DATAGRAM_BYTES, DriverPort, DriverService};
use headway_firmware::steps::output::Pin;

/// While nothing interrupts: a bit is 1,680 clocks.
const FAST_BITS_S: u32 = 100_000;
/// With interrupts on: the servo at rest takes a tenth of a bit.
const SLOW_BITS_S: u32 = 10_000;
/// Half a bit of SPI: 1 MHz less what the pins take, where drivers bear 4.
const HALF_BIT_CLOCKS: u32 = CORE_HZ / 2_000_000;

pub struct PinWires;

impl Wires for PinWires {
    fn drive(&mut self, motor: usize, high: bool) {
        if let Some(pin) = BOARD.wire(motor) {
            output(pin, high);
        }
    }

    fn release(&mut self, motor: usize) {
        if let Some(pin) = BOARD.wire(motor) {
            input(pin);
        }
    }

    fn is_high(&mut self, motor: usize) -> bool {
        BOARD.wire(motor).is_none_or(is_high)
    }
}

/// SCK, MOSI and MISO.
struct Bus([Pin; 3]);

impl BusWires for Bus {
    fn select(&mut self, motor: usize, selected: bool) -> bool {
        let Some(chip) = BOARD.wire(motor) else {
            return false;
        };
        if selected {
            output(self.0[0], true);
            output(self.0[1], false);
            input(self.0[2]);
        }
        output(chip, !selected);
        true
    }

    fn clock(&mut self, high: bool) {
        put(self.0[0], high);
    }

    fn send(&mut self, high: bool) {
        put(self.0[1], high);
    }

    fn receive(&mut self) -> bool {
        is_high(self.0[2])
    }

    fn wait(&mut self) {
        cortex_m::asm::delay(HALF_BIT_CLOCKS);
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

    fn transfer(
        &mut self,
        motor: usize,
        request: &[u8; DATAGRAM_BYTES],
        reply: &mut [u8; DATAGRAM_BYTES],
    ) -> bool {
        runtime::note_pass();
        start::feed_if_early();
        let bus = BOARD.bus.map(Bus);
        bus.is_some_and(|mut bus| transfer(&mut bus, motor, request, reply))
    }

    fn slow_down(&mut self) {
        self.0.set_bit_clocks(CORE_HZ / SLOW_BITS_S);
    }
}

/// Wires let go: the boards' pull-ups are on, and those of the chip.
pub fn set_up() -> DriverWires {
    let wires = (0..BOARD.drivers.len()).filter_map(|motor| BOARD.wire(motor));
    wires.for_each(input);
    DriverWires(OneWire::new(PinWires, CoreClock, CORE_HZ / FAST_BITS_S))
}

/// The main loop's part.
pub struct DriverLoop {
    service: DriverService,
    port: DriverWires,
}

impl DriverLoop {
    /// Sets them up: interrupts are not on yet.
    // Never part of its caller, whose stack lasts.
    #[inline(never)]
    pub fn new(drivers: &DriversConfiguration, servo_hz: u32, mut port: DriverWires) -> Self {
        let mut service = DriverService::new(drivers, servo_hz);
        service.set_up(&mut port);
        with_motion(|motion| service.tell(motion));
        port.slow_down();
        Self { service, port }
    }

    /// One round of the main loop. A turn takes 30 ms, more only if a driver answers with noise.
    #[inline(never)]
    pub fn turn(&mut self) {
        if with_motion(|motion| self.service.is_due(motion)) == Some(true) {
            self.service.turn(&mut self.port);
            with_motion(|motion| self.service.tell(motion));
        }
    }
}
