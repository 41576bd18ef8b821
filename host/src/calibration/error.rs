//! Why a pattern cannot be drawn.

use crate::settings::Settings;
use crate::text::refusal::Refusal;
use headway_firmware::configuration::Kinematics;

/// The option or the machine, with a remedy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// An option is at fault.
    #[error(transparent)]
    Usage(Refusal),
    /// The machine is, or its nozzle.
    #[error(transparent)]
    Machine(Refusal),
}

macro_rules! usage {
    ($($text:tt)*) => { $crate::calibration::CalibrationError::Usage($crate::text::refusal::refusal!($($text)*)) };
}
macro_rules! machine {
    ($($text:tt)*) => { $crate::calibration::CalibrationError::Machine($crate::text::refusal::refusal!($($text)*)) };
}
pub(super) use {machine, usage};

/// The tip is moved by X and Y alone.
pub(super) fn check_linear_joints(settings: &Settings) -> Result<(), CalibrationError> {
    match settings.machine.kinematics {
        Kinematics::Planar | Kinematics::Gantry { .. } => Ok(()),
        _ => Err(machine!(
            "X and Y of the tip are joints of their own on planar machines and gantries alone: on others a frame's \
             ringing is no one joint's"
        )),
    }
}
