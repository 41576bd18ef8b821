//! All drivers of a board: set up before a motor is enabled, then queried one after another, those with UART while
//! nothing moves.
//!
//! In: a port that waits (a datagram and its answer take 15 ms by UART at 10 kbit/s, 0.1 ms by SPI), the motion between
//! its waits.
//! Out: a status of each driver; a fault if one is silent, has restarted, or has switched off. A board calls
//! [`DriverService::set_up`] before its interrupts are on, then in each round of its main loop
//! [`DriverService::is_due`], [`DriverService::turn`] and [`DriverService::tell`]: the first and the last
//! under the motion's lock, `turn` without it. Not covered: reading by UART while the machine moves, for which there
//! is no time.

use super::DriverPort;
use super::link::{DriverLink, LinkError, Readings};
use super::registers::{
    DRIVER_ERROR, HOT, LOW_SUPPLY, OPEN_LOADS, SHORTS, STANDS, WARM, WAS_RESET,
};
use super::spi_link::SpiLink;
use crate::configuration::drivers::{DriverConfiguration, DriversConfiguration};
use crate::motion::Motion;
use headway_protocol::message::{
    DeviceState, DriverFlags, DriverStatus, Fault, FaultCause, REPORT_MOTORS_MAX,
};
use heapless::Vec;

/// From one driver to the next, s: all eight are seen in 2 s, and the main loop is away for a tenth of its
/// time at most, even where all are silent.
const PERIOD_S: f64 = 0.25;
/// The same by SPI while the machine moves: a turn takes 0.5 ms.
const MOVING_PERIOD_S: f64 = 0.05;
/// Readings of a turning motor that must find an open load, one after the other: one may be wrong.
const OPEN_LOADS_MIN: u8 = 2;
/// DRV_STATUS: the current scale in use, and whether StealthChop is active.
const SCALE_SHIFT: u32 = 16;
const STEALTH: u32 = 1 << 30;

/// A fault of a driver.
type Trouble = (FaultCause, i32);

/// One motor's driver.
#[derive(Clone, Copy, Debug)]
struct Driver {
    configuration: Option<DriverConfiguration>,
    is_set_up: bool,
    trouble: Option<Trouble>,
    /// Readings in a row of a turning motor with an open load, up to [`OPEN_LOADS_MIN`].
    open_loads: u8,
}

impl Driver {
    fn has_spi(&self) -> bool {
        self.configuration
            .is_some_and(|driver| driver.kind.has_spi())
    }
}

/// All of them.
#[derive(Clone, Debug)]
pub struct DriverService {
    drivers: Vec<Driver, REPORT_MOTORS_MAX>,
    status: Vec<DriverStatus, REPORT_MOTORS_MAX>,
    next: usize,
    next_ticks: u64,
    servo_hz: f64,
    /// The machine moves: those with UART are left alone.
    moves: bool,
}

impl DriverService {
    /// Nothing is set up yet.
    pub fn new(configuration: &DriversConfiguration, servo_hz: u32) -> Self {
        let mut drivers = Vec::new();
        let mut status = Vec::new();
        for configuration in &configuration.drivers {
            // Room for all by the type's bound; collecting could panic.
            let _ = drivers.push(Driver {
                configuration: *configuration,
                is_set_up: false,
                trouble: None,
                open_loads: 0,
            });
            let flags = if configuration.is_some() {
                DriverFlags::SPOKEN_WITH
            } else {
                0
            };
            let _ = status.push(DriverStatus {
                flags,
                ..DriverStatus::default()
            });
        }
        Self {
            drivers,
            status,
            next: 0,
            next_ticks: 0,
            servo_hz: f64::from(servo_hz),
            moves: false,
        }
    }

    /// Whether there is nothing to speak with.
    pub fn is_idle(&self) -> bool {
        self.drivers
            .iter()
            .all(|driver| driver.configuration.is_none())
    }

    /// Sets all up, before interrupts are on.
    pub fn set_up(&mut self, port: &mut impl DriverPort) {
        for motor in 0..self.drivers.len() {
            self.serve(motor, port);
        }
    }

    /// Whether a turn is due: nothing moves, nor is about to, or a driver can be read meanwhile.
    pub fn is_due(&mut self, motion: &Motion) -> bool {
        let rests = matches!(
            motion.state(),
            DeviceState::Idle
                | DeviceState::Finished
                | DeviceState::Faulted
                | DeviceState::Paused
                | DeviceState::Heating
        );
        let now_ticks = motion.now_ticks();
        self.moves = !rests || !motion.is_at_rest();
        let can_read = !self.moves || self.drivers.iter().any(Driver::has_spi);
        if self.is_idle() || now_ticks < self.next_ticks || !can_read {
            return false;
        }
        let period_s = if self.moves {
            MOVING_PERIOD_S
        } else {
            PERIOD_S
        };
        self.next_ticks = now_ticks + (period_s * self.servo_hz) as u64;
        true
    }

    /// Queries the next driver, or sets it up if necessary.
    pub fn turn(&mut self, port: &mut impl DriverPort) {
        // Stand-alone ones are skipped.
        for _ in 0..self.drivers.len() {
            let motor = self.next;
            self.next = if motor + 1 < self.drivers.len() {
                motor + 1
            } else {
                0
            };
            let driver = self.drivers.get(motor);
            let can_read = !self.moves || driver.is_some_and(Driver::has_spi);
            if can_read && self.serve(motor, port) {
                return;
            }
        }
    }

    /// Reports the results to the motion: after a fault it comes to rest on the path.
    pub fn tell(&self, motion: &mut Motion) {
        let found = self
            .drivers
            .iter()
            .enumerate()
            .find_map(|(motor, driver)| driver.trouble.map(|trouble| (motor, trouble)));
        let fault = found.map(|(motor, (cause, value))| Fault {
            cause,
            index: motor as u8,
            value,
        });
        motion.drivers_mut().note(&self.status, fault);
        if let Some(fault) = fault {
            motion.fail_softly(fault);
        }
    }

    /// One driver's turn; false if the motor has none.
    fn serve(&mut self, motor: usize, port: &mut impl DriverPort) -> bool {
        let places = self.drivers.get_mut(motor).zip(self.status.get_mut(motor));
        let Some((driver, status)) = places else {
            return false;
        };
        let Some(configuration) = driver.configuration else {
            return false;
        };
        let set_up = (!driver.is_set_up).then_some(&configuration);
        let (served, retries) = if configuration.kind.has_spi() {
            let mut link = SpiLink::new(port, motor, configuration.kind);
            let set_up = set_up.map_or(Ok(()), |driver| link.set_up(driver));
            (set_up.and_then(|()| link.ask()), link.retries)
        } else {
            let mut link = DriverLink::new(port, motor, configuration.address);
            let set_up = set_up.map_or(Ok(()), |driver| link.set_up(driver));
            (set_up.and_then(|()| link.ask()), link.retries)
        };
        status.retries = status.retries.saturating_add(retries);
        driver.trouble = match served {
            Ok(readings) => judge(driver, &readings, status),
            Err(error) => Some(trouble_of(error)),
        };
        driver.is_set_up = !matches!(
            driver.trouble,
            Some((FaultCause::DriverSilent | FaultCause::DriverReset, _))
        );
        status.flags &= !DriverFlags::SET_UP;
        if driver.is_set_up {
            status.flags |= DriverFlags::SET_UP;
        }
        true
    }
}

/// Notes a driver's state; returns its fault, if any.
fn judge(driver: &mut Driver, readings: &Readings, status: &mut DriverStatus) -> Option<Trouble> {
    let Readings {
        events,
        state,
        celsius,
    } = *readings;
    let mut open = state & OPEN_LOADS != 0;
    if driver.has_spi() {
        // Only a motor that turns shows one.
        if state & STANDS == 0 {
            driver.open_loads = if open {
                OPEN_LOADS_MIN.min(driver.open_loads + 1)
            } else {
                0
            };
        }
        open = driver.open_loads == OPEN_LOADS_MIN;
    }
    let mut flags = DriverFlags::SPOKEN_WITH;
    for (is_so, flag) in [
        (state & WARM != 0, DriverFlags::WARM),
        (state & HOT != 0, DriverFlags::HOT),
        (state & SHORTS != 0, DriverFlags::SHORT),
        (open, DriverFlags::OPEN_LOAD),
        (events & LOW_SUPPLY != 0, DriverFlags::LOW_SUPPLY),
        (state & STEALTH != 0, DriverFlags::STEALTH),
    ] {
        if is_so {
            flags |= flag;
        }
    }
    status.flags = flags | celsius.map_or(0, DriverFlags::of_celsius);
    status.scale = (state >> SCALE_SHIFT & 31) as u8;
    let value = state as i32;
    if events & WAS_RESET != 0 {
        Some((FaultCause::DriverReset, value))
    } else if state & HOT != 0 {
        Some((FaultCause::DriverHot, value))
    } else if state & SHORTS != 0 || events & DRIVER_ERROR != 0 {
        Some((FaultCause::DriverShort, value))
    } else {
        None
    }
}

/// As WIRE.md numbers them.
fn trouble_of(error: LinkError) -> Trouble {
    let value = match error {
        LinkError::Silent => 0,
        LinkError::Noise => 1,
        LinkError::NotTaken(register) => 0x100 + i32::from(register),
        LinkError::ReadsBack(register) => 0x200 + i32::from(register),
        LinkError::Version(version) => 0x300 + i32::from(version),
        LinkError::Unfit => 0x400,
        LinkError::NoBus => 0x500,
    };
    (FaultCause::DriverSilent, value)
}
