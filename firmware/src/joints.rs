//! Channels -> joint targets in steps, with the soft limits.
//!
//! A carrier's integer base is exact (carriers.rs); its offset and what the tilt adds are f32.
//! All positions are i64 in 2^-31 steps, with [`BIAS`] added.

use crate::configuration::{JOINTS_MAX, Kinematics, MOTORS_MAX, MachineConfiguration};
use crate::interpolator::{Interpolator, Offset};
use crate::kinematics;
use crate::load::tilt_pose;
use crate::steps::{BIAS, STEP, ScaledUnits, steps_to_position};
use headway_protocol::message::{Fault, FaultCause};
use headway_protocol::units::{CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNELS, UNITS_PER_NATURAL};

/// One joint's numbers.
#[derive(Clone, Copy, Debug, Default)]
struct JointScale {
    /// Channel that the joint follows, or [`CHANNELS`] for none: an index of the offsets.
    carrier: usize,
    /// Steps per unit of it.
    steps_per_unit: f32,
    /// Steps per mm or rad.
    steps_per_natural: f32,
    /// Soft limits, 2^-31 steps.
    position_min: i64,
    position_max: i64,
    /// The same for targets: upper half of the lowest, and what may be added to it.
    lowest: i32,
    range: u32,
    /// 0.1 µm or µrad per step.
    units_per_step: f64,
}

/// All joints.
#[derive(Clone, Debug)]
pub struct JointTargets {
    kinematics: Kinematics,
    count: usize,
    joints: [JointScale; JOINTS_MAX],
}

impl JointTargets {
    /// From the machine's configuration.
    pub fn new(configuration: &MachineConfiguration) -> Self {
        let mut joints = [JointScale::default(); JOINTS_MAX];
        let carriers = kinematics::carriers(&configuration.kinematics);
        let parts = joints.iter_mut().zip(&configuration.joints).zip(carriers);
        for ((scale, joint), carrier) in parts {
            let units = carrier
                .and_then(|channel| UNITS_PER_NATURAL.get(channel))
                .copied()
                .unwrap_or(1.0);
            let position = |natural: f64| (natural * joint.steps_per_unit * STEP as f64) as i64;
            let pairs = |position: i64| (position.saturating_add(BIAS) >> 32) as i32;
            let (min, max) = (position(joint.position_min), position(joint.position_max));
            let report_units = if joint.rotary { 1e6 } else { 1e4 };
            *scale = JointScale {
                carrier: carrier.unwrap_or(CHANNELS),
                steps_per_unit: (joint.steps_per_unit / units) as f32,
                steps_per_natural: joint.steps_per_unit as f32,
                position_min: min,
                position_max: max,
                lowest: pairs(min),
                range: pairs(max).wrapping_sub(pairs(min)) as u32,
                units_per_step: report_units / joint.steps_per_unit,
            };
        }
        let count = carriers.len().min(configuration.joints.len());
        Self {
            kinematics: configuration.kinematics,
            count,
            joints,
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

    #[cold]
    fn soft_limit(&self, joint: usize, target: i64) -> Fault {
        self.limit_fault(joint, target.wrapping_sub(BIAS), FaultCause::SoftLimit)
    }

    /// Mask of all joints.
    pub fn all(&self) -> u8 {
        ((1u16 << self.count) - 1) as u8
    }

    /// Writes the targets of the joints at the interpolator's pose; other motors keep theirs.
    ///
    /// # Errors
    /// The fault to latch: kinematics or soft limit.
    #[inline]
    pub fn targets<'a>(
        &self,
        interpolator: &Interpolator,
        targets: impl Iterator<Item = &'a mut i64>,
    ) -> Result<(), Fault> {
        let offset = interpolator.offset();
        let bases = interpolator.bases();
        if self.kinematics == Kinematics::Planar {
            // Joints are channels. That the tilt is none was checked on reception.
            return self.scale(bases, targets, |joint, _| joint.of_carrier(&offset));
        }
        let tilt = [CHANNEL_TILT_X, CHANNEL_TILT_Y].map(|channel| offset.of(channel));
        let pose = tilt_pose(interpolator.tilt_base(), tilt);
        match kinematics::remainder(&self.kinematics, &pose) {
            Ok(remainder) => self.scale(bases, targets, |joint, index| {
                remainder[index] * joint.steps_per_natural + joint.of_carrier(&offset)
            }),
            Err(_) => Err(Fault {
                cause: FaultCause::Kinematics,
                index: 0,
                value: 0,
            }),
        }
    }

    #[inline(always)]
    fn scale<'a>(
        &self,
        bases: &[ScaledUnits; MOTORS_MAX],
        targets: impl Iterator<Item = &'a mut i64>,
        steps: impl Fn(&JointScale, usize) -> f32,
    ) -> Result<(), Fault> {
        let parts = self.joints.iter().zip(bases).zip(targets).enumerate();
        for (index, ((joint, base), target)) in parts.take(self.count) {
            let position = base.position + steps_to_position(steps(joint, index));
            *target = position;
            // In whole steps by pairs: the upper halves alone.
            let above = ((position >> 32) as i32).wrapping_sub(joint.lowest) as u32;
            if above > joint.range {
                return Err(self.soft_limit(index, position));
            }
        }
        Ok(())
    }
}

impl JointScale {
    /// What the carrier makes of an offset, in steps.
    #[inline(always)]
    fn of_carrier(&self, offset: &Offset<'_>) -> f32 {
        offset.of(self.carrier) * self.steps_per_unit
    }
}
