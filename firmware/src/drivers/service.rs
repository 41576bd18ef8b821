//! All drivers of a board: set up before a motor is enabled, then queried one after another while nothing
//! moves.
//!
//! In: a port that waits (a datagram and its answer take 15 ms at 10 kbit/s), the motion between its waits.
//! Out: a status of each driver; a fault if one is silent, has restarted, or has switched off. A board calls
//! [`DriverService::set_up`] before its interrupts are on, then in each round of its main loop
//! [`DriverService::is_due`], [`DriverService::turn`] and [`DriverService::tell`]: the first and the last
//! under the motion's lock, `turn` without it. Not covered: reading while the machine moves, for which there
//! is no time.

use super::DriverPort;
use super::link::{DriverLink, LinkError};
use super::registers::{
    DRIVER_ERROR, DRV_STATUS, GSTAT, HOT, LOW_SUPPLY, OPEN_LOADS, SHORTS, WARM, WAS_RESET,
};
use crate::configuration::drivers::{DriverConfiguration, DriversConfiguration};
use crate::motion::Motion;
use headway_protocol::message::{
    DeviceState, DriverFlags, DriverStatus, Fault, FaultCause, REPORT_MOTORS_MAX,
};
use heapless::Vec;

/// From one driver to the next, s: all eight are seen in 2 s, and the main loop is away for a tenth of its
/// time at most, even where all are silent.
const PERIOD_S: f64 = 0.25;
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
}

/// All of them.
#[derive(Clone, Debug)]
pub struct DriverService {
    drivers: Vec<Driver, REPORT_MOTORS_MAX>,
    status: Vec<DriverStatus, REPORT_MOTORS_MAX>,
    next: usize,
    next_ticks: u64,
    period_ticks: u64,
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
            period_ticks: (PERIOD_S * f64::from(servo_hz)) as u64,
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

    /// Whether a turn is due: nothing moves, nor is about to.
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
        if self.is_idle() || now_ticks < self.next_ticks || !rests || !motion.is_at_rest() {
            return false;
        }
        self.next_ticks = now_ticks + self.period_ticks;
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
            if self.serve(motor, port) {
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
        let mut link = DriverLink::new(port, motor, configuration.address);
        let served = if driver.is_set_up {
            ask(&mut link, status)
        } else {
            link.set_up(&configuration)
                .and_then(|()| ask(&mut link, status))
        };
        status.retries = status.retries.saturating_add(link.retries);
        driver.trouble = served.unwrap_or_else(|error| Some(trouble_of(error)));
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

/// Reads a driver's state; returns its fault, if any.
fn ask<P: DriverPort>(
    link: &mut DriverLink<'_, P>,
    status: &mut DriverStatus,
) -> Result<Option<Trouble>, LinkError> {
    let events = link.read(GSTAT)?;
    let state = link.read(DRV_STATUS)?;
    let mut flags = DriverFlags::SPOKEN_WITH;
    for (is_so, flag) in [
        (state & WARM != 0, DriverFlags::WARM),
        (state & HOT != 0, DriverFlags::HOT),
        (state & SHORTS != 0, DriverFlags::SHORT),
        (state & OPEN_LOADS != 0, DriverFlags::OPEN_LOAD),
        (events & LOW_SUPPLY != 0, DriverFlags::LOW_SUPPLY),
        (state & STEALTH != 0, DriverFlags::STEALTH),
    ] {
        if is_so {
            flags |= flag;
        }
    }
    status.flags = flags;
    status.scale = (state >> SCALE_SHIFT & 31) as u8;
    let value = state as i32;
    Ok(if events & WAS_RESET != 0 {
        Some((FaultCause::DriverReset, value))
    } else if state & HOT != 0 {
        Some((FaultCause::DriverHot, value))
    } else if state & SHORTS != 0 || events & DRIVER_ERROR != 0 {
        Some((FaultCause::DriverShort, value))
    } else {
        None
    })
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
    };
    (FaultCause::DriverSilent, value)
}
