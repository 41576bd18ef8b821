//! Goal: gantry and trunnion are members of the family, single precision is good enough for steps, joints do not
//! jump away from singular poses, and poses out of reach and impossible machines are refused. Method: the same
//! poses through both equations; f32 against f64; known machines. FK(IK) against plain matrices is in the
//! end-to-end tests.
use crate::configuration::axis_family::{AxisFamily, RotaryAxis};
use crate::configuration::{JOINTS_MAX, Kinematics};
use crate::kinematics::pose::Pose;
use crate::kinematics::{KinematicsError, Model, forward, inverse};
use crate::numbers::jet::Jet;
use nalgebra::{Vector2, Vector3};
use std::vec::Vec;

fn axis(on_table: bool, axis: [f64; 3], offset_mm: [f64; 3]) -> RotaryAxis {
    let length = axis.iter().map(|value| value * value).sum::<f64>().sqrt();
    RotaryAxis {
        on_table,
        axis: axis.map(|value| value / length),
        offset_mm,
    }
}

fn machine(
    first: RotaryAxis,
    second: Option<RotaryAxis>,
    tilt_rad: f64,
    solution: u8,
) -> Kinematics {
    let axes = AxisFamily {
        first,
        second,
        tool_axis: AxisFamily::leaning(tilt_rad),
        polar: false,
    };
    Kinematics::Axes { axes, solution }
}

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

fn pose(i: u32, tilt_max: f64) -> Pose<f64> {
    let fraction = f64::from(i) / 20_000.0;
    let direction = f64::from(i) * 2.399_963;
    Pose {
        tip_mm: Vector3::new(
            125.0 + 90.0 * direction.cos(),
            300.0 * fraction,
            50.0 * fraction,
        ),
        tilt_rad: tilt_max * fraction * Vector2::new(direction.cos(), direction.sin()),
        heading_rad: 40.0 * fraction - 15.0,
    }
}

fn turned_apart(a: f64, b: f64) -> f64 {
    let turns = (a - b) / core::f64::consts::TAU;
    (turns - turns.round()).abs() * core::f64::consts::TAU
}

fn assert_same(of: &Kinematics, member: &Kinematics, pose: &Pose<f64>, i: u32) {
    let (of, member) = (inverse(of, pose).unwrap(), inverse(member, pose).unwrap());
    assert_eq!(of.count, member.count);
    for (joint, (a, b)) in of.as_slice().iter().zip(member.as_slice()).enumerate() {
        let off = if joint < 3 {
            (a - b).abs()
        } else {
            turned_apart(*a, *b)
        };
        assert!(off < 1e-9, "pose {i}, joint {joint}: {a} {b}");
    }
}

#[test]
fn gantry_and_trunnion_are_members() {
    let pivot_length_mm = 62.5;
    let gantry = Kinematics::Gantry { pivot_length_mm };
    let pivot = [0.0, 0.0, pivot_length_mm];
    let head = machine(axis(false, X, pivot), Some(axis(false, Y, pivot)), 0.0, 0);
    let centre_mm = [125.0, 110.0, -35.0];
    for i in 1..20_000 {
        assert_same(&gantry, &head, &pose(i, 1.5), i);
        for solution in 0..2 {
            let trunnion = Kinematics::Trunnion {
                centre_mm,
                solution,
            };
            let (a, c) = (axis(true, X, centre_mm), axis(true, Z, centre_mm));
            let table = machine(a, Some(c), 0.0, solution);
            assert_same(&trunnion, &table, &pose(i, 2.6), i);
        }
    }
}

/// Members that differ in all there is: sides, order, slanted axes, a nozzle that leans.
fn members() -> Vec<(&'static str, Kinematics, f64)> {
    let o = [3.0, -7.0, 55.0];
    let c = [120.0, 130.0, -20.0];
    let slanted = [0.0, 1.0, 1.0];
    std::vec![
        (
            "head C B",
            machine(
                axis(false, Z, o),
                Some(axis(false, Y, [2.0, 0.0, 60.0])),
                0.0,
                0
            ),
            1.5
        ),
        (
            "table B C",
            machine(
                axis(true, Y, c),
                Some(axis(true, Z, [118.0, 131.0, 0.0])),
                0.0,
                1
            ),
            2.0
        ),
        (
            "head C, slanted B",
            machine(axis(false, Z, o), Some(axis(false, slanted, o)), 0.0, 0),
            1.5
        ),
        (
            "table C, head B",
            machine(axis(true, Z, c), Some(axis(false, Y, o)), 0.0, 1),
            1.5
        ),
    ]
}

#[test]
fn single_precision_agrees_with_double() {
    for (name, machine, tilt_max) in members() {
        let (mut worst_mm, mut worst_rad) = (0.0f64, 0.0f64);
        for i in 1..20_000 {
            let exact = pose(i, tilt_max);
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
            let single = inverse(&machine, &rounded).unwrap().position;
            // What the joints that single precision finds really do.
            let made = forward(&machine, &single.map(f64::from));
            worst_mm = worst_mm.max((made.tip_mm - exact.tip_mm).norm());
            worst_rad = worst_rad.max((made.tool_axis() - exact.tool_axis()).norm());
            worst_rad = worst_rad.max(turned_apart(made.heading_rad, exact.heading_rad));
        }
        std::println!("{name}: {worst_mm:.6} mm, {worst_rad:e} rad");
        // 300 mm at 1e-6 rad of two axes each, and their own rounding; as the trunnion's.
        assert!(worst_mm > 1e-6 && worst_mm < 1e-3, "{name}: {worst_mm}");
        assert!(worst_rad > 1e-8 && worst_rad < 1e-5, "{name}: {worst_rad}");
    }
}

#[test]
fn derivatives_are_those_of_the_joints() {
    for (name, machine, tilt_max) in members() {
        let model: Model<Jet<f64, 3>> = Model::new(&machine);
        for i in (500..20_000).step_by(777) {
            let here = pose(i, tilt_max);
            let at = |t: f64| {
                let mut pose = here;
                pose.tip_mm += Vector3::new(30.0, -20.0, 5.0) * t;
                pose.tilt_rad += Vector2::new(0.3, -0.2) * t;
                pose
            };
            let jet = |value: f64, rate: f64| Jet([value, rate, 0.0]);
            let moving = Pose {
                tip_mm: Vector3::new(
                    jet(here.tip_mm.x, 30.0),
                    jet(here.tip_mm.y, -20.0),
                    jet(here.tip_mm.z, 5.0),
                ),
                tilt_rad: Vector2::new(jet(here.tilt_rad.x, 0.3), jet(here.tilt_rad.y, -0.2)),
                heading_rad: jet(here.heading_rad, 0.0),
            };
            let found = model.remainder(&moving).unwrap();
            let plain: Model<f64> = Model::new(&machine);
            let h = 1e-5;
            let (low, high) = (
                plain.remainder(&at(-h)).unwrap(),
                plain.remainder(&at(h)).unwrap(),
            );
            for joint in 0..JOINTS_MAX {
                let mut way = high[joint] - low[joint];
                if joint >= 3 {
                    way -= core::f64::consts::TAU * (way / core::f64::consts::TAU).round();
                }
                let rate = way / (2.0 * h);
                let off = (found[joint].0[1] - rate).abs();
                assert!(
                    off < 1e-4 * (1.0 + rate.abs()),
                    "{name} {i} joint {joint}: {off}"
                );
            }
        }
    }
}

#[test]
fn what_axes_do_not_reach_is_refused() {
    let at = |x: f64, y: f64| Pose {
        tip_mm: Vector3::zeros(),
        tilt_rad: Vector2::new(x, y),
        heading_rad: 0.0,
    };
    let lean = 45f64.to_radians();
    let cone = machine(axis(false, Z, [0.0, 0.0, 80.0]), None, lean, 0);
    assert!(inverse(&cone, &at(0.0, lean)).is_ok() && inverse(&cone, &at(-lean, 0.0003)).is_ok());
    assert_eq!(
        inverse(&cone, &at(0.0, 0.0)),
        Err(KinematicsError::TiltOutOfReach)
    );
    // A slanted second axis reaches to twice its slant.
    let slanted = axis(false, [0.0, 1.0, 1.0], [0.0; 3]);
    let nutating = machine(axis(false, Z, [0.0; 3]), Some(slanted), 0.0, 0);
    assert!(inverse(&nutating, &at(1.5, 0.0)).is_ok());
    assert_eq!(
        inverse(&nutating, &at(1.7, 0.0)),
        Err(KinematicsError::TiltOutOfReach)
    );
    let upright = inverse(&nutating, &at(0.0, 0.0)).unwrap();
    assert!(
        upright.position[3..6]
            .iter()
            .all(|angle| angle.abs() < 1e-9),
        "{upright:?}"
    );
    let gantry = machine(
        axis(false, X, [0.0; 3]),
        Some(axis(false, Y, [0.0; 3])),
        0.0,
        0,
    );
    assert_eq!(
        inverse(&gantry, &at(0.0, 1.57)),
        Err(KinematicsError::Singular)
    );
}

#[test]
fn a_polar_table_turns_the_tip_under_the_axis() {
    let centre = [100.0, 50.0, 0.0];
    for solution in 0..2 {
        let axes = AxisFamily {
            first: axis(true, Z, centre),
            second: None,
            tool_axis: Z,
            polar: true,
        };
        let machine = Kinematics::Axes { axes, solution };
        let mut pose = pose(777, 0.0);
        pose.tip_mm.x += 3.0;
        let joints = inverse(&machine, &pose).unwrap();
        assert_eq!(joints.count, 4);
        assert_eq!(joints.position[0] > centre[0], solution == 0);
        let back = forward(&machine, &joints.position);
        assert!((back.tip_mm - pose.tip_mm).norm() < 1e-11);
        assert!((back.heading_rad - pose.heading_rad).abs() < 1e-12);
        pose.tip_mm = Vector3::from(centre);
        assert_eq!(inverse(&machine, &pose), Err(KinematicsError::Singular));
        let tilted = Pose {
            tilt_rad: Vector2::new(0.1, 0.0),
            ..pose
        };
        assert_eq!(
            inverse(&machine, &tilted),
            Err(KinematicsError::TiltOutOfReach)
        );
    }
}

#[test]
fn axes_that_move_nothing_are_refused() {
    let mut configuration = crate::board::built_in::emulated_planar();
    let linear = configuration.joints[0];
    let turn = configuration.joints[3];
    configuration.joints = [linear, linear, linear, turn, turn, turn]
        .into_iter()
        .collect();
    let mut is_right = |first: RotaryAxis, second: RotaryAxis, tilt_rad: f64| {
        configuration.kinematics = machine(first, Some(second), tilt_rad, 0);
        configuration.check().is_ok()
    };
    let o = [0.0; 3];
    assert!(is_right(axis(false, X, o), axis(false, Y, o), 0.0));
    assert!(
        !is_right(axis(false, X, o), axis(false, Z, o), 0.0),
        "the second is the nozzle's own"
    );
    assert!(
        is_right(axis(false, X, o), axis(false, Z, o), 0.5),
        "a nozzle that leans"
    );
    assert!(
        !is_right(axis(true, Z, o), axis(true, X, o), 0.0),
        "C below A does nothing"
    );
    assert!(
        !is_right(axis(true, X, o), axis(true, X, o), 0.0),
        "parallel"
    );
    let mut short = axis(true, X, o);
    short.axis[0] = 0.9;
    assert!(!is_right(short, axis(true, Z, o), 0.0), "no unit vector");
}
