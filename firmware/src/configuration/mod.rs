//! What a machine and its board are: nouns that all other rooms read.
//!
//! In: numbers of a machine file, or of a record of settings. Out: plain values, checked nowhere here: which of them
//! can be run is said in `checks`, what is made of them in the rooms that use them. Left out: constants of the
//! design, which are nobody's to choose (`design.rs`).

pub mod axis_family;
pub mod board_name;
pub mod drivers;
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
