//! What the firmware knows of its machine: joints, kinematics, extruder, tick rates.
//!
//! The host builds it from the machine file and plans against the same numbers; the handshake
//! compares its hash. Joint order: the kinematics' joints first, the extruder is motor `joints.len()`.

use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most joints a machine can have, the extruder not counted (8-driver boards).
pub const JOINTS_MAX: usize = 7;
/// Joints and extruder.
pub const MOTORS_MAX: usize = JOINTS_MAX + 1;

/// Which equations turn a pose into joint positions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Kinematics {
    /// X Y Z + C, the nozzle turning; the tool axis stays +Z.
    Planar,
    /// X Y Z + head A, B, C with the given pivot length.
    Gantry {
        /// Distance from the nozzle tip to the crossing of the A and B axes.
        pivot_length_mm: f64,
    },
}

/// One joint; lengths in mm for linear joints, rad for rotary ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointConfiguration {
    /// True for rotary joints (rad), false for linear ones (mm).
    pub rotary: bool,
    /// Motor steps per mm or rad, microsteps included.
    pub steps_per_unit: f64,
    /// Lowest position, mm or rad.
    pub position_min: f64,
    /// Highest position, mm or rad.
    pub position_max: f64,
    /// Speed limit, mm/s or rad/s.
    pub speed_max: f64,
    /// Acceleration limit, mm/s² or rad/s².
    pub acceleration_max: f64,
    /// Jerk limit, mm/s³ or rad/s³.
    pub jerk_max: f64,
}

/// The extruder, all in deposited volume.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExtruderConfiguration {
    /// Motor steps per mm³.
    pub steps_per_mm3: f64,
    /// Limit of the motor's rate, pressure advance, prime and retract included.
    pub speed_max_mm3_s: f64,
    /// Limit of the motor's acceleration.
    pub acceleration_max_mm3_s2: f64,
    /// K in e = V + K dV/dt.
    pub pressure_advance_s: f64,
    /// Window over which dV/dt is smoothed (box, centred by look-back: see flow.rs).
    pub pressure_advance_window_ms: f64,
}

/// The whole machine as the firmware sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MachineConfiguration {
    /// Equations of motion.
    pub kinematics: Kinematics,
    /// Joints in the kinematics' order (`planar`: X Y Z C; `gantry`: X Y Z A B C).
    pub joints: Vec<JointConfiguration, JOINTS_MAX>,
    /// The extruder.
    pub extruder: ExtruderConfiguration,
    /// Servo interrupt rate; span durations count its ticks.
    pub servo_hz: u32,
    /// Step interrupt rate, a multiple of `servo_hz`.
    pub step_hz: u32,
}
