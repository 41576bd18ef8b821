//! Pose -> joint positions and back, one file per machine.
//!
//! Pure functions, generic over the number type: f64 for planning, f32 on the servo tick.
//! Units: mm for linear joints, rad for rotary ones; joints in the machine's order.
//!
//! A joint position is a *carrier* plus a *remainder*. The carrier is the one channel that the
//! joint follows one to one (X carries x, C carries the heading), kept as an exact integer on the
//! controller; the remainder is what the tilt adds, small enough for f32. The split is what keeps
//! step counts exact far from the origin.

pub mod gantry;
pub mod planar;

use crate::configuration::{JOINTS_MAX, Kinematics};
use crate::pose::Pose;
use crate::real::Real;

/// Why a pose has no joint positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum KinematicsError {
    /// The tool axis is further from Z than the machine can tilt it at all.
    TiltOutOfReach,
    /// Two rotary axes line up: the joints are not determined by the pose.
    Singular,
    /// A number is not finite.
    NotFinite,
}

impl core::fmt::Display for KinematicsError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::TiltOutOfReach => "the tool axis is tilted further than the machine can reach",
            Self::Singular => "two rotary axes line up in this pose",
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

/// Number of joints of a machine, the extruder not counted.
pub const fn joint_count(kinematics: &Kinematics) -> usize {
    match kinematics {
        Kinematics::Planar => planar::CARRIERS.len(),
        Kinematics::Gantry { .. } => gantry::CARRIERS.len(),
    }
}

/// For each joint the channel that it follows one to one, if any.
pub const fn carriers(kinematics: &Kinematics) -> &'static [Option<usize>] {
    match kinematics {
        Kinematics::Planar => &planar::CARRIERS,
        Kinematics::Gantry { .. } => &gantry::CARRIERS,
    }
}

/// What each joint adds to its carrier.
///
/// # Errors
/// See [`KinematicsError`]. The tip of the pose may be anything for machines whose remainder does
/// not depend on it.
#[inline]
pub fn remainder<R: Real>(
    kinematics: &Kinematics,
    pose: &Pose<R>,
) -> Result<[R; JOINTS_MAX], KinematicsError> {
    match kinematics {
        Kinematics::Planar => planar::remainder(pose),
        Kinematics::Gantry { pivot_length_mm } => gantry::remainder(R::of(*pivot_length_mm), pose),
    }
}

/// Joint positions of a pose.
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
    let carriers = carriers(kinematics);
    for (joint, carrier) in position.iter_mut().zip(carriers) {
        if let Some(channel) = carrier.and_then(|channel| channels.get(channel)) {
            *joint += *channel;
        }
    }
    Ok(Joints {
        position,
        count: carriers.len(),
    })
}

/// Pose of joint positions. The heading comes back unwrapped, as it was.
pub fn forward<R: Real>(kinematics: &Kinematics, joints: &[R; JOINTS_MAX]) -> Pose<R> {
    match kinematics {
        Kinematics::Planar => planar::forward(joints),
        Kinematics::Gantry { pivot_length_mm } => gantry::forward(R::of(*pivot_length_mm), joints),
    }
}
