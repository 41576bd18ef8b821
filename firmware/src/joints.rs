//! Channels -> joint targets in steps, with the soft limits.
//!
//! A carrier's integer base is scaled exactly once per span; its offset and what the tilt adds are
//! f32. All positions are i64 in 2^-31 steps.

use crate::configuration::{JOINTS_MAX, Kinematics, MOTORS_MAX, MachineConfiguration};
use crate::kinematics;
use crate::load::tilt_pose;
use crate::steps::{STEP, StepScale, steps_to_position};
use headway_protocol::message::{Fault, FaultCause};
use headway_protocol::units::{CHANNELS, UNITS_PER_NATURAL};

/// One joint's numbers.
#[derive(Clone, Copy, Debug, Default)]
struct JointScale {
    /// Channel that the joint follows, or [`CHANNELS`] for none.
    carrier: usize,
    base_scale: StepScale,
    /// Steps per channel unit of the carrier.
    steps_per_unit: f32,
    /// Steps per mm or rad.
    steps_per_natural: f32,
    position_min: i64,
    position_max: i64,
    /// 0.1 µm or µrad per step.
    units_per_step: f64,
}

/// All joints.
#[derive(Clone, Debug)]
pub struct JointTargets {
    kinematics: Kinematics,
    count: usize,
    joints: [JointScale; JOINTS_MAX],
    base: [i64; CHANNELS],
    base_positions: [i64; JOINTS_MAX],
}

impl JointTargets {
    /// From the machine's configuration.
    pub fn new(configuration: &MachineConfiguration) -> Self {
        let mut joints = [JointScale::default(); JOINTS_MAX];
        let carriers = kinematics::carriers(&configuration.kinematics);
        for ((scale, joint), carrier) in joints.iter_mut().zip(&configuration.joints).zip(carriers)
        {
            let units = carrier
                .and_then(|channel| UNITS_PER_NATURAL.get(channel))
                .copied()
                .unwrap_or(1.0);
            let position = |natural: f64| (natural * joint.steps_per_unit * STEP as f64) as i64;
            let report_units = if joint.rotary { 1e6 } else { 1e4 };
            *scale = JointScale {
                carrier: carrier.unwrap_or(CHANNELS),
                base_scale: StepScale::new(joint.steps_per_unit / units),
                steps_per_unit: (joint.steps_per_unit / units) as f32,
                steps_per_natural: joint.steps_per_unit as f32,
                position_min: position(joint.position_min),
                position_max: position(joint.position_max),
                units_per_step: report_units / joint.steps_per_unit,
            };
        }
        let count = carriers.len().min(configuration.joints.len());
        Self {
            kinematics: configuration.kinematics,
            count,
            joints,
            base: [0; CHANNELS],
            base_positions: [0; JOINTS_MAX],
        }
    }

    /// Number of joints.
    pub fn count(&self) -> usize {
        self.count
    }

    /// True if a position, 2^-31 steps, is within the joint's range.
    pub fn is_in_range(&self, joint: usize, position: i64) -> bool {
        joint < self.count && self.beyond_range(joint, position) <= 0
    }

    /// How far a position lies beyond the joint's range, 2^-31 steps; 0 or less inside.
    pub fn beyond_range(&self, joint: usize, position: i64) -> i64 {
        self.joints.get(joint).map_or(i64::MAX, |joint| {
            let below = joint.position_min.saturating_sub(position);
            below.max(position.saturating_sub(joint.position_max))
        })
    }

    /// The fault of a joint at a position, 2^-31 steps.
    pub(crate) fn limit_fault(&self, joint: usize, position: i64, cause: FaultCause) -> Fault {
        let units_per_step = self.joints.get(joint).map_or(0.0, |j| j.units_per_step);
        Fault {
            cause,
            index: joint as u8,
            value: (position as f64 / STEP as f64 * units_per_step) as i32,
        }
    }

    /// Mask of all joints.
    pub fn all(&self) -> u8 {
        ((1u16 << self.count) - 1) as u8
    }

    /// Takes over the integer base, once per span.
    pub fn set_base(&mut self, base: &[i64; CHANNELS]) {
        self.base = *base;
        for (position, joint) in self.base_positions.iter_mut().zip(&self.joints) {
            if let Some(units) = base.get(joint.carrier) {
                *position = joint.base_scale.position(*units);
            }
        }
    }

    /// Writes the targets of the joints at an offset from the base; the other motors keep theirs.
    ///
    /// # Errors
    /// The fault to latch: kinematics or soft limit.
    #[inline]
    pub fn targets(
        &self,
        offset: &[f32; CHANNELS],
        targets: &mut [i64; MOTORS_MAX],
    ) -> Result<(), Fault> {
        let pose = tilt_pose(&self.base, offset);
        let remainder = kinematics::remainder(&self.kinematics, &pose).map_err(|_| Fault {
            cause: FaultCause::Kinematics,
            index: 0,
            value: 0,
        })?;
        for (index, joint) in self.joints.iter().enumerate().take(self.count) {
            let mut steps = remainder[index] * joint.steps_per_natural;
            if let Some(units) = offset.get(joint.carrier) {
                steps += units * joint.steps_per_unit;
            }
            let target = self.base_positions[index] + steps_to_position(steps);
            if target < joint.position_min || target > joint.position_max {
                return Err(joint.beyond(index, target));
            }
            targets[index] = target;
        }
        Ok(())
    }
}

impl JointScale {
    #[cold]
    fn beyond(&self, index: usize, target: i64) -> Fault {
        let steps = target as f64 / STEP as f64;
        Fault {
            cause: FaultCause::SoftLimit,
            index: index as u8,
            value: (steps * self.units_per_step) as i32,
        }
    }
}
