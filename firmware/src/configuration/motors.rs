//! Motors that are not joints: a pair of joints that two motors move together, and motors that repeat another.
//!
//! ```text
//! joints -> (X, Y) becomes (X + Y, X - Y) -> motors, the extruder, copies
//! ```
//! CoreXY has two belts: one motor turns by the sum of the two axes, the other by their difference (J. Moyer,
//! 2012); CoreXZ is the same with another pair. The machine is planned, shaped, homed and limited by its
//! joints; only the step generator uses the motors, whose own limits apply as well. Positions are in 2^-31
//! steps and fine targets in 2^-22 steps, where sums and differences are exact: the steps are those of the
//! transformed targets. Not covered: pairs of rotary joints, joints of the pair with different steps per mm.

use crate::configuration::JOINTS_MAX;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most motors that repeat another.
pub const COPIES_MAX: usize = 3;

/// Two joints, and two motors of which one moves by their sum and one by their difference. The motors' limits are
/// not below those of the joints.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotorPair {
    /// The joints, from 0; the first one's motor moves by the sum, the second one's by first - second.
    pub joints: [u8; 2],
    /// Speed limit of either motor's belt, mm/s.
    pub speed_max: f64,
    /// Its acceleration limit, mm/s².
    pub acceleration_max: f64,
    /// Its jerk limit, mm/s³.
    pub jerk_max: f64,
}

impl MotorPair {
    /// Displacements of the two motors for the displacements `joints`, in the pair's order.
    pub fn motors_of(&self, joints: &[f64; JOINTS_MAX]) -> [f64; 2] {
        let [a, b] = self
            .joints
            .map(|joint| joints[usize::from(joint) % JOINTS_MAX]);
        [a + b, a - b]
    }
}

/// How motors follow joints.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MotorMatrix {
    /// Two joints that share their motors.
    pub pair: Option<MotorPair>,
    /// After the extruder's motor: each makes the steps of the joint's motor that it names.
    pub copies: Vec<u8, COPIES_MAX>,
}

impl MotorMatrix {
    /// A motor for each joint and one for the extruder.
    pub const DIRECT: Self = Self {
        pair: None,
        copies: Vec::new(),
    };

    /// Every motor is a joint's, or the extruder's.
    pub fn is_direct(&self) -> bool {
        self.pair.is_none() && self.copies.is_empty()
    }

    /// The motors that hold some of a number of joints, one bit each: those of both joints of a pair.
    pub fn motors_of(&self, joints: u8, count: usize) -> u8 {
        let pair = self.pair.iter().flat_map(|pair| pair.joints);
        let pair = pair.fold(0, |mask, joint| mask | 1u8.unbounded_shl(joint.into()));
        let own = joints | if joints & pair != 0 { pair } else { 0 };
        let copies = self.copies.iter().zip(count as u32 + 1..);
        copies.fold(own, |mask, (joint, motor)| {
            mask | (own.unbounded_shr((*joint).into()) & 1).unbounded_shl(motor)
        })
    }

    /// How many joints move a motor at most.
    pub fn share(&self) -> f64 {
        if self.pair.is_some() { 2.0 } else { 1.0 }
    }

    /// Joint positions in motor steps -> positions of the joints' motors.
    pub fn motor_steps(&self, joint_steps: &[f64; JOINTS_MAX]) -> [f64; JOINTS_MAX] {
        let mut motors = *joint_steps;
        if let Some(pair) = &self.pair {
            let moved = pair.motors_of(joint_steps);
            for (joint, steps) in pair.joints.into_iter().zip(moved) {
                motors[usize::from(joint) % JOINTS_MAX] = steps;
            }
        }
        motors
    }

    /// Positions of the joints' motors -> joint positions in motor steps.
    pub fn joint_steps(&self, motor_steps: &[f64; JOINTS_MAX]) -> [f64; JOINTS_MAX] {
        let mut joints = self.motor_steps(motor_steps);
        for joint in self.pair.iter().flat_map(|pair| pair.joints) {
            joints[usize::from(joint) % JOINTS_MAX] *= 0.5;
        }
        joints
    }
}
