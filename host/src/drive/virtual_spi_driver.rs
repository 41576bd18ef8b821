//! A TMC5160 or TMC2240 without hardware: registers behind a shift register of 40 bits.
//!
//! In: datagrams as the bus carries them. Out: the answer to the one before, or what it wrote. Written from the data
//! sheets (TMC5160A rev. 1.17, chapters 4 and 6; TMC2240 rev. 3) without code of the firmware. The virtual board uses
//! it, and in the tests a bus that is simulated by its levels. Not covered: currents and motors.

use headway_firmware::configuration::drivers::DriverKind;
use std::collections::BTreeMap;

const GSTAT: u8 = 0x01;
const IHOLD_IRUN: u8 = 0x10;
const DRV_STATUS: u8 = 0x6f;
/// Registers that a TMC5160 lets be read, of those that are used here; a TMC2240 lets all be.
const READABLE_5160: [u8; 5] = [0x00, GSTAT, 0x04, 0x6c, DRV_STATUS];
/// Those that cannot be written.
const READ_ONLY: [u8; 3] = [0x04, 0x51, DRV_STATUS];

/// One chip.
#[derive(Clone, Debug)]
pub struct VirtualSpiDriver {
    kind: DriverKind,
    /// Registers by number; unwritten ones are 0, IOIN has the version.
    pub registers: BTreeMap<u8, u32>,
    /// What the next datagram brings.
    answer: u32,
}

impl VirtualSpiDriver {
    /// Just switched on.
    pub fn new(kind: DriverKind) -> Self {
        let mut driver = Self {
            kind,
            registers: BTreeMap::new(),
            answer: 0,
        };
        driver.restart();
        driver
    }

    /// As after an interruption of its supply: all settings are lost.
    pub fn restart(&mut self) {
        self.answer = 0;
        // GSTAT, IOIN, CHOPCONF and PWMCONF.
        let [events, pins, chopper, pwm] = match self.kind {
            DriverKind::Tmc2240 => [0b1_1001, 0x4000_0000, 0x1441_0153, 0xc44c_001d],
            _ => [0b101, 0x3000_0040, 0x1041_0150, 0xc40c_001e],
        };
        let state = (DRV_STATUS, 1 << 31);
        // 26 °C, of a TMC2240.
        let warmth = (0x51, 2238);
        let values = [
            (GSTAT, events),
            (0x04, pins),
            (0x6c, chopper),
            (0x70, pwm),
            state,
            warmth,
        ];
        self.registers = values.into();
    }

    /// A register.
    pub fn register(&self, number: u8) -> u32 {
        self.registers.get(&number).copied().unwrap_or(0)
    }

    /// Exchanges a datagram.
    pub fn transfer(&mut self, request: &[u8; 5]) -> [u8; 5] {
        let [a, b, c, d] = self.answer.to_be_bytes();
        // Restarted, and a driver's error, are shown with every datagram.
        let state = (self.register(GSTAT) & 0b11) as u8;
        let [register, data @ ..] = *request;
        self.answer = if register >= 0x80 {
            let value = u32::from_be_bytes(data);
            self.write(register & 0x7f, value);
            value
        } else if self.kind == DriverKind::Tmc2240 || READABLE_5160.contains(&register) {
            self.register(register)
        } else {
            0
        };
        [state, a, b, c, d]
    }

    fn write(&mut self, register: u8, value: u32) {
        if READ_ONLY.contains(&register) {
            return;
        }
        // Ones clear what has happened.
        let new = match register {
            GSTAT => self.register(GSTAT) & !value,
            _ => value,
        };
        self.registers.insert(register, new);
        if register == IHOLD_IRUN {
            let run = value >> 8 & 31;
            let status = self.register(DRV_STATUS) & !(31 << 16);
            self.registers.insert(DRV_STATUS, status | run << 16);
        }
    }
}
