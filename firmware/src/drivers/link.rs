//! Reads and writes registers of one motor's driver with verification: bounded tries, each counted.
//!
//! In: a port, motor and node address. Out: values, or why there are none. A write is accepted when the
//! chip's own counter (IFCNT) has increased by one. An attempt whose answer was lost may have been
//! accepted: writing the same value twice is harmless.

use super::DriverPort;
use super::datagram::{self, WRITE_BYTES};
use super::registers::{DRV_STATUS, GSTAT, IFCNT, IOIN, settings};
use crate::configuration::drivers::DriverConfiguration;

/// Tries of a read or a write: at one bad datagram in ten, which is a broken wire, one in 10⁵ fails.
pub const TRIES: usize = 5;
/// All bits of GSTAT.
const ALL_EVENTS: u32 = 0b111;

/// Why a driver is not as it should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkError {
    /// No answer.
    Silent,
    /// No answer was valid.
    Noise,
    /// It does not count this register's write.
    NotTaken(u8),
    /// This register reads back otherwise.
    ReadsBack(u8),
    /// Another chip, with this version.
    Version(u8),
    /// It cannot be set so.
    Unfit,
    /// The board has no bus to it.
    NoBus,
}

/// What a driver tells of itself, in the bits of a TMC2209.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Readings {
    /// GSTAT.
    pub events: u32,
    /// DRV_STATUS.
    pub state: u32,
    /// Its temperature, °C, if it measures that.
    pub celsius: Option<i16>,
}

/// A driver's registers.
#[derive(Debug)]
pub struct DriverLink<'a, P> {
    /// Wires.
    pub port: &'a mut P,
    /// The motor of the driver.
    pub motor: usize,
    /// Its node address.
    pub address: u8,
    /// Datagrams that had to be sent again.
    pub retries: u16,
}

impl<'a, P: DriverPort> DriverLink<'a, P> {
    /// Of a motor.
    pub fn new(port: &'a mut P, motor: usize, address: u8) -> Self {
        Self {
            port,
            motor,
            address,
            retries: 0,
        }
    }

    /// One register.
    ///
    /// # Errors
    /// `Silent` or `Noise`, after [`TRIES`].
    pub fn read(&mut self, register: u8) -> Result<u32, LinkError> {
        let mut error = LinkError::Silent;
        for _ in 0..TRIES {
            let asked = datagram::read(self.address, register);
            let mut answer = [0; WRITE_BYTES];
            let came = self.port.exchange(self.motor, &asked, &mut answer);
            if came == WRITE_BYTES
                && let Some(value) = datagram::reply(&answer, register)
            {
                return Ok(value);
            }
            if came > 0 {
                error = LinkError::Noise;
            }
            self.retries = self.retries.saturating_add(1);
        }
        Err(error)
    }

    fn writes_taken(&mut self) -> Result<u8, LinkError> {
        Ok(self.read(IFCNT)? as u8)
    }

    /// Writes one, `before` being the chip's count; that afterwards.
    fn write(&mut self, register: u8, value: u32, before: u8) -> Result<u8, LinkError> {
        let mut known = before;
        for _ in 0..TRIES {
            let sent = datagram::write(self.address, register, value);
            self.port.exchange(self.motor, &sent, &mut []);
            let now = self.writes_taken()?;
            if now == known.wrapping_add(1) {
                return Ok(now);
            }
            known = now;
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
        let [version, ..] = self.read(IOIN)?.to_be_bytes();
        if version != driver.kind.numbers().1 {
            return Err(LinkError::Version(version));
        }
        let mut taken = self.writes_taken()?;
        for setting in &settings {
            taken = self.write(setting.register, setting.value, taken)?;
        }
        for setting in settings.iter().filter(|setting| setting.is_readable) {
            if self.read(setting.register)? != setting.value {
                return Err(LinkError::ReadsBack(setting.register));
            }
        }
        // From here on a restart of the chip shows.
        self.write(GSTAT, ALL_EVENTS, taken)?;
        Ok(())
    }

    /// Its state.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn ask(&mut self) -> Result<Readings, LinkError> {
        Ok(Readings {
            events: self.read(GSTAT)?,
            state: self.read(DRV_STATUS)?,
            celsius: None,
        })
    }
}
