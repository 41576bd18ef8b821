//! `trunnion`: X Y Z + a table that tilts (A, about X) and turns (C, about its own normal) + the
//! nozzle (H), which makes the rest of the heading.
//!
//! A point p of the part is at c + R_x(A) R_z(C) (p - c) in machine axes, c a point on both axes of the
//! table; R_x(A) R_z(C) n = Z. With the tilt vector tau that is -A about R_z(-C) x, so A = -|tau|, C =
//! atan2(-tau_y, tau_x) or A = |tau|, C = atan2(tau_y, -tau_x), and because R_min = R_z(-C) R_x(-A)
//! R_z(C), the heading in machine axes is H = heading + C: no more trigonometry. C is within a turn of 0
//! ([`super::winding`] counts the turns). With an upright tool C is free: it is 0 there.

use super::KinematicsError;
use crate::configuration::JOINTS_MAX;
use crate::kinematics::pose::{Pose, TILT_REACH_RAD};
use crate::numbers::real::Real;
use headway_protocol::units::CHANNEL_HEADING;
use nalgebra::{Vector2, Vector3};

/// H follows the heading; the others turn with the table.
pub const JOINT_CHANNELS: [Option<usize>; 6] =
    [None, None, None, None, None, Some(CHANNEL_HEADING)];

/// Joints that count turns: C and H.
pub const WINDS: u8 = 0b11_0000;

/// Below it a root has no relative accuracy (`numbers/real.rs`): a tool tilted by less than 1e-15 rad is upright.
const ROOT_MIN: f64 = 1e-30;

/// The table's numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trunnion<R> {
    centre_mm: [R; 3],
    /// A is not negative; otherwise not positive.
    tilts_forward: bool,
}

impl<R: Real> Trunnion<R> {
    /// Of a centre on both axes, mm; solution 0 tilts to negative A, 1 to positive A.
    pub fn new(centre_mm: &[f64; 3], solution: u8) -> Self {
        Self {
            centre_mm: centre_mm.map(R::of),
            tilts_forward: solution & 1 != 0,
        }
    }

    /// X Y Z A C and the contribution of C to H, mm and rad.
    ///
    /// # Errors
    /// [`KinematicsError::TiltOutOfReach`] beyond 150°.
    #[inline(never)]
    pub fn remainder(&self, pose: &Pose<R>) -> Result<[R; JOINTS_MAX], KinematicsError> {
        let tilt = pose.tilt_rad;
        let square = tilt.x * tilt.x + tilt.y * tilt.y;
        // The comparison is written so that a NaN is refused too.
        let in_reach = square <= R::of(TILT_REACH_RAD * TILT_REACH_RAD);
        if !in_reach {
            return Err(KinematicsError::TiltOutOfReach);
        }
        let theta = square.root();
        let (a, [x, y]) = if self.tilts_forward {
            (theta, [-tilt.x, tilt.y])
        } else {
            (-theta, [tilt.x, -tilt.y])
        };
        // The table's turn needs no trigonometry; an upright tool leaves it free.
        let (c, turn) = if square > R::of(ROOT_MIN) {
            (y.angle_from_x(x), (y / theta, x / theta))
        } else {
            (R::of(0.0), (R::of(0.0), R::of(1.0)))
        };
        let [x, y, z] = self.turned([pose.tip_mm.x, pose.tip_mm.y, pose.tip_mm.z], a, turn);
        Ok([x, y, z, a, c, c, R::of(0.0)])
    }

    /// A point of the part in machine axes, with the table at A, and at C by its sine and cosine.
    fn turned(&self, part_mm: [R; 3], a: R, (sine_c, cosine_c): (R, R)) -> [R; 3] {
        let [cx, cy, cz] = self.centre_mm;
        let (sine_a, cosine_a) = a.sine_cosine();
        let (x, y, z) = (part_mm[0] - cx, part_mm[1] - cy, part_mm[2] - cz);
        let across = sine_c * x + cosine_c * y;
        [
            cx + cosine_c * x - sine_c * y,
            cy + cosine_a * across - sine_a * z,
            cz + sine_a * across + cosine_a * z,
        ]
    }

    /// Pose of X Y Z A C H.
    pub fn forward(&self, joints: &[R; JOINTS_MAX]) -> Pose<R> {
        let [x, y, z, a, c, h, _] = *joints;
        let [cx, cy, cz] = self.centre_mm;
        let (sine_a, cosine_a) = a.sine_cosine();
        let (sine_c, cosine_c) = c.sine_cosine();
        let (x, y, z) = (x - cx, y - cy, z - cz);
        let across = cosine_a * y + sine_a * z;
        Pose {
            tip_mm: Vector3::new(
                cx + cosine_c * x + sine_c * across,
                cy - sine_c * x + cosine_c * across,
                cz - sine_a * y + cosine_a * z,
            ),
            tilt_rad: Vector2::new(-a * cosine_c, a * sine_c),
            heading_rad: h - c,
        }
    }
}

#[cfg(test)]
mod tests {
    //! Goal: FK(IK(pose)) = pose, and the joints really bring the tool axis up and the heading where
    //! it is to be. Method: poses all over; matrices built by nalgebra alone; f32 against f64.
    use crate::configuration::Kinematics;
    use crate::kinematics::pose::Pose;
    use crate::kinematics::{forward, inverse};
    use nalgebra::{Rotation3, Vector2, Vector3};

    const CENTRE_MM: [f64; 3] = [125.0, 110.0, -35.0];

    fn machine(solution: u8) -> Kinematics {
        Kinematics::Trunnion {
            centre_mm: CENTRE_MM,
            solution,
        }
    }

    fn pose(i: u32) -> Pose<f64> {
        let fraction = f64::from(i) / 20_000.0;
        let direction = f64::from(i) * 2.399_963;
        Pose {
            tip_mm: Vector3::new(
                125.0 + 90.0 * direction.cos(),
                300.0 * fraction,
                50.0 * fraction,
            ),
            tilt_rad: 2.6 * fraction * Vector2::new(direction.cos(), direction.sin()),
            heading_rad: 40.0 * fraction - 15.0,
        }
    }

    #[test]
    fn joints_make_the_pose_and_come_back() {
        for i in 1..20_000 {
            let machine = machine((i % 2) as u8);
            let pose = pose(i);
            let joints = inverse(&machine, &pose).unwrap().position;
            let table = Rotation3::from_axis_angle(&Vector3::x_axis(), joints[3])
                * Rotation3::from_axis_angle(&Vector3::z_axis(), joints[4]);
            let nozzle = Rotation3::from_axis_angle(&Vector3::z_axis(), joints[5]);
            let difference = (table * pose.rotation()).matrix() - nozzle.matrix();
            assert!(difference.norm() < 1e-12, "pose {i}: {difference}");
            let centre = Vector3::from(CENTRE_MM);
            let tip = centre + table * (pose.tip_mm - centre);
            assert!((tip - Vector3::new(joints[0], joints[1], joints[2])).norm() < 1e-11);
            assert_eq!(joints[3] > 0.0, i % 2 == 1, "pose {i}");
            let back = forward(&machine, &joints);
            assert!((back.tip_mm - pose.tip_mm).norm() < 1e-11, "pose {i}");
            assert!((back.tilt_rad - pose.tilt_rad).norm() < 1e-12, "pose {i}");
            assert!(
                (back.heading_rad - pose.heading_rad).abs() < 1e-12,
                "pose {i}"
            );
        }
    }

    #[test]
    fn single_precision_agrees_with_double() {
        let mut worst = [0.0f64; 6];
        for i in 1..20_000 {
            let exact = pose(i);
            let rounded = Pose {
                tip_mm: exact.tip_mm.map(|v| v as f32),
                tilt_rad: exact.tilt_rad.map(|v| v as f32),
                heading_rad: 0.0f32,
            };
            let exact = Pose {
                tip_mm: rounded.tip_mm.map(f64::from),
                tilt_rad: rounded.tilt_rad.map(f64::from),
                heading_rad: 0.0,
            };
            let single = inverse(&machine(0), &rounded).unwrap().position;
            let double = inverse(&machine(0), &exact).unwrap().position;
            for (worst, (single, double)) in worst.iter_mut().zip(single.iter().zip(double)) {
                *worst = worst.max((f64::from(*single) - double).abs());
            }
        }
        // 300 mm at 4e-7 rad of A and C each, and their own rounding.
        assert!(
            worst[..3].iter().all(|&mm| mm > 1e-6 && mm < 5e-4),
            "{worst:?}"
        );
        assert!(
            worst[3..].iter().all(|&rad| rad > 1e-8 && rad < 1e-6),
            "{worst:?}"
        );
    }
}
