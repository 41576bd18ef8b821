//! The joint solution of a place as controllers name it.
//!
//! In: the arm and its joints as its controller counts them, rad. Out: ABB's quadrants and number of the solution (confdata,
//! Technical reference manual RAPID, 3HAC050917), KUKA's status and turn (S and T). Both ask three things: is the wrist's
//! centre behind axis 1, is it in front of the lower arm, is axis 5 negative.

use headway_firmware::configuration::{Arm, JOINTS_MAX};
use std::f64::consts::FRAC_PI_2;

/// Axes of an arm.
pub(super) const AXES: usize = 6;

/// Nearer to 0 an angle is 0, rad: a joint that stands at the border of two quadrants is not to flicker.
const ZERO_RAD: f64 = 2e-5;

fn is_negative(rad: f64) -> bool {
    rad < -ZERO_RAD
}

/// Angles of the model, rad: all upright at 0.
fn model(arm: &Arm, joints: &[f64; JOINTS_MAX]) -> [f64; AXES] {
    std::array::from_fn(|axis| {
        let joint = match arm.reversed >> axis & 1 {
            0 => joints[axis],
            _ => -joints[axis],
        };
        joint - arm.offset_rad[axis]
    })
}

/// Whether the wrist's centre is behind axis 1, and in front of the lower arm.
fn sides(arm: &Arm, joints: &[f64; JOINTS_MAX]) -> [bool; 2] {
    let [_, second, third, ..] = model(arm, joints);
    let forearm = second + third;
    let forward_mm = arm.a1_mm
        + arm.c2_mm * second.sin()
        + arm.a2_mm * forearm.cos()
        + arm.c3_mm * forearm.sin();
    let before_arm_mm = arm.a2_mm * third.cos() + arm.c3_mm * third.sin();
    [forward_mm < 0.0, before_arm_mm > 0.0]
}

/// cf1, cf4, cf6, cfx.
pub(super) fn quadrants(arm: &Arm, joints: &[f64; JOINTS_MAX]) -> [i32; 4] {
    let [behind, before_arm] = sides(arm, joints);
    let quadrant = |axis: usize| ((joints[axis] + ZERO_RAD) / FRAC_PI_2).floor() as i32;
    let wrist = i32::from(is_negative(joints[4]));
    let solution = 4 * i32::from(behind) + 2 * i32::from(!before_arm) + wrist;
    [quadrant(0), quadrant(3), quadrant(5), solution]
}

/// S and T.
pub(super) fn status_and_turn(arm: &Arm, joints: &[f64; JOINTS_MAX]) -> [u32; 2] {
    let [behind, before_arm] = sides(arm, joints);
    let sign = |axis: usize| u32::from(is_negative(joints[axis]));
    let status = u32::from(behind) | u32::from(before_arm) << 1 | sign(4) << 2;
    let turn = (0..AXES).map(|axis| sign(axis) << axis).sum();
    [status, turn]
}
