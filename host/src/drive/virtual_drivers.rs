//! TMC2209 drivers without hardware: registers that are accessed by datagrams, with faults that can
//! be injected.
//!
//! In: bytes as received from the wire. Out: replies. Written from the data sheet (rev. 1.09, chapters 4 and 5)
//! without code of the firmware; the checksum is that of the `crc` crate. The virtual board uses it, and in the
//! tests a wire simulated by its levels. Not covered: currents and motors.

use crate::drive::virtual_spi_driver::VirtualSpiDriver;
use crc::{Algorithm, Crc};
use headway_firmware::configuration::drivers::{DriverConfiguration, DriversConfiguration};
use headway_firmware::drivers::{DATAGRAM_BYTES, DriverPort};
use std::collections::BTreeMap;

/// x⁸ + x² + x + 1, each byte's lowest bit first, result not reflected.
const SHEET: Algorithm<u8> = Algorithm {
    width: 8,
    poly: 0x07,
    init: 0,
    refin: true,
    refout: false,
    xorout: 0,
    check: 0,
    residue: 0,
};
const CRC: Crc<u8> = Crc::<u8>::new(&SHEET);

const GSTAT: u8 = 0x01;
const IFCNT: u8 = 0x02;
const IOIN: u8 = 0x06;
const DRV_STATUS: u8 = 0x6f;
/// Registers that can be read.
const READABLE: [u8; 7] = [0x00, GSTAT, IFCNT, IOIN, 0x6c, DRV_STATUS, 0x70];

/// One chip.
#[derive(Clone, Debug)]
pub struct VirtualDriver {
    /// Set by two pins.
    pub address: u8,
    /// Registers by number; unwritten ones are 0, IOIN has the version.
    pub registers: BTreeMap<u8, u32>,
    taken: u8,
}

impl VirtualDriver {
    /// Just switched on.
    pub fn new(address: u8) -> Self {
        let mut driver = Self {
            address,
            registers: BTreeMap::new(),
            taken: 0,
        };
        driver.restart();
        driver
    }

    /// As after an interruption of its supply: all settings are lost.
    pub fn restart(&mut self) {
        self.registers.clear();
        self.taken = 0;
        for (register, value) in [
            (0x00, 0x0000_0101),
            (GSTAT, 1),
            (IOIN, 0x2100_0000),
            (0x6c, 0x1000_0053),
            (0x70, 0xc10d_0024),
            (DRV_STATUS, 1 << 31),
        ] {
            self.registers.insert(register, value);
        }
    }

    /// A register.
    pub fn register(&self, number: u8) -> u32 {
        self.registers.get(&number).copied().unwrap_or(0)
    }

    /// Handles a complete datagram: returns its answer, if it has one. A wrong checksum is not
    /// answered.
    pub fn take(&mut self, datagram: &[u8]) -> Option<[u8; 8]> {
        let (&crc, body) = datagram.split_last()?;
        let is_ours = body[0] & 0x0f == 0x05 && CRC.checksum(body) == crc;
        if !is_ours || body[1] != self.address {
            return None;
        }
        match *body {
            [_, _, register] if register < 0x80 => {
                READABLE.contains(&register).then(|| self.answer(register))
            }
            [_, _, register, a, b, c, d] if register >= 0x80 => {
                self.write(register & 0x7f, u32::from_be_bytes([a, b, c, d]));
                None
            }
            _ => None,
        }
    }

    fn write(&mut self, register: u8, value: u32) {
        self.taken = self.taken.wrapping_add(1);
        let old = self.register(register);
        // Ones clear what has happened.
        let new = if register == GSTAT {
            old & !value
        } else {
            value
        };
        self.registers.insert(register, new);
        if register == 0x10 {
            let run = value >> 8 & 31;
            let status = self.register(DRV_STATUS) & !(31 << 16);
            self.registers.insert(DRV_STATUS, status | run << 16);
        }
    }

    fn answer(&self, register: u8) -> [u8; 8] {
        let value = match register {
            IFCNT => self.taken.into(),
            other => self.register(other),
        };
        let mut reply = [0x05, 0xff, register, 0, 0, 0, 0, 0];
        reply[3..7].copy_from_slice(&value.to_be_bytes());
        reply[7] = CRC.checksum(&reply[..7]);
        reply
    }
}

/// Drivers by motor, those with UART and those with SPI, on wires without fault.
#[derive(Clone, Debug, Default)]
pub struct VirtualDrivers(
    pub Vec<Option<VirtualDriver>>,
    pub Vec<Option<VirtualSpiDriver>>,
);

impl VirtualDrivers {
    /// One for each that is set up.
    pub fn of(configuration: &DriversConfiguration) -> Self {
        let drivers = || configuration.drivers.iter().copied();
        let uart = |driver: DriverConfiguration| VirtualDriver::new(driver.address);
        let spi = |driver: DriverConfiguration| VirtualSpiDriver::new(driver.kind);
        Self(
            drivers()
                .map(|one| one.filter(|driver| !driver.kind.has_spi()).map(uart))
                .collect(),
            drivers()
                .map(|one| one.filter(|driver| driver.kind.has_spi()).map(spi))
                .collect(),
        )
    }
}

impl DriverPort for VirtualDrivers {
    fn exchange(&mut self, motor: usize, request: &[u8], reply: &mut [u8]) -> usize {
        let Some(Some(driver)) = self.0.get_mut(motor) else {
            return 0;
        };
        let Some(answer) = driver.take(request) else {
            return 0;
        };
        let length = reply.len().min(answer.len());
        reply[..length].copy_from_slice(&answer[..length]);
        length
    }

    fn transfer(
        &mut self,
        motor: usize,
        request: &[u8; DATAGRAM_BYTES],
        reply: &mut [u8; DATAGRAM_BYTES],
    ) -> bool {
        // A bus without a chip that is selected is pulled up.
        *reply = match self.1.get_mut(motor) {
            Some(Some(driver)) => driver.transfer(request),
            _ => [0xff; DATAGRAM_BYTES],
        };
        true
    }
}
