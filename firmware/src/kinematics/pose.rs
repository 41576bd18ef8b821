//! The pose of the nozzle: tip position, tool axis and heading (six degrees of freedom, docs/design/pose-and-machines.md).
//!
//! The tool axis n is represented by the tilt vector tau = theta (-n_y, n_x) / sin(theta), theta =
//! acos(n_z): the rotation vector of the smallest rotation from Z to n. The orientation is R =
//! R_min(Z to n) R_z(heading).

use crate::numbers::real::Real;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS,
};
use nalgebra::{RealField, Rotation3, Vector2, Vector3};

/// Largest angle between tool axis and Z; beyond it the tilt vector is too close to the pole.
pub const TILT_MAX_RAD: f64 = 150.0 * core::f64::consts::PI / 180.0;
/// What the rounding of a file may add to it: a unit vector of four digits is off by up to 0.09 mrad.
pub const TILT_ROUNDING_RAD: f64 = 1e-4;
/// Largest tilt that has joints: the largest permitted one plus the errors of interpolation and of a fit within 0.1
/// mrad.
pub const TILT_REACH_RAD: f64 = TILT_MAX_RAD + 5.0 * TILT_ROUNDING_RAD;

/// Position and orientation of the nozzle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose<R: Real> {
    /// Nozzle tip, mm.
    pub tip_mm: Vector3<R>,
    /// Tilt vector tau (x, y), rad.
    pub tilt_rad: Vector2<R>,
    /// Heading about the tool axis, rad, unwrapped.
    pub heading_rad: R,
}

impl<R: Real> Pose<R> {
    /// Reads the pose channels (mm, mm, mm, rad, rad, rad, mm³); without the volume.
    pub fn from_channels(natural: &[R; CHANNELS]) -> Self {
        Self {
            tip_mm: Vector3::new(natural[CHANNEL_X], natural[CHANNEL_Y], natural[CHANNEL_Z]),
            tilt_rad: Vector2::new(natural[CHANNEL_TILT_X], natural[CHANNEL_TILT_Y]),
            heading_rad: natural[CHANNEL_HEADING],
        }
    }

    /// The tool axis n, from the tip into the head.
    pub fn tool_axis(&self) -> Vector3<R> {
        tool_axis(self.tilt_rad)
    }
}

impl<R: Real + RealField> Pose<R> {
    /// R = R_min R_z(heading): turns tool coordinates into machine coordinates.
    pub fn rotation(&self) -> Rotation3<R> {
        let zero = R::of(0.0);
        let tilt = Rotation3::new(Vector3::new(self.tilt_rad.x, self.tilt_rad.y, zero));
        tilt * Rotation3::from_axis_angle(&Vector3::z_axis(), self.heading_rad)
    }
}

/// Tool axis n of a tilt vector in rad: n = (tau_y sinc, -tau_x sinc, cos theta).
pub fn tool_axis<R: Real>(tilt_rad: Vector2<R>) -> Vector3<R> {
    let theta_squared = tilt_rad.x * tilt_rad.x + tilt_rad.y * tilt_rad.y;
    let (cosine, sinc) = theta_squared.cosine_and_sinc_of_square();
    Vector3::new(tilt_rad.y * sinc, -(tilt_rad.x * sinc), cosine)
}

/// Tilt vector of a unit tool axis; zero for Z itself and for the pole -Z, where it is undefined.
pub fn tilt_of_axis<R: Real>(axis: &Vector3<R>) -> Vector2<R> {
    let sine = (axis.x * axis.x + axis.y * axis.y).root();
    if sine <= R::of(1e-30) {
        return Vector2::new(R::of(0.0), R::of(0.0));
    }
    let quotient = sine.angle_from_x(axis.z) / sine;
    Vector2::new(-axis.y * quotient, axis.x * quotient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tool_axis_is_the_third_column_of_the_rotation() {
        for i in 0..1000 {
            let direction = f64::from(i) * 0.37;
            let theta = TILT_MAX_RAD * f64::from(i) / 1000.0;
            let pose = Pose {
                tip_mm: Vector3::zeros(),
                tilt_rad: Vector2::new(theta * direction.cos(), theta * direction.sin()),
                heading_rad: f64::from(i) * 0.1,
            };
            let column = pose.rotation() * Vector3::z();
            assert!((column - pose.tool_axis()).norm() < 1e-14);
            assert!((pose.tool_axis().norm() - 1.0).abs() < 1e-14);
            let back = tilt_of_axis(&pose.tool_axis());
            assert!((back - pose.tilt_rad).norm() < 1e-12, "{theta}");
        }
    }
}
