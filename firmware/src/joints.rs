//! Interpolated motors -> joint targets in steps, with the soft limits.
//!
//! A carrier's integer base is exact (interpolator.rs); its offset and what the tilt adds are f32.

use crate::configuration::{JOINTS_MAX, Kinematics, MOTORS_MAX, MachineConfiguration};
use crate::interpolator::{Interpolator, Offset};
use crate::kinematics::{self, gantry};
use crate::load::tilt_pose;
use crate::steps::{POSITION_FRACTION_BITS, STEP, Target};
use headway_protocol::message::{Fault, FaultCause};

/// Furthest that a soft limit can be, whole steps: well within the 32 bits of a target.
const WHOLE_STEPS_MAX: i64 = (1 << 30) - 4;

/// What the tilt adds to each joint; nothing on a machine without tilt.
type Remainder = Option<[f32; JOINTS_MAX]>;

/// One joint's numbers.
#[derive(Clone, Copy, Debug, Default)]
struct JointScale {
    /// Steps per mm or rad.
    steps_per_natural: f32,
    /// Soft limits, 2^-31 steps.
    position_min: i64,
    position_max: i64,
    /// The same in whole steps: the lowest, and what may be added to it. A step or two of slack,
    /// because targets may be one off.
    lowest: i32,
    range: u32,
    /// 0.1 µm or µrad per step.
    units_per_step: f64,
}

/// What the joints' new targets are like.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reach {
    /// Joints outside their soft limits, a mask.
    pub outside: u32,
    /// See [`Target::replace`].
    pub jumps: u32,
}

/// All joints.
#[derive(Clone, Debug)]
pub struct JointTargets {
    /// Of a gantry; none on a planar machine. In single precision once and for all.
    pivot_length_mm: Option<f32>,
    count: usize,
    joints: [JointScale; MOTORS_MAX],
}

impl JointTargets {
    /// From the machine's configuration.
    pub fn new(configuration: &MachineConfiguration) -> Self {
        let mut joints = [JointScale::default(); MOTORS_MAX];
        let carriers = kinematics::carriers(&configuration.kinematics);
        for (scale, joint) in joints.iter_mut().zip(&configuration.joints) {
            let position = |natural: f64| (natural * joint.steps_per_unit * STEP as f64) as i64;
            // Limits beyond what targets hold are cut: a machine whose nozzle turns freely.
            let whole = |position: i64| {
                let steps = position >> POSITION_FRACTION_BITS;
                steps.clamp(-WHOLE_STEPS_MAX, WHOLE_STEPS_MAX) as i32
            };
            let (min, max) = (position(joint.position_min), position(joint.position_max));
            let report_units = if joint.rotary { 1e6 } else { 1e4 };
            *scale = JointScale {
                steps_per_natural: joint.steps_per_unit as f32,
                position_min: min,
                position_max: max,
                lowest: whole(min) - 2,
                range: (whole(max) - whole(min) + 4) as u32,
                units_per_step: report_units / joint.steps_per_unit,
            };
        }
        let count = carriers.len().min(configuration.joints.len());
        Self {
            pivot_length_mm: match configuration.kinematics {
                Kinematics::Planar => None,
                Kinematics::Gantry { pivot_length_mm } => Some(pivot_length_mm as f32),
            },
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

    /// Mask of all joints.
    pub fn all(&self) -> u8 {
        ((1u16 << self.count) - 1) as u8
    }

    /// What the tilt adds to the joints at the interpolator's pose, mm and rad.
    ///
    /// # Errors
    /// The fault to latch.
    #[inline]
    fn remainder(&self, interpolator: &Interpolator) -> Result<Remainder, Fault> {
        // Joints of a planar machine are channels. That the tilt is none was checked on reception.
        let Some(pivot_length_mm) = self.pivot_length_mm else {
            return Ok(None);
        };
        let offset = interpolator.offset();
        let (tilt, base) = offset.tilt();
        let pose = tilt_pose(base, tilt);
        match gantry::remainder(pivot_length_mm, &pose) {
            Ok(remainder) => Ok(Some(remainder)),
            Err(_) => Err(Fault {
                cause: FaultCause::Kinematics,
                index: 0,
                value: 0,
            }),
        }
    }

    /// Writes the joints' targets at the interpolator's pose; other motors keep theirs.
    ///
    /// # Errors
    /// The fault to latch.
    #[inline]
    pub fn set_targets<'a>(
        &self,
        interpolator: &Interpolator,
        targets: impl Iterator<Item = &'a mut Target>,
    ) -> Result<Reach, Fault> {
        let offset = interpolator.offset();
        let reach = match self.remainder(interpolator)? {
            // A loop of its own for machines that have nothing to add.
            None => self.scale(&offset, targets, |_, _, steps| steps),
            Some(remainder) => self.scale(&offset, targets, |joint, index, steps| {
                let added = remainder.get(index).copied().unwrap_or(0.0);
                steps + added * joint.steps_per_natural
            }),
        };
        Ok(reach)
    }

    #[inline(always)]
    fn scale<'a>(
        &self,
        offset: &Offset<'_>,
        targets: impl Iterator<Item = &'a mut Target>,
        all_steps: impl Fn(&JointScale, usize, f32) -> f32,
    ) -> Reach {
        let mut reach = Reach::default();
        let parts = self.joints.iter().zip(offset.motors()).zip(targets);
        for (index, ((joint, (steps, anchor)), target)) in parts.enumerate().take(self.count) {
            let new = anchor.moved(all_steps(joint, index, steps));
            reach.jumps |= target.replace(new);
            let above = new.whole.wrapping_sub(joint.lowest) as u32;
            if above > joint.range {
                reach.outside |= 1 << index;
            }
        }
        reach
    }

    /// The targets of a pose at rest, 2^-31 steps: joints, then the extruder.
    ///
    /// # Errors
    /// The fault that it would be to go there.
    pub fn targets(&self, interpolator: &Interpolator) -> Result<[i64; MOTORS_MAX], Fault> {
        let mut targets = [Target::default(); MOTORS_MAX];
        for (target, (_, anchor)) in targets.iter_mut().zip(interpolator.offset().motors()) {
            *target = anchor;
        }
        let reach = self.set_targets(interpolator, targets.iter_mut())?;
        let targets = targets.map(Target::position);
        self.check_limits(reach.outside, &targets)?;
        Ok(targets)
    }

    /// # Errors
    /// The fault of the first joint in `outside`.
    #[inline(always)]
    pub fn check_limits(&self, outside: u32, targets: &[i64; MOTORS_MAX]) -> Result<(), Fault> {
        if outside == 0 {
            return Ok(());
        }
        let joint = outside.trailing_zeros() as usize % MOTORS_MAX;
        Err(self.limit_fault(joint, targets[joint], FaultCause::SoftLimit))
    }
}
