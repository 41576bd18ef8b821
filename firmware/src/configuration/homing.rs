//! Switches of the joints, and the search for each.
//!
//! In: numbers of the machine file, mm and rad, or defaults from the machine's limits. Out: a
//! [`HomingConfiguration`], used by `motion/homing.rs`.

use crate::configuration::{JOINTS_MAX, JointConfiguration, MachineConfiguration};
use core::f64::consts::TAU;
use heapless::Vec;
use serde::{Deserialize, Serialize};

const DEGREE_RAD: f64 = TAU / 360.0;

/// How one joint finds its switch; mm for linear joints, rad for rotary ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointHoming {
    /// Joint from 0 in the kinematics' order.
    pub joint: u8,
    /// The switch is at the upper end.
    pub towards_max: bool,
    /// Speed of the search, mm/s or rad/s.
    pub fast_natural_s: f64,
    /// Speed of the second, decisive touch, mm/s or rad/s.
    pub slow_natural_s: f64,
    /// Distance back from the switch before the second touch, and after it.
    pub back_off_natural: f64,
    /// Longest distance to the switch.
    pub travel_max_natural: f64,
    /// Where the joint is when the switch trips; without ends: in the middle of the switch.
    pub position_natural: f64,
    /// The switch also stops other motion that reaches it; never that of a joint without ends, which
    /// passes it in every turn.
    pub guards: bool,
}

impl JointHoming {
    /// A switch at the end of the joint's range. Fast at a quarter of the speed limit, 40 mm/s or 1 rad/s
    /// at most; slow at a tenth of that; 3 mm or 3° back. A joint without ends is searched for a turn.
    pub fn usual(joint: u8, towards_max: bool, limits: &JointConfiguration) -> Self {
        let (most, back_off_natural) = if limits.rotary {
            (1.0, 3.0 * DEGREE_RAD)
        } else {
            (40.0, 3.0)
        };
        let quarter = 0.25 * limits.speed_max;
        let fast = if quarter < most { quarter } else { most };
        let range = limits.position_max - limits.position_min;
        let range = if limits.is_endless() { TAU } else { range };
        Self {
            joint,
            towards_max,
            fast_natural_s: fast,
            slow_natural_s: 0.1 * fast,
            back_off_natural,
            travel_max_natural: 1.1 * range,
            position_natural: if towards_max {
                limits.position_max
            } else {
                limits.position_min
            },
            guards: !limits.is_endless(),
        }
    }
}

/// The switches of a machine, in the order in which all are homed. Not part of the machine's
/// hash: a plan does not depend on it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HomingConfiguration {
    /// One entry per joint with a switch.
    pub joints: Vec<JointHoming, JOINTS_MAX>,
    /// Joints whose switch is a mark that they pass once per turn, one bit each; joints without ends always are. It
    /// is a section of its own in a record.
    #[serde(skip)]
    pub marks: u8,
    /// Joints whose motors stay on when nothing has moved for long, since they would fall; one bit each. A section of
    /// its own as well.
    #[serde(skip)]
    pub hold: u8,
}

impl HomingConfiguration {
    /// No switches.
    pub const fn none() -> Self {
        Self {
            joints: Vec::new(),
            marks: 0,
            hold: 0,
        }
    }

    /// For machines with a switch at the upper end of Z, which is homed first, away from a part on
    /// the bed, and at the lower ends of X and Y; each as [`JointHoming::usual`].
    pub fn standard(machine: &MachineConfiguration) -> Self {
        let mut joints = Vec::new();
        for (joint, towards_max) in [(2u8, true), (0, false), (1, false)] {
            let limits = machine.joints.get(usize::from(joint));
            // A joint without ends, as that of a polar table, has no end to be homed to.
            let Some(limits) = limits.filter(|limits| !limits.is_endless()) else {
                continue;
            };
            // Three joints fit by the type's bound.
            let _ = joints.push(JointHoming::usual(joint, towards_max, limits));
        }
        Self {
            joints,
            ..Self::none()
        }
    }

    /// The joint passes its switch once per turn: an index mark, of which both edges are found.
    pub fn is_mark(&self, joint: u8, machine: &MachineConfiguration) -> bool {
        let limits = machine.joints.get(usize::from(joint));
        let turns = limits.is_some_and(|limits| limits.rotary);
        let is_endless = limits.is_some_and(JointConfiguration::is_endless);
        is_endless || turns && self.marks >> (joint & 7) & 1 == 1
    }

    /// How a joint is homed, if it has a switch.
    pub fn of(&self, joint: u8) -> Option<&JointHoming> {
        self.joints.iter().find(|homing| homing.joint == joint)
    }
}
