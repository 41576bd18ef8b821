//! `gantry`: X Y Z + head A (about X), B (about Y), C (heading), pivot length L.
//!
//! R = R_x(A) R_y(B) R_z(C), X Y Z = p + L n - (0, 0, L). With n = (sin B, -sin A cos B,
//! cos A cos B): A = atan2(-n_y, n_z), B = asin(n_x), and, because R_min has no twist,
//! C = heading + atan2(n_x n_y, n_z (1 + n_z) + n_y²), which needs no sine of the heading.

use super::KinematicsError;
use crate::configuration::JOINTS_MAX;
use crate::kinematics::pose::{Pose, TILT_REACH_RAD, tilt_of_axis, tool_axis};
use crate::numbers::real::Real;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y, CHANNEL_Z};
use nalgebra::Vector3;

/// X Y Z follow the tip, C follows the heading; A and B follow only from the tilt.
pub const JOINT_CHANNELS: [Option<usize>; 6] = [
    Some(CHANNEL_X),
    Some(CHANNEL_Y),
    Some(CHANNEL_Z),
    None,
    None,
    Some(CHANNEL_HEADING),
];

/// cos² B below which A and C line up too closely: B within about 1.8° of ±90°.
const COSINE_B_SQUARED_MIN: f64 = 1e-3;

/// What the tilt adds to X Y Z A B C, mm and rad.
///
/// # Errors
/// [`KinematicsError::TiltOutOfReach`] beyond 150°, [`KinematicsError::Singular`] near B = ±90°
/// and where A would pass ±180°.
#[inline]
pub fn remainder<R: Real>(
    pivot_length_mm: R,
    pose: &Pose<R>,
) -> Result<[R; JOINTS_MAX], KinematicsError> {
    let tilt = pose.tilt_rad;
    let theta_squared = tilt.x * tilt.x + tilt.y * tilt.y;
    // The comparison is written so that a NaN is refused too.
    let in_reach = theta_squared <= R::of(TILT_REACH_RAD * TILT_REACH_RAD);
    if !in_reach {
        return Err(KinematicsError::TiltOutOfReach);
    }
    let n = tool_axis(tilt);
    let one = R::of(1.0);
    let cosine_b_squared = n.y * n.y + n.z * n.z;
    let heading_denominator = n.z * (one + n.z) + n.y * n.y;
    let least = R::of(COSINE_B_SQUARED_MIN);
    if cosine_b_squared < least || heading_denominator < least {
        return Err(KinematicsError::Singular);
    }
    let mut joints = [R::of(0.0); JOINTS_MAX];
    joints[0] = pivot_length_mm * n.x;
    joints[1] = pivot_length_mm * n.y;
    joints[2] = pivot_length_mm * (n.z - one);
    joints[3] = (-n.y).angle_from_x(n.z);
    joints[4] = n.x.angle_from_x(cosine_b_squared.root());
    joints[5] = (n.x * n.y).angle_from_x(heading_denominator);
    Ok(joints)
}

/// Pose of X Y Z A B C.
pub fn forward<R: Real>(pivot_length_mm: R, joints: &[R; JOINTS_MAX]) -> Pose<R> {
    let one = R::of(1.0);
    let (sine_a, cosine_a) = joints[3].sine_cosine();
    let (sine_b, cosine_b) = joints[4].sine_cosine();
    let n = Vector3::new(sine_b, -sine_a * cosine_b, cosine_a * cosine_b);
    let twist = (n.x * n.y).angle_from_x(n.z * (one + n.z) + n.y * n.y);
    Pose {
        tip_mm: Vector3::new(
            joints[0] - pivot_length_mm * n.x,
            joints[1] - pivot_length_mm * n.y,
            joints[2] - pivot_length_mm * (n.z - one),
        ),
        tilt_rad: tilt_of_axis(&n),
        heading_rad: joints[5] - twist,
    }
}

#[cfg(test)]
mod tests {
    //! Goal: FK(IK(pose)) = pose over the whole tilt range, and the joints really make the pose's
    //! rotation matrix. Method: a spiral of poses; matrices built by nalgebra alone.
    use crate::configuration::Kinematics;
    use crate::kinematics::pose::Pose;
    use crate::kinematics::{Joints, KinematicsError, forward, inverse};
    use nalgebra::{Rotation3, Vector2, Vector3};

    const MACHINE: Kinematics = Kinematics::Gantry {
        pivot_length_mm: 62.5,
    };

    fn pose(theta_rad: f64, direction_rad: f64, heading_rad: f64) -> Pose<f64> {
        Pose {
            tip_mm: Vector3::new(120.0 * direction_rad.cos(), 200.0, theta_rad * 10.0),
            tilt_rad: theta_rad * Vector2::new(direction_rad.cos(), direction_rad.sin()),
            heading_rad,
        }
    }

    fn rotation_of_joints(joints: &Joints<f64>) -> Rotation3<f64> {
        let j = &joints.position;
        Rotation3::from_axis_angle(&Vector3::x_axis(), j[3])
            * Rotation3::from_axis_angle(&Vector3::y_axis(), j[4])
            * Rotation3::from_axis_angle(&Vector3::z_axis(), j[5])
    }

    #[test]
    fn joints_make_the_pose_and_come_back() {
        let mut solved = 0;
        for i in 0..20_000 {
            let fraction = f64::from(i) / 20_000.0;
            let pose = pose(
                2.6 * fraction,
                f64::from(i) * 2.399_963,
                40.0 * fraction - 15.0,
            );
            let Ok(joints) = inverse(&MACHINE, &pose) else {
                continue;
            };
            solved += 1;
            let difference = rotation_of_joints(&joints).matrix() - pose.rotation().matrix();
            assert!(difference.norm() < 1e-12, "pose {i}: {difference}");
            let pivot = pose.tip_mm + 62.5 * pose.tool_axis() - Vector3::new(0.0, 0.0, 62.5);
            let xyz = Vector3::new(joints.position[0], joints.position[1], joints.position[2]);
            assert!((pivot - xyz).norm() < 1e-12);
            let back = forward(&MACHINE, &joints.position);
            assert!((back.tip_mm - pose.tip_mm).norm() < 1e-11);
            assert!((back.tilt_rad - pose.tilt_rad).norm() < 1e-9);
            assert!((back.heading_rad - pose.heading_rad).abs() < 1e-9);
        }
        assert!(solved > 15_000, "only {solved} poses were solved");
    }

    #[test]
    fn joints_are_continuous_through_the_vertical() {
        let mut last: Option<Joints<f64>> = None;
        for i in -20_000..=20_000 {
            let theta = f64::from(i) * 5e-5;
            let joints = inverse(&MACHINE, &pose(theta, 0.7, 3.0)).unwrap();
            if let Some(last) = last {
                for joint in 0..6 {
                    let jump = (joints.position[joint] - last.position[joint]).abs();
                    // 5e-5 rad of tilt, times the pivot length for the linear joints, times two.
                    assert!(jump < 5e-5 * 125.0, "joint {joint} at {theta}: {jump}");
                }
            }
            last = Some(joints);
        }
    }

    #[test]
    fn singular_and_unreachable_poses_are_refused() {
        let at = |theta, direction| inverse(&MACHINE, &pose(theta, direction, 0.0));
        let quarter = core::f64::consts::FRAC_PI_2;
        assert_eq!(at(quarter, quarter), Err(KinematicsError::Singular));
        assert_eq!(at(2.7, 0.3), Err(KinematicsError::TiltOutOfReach));
        assert!(at(quarter, 0.0).is_ok());
    }

    #[test]
    fn single_precision_agrees_with_double() {
        let mut worst_um = 0.0f64;
        let mut worst_urad = 0.0f64;
        for i in 0..20_000 {
            let theta = 1.5 * f64::from(i) / 20_000.0;
            let exact_pose = pose(theta, f64::from(i) * 2.399_963, 0.0);
            let rounded = Pose {
                tip_mm: Vector3::zeros(),
                tilt_rad: exact_pose.tilt_rad.map(|v| v as f32),
                heading_rad: 0.0f32,
            };
            let exact_pose = Pose {
                tip_mm: Vector3::zeros(),
                tilt_rad: rounded.tilt_rad.map(f64::from),
                heading_rad: 0.0,
            };
            let (Ok(single), Ok(double)) =
                (inverse(&MACHINE, &rounded), inverse(&MACHINE, &exact_pose))
            else {
                continue;
            };
            for joint in 0..6 {
                let error = (f64::from(single.position[joint]) - double.position[joint]).abs();
                if joint < 3 {
                    worst_um = worst_um.max(error * 1e3);
                } else {
                    worst_urad = worst_urad.max(error * 1e6);
                }
            }
        }
        // 62.5 mm times a few units of the last place of the sine quotient and cosine; the angles
        // lose as much again as A and C approach B = 90°.
        assert!(worst_um > 1e-4 && worst_um < 0.03, "{worst_um} um");
        assert!(worst_urad > 1e-3 && worst_urad < 12.0, "{worst_urad} urad");
    }
}
