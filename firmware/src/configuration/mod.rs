//! The description of a machine and its board: types that all other modules read.
//!
//! In: numbers of a machine file, or of a record of settings. Out: plain, unchecked values: `checks` decides which
//! of them can be run, and the modules that use them implement them. Not covered: constants of the design, which
//! nobody can choose (`design.rs`).

pub mod axis_family;
pub mod board_name;
pub mod drivers;
pub mod flow_curves;
pub mod heat;
pub mod homing;
mod machine;
pub mod motors;
pub mod sensor;
pub mod shaping;
pub mod wiring;

pub use machine::{
    Arm, ConfigurationError, ExtruderConfiguration, Frame, JOINTS_MAX, JointConfiguration,
    Kinematics, MOTORS_MAX, MachineConfiguration, WrongNumber,
};
