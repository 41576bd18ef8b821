//! The firmware's description of its machine: joints, kinematics, extruder, tick rates.
//!
//! The host builds it from the machine file and plans with the same numbers; the handshake compares
//! its hash. Joint order: the kinematics' joints first, the extruder is motor `joints.len()`.

use crate::configuration::axis_family::AxisFamily;
use crate::configuration::flow_curves::FlowCurves;
use crate::configuration::motors::MotorMatrix;
use crate::configuration::shaping::Shaper;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most joints a machine can have, the extruder not counted (8-driver boards).
pub const JOINTS_MAX: usize = 7;
/// Joints and extruder.
pub const MOTORS_MAX: usize = JOINTS_MAX + 1;

/// A frame in another: where its origin is, and its axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Origin, mm.
    pub origin_mm: [f64; 3],
    /// Rotation by rows: turns coordinates in this frame into those of the other.
    pub rotation: [[f64; 3]; 3],
}

impl Frame {
    /// The other frame itself.
    pub const IDENTITY: Self = Self {
        origin_mm: [0.0; 3],
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    };

    /// Turned by roll, pitch and yaw, rad: R = R_z(yaw) R_y(pitch) R_x(roll).
    pub fn of_angles(origin_mm: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> Self {
        let (sr, cr) = libm::sincos(roll);
        let (sp, cp) = libm::sincos(pitch);
        let (sy, cy) = libm::sincos(yaw);
        Self {
            origin_mm,
            rotation: [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ],
        }
    }

    /// Roll, pitch and yaw, rad, as in [`Self::of_angles`].
    pub fn angles(&self) -> [f64; 3] {
        let [[a, _, _], [b, _, _], [c, d, e]] = self.rotation;
        [
            libm::atan2(d, e),
            libm::atan2(-c, libm::sqrt(a * a + b * b)),
            libm::atan2(b, a),
        ]
    }
}

/// A six-joint arm: ortho-parallel base, spherical wrist (the parameters of Brandstötter, Angerer and
/// Hofbaur, 2014).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Arm {
    /// From the column's axis to the shoulder's.
    pub a1_mm: f64,
    /// From the elbow's axis to the forearm's, positive to the front.
    pub a2_mm: f64,
    /// Offset of the arm's plane from the column's axis.
    pub b_mm: f64,
    /// From the base to the shoulder's axis.
    pub c1_mm: f64,
    /// From the shoulder's axis to the elbow's.
    pub c2_mm: f64,
    /// From the elbow's axis to the wrist's centre, along the forearm.
    pub c3_mm: f64,
    /// From the wrist's centre to the flange.
    pub c4_mm: f64,
    /// Joint = model angle + offset, rad,
    pub offset_rad: [f64; 6],
    /// negated where a bit is set: bit 0 is joint 1.
    pub reversed: u8,
    /// The arm's base in machine axes.
    pub base: Frame,
    /// The tool in flange axes: its origin at the nozzle's tip, its Z from the tip into the head.
    pub tool: Frame,
    /// A seventh joint turns the nozzle; the flange then keeps its heading at 0.
    pub nozzle: bool,
}

/// Which equations turn a pose into joint positions.
// Boxing is impossible without a heap.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Kinematics {
    /// X Y Z + C, the nozzle turning; the tool axis stays +Z.
    Planar,
    /// X Y Z + head A, B, C with the given pivot length.
    Gantry {
        /// Distance from the nozzle tip to the crossing of the A and B axes.
        pivot_length_mm: f64,
    },
    /// X Y Z + table A, C + nozzle H.
    Trunnion {
        /// A point on both axes of the table, with the table level, machine axes.
        centre_mm: [f64; 3],
        /// Which of the joint solutions: chosen for each job, see [`MachineConfiguration::hash`].
        solution: u8,
    },
    /// A six-joint arm, with or without a nozzle joint.
    Arm6 {
        /// Its lengths and frames.
        arm: Arm,
        /// As above.
        solution: u8,
    },
    /// X Y Z, one or two rotary axes in head or table, nozzle H.
    Axes {
        /// The rotary axes.
        axes: AxisFamily,
        /// As above.
        solution: u8,
    },
}

impl Kinematics {
    /// The joint solution in use.
    pub const fn solution(&self) -> u8 {
        match self {
            Self::Planar | Self::Gantry { .. } => 0,
            Self::Trunnion { solution, .. }
            | Self::Arm6 { solution, .. }
            | Self::Axes { solution, .. } => *solution,
        }
    }

    /// The same machine with another joint solution.
    #[must_use]
    pub fn with_solution(mut self, chosen: u8) -> Self {
        match &mut self {
            Self::Planar | Self::Gantry { .. } => {}
            Self::Trunnion { solution, .. }
            | Self::Arm6 { solution, .. }
            | Self::Axes { solution, .. } => *solution = chosen,
        }
        self
    }
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
    /// Window over which dV/dt is smoothed (a moving average of the past, centred by the delay: see
    /// flow/mod.rs).
    pub pressure_advance_window_ms: f64,
}

/// The complete machine for the firmware.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MachineConfiguration {
    /// Equations of motion.
    pub kinematics: Kinematics,
    /// Joints in the kinematics' order (`planar`: X Y Z C; `gantry`: X Y Z A B C; `trunnion`: X Y Z A C H;
    /// `arm6`: 1 to 6 and the nozzle's, if any; `axes`: X Y Z, the rotary ones and H, with C instead of Y for a
    /// polar table).
    pub joints: Vec<JointConfiguration, JOINTS_MAX>,
    /// The joints' input shapers, in the joints' order.
    pub shapers: [Shaper; JOINTS_MAX],
    /// The extruder.
    pub extruder: ExtruderConfiguration,
    /// Servo interrupt rate; span durations count its ticks.
    pub servo_hz: u32,
    /// Step interrupt rate, a multiple of `servo_hz`.
    pub step_hz: u32,
    /// How motors follow joints. It is not in the bytes of machines without it, which are unchanged, and never read
    /// from them: it is a section of its own in a record.
    #[serde(skip_deserializing, skip_serializing_if = "MotorMatrix::is_direct")]
    pub motors: MotorMatrix,
    /// The extruder's curves, kept out of the bytes in the same way.
    #[serde(skip_deserializing, skip_serializing_if = "FlowCurves::is_none")]
    pub curves: FlowCurves,
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
    /// A length of the kinematics is not finite or not positive where required, or axes of a frame
    /// are not at right angles.
    Kinematics,
    /// The input shaper of this joint: an invalid frequency or damping, or a frequency too low for the
    /// controller, by itself or for the joint's acceleration.
    Shaper(usize),
    /// A pair of motors or a copy names joints that do not fit, or there are too many motors.
    Motors,
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
            Self::Shaper(joint) => write!(
                formatter,
                "the shaper of joint {joint} does not fit: its frequency must be higher (up to a quarter \
                 of the servo rate), its damping from 0 to 0.5"
            ),
            Self::Kinematics => {
                formatter.write_str("a length or frame of the kinematics is out of range")
            }
            Self::Motors => formatter.write_str(
                "the motors do not fit the joints: a pair needs two linear joints with the same steps a mm, and \
                 there are 8 motors at most",
            ),
        }
    }
}

impl core::error::Error for ConfigurationError {}

impl MachineConfiguration {
    /// Step ticks of a servo interval.
    pub fn interval_ticks(&self) -> u32 {
        self.step_hz.checked_div(self.servo_hz).unwrap_or(0)
    }

    /// Identifies a machine. The joint solution is not part of it: jobs choose theirs.
    pub fn hash(&self) -> u32 {
        let mut machine = self.clone();
        machine.kinematics = machine.kinematics.with_solution(0);
        headway_protocol::frame::hash_of(&machine)
    }

    /// The same machine without what is written apart from it: its motors and its curves.
    #[must_use]
    pub fn plain(&self) -> Self {
        Self {
            motors: MotorMatrix::DIRECT,
            curves: FlowCurves::NONE,
            ..self.clone()
        }
    }

    /// Limits of the flow that arrives and of its change, mm³/s and mm³/s²: within them the motor keeps its own.
    pub fn arriving_limits(&self) -> [f64; 2] {
        let extruder = &self.extruder;
        [
            self.curves.arriving().at(extruder.speed_max_mm3_s)[0],
            extruder.acceleration_max_mm3_s2 / self.curves.asked().steepest(),
        ]
    }

    /// Motors in all: joints, extruder, copies.
    pub fn motor_count(&self) -> usize {
        self.joints.len() + 1 + self.motors.copies.len()
    }

    /// Lowest and highest positions of the joints, mm or rad; 0 for those that are not there.
    pub fn ranges(&self) -> [[f64; 2]; JOINTS_MAX] {
        let mut ranges = [[0.0; 2]; JOINTS_MAX];
        for (range, joint) in ranges.iter_mut().zip(&self.joints) {
            *range = [joint.position_min, joint.position_max];
        }
        ranges
    }
}

/// A number that cannot be, with its place among [`headway_protocol::settings::items`].
pub type WrongNumber = (u8, f64);

impl JointConfiguration {
    /// It turns without an end: it has no range, or one beyond the range of step counts.
    pub fn is_endless(&self) -> bool {
        let range_steps = (self.position_max - self.position_min) * self.steps_per_unit;
        self.rotary && range_steps >= f64::from(i32::MAX)
    }
}
