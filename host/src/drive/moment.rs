//! The motion at one moment of a finished stream, with its joints.
//!
//! In: a [`Span`] and a time in it (servo ticks), the machine's kinematics. Out: channels and joints with their first to
//! third time derivatives, natural units and seconds. Joints of machines that are not linear in the channels come from
//! central differences over `DIFFERENCE_S`, of inverse kinematics on the span's cubic.

use headway_firmware::configuration::{JOINTS_MAX, Kinematics};
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::kinematics::{inverse, winds};
use headway_firmware::path::spline::Span;
use headway_protocol::units::{CHANNEL_HEADING, CHANNELS};
use std::f64::consts::TAU;

/// Half width of the central differences: rounding gives 10⁻⁶ of an acceleration, truncation less.
const DIFFERENCE_S: f64 = 2e-4;

/// The motion at one moment, in natural units and seconds.
pub struct Moment {
    /// Channels.
    pub position: [f64; CHANNELS],
    /// Their rates.
    pub velocity: [f64; CHANNELS],
    /// Their second derivatives.
    pub acceleration: [f64; CHANNELS],
    /// Their third derivatives.
    pub jerk: [f64; CHANNELS],
}

impl Moment {
    /// At `local` servo ticks from the start of a span.
    pub fn of(span: &Span, local: f64, servo_hz: f64) -> Self {
        Moment {
            position: span.position(local),
            velocity: span.velocity(local, servo_hz),
            acceleration: span.acceleration(local, servo_hz),
            jerk: span.jerk(servo_hz),
        }
    }

    /// First to third time derivative of every joint. A pose without joints has none.
    pub fn joint_derivatives(&self, kinematics: &Kinematics) -> [[f64; JOINTS_MAX]; 3] {
        let mut derivatives = [[0.0; JOINTS_MAX]; 3];
        if matches!(kinematics, Kinematics::Planar) {
            // X Y Z C are channels themselves.
            for (joint, channel) in [0, 1, 2, CHANNEL_HEADING].into_iter().enumerate() {
                derivatives[0][joint] = self.velocity[channel];
                derivatives[1][joint] = self.acceleration[channel];
                derivatives[2][joint] = self.jerk[channel];
            }
            return derivatives;
        }
        let h = DIFFERENCE_S;
        let at = |time_s: f64| self.joints(kinematics, time_s);
        let (Some(a), Some(b), Some(c), Some(d), Some(e)) =
            (at(-2.0 * h), at(-h), at(0.0), at(h), at(2.0 * h))
        else {
            return derivatives;
        };
        for joint in 0..JOINTS_MAX {
            let winds = winds(kinematics) >> joint & 1 != 0;
            let [a, b, c, d, e] = [a, b, c, d, e].map(|joints| {
                // The turn that is nearest to the middle.
                let turns = ((c[joint] - joints[joint]) / TAU).round();
                joints[joint] + if winds { turns * TAU } else { 0.0 }
            });
            // Five-point stencils: fourth order in h for the first two.
            derivatives[0][joint] = (8.0 * (d - b) - (e - a)) / (12.0 * h);
            derivatives[1][joint] = (16.0 * (d + b) - (e + a) - 30.0 * c) / (12.0 * h * h);
            derivatives[2][joint] = (e - a - 2.0 * (d - b)) / (2.0 * h * h * h);
        }
        derivatives
    }

    /// Joints on the local Taylor polynomial, so that a knot is evaluated from one side.
    fn joints(&self, kinematics: &Kinematics, time_s: f64) -> Option<[f64; JOINTS_MAX]> {
        let channels = std::array::from_fn(|c| {
            self.position[c]
                + time_s
                    * (self.velocity[c]
                        + time_s * (self.acceleration[c] / 2.0 + time_s * self.jerk[c] / 6.0))
        });
        let joints = inverse(kinematics, &Pose::from_channels(&channels));
        joints.ok().map(|joints| joints.position)
    }
}

#[cfg(test)]
mod tests {
    //! Goal: joints that turn with the whole pose have the derivatives of their formula. Method: a tilt on a gantry.
    use super::*;
    use headway_firmware::kinematics::pose::tool_axis;
    use nalgebra::Vector2;

    #[test]
    fn gantry_joints_agree_with_the_motion_of_the_pivot() {
        // A tilt alone moves the pivot: its acceleration is L d²n/dt², from the axis itself.
        let kinematics = Kinematics::Gantry {
            pivot_length_mm: 80.0,
        };
        let moment = Moment {
            position: [100.0, 50.0, 10.0, 0.1, -0.2, 0.5, 0.0],
            velocity: [10.0, -5.0, 1.0, 0.7, 0.4, 3.0, 0.0],
            acceleration: [100.0, 50.0, -20.0, 8.0, -6.0, 40.0, 0.0],
            jerk: [0.0; CHANNELS],
        };
        let [velocity, acceleration, _] = moment.joint_derivatives(&kinematics);
        let axis = |t: f64| {
            tool_axis(Vector2::new(
                0.1 + t * (0.7 + 4.0 * t),
                -0.2 + t * (0.4 - 3.0 * t),
            ))
        };
        let h = 1e-4;
        let rate = (axis(h) - axis(-h)) / (2.0 * h);
        let bend = (axis(h) + axis(-h) - 2.0 * axis(0.0)) / (h * h);
        for joint in 0..3 {
            let expected = moment.velocity[joint] + 80.0 * rate[joint];
            assert!((velocity[joint] - expected).abs() < 1e-4 * expected.abs().max(1.0));
            let expected = moment.acceleration[joint] + 80.0 * bend[joint];
            assert!((acceleration[joint] - expected).abs() < 1e-4 * expected.abs().max(10.0));
        }
    }
}
