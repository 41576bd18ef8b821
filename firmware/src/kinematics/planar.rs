//! `planar`: X Y Z + C, the nozzle turning about Z. Joints equal the channels.

use super::KinematicsError;
use crate::configuration::JOINTS_MAX;
use crate::kinematics::pose::Pose;
use crate::numbers::real::Real;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y, CHANNEL_Z};
use nalgebra::{Vector2, Vector3};

/// X Y Z C follow x, y, z and the heading.
pub const JOINT_CHANNELS: [Option<usize>; 4] = [
    Some(CHANNEL_X),
    Some(CHANNEL_Y),
    Some(CHANNEL_Z),
    Some(CHANNEL_HEADING),
];

/// Tilt that still counts as upright: half the wire's default tolerance of the tool axis, rad.
const UPRIGHT_TOLERANCE_RAD: f64 = 5e-5;

/// Nothing: the joints are the channels.
///
/// # Errors
/// [`KinematicsError::TiltOutOfReach`] where the tool axis is not Z.
#[inline]
pub fn remainder<R: Real>(pose: &Pose<R>) -> Result<[R; JOINTS_MAX], KinematicsError> {
    let most = R::of(UPRIGHT_TOLERANCE_RAD);
    if pose.tilt_rad.x.magnitude() <= most && pose.tilt_rad.y.magnitude() <= most {
        Ok([R::of(0.0); JOINTS_MAX])
    } else {
        Err(KinematicsError::TiltOutOfReach)
    }
}

/// Pose of X Y Z C.
pub fn forward<R: Real>(joints: &[R; JOINTS_MAX]) -> Pose<R> {
    let zero = R::of(0.0);
    Pose {
        tip_mm: Vector3::new(joints[0], joints[1], joints[2]),
        tilt_rad: Vector2::new(zero, zero),
        heading_rad: joints[3],
    }
}

#[cfg(test)]
mod tests {
    use crate::configuration::Kinematics;
    use crate::kinematics::pose::Pose;
    use crate::kinematics::{KinematicsError, forward, inverse};
    use nalgebra::{Vector2, Vector3};

    #[test]
    fn joints_are_the_channels_and_a_tilt_is_refused() {
        let mut pose = Pose {
            tip_mm: Vector3::new(10.5f64, -3.25, 0.2),
            tilt_rad: Vector2::zeros(),
            heading_rad: 77.7,
        };
        let joints = inverse(&Kinematics::Planar, &pose).unwrap();
        assert_eq!(joints.as_slice(), [10.5, -3.25, 0.2, 77.7]);
        assert_eq!(forward(&Kinematics::Planar, &joints.position), pose);
        pose.tilt_rad.x = 0.01;
        assert_eq!(
            inverse(&Kinematics::Planar, &pose),
            Err(KinematicsError::TiltOutOfReach)
        );
        pose.tilt_rad.x = f64::NAN;
        assert_eq!(
            inverse(&Kinematics::Planar, &pose),
            Err(KinematicsError::NotFinite)
        );
    }
}
