//! Drivers of an STM32F4 board that communicates with them: set up before interrupts are on, then queried by
//! the main loop while nothing moves.

use super::runtime::with_motion;
use super::wires::DriverWires;
use headway_firmware::configuration::drivers::DriversConfiguration;
use headway_firmware::drivers::{DriverPort, DriverService};

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
