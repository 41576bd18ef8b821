//! Why a pattern cannot be drawn.

use crate::settings::SettingsError;

/// The option or the machine, with a remedy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// Goes with another pattern.
    #[error("{option} does not go with the pattern `{pattern}`: it has nothing of that kind")]
    Option {
        /// As the command spells it.
        option: &'static str,
        /// The pattern.
        pattern: &'static str,
    },
    /// Too few lines to compare, or too many to print.
    #[error("--lines {lines}: write a number from 3 to {lines_max}")]
    Lines {
        /// The requested value.
        lines: u32,
        /// Most there may be.
        lines_max: u32,
    },
    /// An invalid number.
    #[error("{option} {value}: write a number from {low} to {high}")]
    Range {
        /// As the command spells it.
        option: &'static str,
        /// What was given.
        value: f64,
        /// Least.
        low: f64,
        /// Most.
        high: f64,
    },
    /// Stepped values that do not increase, or are invalid.
    #[error("values from {from} to {to}: write --from below --to, both from {low} to {high}")]
    Values {
        /// First.
        from: f64,
        /// Last.
        to: f64,
        /// Least that makes sense.
        low: f64,
        /// Most that makes sense.
        high: f64,
    },
    /// Larger than the bed.
    #[error(
        "the pattern is {:.0} x {:.0} mm, the work area {} x {} mm: lay shorter lines (--length) or fewer \
         (--lines)",
        sizes_mm[0], sizes_mm[1], area_mm[0], area_mm[1]
    )]
    Area {
        /// The pattern.
        sizes_mm: [f64; 2],
        /// The work area.
        area_mm: [f64; 2],
    },
    /// Nothing to be seen of a heading.
    #[error(
        "the aperture is round: it lays the same bead whichever way it is turned; a heading is calibrated \
         with the nozzle that needs it (--aperture)"
    )]
    Round,
    /// The head does not tilt.
    #[error(
        "a {kinematics} machine has no pivot: this pattern is for heads that tilt (kinematics gantry); leave \
         it out"
    )]
    NoPivot {
        /// The machine's kinematics.
        kinematics: &'static str,
    },
    /// More values than these lines can distinguish.
    #[error(
        "a {kinematics} machine has no single pivot length: its {key} are several numbers that these lines \
         do not tell apart; measure them with an indicator on the tip while the axes tilt, until it stands \
         still"
    )]
    SeveralNumbers {
        /// The machine's kinematics.
        kinematics: &'static str,
        /// Its keys.
        key: &'static str,
    },
    /// Steps of an arm.
    #[error(
        "the six joints of an arm are not read off lines one by one: take their steps from gear and motor"
    )]
    ArmSteps,
    /// The tip is not moved by X and Y alone.
    #[error(
        "X and Y of the tip are joints of their own on planar machines and gantries alone: on others a frame's \
         ringing is no one joint's"
    )]
    NoLinearJoints,
    /// Frequencies that cannot be shaken.
    #[error(
        "frequencies from {from} to {to} Hz: write --from below --to, both from {low} to {high} Hz; above that the \
         acceleration_max of X and Y allows less than a step to and fro"
    )]
    Frequencies {
        /// First.
        from: f64,
        /// Last.
        to: f64,
        /// Least.
        low: f64,
        /// Most.
        high: f64,
    },
    /// Nothing that could be stepped.
    #[error(
        "flow.{key} is 0 in the machine file: begin with an estimate, as with 2 mm³ for a small nozzle"
    )]
    NoVolume {
        /// The key.
        key: &'static str,
    },
    /// A machine with the stepped value is invalid.
    #[error("with the value {value}: {error}")]
    Machine {
        /// The value.
        value: f64,
        /// The error.
        error: SettingsError,
    },
}

impl CalibrationError {
    /// True where an option is at fault, not the machine.
    pub fn is_usage(&self) -> bool {
        use CalibrationError as E;
        match self {
            E::Option { .. } | E::Lines { .. } | E::Range { .. } | E::Values { .. } => true,
            E::Frequencies { .. } => true,
            E::NoLinearJoints => false,
            E::Area { .. } | E::Round | E::NoPivot { .. } | E::SeveralNumbers { .. } => false,
            E::ArmSteps | E::NoVolume { .. } | E::Machine { .. } => false,
        }
    }
}
