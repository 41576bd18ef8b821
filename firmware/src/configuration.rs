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

/// Why a configuration cannot be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigurationError {
    /// The kinematics need another number of joints.
    JointCount {
        /// Joints of the kinematics.
        needed: usize,
        /// Joints given.
        given: usize,
    },
    /// `step_hz` must be a multiple of `servo_hz`, 65 to 256 times.
    TickRates,
    /// A number of this joint is not finite, not positive where it must be, or out of range; the
    /// extruder counts as the last joint.
    Joint(usize),
    /// The pivot length is not finite.
    Kinematics,
}

impl core::fmt::Display for ConfigurationError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::JointCount { needed, given } => {
                write!(
                    formatter,
                    "the kinematics need {needed} joints, {given} are given"
                )
            }
            Self::TickRates => formatter
                .write_str("the step rate must be a multiple of the servo rate, 65 to 256 times"),
            Self::Joint(joint) => write!(formatter, "a number of joint {joint} is out of range"),
            Self::Kinematics => formatter.write_str("the pivot length is not a finite number"),
        }
    }
}

impl core::error::Error for ConfigurationError {}

/// Most steps per mm, rad or mm³: the fixed-point scale holds it, and no driver needs it.
const STEPS_PER_UNIT_MAX: f64 = 30_000.0;

impl MachineConfiguration {
    /// Step ticks of a servo interval.
    pub fn interval_ticks(&self) -> u32 {
        self.step_hz.checked_div(self.servo_hz).unwrap_or(0)
    }

    /// Checks everything that the firmware relies on.
    ///
    /// # Errors
    /// [`ConfigurationError`], the first that is found.
    pub fn check(&self) -> Result<(), ConfigurationError> {
        let needed = crate::kinematics::joint_count(&self.kinematics);
        let given = self.joints.len();
        if needed != given {
            return Err(ConfigurationError::JointCount { needed, given });
        }
        if let Kinematics::Gantry { pivot_length_mm } = self.kinematics
            && !pivot_length_mm.is_finite()
        {
            return Err(ConfigurationError::Kinematics);
        }
        let ticks = self.interval_ticks();
        let range = crate::steps::INTERVAL_TICKS_MIN..=crate::steps::INTERVAL_TICKS_MAX;
        if !range.contains(&ticks) || ticks.checked_mul(self.servo_hz) != Some(self.step_hz) {
            return Err(ConfigurationError::TickRates);
        }
        for (index, joint) in self.joints.iter().enumerate() {
            let positive = [
                joint.speed_max,
                joint.acceleration_max,
                joint.jerk_max,
                joint.steps_per_unit,
            ];
            let range_is_right = joint.position_min < joint.position_max;
            if !range_is_right || !positive.iter().all(is_positive) || !fits(joint.steps_per_unit) {
                return Err(ConfigurationError::Joint(index));
            }
        }
        let extruder = &self.extruder;
        let positive = [
            extruder.steps_per_mm3,
            extruder.speed_max_mm3_s,
            extruder.acceleration_max_mm3_s2,
        ];
        let not_negative = extruder.pressure_advance_s >= 0.0
            && extruder.pressure_advance_window_ms >= 0.0
            && extruder.pressure_advance_s.is_finite();
        if !not_negative || !positive.iter().all(is_positive) || !fits(extruder.steps_per_mm3) {
            return Err(ConfigurationError::Joint(given));
        }
        Ok(())
    }
}

fn is_positive(value: &f64) -> bool {
    *value > 0.0 && value.is_finite()
}

fn fits(steps_per_unit: f64) -> bool {
    steps_per_unit <= STEPS_PER_UNIT_MAX
}
