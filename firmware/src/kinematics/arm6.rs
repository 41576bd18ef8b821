//! `arm6`: six revolute joints, ortho-parallel base and spherical wrist; the nozzle at the flange, in
//! any tool frame, with or without a seventh joint that turns it.
//!
//! In: a pose (mm, rad). Out: joint angles, rad, each within half a turn of its offset
//! ([`super::winding`] counts the turns). The geometry is that of M. Brandstötter, A. Angerer and M.
//! Hofbaur, An Analytical Solution of the Inverse Kinematics Problem of Industrial Serial
//! Manipulators with an Ortho-parallel Basis and a Spherical Wrist (2014): a1, a2, b, c1..c4. Their
//! eight solutions are numbered by bits: 1 turns the shoulder round, 2 the elbow, 4 the wrist.
//! Arccosines are computed as angles of points, so that no digits are lost near stretched arms;
//! sines and cosines of joints 1 to 3 come from the points as well.

use super::KinematicsError;
use crate::configuration::{Arm, JOINTS_MAX};
use crate::kinematics::pose::{Pose, TILT_REACH_RAD, tilt_of_axis, tool_axis};
use crate::numbers::real::Real;
use headway_protocol::units::CHANNEL_HEADING;
use nalgebra::Vector3;

/// No joint follows a channel,
pub const JOINT_CHANNELS: [Option<usize>; 6] = [None; 6];
/// but for the nozzle's own.
pub const JOINT_CHANNELS_WITH_NOZZLE: [Option<usize>; 7] =
    [None, None, None, None, None, None, Some(CHANNEL_HEADING)];
/// Joints that count turns.
pub const WINDS: u8 = 0b11_1111;
/// Number of joint solutions of a pose.
pub const SOLUTIONS: u8 = 8;

/// Sine of the wrist's or elbow's angle below which the joints around it are not determined: 0.06°.
const SINE_MIN: f64 = 1e-3;

/// Three rows.
type Matrix<R> = [[R; 3]; 3];

/// The arm's numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm6<R> {
    a1: R,
    a2: R,
    b: R,
    c1: R,
    c2: R,
    c3: R,
    /// a2² + c3².
    forearm_square: R,
    offset_rad: [R; 6],
    reversed: u8,
    /// Machine to base axes, and the base's origin in them.
    to_base: Matrix<R>,
    base_mm: [R; 3],
    /// Tool to flange axes, and the tip from the wrist's centre in flange axes.
    to_flange: Matrix<R>,
    tip_mm: [R; 3],
    nozzle: bool,
    solution: u8,
}

fn times<R: Real>(m: &Matrix<R>, v: [R; 3]) -> [R; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn transposed<R: Copy>(m: &Matrix<R>) -> Matrix<R> {
    let [[a, b, c], [d, e, f], [g, h, i]] = *m;
    [[a, d, g], [b, e, h], [c, f, i]]
}

fn product<R: Real>(m: &Matrix<R>, other: &Matrix<R>) -> Matrix<R> {
    transposed(&transposed(other).map(|column| times(m, column)))
}

/// The smallest rotation that takes Z to n, by rows.
fn smallest_rotation<R: Real>(n: &Vector3<R>) -> Matrix<R> {
    let one = R::of(1.0);
    let (x, y) = (n.x / (one + n.z), n.y / (one + n.z));
    [
        [one - n.x * x, -(n.x * y), n.x],
        [-(n.x * y), one - n.y * y, n.y],
        [-n.x, -n.y, n.z],
    ]
}

impl<R: Real> Arm6<R> {
    /// Of the arm's parameters and one of its [`SOLUTIONS`].
    pub fn new(arm: &Arm, solution: u8) -> Self {
        let to_base = transposed(&arm.base.rotation).map(|row| row.map(R::of));
        let base_mm = times(&transposed(&arm.base.rotation), arm.base.origin_mm);
        let [x, y, z] = arm.tool.origin_mm;
        Self {
            a1: R::of(arm.a1_mm),
            a2: R::of(arm.a2_mm),
            b: R::of(arm.b_mm),
            c1: R::of(arm.c1_mm),
            c2: R::of(arm.c2_mm),
            c3: R::of(arm.c3_mm),
            forearm_square: R::of(arm.a2_mm * arm.a2_mm + arm.c3_mm * arm.c3_mm),
            offset_rad: arm.offset_rad.map(R::of),
            reversed: arm.reversed,
            to_base,
            base_mm: base_mm.map(R::of),
            to_flange: transposed(&arm.tool.rotation).map(|row| row.map(R::of)),
            tip_mm: [x, y, z + arm.c4_mm].map(R::of),
            nozzle: arm.nozzle,
            solution,
        }
    }

    /// The joints' angles, rad; for a nozzle joint 0, the difference to the heading.
    ///
    /// # Errors
    /// [`KinematicsError::TiltOutOfReach`] beyond 150°, [`KinematicsError::OutOfReach`] if the arm is
    /// too short or too long, [`KinematicsError::Singular`] if it is stretched or the wrist straight.
    #[inline(never)]
    pub fn remainder(&self, pose: &Pose<R>) -> Result<[R; JOINTS_MAX], KinematicsError> {
        let tilt = pose.tilt_rad;
        let in_reach = tilt.x * tilt.x + tilt.y * tilt.y <= R::of(TILT_REACH_RAD * TILT_REACH_RAD);
        if !in_reach {
            return Err(KinematicsError::TiltOutOfReach);
        }
        let mut tool = smallest_rotation(&tool_axis(tilt));
        if !self.nozzle {
            let (sine, cosine) = pose.heading_rad.sine_cosine();
            tool = tool.map(|[x, y, z]| [x * cosine + y * sine, y * cosine - x * sine, z]);
        }
        let flange = product(&product(&self.to_base, &tool), &self.to_flange);
        let tip = times(&self.to_base, [pose.tip_mm.x, pose.tip_mm.y, pose.tip_mm.z]);
        let lever = times(&flange, self.tip_mm);
        let wrist: [R; 3] = core::array::from_fn(|i| tip[i] - self.base_mm[i] - lever[i]);
        let angles = self.angles(wrist, &flange)?;
        let mut joints = [R::of(0.0); JOINTS_MAX];
        for (index, angle) in angles.into_iter().enumerate() {
            let angle = angle + self.offset_rad[index];
            joints[index] = if self.is_reversed(index) {
                -angle
            } else {
                angle
            };
        }
        Ok(joints)
    }

    fn is_reversed(&self, joint: usize) -> bool {
        self.reversed >> joint & 1 != 0
    }

    /// Angles of the model from the wrist's centre and the flange's axes, both in base axes.
    fn angles(&self, wrist: [R; 3], flange: &Matrix<R>) -> Result<[R; 6], KinematicsError> {
        let zero = R::of(0.0);
        let [x, y, z] = [wrist[0], wrist[1], wrist[2] - self.c1];
        let (b, c2) = (self.b, self.c2);
        let away = x * x + y * y;
        let radius_square = away - b * b;
        // Written so that a NaN is refused, like all comparisons here.
        let beside_the_column = radius_square > R::of(SINE_MIN) * away;
        if !beside_the_column {
            return Err(KinematicsError::Singular);
        }
        let mut radius = radius_square.root();
        if self.solution & 1 != 0 {
            radius = -radius;
        }
        let (s1, c1) = (y * radius - x * b, x * radius + y * b);
        let theta1 = s1.angle_from_x(c1);
        let (s1, c1) = (s1 / away, c1 / away);
        // The triangle of upper arm, forearm and the line to the wrist's centre.
        let u = radius - self.a1;
        let square = u * u + z * z;
        let at_shoulder = square + c2 * c2 - self.forearm_square;
        let at_elbow = square - c2 * c2 - self.forearm_square;
        let most = R::of(4.0) * square * c2 * c2;
        let height_square = most - at_shoulder * at_shoulder;
        if height_square <= zero {
            return Err(KinematicsError::OutOfReach);
        }
        let bent = height_square > R::of(SINE_MIN * SINE_MIN) * most;
        if !bent {
            return Err(KinematicsError::Singular);
        }
        let mut height = height_square.root();
        if self.solution & 2 != 0 {
            height = -height;
        }
        let (s2, c2_) = (u * at_shoulder - z * height, z * at_shoulder + u * height);
        let (s3, c3_) = (
            height * self.c3 - at_elbow * self.a2,
            at_elbow * self.c3 + height * self.a2,
        );
        // Both points are at the distance of these; their product turns by joints 2 and 3 together.
        let both = R::of(4.0) * square * c2 * c2 * self.forearm_square;
        let s23 = (s2 * c3_ + c2_ * s3) / both;
        let c23 = (c2_ * c3_ - s2 * s3) / both;
        let [theta4, theta5, theta6] = self.wrist([s1, c1], [s23, c23], flange)?;
        let (theta2, theta3) = (s2.angle_from_x(c2_), s3.angle_from_x(c3_));
        Ok([theta1, theta2, theta3, theta4, theta5, theta6])
    }

    /// Angles 4 to 6 that bring the flange to its axes.
    fn wrist(
        &self,
        [s1, c1]: [R; 2],
        [s23, c23]: [R; 2],
        flange: &Matrix<R>,
    ) -> Result<[R; 3], KinematicsError> {
        let along: [R; 3] = core::array::from_fn(|i| c1 * flange[0][i] + s1 * flange[1][i]);
        let across = c1 * flange[1][2] - s1 * flange[0][2];
        let forward = c23 * along[2] - s23 * flange[2][2];
        let up: [R; 3] = core::array::from_fn(|i| s23 * along[i] + c23 * flange[2][i]);
        let sine = (forward * forward + across * across).root();
        let bent = sine > R::of(SINE_MIN);
        if !bent {
            return Err(KinematicsError::Singular);
        }
        Ok(if self.solution & 4 != 0 {
            [
                (-across).angle_from_x(-forward),
                (-sine).angle_from_x(up[2]),
                (-up[1]).angle_from_x(up[0]),
            ]
        } else {
            [
                across.angle_from_x(forward),
                sine.angle_from_x(up[2]),
                up[1].angle_from_x(-up[0]),
            ]
        })
    }

    /// Pose of the joints; the heading is within half a turn, unless there is a nozzle joint.
    pub fn forward(&self, joints: &[R; JOINTS_MAX]) -> Pose<R> {
        let mut theta = [R::of(0.0); 6];
        for (index, angle) in theta.iter_mut().enumerate() {
            let joint = joints[index];
            let joint = if self.is_reversed(index) {
                -joint
            } else {
                joint
            };
            *angle = joint - self.offset_rad[index];
        }
        let zero = R::of(0.0);
        let one = R::of(1.0);
        let about_z = |angle: R| {
            let (s, c) = angle.sine_cosine();
            [[c, -s, zero], [s, c, zero], [zero, zero, one]]
        };
        let about_y = |angle: R| {
            let (s, c) = angle.sine_cosine();
            [[c, zero, s], [zero, one, zero], [-s, zero, c]]
        };
        let base = about_z(theta[0]);
        let forearm = about_y(theta[1] + theta[2]);
        let upper = times(&about_y(theta[1]), [zero, zero, self.c2]);
        let lower = times(&forearm, [self.a2, zero, self.c3]);
        let in_plane = [
            upper[0] + lower[0] + self.a1,
            self.b,
            upper[2] + lower[2] + self.c1,
        ];
        let wrist = times(&base, in_plane);
        let hand = product(
            &product(&about_z(theta[3]), &about_y(theta[4])),
            &about_z(theta[5]),
        );
        let flange = product(&product(&base, &forearm), &hand);
        let lever = times(&flange, self.tip_mm);
        let tip: [R; 3] = core::array::from_fn(|i| wrist[i] + self.base_mm[i] + lever[i]);
        let out = transposed(&self.to_base);
        let tip = times(&out, tip);
        let tool = product(&product(&out, &flange), &transposed(&self.to_flange));
        let axis = Vector3::new(tool[0][2], tool[1][2], tool[2][2]);
        let upright = transposed(&smallest_rotation(&axis));
        let long = times(&upright, [tool[0][0], tool[1][0], tool[2][0]]);
        let turned = long[1].angle_from_x(long[0]);
        Pose {
            tip_mm: Vector3::new(tip[0], tip[1], tip[2]),
            tilt_rad: tilt_of_axis(&axis),
            heading_rad: if self.nozzle {
                turned + joints[6]
            } else {
                turned
            },
        }
    }
}
