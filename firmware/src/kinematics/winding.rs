//! Unwraps angles found by an arctangent, so that joints are continuous.
//!
//! In: the current angle, within half a turn of 0 (or of a constant). Out: the number of turns to
//! add. Two samples must be less than half a turn apart, which at 2 kHz holds for every real
//! machine.

use super::winds;
use crate::configuration::{JOINTS_MAX, Kinematics};
use crate::numbers::real::Real;

/// Turns of each joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Winding<R> {
    last_rad: [R; JOINTS_MAX],
    turns: [i32; JOINTS_MAX],
}

impl<R: Real> Default for Winding<R> {
    fn default() -> Self {
        Self {
            last_rad: [R::of(0.0); JOINTS_MAX],
            turns: [0; JOINTS_MAX],
        }
    }
}

impl<R: Real> Winding<R> {
    /// Joints at rest: of the equal angles the one within its range (min, max) that is nearest to the
    /// range's middle, or to 0 where the joint has no stop.
    pub fn at_rest(
        kinematics: &Kinematics,
        joints: &[R; JOINTS_MAX],
        ranges: &[[f64; 2]; JOINTS_MAX],
    ) -> Self {
        let mut turns = [0; JOINTS_MAX];
        let winds = winds(kinematics);
        let parts = turns.iter_mut().zip(joints).zip(ranges);
        for (index, ((turns, angle), &[min, max])) in parts.enumerate() {
            let middle = if min.is_finite() && max.is_finite() {
                0.5 * (min + max)
            } else {
                0.0
            };
            if winds >> index & 1 != 0 {
                let away = (middle - angle.as_double()) / core::f64::consts::TAU;
                *turns = (if away < 0.0 { away - 0.5 } else { away + 0.5 }) as i32;
            }
        }
        Self {
            last_rad: *joints,
            turns,
        }
    }

    /// Turns to add to a joint that is now at `angle_rad`.
    #[inline(always)]
    pub fn follow(&mut self, joint: usize, angle_rad: R) -> i32 {
        let half = R::of(core::f64::consts::PI);
        let joint = joint % JOINTS_MAX;
        let step = angle_rad - self.last_rad[joint];
        if step > half {
            self.turns[joint] -= 1;
        } else if step < -half {
            self.turns[joint] += 1;
        }
        self.last_rad[joint] = angle_rad;
        self.turns[joint]
    }

    /// All current joints, with turns added; joints that do not wind are unchanged.
    pub fn unwound(&mut self, kinematics: &Kinematics, joints: &mut [R; JOINTS_MAX]) {
        let winds = winds(kinematics);
        for (index, joint) in joints.iter_mut().enumerate() {
            if winds >> index & 1 != 0 {
                let turns = self.follow(index, *joint);
                *joint += R::of_integer(turns) * R::of(core::f64::consts::TAU);
            }
        }
    }
}

impl Winding<f64> {
    /// The same in single precision, as the controller has it.
    pub fn single(&self) -> Winding<f32> {
        Winding {
            last_rad: self.last_rad.map(|angle| angle as f32),
            turns: self.turns,
        }
    }
}
