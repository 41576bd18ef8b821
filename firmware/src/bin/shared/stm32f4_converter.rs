//! A converter of the STM32F4, after RM0390 (chapter 13): the thermistors one after another, one conversion
//! at a time, started and read by the main loop, which never waits for it.

use super::rcc::{Bus, clock_on};
use super::{CoreDelay, pins};
use crate::BOARD;
use embedded_hal::delay::DelayNs;
use headway_firmware::board::HeatPort;
use headway_firmware::configuration::heat::HEATERS_MAX;

/// From a converter to the next: by addresses, and by clocks.
const CONVERTER_BYTES: usize = 0x100;
const NUMBER: usize = BOARD.converter as usize - 1;
const CLOCK: u32 = 1 << (8 + NUMBER);
const CONVERTER: usize = 0x4001_2000 + NUMBER * CONVERTER_BYTES;
const STATE: *mut u32 = CONVERTER as *mut u32;
const CONTROL: *mut u32 = (CONVERTER + 0x08) as *mut u32;
/// Sampling times of channels 10 to 18, and 0 to 9.
const SAMPLING: [*mut u32; 2] = [
    (CONVERTER + 0x0c) as *mut u32,
    (CONVERTER + 0x10) as *mut u32,
];
const SEQUENCE: *mut u32 = (CONVERTER + 0x34) as *mut u32;
const DATA: *mut u32 = (CONVERTER + 0x4c) as *mut u32;
const COMMON: *mut u32 = 0x4001_2304 as *mut u32;
/// 84 MHz / 4: at most 36.
const BY_FOUR: u32 = 1 << 16;
/// 480 clocks of every channel, three bits each: 23 us for the filter of 4.7 kOhm and 100 nF to follow.
const SLOWEST: u32 = 0o7_777_777_777;
const ON: u32 = 1;
/// Time from on until it can convert, three times the data sheet's.
const WAKING_US: u32 = 10;
const START: u32 = 1 << 30;
const DONE: u32 = 1 << 1;

/// The thermistors' channels.
const CHANNELS: [u32; HEATERS_MAX] = BOARD.sensor_channels();

/// Sensors and supply.
pub struct Thermistors {
    /// Which one is being converted.
    sensor: usize,
}

impl Thermistors {
    /// Before interrupts are on.
    pub fn set_up() -> Self {
        if BOARD.heaters.is_empty() {
            return Self { sensor: 0 };
        }
        clock_on(Bus::Apb2, CLOCK);
        // SAFETY: registers of this converter, which nothing else uses.
        unsafe {
            COMMON.write_volatile(BY_FOUR);
            for sampling in SAMPLING {
                sampling.write_volatile(SLOWEST);
            }
            CONTROL.write_volatile(ON);
        }
        CoreDelay.delay_us(WAKING_US);
        let heat = Self { sensor: 0 };
        heat.begin();
        heat
    }

    fn begin(&self) {
        let channel = CHANNELS.get(self.sensor).copied().unwrap_or(0);
        // SAFETY: as above.
        unsafe {
            SEQUENCE.write_volatile(channel);
            CONTROL.write_volatile(ON | START);
        }
    }
}

impl HeatPort for Thermistors {
    fn poll(&mut self) -> Option<(usize, u16)> {
        if BOARD.heaters.is_empty() {
            return None;
        }
        // SAFETY: as above; reading the data clears the flag.
        let raw = unsafe {
            if STATE.read_volatile() & DONE == 0 {
                return None;
            }
            DATA.read_volatile() as u16
        };
        let sensor = self.sensor;
        self.sensor = if sensor + 1 < BOARD.heaters.len() {
            sensor + 1
        } else {
            0
        };
        self.begin();
        Some((sensor, raw))
    }

    fn supply(&mut self, on: bool) {
        pins::supply(on);
    }
}
