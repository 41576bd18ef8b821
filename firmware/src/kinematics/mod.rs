//! Pose -> joint positions and back, one file per machine.
//!
//! In: a [`Pose`], or the joints; the [`Kinematics`] of the configuration. Out: joints, or the pose, or the reason
//! for an error. Pure functions, generic over the number type: f64 for planning, f32 on the servo tick.
//! Units: mm for linear joints, rad for rotary ones; joints in the machine's order.
//!
//! A joint position is a *joint channel* plus a *remainder*. The joint channel is the one channel that the
//! joint follows one to one (X carries x, C carries the heading), kept as an exact integer on the
//! controller; the remainder is the tilt's contribution, small enough for f32. The split keeps step counts
//! exact far from the origin.
//!
//! Joints whose angle comes from an arctangent are found within half a turn; [`winding`] makes them
//! continuous. Where a pose has several joint solutions, the one that [`Kinematics`] names is used.

pub mod arm6;
pub mod axes;
pub mod gantry;
pub mod planar;
pub mod pose;
pub mod trunnion;
pub mod winding;

use crate::configuration::{JOINTS_MAX, Kinematics};
use crate::kinematics::pose::Pose;
use crate::numbers::real::Real;

/// Why a pose has no joint positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum KinematicsError {
    /// The tool axis is further from Z than the machine can tilt it at all.
    TiltOutOfReach,
    /// Two rotary axes line up: the joints are not determined by the pose.
    Singular,
    /// The arm is too short for the tip's place, or too long.
    OutOfReach,
    /// A number is not finite.
    NotFinite,
}

impl core::fmt::Display for KinematicsError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::TiltOutOfReach => "the tool axis is tilted further than the machine can reach",
            Self::Singular => "two rotary axes line up in this pose",
            Self::OutOfReach => "the arm does not reach this place",
            Self::NotFinite => "the pose is not finite",
        })
    }
}

impl core::error::Error for KinematicsError {}

/// Joint positions in mm and rad; joints past `count` are 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joints<R> {
    /// Positions, in the machine's joint order.
    pub position: [R; JOINTS_MAX],
    /// How many joints the machine has.
    pub count: usize,
}

impl<R> Joints<R> {
    /// The joints that exist.
    pub fn as_slice(&self) -> &[R] {
        self.position.get(..self.count).unwrap_or(&self.position)
    }
}

impl Kinematics {
    /// Number of joint solutions of a pose.
    pub const fn solutions(&self) -> u8 {
        match self {
            Self::Planar | Self::Gantry { .. } => 1,
            Self::Trunnion { .. } => 2,
            Self::Arm6 { .. } => arm6::SOLUTIONS,
            Self::Axes { axes, .. } if axes.second.is_none() && !axes.polar => 1,
            Self::Axes { .. } => 2,
        }
    }
}

/// Number of joints of a machine, the extruder not counted.
pub const fn joint_count(kinematics: &Kinematics) -> usize {
    match kinematics {
        Kinematics::Planar => planar::JOINT_CHANNELS.len(),
        Kinematics::Gantry { .. } => gantry::JOINT_CHANNELS.len(),
        Kinematics::Trunnion { .. } => trunnion::JOINT_CHANNELS.len(),
        Kinematics::Arm6 { arm, .. } if arm.nozzle => arm6::JOINT_CHANNELS_WITH_NOZZLE.len(),
        Kinematics::Arm6 { .. } => arm6::JOINT_CHANNELS.len(),
        Kinematics::Axes { axes, .. } => axes.joint_channels().len(),
    }
}

/// For each joint the channel that it follows one to one, if any.
pub const fn joint_channels(kinematics: &Kinematics) -> &'static [Option<usize>] {
    match kinematics {
        Kinematics::Planar => &planar::JOINT_CHANNELS,
        Kinematics::Gantry { .. } => &gantry::JOINT_CHANNELS,
        Kinematics::Trunnion { .. } => &trunnion::JOINT_CHANNELS,
        Kinematics::Arm6 { arm, .. } if arm.nozzle => &arm6::JOINT_CHANNELS_WITH_NOZZLE,
        Kinematics::Arm6 { .. } => &arm6::JOINT_CHANNELS,
        Kinematics::Axes { axes, .. } => axes.joint_channels(),
    }
}

/// Joints that are found within half a turn: a mask.
pub const fn winds(kinematics: &Kinematics) -> u8 {
    match kinematics {
        Kinematics::Planar | Kinematics::Gantry { .. } => 0,
        Kinematics::Trunnion { .. } => trunnion::WINDS,
        Kinematics::Arm6 { .. } => arm6::WINDS,
        Kinematics::Axes { axes, .. } if axes.polar => axes::POLAR_WINDS,
        Kinematics::Axes { axes, .. } if axes.second.is_none() => axes::ONE_WINDS,
        Kinematics::Axes { .. } => axes::TWO_WIND,
    }
}

/// True if joints depend on the complete pose, not only on the tilt.
pub const fn follows_pose(kinematics: &Kinematics) -> bool {
    match kinematics {
        Kinematics::Planar | Kinematics::Gantry { .. } => false,
        Kinematics::Trunnion { .. } | Kinematics::Arm6 { .. } => true,
        Kinematics::Axes { axes, .. } => !axes.is_in_head(),
    }
}

/// A machine's equations with their constants in one number type.
// Boxing is impossible without a heap.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Model<R> {
    /// See [`planar`].
    Planar,
    /// See [`gantry`]: the pivot length in mm.
    Gantry(R),
    /// See [`trunnion`].
    Trunnion(trunnion::Trunnion<R>),
    /// See [`arm6`].
    Arm6(arm6::Arm6<R>),
    /// See [`axes`].
    Axes(axes::Axes<R>),
}

impl<R: Real> Model<R> {
    /// Of a machine, with the joint solution that it names.
    pub fn new(kinematics: &Kinematics) -> Self {
        match kinematics {
            Kinematics::Planar => Self::Planar,
            Kinematics::Gantry { pivot_length_mm } => Self::Gantry(R::of(*pivot_length_mm)),
            Kinematics::Trunnion {
                centre_mm,
                solution,
            } => Self::Trunnion(trunnion::Trunnion::new(centre_mm, *solution)),
            Kinematics::Arm6 { arm, solution } => Self::Arm6(arm6::Arm6::new(arm, *solution)),
            Kinematics::Axes { axes, solution } => Self::Axes(axes::Axes::new(axes, *solution)),
        }
    }

    /// What each joint adds to its joint channel.
    ///
    /// # Errors
    /// See [`KinematicsError`]. The tip of the pose may be anything where
    /// [`follows_pose`] is false.
    #[inline(never)]
    pub fn remainder(&self, pose: &Pose<R>) -> Result<[R; JOINTS_MAX], KinematicsError> {
        match self {
            Self::Planar => planar::remainder(pose),
            Self::Gantry(pivot_length_mm) => gantry::remainder(*pivot_length_mm, pose),
            Self::Trunnion(trunnion) => trunnion.remainder(pose),
            Self::Arm6(arm) => arm.remainder(pose),
            Self::Axes(axes) => axes.remainder(pose),
        }
    }

    /// Pose of joint positions.
    pub fn forward(&self, joints: &[R; JOINTS_MAX]) -> Pose<R> {
        match self {
            Self::Planar => planar::forward(joints),
            Self::Gantry(pivot_length_mm) => gantry::forward(*pivot_length_mm, joints),
            Self::Trunnion(trunnion) => trunnion.forward(joints),
            Self::Arm6(arm) => arm.forward(joints),
            Self::Axes(axes) => axes.forward(joints),
        }
    }
}

/// What each joint adds to its joint channel, see [`Model::remainder`].
///
/// # Errors
/// See [`KinematicsError`].
#[inline]
pub fn remainder<R: Real>(
    kinematics: &Kinematics,
    pose: &Pose<R>,
) -> Result<[R; JOINTS_MAX], KinematicsError> {
    Model::new(kinematics).remainder(pose)
}

/// Joint positions of a pose; those of [`winds`] within half a turn.
///
/// # Errors
/// See [`KinematicsError`].
pub fn inverse<R: Real>(
    kinematics: &Kinematics,
    pose: &Pose<R>,
) -> Result<Joints<R>, KinematicsError> {
    let channels = [
        pose.tip_mm.x,
        pose.tip_mm.y,
        pose.tip_mm.z,
        pose.tilt_rad.x,
        pose.tilt_rad.y,
        pose.heading_rad,
    ];
    if channels.iter().any(|value| !value.is_number()) {
        return Err(KinematicsError::NotFinite);
    }
    let mut position = remainder(kinematics, pose)?;
    let joint_channels = joint_channels(kinematics);
    for (joint, joint_channel) in position.iter_mut().zip(joint_channels) {
        if let Some(channel) = joint_channel.and_then(|channel| channels.get(channel)) {
            *joint += *channel;
        }
    }
    Ok(Joints {
        position,
        count: joint_channels.len(),
    })
}

/// Pose of joint positions. The heading is unwrapped, as in the input, except for arms whose flange
/// turns it: there it is within half a turn.
pub fn forward<R: Real>(kinematics: &Kinematics, joints: &[R; JOINTS_MAX]) -> Pose<R> {
    Model::new(kinematics).forward(joints)
}
