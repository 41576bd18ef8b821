//! The state of the drivers for the motion: a status shows it, and their fault cannot be cleared while
//! its cause persists.

use headway_protocol::message::{DriverStatus, Fault, REPORT_MOTORS_MAX};
use heapless::Vec;

/// Readings.
#[derive(Clone, Debug, Default)]
pub struct DriverPanel {
    status: Vec<DriverStatus, REPORT_MOTORS_MAX>,
    fault: Option<Fault>,
}

impl DriverPanel {
    /// Takes over what the service has found.
    pub(crate) fn note(
        &mut self,
        status: &Vec<DriverStatus, REPORT_MOTORS_MAX>,
        fault: Option<Fault>,
    ) {
        self.status.clone_from(status);
        self.fault = fault;
    }

    /// Drivers for a status.
    pub fn status(&self) -> &Vec<DriverStatus, REPORT_MOTORS_MAX> {
        &self.status
    }

    /// The present fault.
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }
}
