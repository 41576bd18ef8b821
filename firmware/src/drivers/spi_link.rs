//! Reads and writes registers of a driver with SPI, with verification: bounded tries, each counted.
//!
//! ```text
//! request: register (+ 80 to write) | data, highest byte first (4)
//! reply:   state                    | what the request before has asked for, or has written (4)
//! ```
//! In: a port, a motor, its configuration. Out: values, or why there are none. There is no checksum: the chip's version
//! is read with everything else, a write comes back with the next request, and a fault is read twice. Not covered: a
//! write that the line carries and the chip ignores, in a register that cannot be read.

use super::DriverPort;
use super::link::{LinkError, Readings, TRIES};
use super::registers::{DRIVER_ERROR, DRV_STATUS, GSTAT, HOT, SHORTS};
use super::soft_spi::DATAGRAM_BYTES;
use super::spi_registers::{
    ADC_TEMP, ALL_EVENTS, IOIN, celsius, events_as_2209, settings, state_as_2209,
};
use crate::configuration::drivers::{DriverConfiguration, DriverKind};

const WRITES: u8 = 0x80;
/// Bits of the state that a fault is made of.
const FAULTS: u32 = HOT | SHORTS;

/// A driver's registers.
#[derive(Debug)]
pub struct SpiLink<'a, P> {
    port: &'a mut P,
    motor: usize,
    kind: DriverKind,
    /// Datagrams that had to be sent again.
    pub retries: u16,
}

impl<'a, P: DriverPort> SpiLink<'a, P> {
    /// Of a motor.
    pub fn new(port: &'a mut P, motor: usize, kind: DriverKind) -> Self {
        Self {
            port,
            motor,
            kind,
            retries: 0,
        }
    }

    /// One datagram: the answer to the one before.
    fn exchange(&mut self, register: u8, value: u32) -> Result<u32, LinkError> {
        let [a, b, c, d] = value.to_be_bytes();
        let mut reply = [0; DATAGRAM_BYTES];
        if !self
            .port
            .transfer(self.motor, &[register, a, b, c, d], &mut reply)
        {
            return Err(LinkError::NoBus);
        }
        let [_state, a, b, c, d] = reply;
        Ok(u32::from_be_bytes([a, b, c, d]))
    }

    /// Registers, one after another.
    ///
    /// # Errors
    /// `Silent` or `Version`, after [`TRIES`], or `NoBus`.
    pub fn read<const N: usize>(&mut self, registers: [u8; N]) -> Result<[u32; N], LinkError> {
        let mut error = LinkError::Silent;
        for _ in 0..TRIES {
            let mut values = [0; N];
            let asked = registers.into_iter().skip(1).chain([IOIN]);
            self.exchange(registers.first().copied().unwrap_or(IOIN), 0)?;
            for (value, next) in values.iter_mut().zip(asked) {
                *value = self.exchange(next, 0)?;
            }
            let pins = self.exchange(IOIN, 0)?;
            let [version, ..] = pins.to_be_bytes();
            if version == self.kind.numbers().1 {
                return Ok(values);
            }
            // A line without a chip gives one level only.
            error = match pins {
                0 | u32::MAX => LinkError::Silent,
                _ => LinkError::Version(version),
            };
            self.retries = self.retries.saturating_add(1);
        }
        Err(error)
    }

    /// Writes one; what was received comes back.
    fn write(&mut self, register: u8, value: u32) -> Result<(), LinkError> {
        for _ in 0..TRIES {
            self.exchange(register | WRITES, value)?;
            if self.exchange(IOIN, 0)? == value {
                return Ok(());
            }
            self.retries = self.retries.saturating_add(1);
        }
        Err(LinkError::NotTaken(register))
    }

    /// Sets the driver up and reads back its readable registers.
    ///
    /// # Errors
    /// The first failure; earlier writes remain.
    pub fn set_up(&mut self, driver: &DriverConfiguration) -> Result<(), LinkError> {
        let settings = settings(driver).ok_or(LinkError::Unfit)?;
        self.read([GSTAT])?;
        for setting in &settings {
            self.write(setting.register, setting.value)?;
        }
        for setting in settings.iter().filter(|setting| setting.is_readable) {
            let reads_back =
                |link: &mut Self| Ok(link.read([setting.register])? == [setting.value]);
            // What differs for once is the line.
            if !reads_back(self)? && !reads_back(self)? {
                return Err(LinkError::ReadsBack(setting.register));
            }
        }
        // From here on a restart of the chip shows.
        self.write(GSTAT, ALL_EVENTS)
    }

    /// Its state, in the TMC2209's bits.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn ask(&mut self) -> Result<Readings, LinkError> {
        let first = self.readings()?;
        if first.events | first.state & FAULTS == 0 {
            return Ok(first);
        }
        let mut readings = self.readings()?;
        readings.events &= first.events;
        readings.state &= first.state | !FAULTS;
        if readings.events & DRIVER_ERROR != 0 {
            // It is latched; what lasts is told again.
            self.write(GSTAT, DRIVER_ERROR)?;
        }
        Ok(readings)
    }

    fn readings(&mut self) -> Result<Readings, LinkError> {
        let [events, state, warmth] = self.read([GSTAT, DRV_STATUS, ADC_TEMP])?;
        Ok(Readings {
            events: events_as_2209(events),
            state: state_as_2209(state),
            celsius: (self.kind == DriverKind::Tmc2240).then(|| celsius(warmth)),
        })
    }
}
