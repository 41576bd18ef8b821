//! Interpolated motors -> joint targets in steps, with the soft limits.
//!
//! A joint channel's integer base is exact (path/interpolator/ready_span.rs); its offset and the tilt's contribution
//! are f32.

use crate::configuration::{JOINTS_MAX, Kinematics, MOTORS_MAX, MachineConfiguration};
use crate::kinematics::pose::Pose;
use crate::kinematics::winding::Winding;
use crate::kinematics::{self, Model, arm6, gantry, planar, trunnion};
use crate::path::interpolator::{Offset, RestPose};
use crate::path::load::{range_slack, tilt_pose};
use crate::steps::{STEP, Target, count};
use headway_protocol::message::{Fault, FaultCause};
use nalgebra::Vector3;

/// Furthest that a soft limit can be, whole steps: well within the 32 bits of a target.
const WHOLE_STEPS_MAX: i64 = (1 << 30) - 4;

/// The same as a position: of a joint without a stop.
const POSITION_MAX: i64 = WHOLE_STEPS_MAX * STEP;

/// A pose in the stream that has no joint positions.
const IMPOSSIBLE_POSE: Fault = Fault {
    cause: FaultCause::Kinematics,
    index: 0,
    value: 0,
};

/// One joint's numbers.
#[derive(Clone, Copy, Debug, Default)]
struct JointScale {
    /// Steps per mm or rad.
    steps_per_natural: f32,
    /// Soft limits, 2^-31 steps.
    position_min: i64,
    position_max: i64,
    /// What a path may be beyond them: twice as much as spans are taken with, whose check is rounded and looks at some
    /// places only.
    slack: i64,
    /// The same in whole steps, one further in because targets may be one off: the lowest, and what
    /// may be added to it. Beyond it the exact position is checked.
    lowest: i32,
    range: u32,
    /// 0.1 µm or µrad per step.
    units_per_step: f64,
    /// A whole turn of a joint that turns, 2^-31 steps.
    turn: i64,
    /// It turns without a stop.
    endless: bool,
}

impl JointScale {
    /// A joint without a stop: its whole steps wrap at 32 bits, and only their place in a turn counts.
    fn endless(steps_per_unit: f64) -> Self {
        Self {
            steps_per_natural: steps_per_unit as f32,
            position_min: i64::MIN,
            position_max: i64::MAX,
            slack: 0,
            lowest: i32::MIN,
            range: u32::MAX,
            units_per_step: 1e6 / steps_per_unit,
            turn: (core::f64::consts::TAU * steps_per_unit * STEP as f64 + 0.5) as i64,
            endless: true,
        }
    }
}

/// What the joints' new targets are like.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reach {
    /// Joints outside their soft limits, or next to them: a mask for [`JointTargets::check_limits`].
    pub outside: u32,
    /// See [`Target::replace`].
    pub jumps: u32,
}

/// The joint solution in use, and the turns of its joints: a command that is refused leaves both.
#[derive(Clone, Copy, Debug)]
pub struct Branch {
    solution: u8,
    winding: Winding<f32>,
}

/// All joints.
#[derive(Clone, Debug)]
pub struct JointTargets {
    /// The machine's equations, in single precision once and for all.
    model: Model<f32>,
    kinematics: Kinematics,
    winding: Winding<f32>,
    /// Ends of the joints' ranges, mm or rad.
    ranges: [[f64; 2]; JOINTS_MAX],
    count: usize,
    joints: [JointScale; MOTORS_MAX],
}

impl JointTargets {
    /// From the machine's configuration.
    pub fn new(configuration: &MachineConfiguration) -> Self {
        let mut joints = [JointScale::default(); MOTORS_MAX];
        let joint_channels = kinematics::joint_channels(&configuration.kinematics);
        for (scale, joint) in joints.iter_mut().zip(&configuration.joints) {
            // A range beyond what targets hold is cut, or has no end.
            let position = |natural: f64| {
                let position = (natural * joint.steps_per_unit * STEP as f64) as i64;
                position.clamp(-POSITION_MAX, POSITION_MAX)
            };
            let whole =
                |position: i64| count(position).clamp(-WHOLE_STEPS_MAX, WHOLE_STEPS_MAX) as i32;
            let (min, max) = (position(joint.position_min), position(joint.position_max));
            let report_units = if joint.rotary { 1e6 } else { 1e4 };
            if joint.rotary && min <= -POSITION_MAX && max >= POSITION_MAX {
                *scale = JointScale::endless(joint.steps_per_unit);
                continue;
            }
            *scale = JointScale {
                steps_per_natural: joint.steps_per_unit as f32,
                position_min: min,
                position_max: max,
                slack: position(2.0 * range_slack(joint)),
                lowest: whole(min) + 1,
                range: (whole(max) - whole(min) - 2).max(0) as u32,
                units_per_step: report_units / joint.steps_per_unit,
                turn: position(core::f64::consts::TAU),
                endless: false,
            };
        }
        let count = joint_channels.len().min(configuration.joints.len());
        Self {
            model: Model::new(&configuration.kinematics),
            kinematics: configuration.kinematics,
            winding: Winding::default(),
            ranges: configuration.ranges(),
            count,
            joints,
        }
    }

    /// The joint solution in use.
    pub fn solution(&self) -> u8 {
        self.kinematics.solution()
    }

    /// Selects the joint solution, at the start of a stream. False if the machine does not have it.
    #[must_use]
    pub fn take_solution(&mut self, solution: u8) -> bool {
        if solution >= self.kinematics.solutions() {
            return false;
        }
        self.kinematics = self.kinematics.with_solution(solution);
        self.model = Model::new(&self.kinematics);
        true
    }

    /// The present branch.
    pub fn branch(&self) -> Branch {
        Branch {
            solution: self.solution(),
            winding: self.winding,
        }
    }

    /// Goes back to a branch that was the present one.
    pub fn go_back(&mut self, branch: &Branch) {
        // It was taken once.
        let _ = self.take_solution(branch.solution);
        self.winding = branch.winding;
    }

    /// Number of joints.
    pub fn count(&self) -> usize {
        self.count
    }

    /// True if a position, 2^-31 steps, is within the joint's range.
    pub fn is_in_range(&self, joint: usize, position: i64) -> bool {
        joint < self.count && self.beyond_range(joint, position) <= 0
    }

    /// Distance of a position beyond the joint's range, 2^-31 steps; 0 or less inside.
    pub fn beyond_range(&self, joint: usize, position: i64) -> i64 {
        self.joints.get(joint).map_or(i64::MAX, |joint| {
            let below = joint.position_min.saturating_sub(position);
            below.max(position.saturating_sub(joint.position_max))
        })
    }

    /// Distance of a joint from a position, 2^-31 steps: for one that turns without an end in the
    /// shorter direction.
    pub fn way_to(&self, joint: usize, goal: i64, here: i64) -> i64 {
        // Whole steps have 32 bits.
        let way = goal.wrapping_sub(here) << 1 >> 1;
        let endless = self.joints.get(joint).filter(|joint| joint.endless);
        let turn = endless.map_or(0, |joint| joint.turn);
        match way.checked_rem_euclid(turn) {
            Some(rest) if rest > turn / 2 => rest - turn,
            Some(rest) => rest,
            None => way,
        }
    }

    /// The fault of a joint at a position, 2^-31 steps.
    pub(crate) fn limit_fault(&self, joint: usize, position: i64, cause: FaultCause) -> Fault {
        Fault {
            cause,
            index: joint as u8,
            value: self.units_of(joint, position),
        }
    }

    /// A joint's position, 2^-31 steps, in 0.1 µm or µrad.
    #[inline(never)]
    pub(crate) fn units_of(&self, joint: usize, position: i64) -> i32 {
        let units_per_step = self.joints.get(joint).map_or(0.0, |j| j.units_per_step);
        (position as f64 / STEP as f64 * units_per_step) as i32
    }

    /// Mask of all joints.
    pub fn all(&self) -> u8 {
        ((1u16 << self.count) - 1) as u8
    }

    /// Sets the joints' targets at the pose, where `put` returns the result of [`Target::replace`]; other
    /// motors keep theirs. Poses of two calls must be close enough that no joint turns by half a turn.
    ///
    /// # Errors
    /// The fault to latch.
    #[inline(always)]
    pub fn set_targets(
        &mut self,
        offset: &Offset<'_>,
        put: impl FnMut(usize, Target) -> u32,
    ) -> Result<Reach, Fault> {
        // A loop of its own for machines that have nothing to add: joints of a planar machine are
        // channels. That the tilt is none was checked on reception.
        match &self.model {
            Model::Planar if offset.is_far() => Ok(self.follow_far(offset, put)),
            Model::Planar => {
                let near = |_: &JointScale, _, way, anchor: Target| anchor.moved_near(way);
                Ok(follow(
                    &self.joints,
                    &planar::JOINT_CHANNELS,
                    offset,
                    put,
                    near,
                ))
            }
            Model::Gantry(pivot_length_mm) => {
                let (tilt, base) = offset.tilt();
                let pose = tilt_pose(base, tilt);
                let added =
                    gantry::remainder(*pivot_length_mm, &pose).map_err(|_| IMPOSSIBLE_POSE)?;
                let all_steps = |joint: &JointScale, index: usize, steps: f32, anchor: Target| {
                    let added = added.get(index).copied().unwrap_or(0.0);
                    anchor.moved(steps + added * joint.steps_per_natural)
                };
                Ok(follow(
                    &self.joints,
                    &gantry::JOINT_CHANNELS,
                    offset,
                    put,
                    all_steps,
                ))
            }
            Model::Trunnion(trunnion) => {
                let joints = trunnion.remainder(&whole_pose(offset));
                let joints = joints.map_err(|_| IMPOSSIBLE_POSE)?;
                Ok(self.follow_winding::<{ trunnion::WINDS }, _>(
                    &trunnion::JOINT_CHANNELS,
                    (offset, &joints),
                    put,
                ))
            }
            Model::Arm6(arm) => {
                let joints = arm.remainder(&whole_pose(offset));
                let joints = joints.map_err(|_| IMPOSSIBLE_POSE)?;
                let at = (offset, &joints);
                Ok(if self.count > arm6::JOINT_CHANNELS.len() {
                    let joint_channels = &arm6::JOINT_CHANNELS_WITH_NOZZLE;
                    self.follow_winding::<{ arm6::WINDS }, _>(joint_channels, at, put)
                } else {
                    self.follow_winding::<{ arm6::WINDS }, _>(&arm6::JOINT_CHANNELS, at, put)
                })
            }
            Model::Axes(axes) => {
                let pose = if kinematics::follows_pose(&self.kinematics) {
                    whole_pose(offset)
                } else {
                    let (tilt, base) = offset.tilt();
                    tilt_pose(base, tilt)
                };
                let joints = axes.remainder(&pose).map_err(|_| IMPOSSIBLE_POSE)?;
                Ok(self.follow_axes((offset, &joints), put))
            }
        }
    }

    /// The targets of joints at what is `added` beyond what they carry, whole turns of `WINDS` counted.
    #[inline(never)]
    fn follow_winding<const WINDS: u8, const JOINTS: usize>(
        &mut self,
        joint_channels: &[Option<usize>; JOINTS],
        (offset, added): (&Offset<'_>, &[f32; JOINTS_MAX]),
        put: impl FnMut(usize, Target) -> u32,
    ) -> Reach {
        let winding = &mut self.winding;
        let wound = |joint: &JointScale, index: usize, steps: f32, mut anchor: Target| {
            let added = added.get(index).copied().unwrap_or(0.0);
            if WINDS >> index & 1 != 0 {
                anchor = wound(winding, joint, index, added, anchor);
            }
            anchor.moved(steps + added * joint.steps_per_natural)
        };
        follow(&self.joints, joint_channels, offset, put, wound)
    }

    /// The same for any number of joints, once for all machines of linear and rotary axes.
    #[inline(never)]
    fn follow_axes(
        &mut self,
        (offset, added): (&Offset<'_>, &[f32; JOINTS_MAX]),
        put: impl FnMut(usize, Target) -> u32,
    ) -> Reach {
        let winds = kinematics::winds(&self.kinematics);
        let joint_channels = kinematics::joint_channels(&self.kinematics);
        let winding = &mut self.winding;
        let wound = |joint: &JointScale, index: usize, steps: f32, anchor: Target| {
            let added = added.get(index).copied().unwrap_or(0.0);
            let anchor = if winds >> index & 1 != 0 {
                wound(winding, joint, index, added, anchor)
            } else {
                anchor
            };
            anchor.moved(steps + added * joint.steps_per_natural)
        };
        follow(&self.joints, joint_channels, offset, put, wound)
    }

    /// A planar machine in a span that is long for its motors.
    #[inline(never)]
    fn follow_far(&self, offset: &Offset<'_>, put: impl FnMut(usize, Target) -> u32) -> Reach {
        let far = |_: &JointScale, _, steps, anchor: Target| anchor.moved(steps);
        follow(&self.joints, &planar::JOINT_CHANNELS, offset, put, far)
    }

    /// The targets of a pose at rest, 2^-31 steps: joints, then the extruder.
    ///
    /// # Errors
    /// The fault that a move there would cause.
    #[inline(never)]
    pub fn targets(&mut self, pose: &RestPose) -> Result<[i64; MOTORS_MAX], Fault> {
        let offset = pose.offset();
        if kinematics::winds(&self.kinematics) != 0 {
            let added = self.model.remainder(&whole_pose(&offset));
            let added = added.map_err(|_| IMPOSSIBLE_POSE)?;
            let ranges = &self.ranges;
            self.winding = Winding::at_rest(&self.kinematics, &added, ranges);
        }
        let mut targets = [Target::of_position(0); MOTORS_MAX];
        targets[self.count % MOTORS_MAX] = offset.of_motor(self.count).1;
        let put = |joint: usize, new| {
            targets[joint % MOTORS_MAX] = new;
            0
        };
        let reach = self.set_targets(&offset, put)?;
        self.check_limits(reach.outside, |joint| targets[joint % MOTORS_MAX])?;
        Ok(targets.map(Target::position))
    }

    /// Checks the joints in `outside` more closely: no step may exceed a limit and its slack, rounded to a
    /// step.
    ///
    /// # Errors
    /// The fault of the first one that would.
    #[inline(never)]
    pub fn check_limits(
        &self,
        outside: u32,
        mut target: impl FnMut(usize) -> Target,
    ) -> Result<(), Fault> {
        let mut left = outside;
        while left != 0 {
            let index = left.trailing_zeros() as usize % MOTORS_MAX;
            left &= left - 1;
            let joint = &self.joints[index];
            let position = target(index).position();
            let lowest = count(joint.position_min.saturating_sub(joint.slack));
            let highest = count(joint.position_max.saturating_add(joint.slack));
            if !(lowest..=highest).contains(&count(position)) {
                return Err(self.limit_fault(index, position, FaultCause::SoftLimit));
            }
        }
        Ok(())
    }
}

/// The anchor of a joint that winds, its whole turns added.
#[inline(always)]
fn wound(
    winding: &mut Winding<f32>,
    joint: &JointScale,
    index: usize,
    added: f32,
    anchor: Target,
) -> Target {
    let turns = winding.follow(index, added);
    if turns == 0 {
        return anchor;
    }
    let way = i64::from(turns).wrapping_mul(joint.turn);
    Target::of_position(anchor.position().wrapping_add(way))
}

/// The targets of joints that follow `joint_channels`, with what else there is.
#[inline(always)]
fn follow(
    joints: &[JointScale; MOTORS_MAX],
    joint_channels: &[Option<usize>],
    offset: &Offset<'_>,
    mut put: impl FnMut(usize, Target) -> u32,
    mut target: impl FnMut(&JointScale, usize, f32, Target) -> Target,
) -> Reach {
    let mut reach = Reach::default();
    for (index, (joint_channel, joint)) in joint_channels.iter().zip(joints).enumerate() {
        let (way, anchor) = match joint_channel {
            Some(_) => offset.of_motor(index),
            None => (0.0, Target::of_position(0)),
        };
        let new = target(joint, index, way, anchor);
        reach.jumps |= put(index, new);
        let above = new.whole.wrapping_sub(joint.lowest) as u32;
        if above > joint.range {
            reach.outside |= 1 << index;
        }
    }
    reach
}

/// The pose of machines whose joints follow all of it.
#[inline(always)]
fn whole_pose(offset: &Offset<'_>) -> Pose<f32> {
    let (tilt, base) = offset.tilt();
    let [x, y, z, heading_rad] = offset.place();
    Pose {
        tip_mm: Vector3::new(x, y, z),
        heading_rad,
        ..tilt_pose(base, tilt)
    }
}

#[cfg(test)]
mod tests {
    //! Goal: no step goes beyond a soft limit, and none before it is refused. Method: poses around
    //! the limits of a joint with 80 steps a mm, by a few hundredths of a step.
    use super::*;
    use crate::board::built_in::emulated_planar;
    use crate::path::joint_channels::JointChannels;
    use headway_protocol::units::ChannelPoint;

    #[test]
    fn a_soft_limit_trips_before_the_step_beyond_it() {
        let configuration = emulated_planar();
        let mut joints = JointTargets::new(&configuration);
        let joint_channels = JointChannels::new(&configuration);
        // The next step above 310 mm is due 62.5 of 0.1 µm further, that below -10 mm just so far.
        for (x_units, refused) in [
            (3_100_000, false),
            (3_100_062, false),
            (3_100_063, true),
            (3_100_200, true),
            (3_099_900, false),
            (-100_000, false),
            (-100_062, false),
            (-100_064, true),
            (-99_900, false),
        ] {
            let mut pose = ChannelPoint::default();
            pose[0] = x_units;
            let targets = joints.targets(&RestPose::new(&joint_channels, &pose));
            assert_eq!(targets.is_err(), refused, "{x_units}");
        }
    }

    #[test]
    fn a_joint_without_a_stop_has_no_limit() {
        let mut configuration = emulated_planar();
        configuration.joints[3].position_min = f64::NEG_INFINITY;
        configuration.joints[3].position_max = f64::INFINITY;
        let mut joints = JointTargets::new(&configuration);
        let joint_channels = JointChannels::new(&configuration);
        for heading_units in [0, 2_000_000_000, -2_000_000_000] {
            let mut pose = ChannelPoint::default();
            pose[5] = heading_units;
            let at_rest = RestPose::new(&joint_channels, &pose);
            assert!(joints.targets(&at_rest).is_ok(), "{heading_units}");
            assert!(joints.is_in_range(3, i64::from(heading_units) << 30));
        }
    }
}
