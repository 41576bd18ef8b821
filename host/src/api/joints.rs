//! The joints of a job: their names and limits, and their positions at a given time.
//!
//! In: samples of `joint_export`. Out: plain structs, mm and rad, in the machine's coordinates.

use crate::job::MotionState;
use crate::joint_export::samples::{JointName, JointSample};
use headway_firmware::configuration::JointConfiguration;
use headway_protocol::units::CHANNEL_VOLUME;

/// A joint of a job's machine.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct JobJoint {
    /// Name as in the machine file.
    pub name: String,
    /// `mm` or `rad`.
    pub unit: &'static str,
    /// What its columns in tables begin with.
    pub column: String,
    /// Motor steps per mm or rad.
    pub steps_per_unit: f64,
    /// Lowest and highest position; without ends negative and positive infinity.
    pub range: [f64; 2],
}

/// The joints at one time, in the machine's order.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct JobJoints {
    /// Time since the job began.
    pub time_s: f64,
    /// Layer from 0.
    pub layer: u32,
    /// Pass from 0 over the complete job; `None` between passes.
    pub pass: Option<u32>,
    /// What the head does.
    pub state: MotionState,
    /// Deposited so far.
    pub volume_mm3: f64,
    /// Flow of the deposited volume; 0 off the passes.
    pub flow_mm3_s: f64,
    /// Positions, mm or rad; joints that turn without end count their turns.
    pub position: Vec<f64>,
    /// Rates, per second.
    pub velocity: Vec<f64>,
    /// Second derivatives.
    pub acceleration: Vec<f64>,
    /// Whole motor steps.
    pub steps: Vec<i64>,
}

impl JobJoint {
    pub(super) fn of(name: &JointName, joint: &JointConfiguration) -> Self {
        JobJoint {
            name: name.name.to_string(),
            unit: name.unit,
            column: name.column.clone(),
            steps_per_unit: joint.steps_per_unit,
            range: [joint.position_min, joint.position_max],
        }
    }
}

impl JobJoints {
    pub(super) fn of(of: &JointSample, joints: usize) -> Self {
        JobJoints {
            time_s: of.sample.time_s,
            layer: of.sample.mark.layer,
            pass: of.sample.mark.pass,
            state: of.sample.mark.state,
            volume_mm3: of.sample.position[CHANNEL_VOLUME],
            flow_mm3_s: of.sample.flow_mm3_s(),
            position: of.position[..joints].to_vec(),
            velocity: of.velocity[..joints].to_vec(),
            acceleration: of.acceleration[..joints].to_vec(),
            steps: of.steps[..joints].to_vec(),
        }
    }
}
