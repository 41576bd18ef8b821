//! Goal: the arm's inverse kinematics finds every joint solution and none that is none. Method: the
//! published cases of an independent implementation in ../shared/data/arm (left out where they are
//! missing), random poses of both example arms through forward and inverse, and single precision against
//! double.

use headway::settings::machine_file;
use headway_firmware::configuration::{Arm, Frame, JOINTS_MAX, Kinematics};
use headway_firmware::kinematics::pose::{Pose, tilt_of_axis};
use headway_firmware::kinematics::{KinematicsError, forward, inverse};
use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;

const IRB: Arm = Arm {
    a1_mm: 100.0,
    a2_mm: -135.0,
    b_mm: 0.0,
    c1_mm: 615.0,
    c2_mm: 705.0,
    c3_mm: 755.0,
    c4_mm: 85.0,
    offset_rad: [0.0, 0.0, -FRAC_PI_2, 0.0, 0.0, 0.0],
    reversed: 0,
    base: Frame::IDENTITY,
    tool: Frame::IDENTITY,
    nozzle: false,
};
const KUKA: Arm = Arm {
    a1_mm: 25.0,
    a2_mm: -35.0,
    c1_mm: 400.0,
    c2_mm: 315.0,
    c3_mm: 365.0,
    c4_mm: 80.0,
    offset_rad: [0.0, -FRAC_PI_2, 0.0, 0.0, 0.0, 0.0],
    reversed: 0b10_1001,
    ..IRB
};

/// Numbers in the brackets after `key` in a line, bracket by bracket.
fn numbers(line: &str, key: &str) -> Vec<f64> {
    let Some(at) = line.find(key) else {
        return Vec::new();
    };
    let list = &line[at + key.len()..];
    let end = list.find(']').unwrap_or(list.len());
    let cells = list[..end].split(|c: char| !(c.is_ascii_digit() || "+-.eE".contains(c)));
    cells.filter_map(|cell| cell.parse().ok()).collect()
}

fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}

fn apart(one: &[f64], other: &[f64]) -> f64 {
    let pairs = one.iter().zip(other).take(6);
    pairs.map(|(a, b)| wrapped(a - b).abs()).fold(0.0, f64::max)
}

/// The pose of a flange whose Z is the tool axis.
fn flange_pose(tip_mm: Vector3<f64>, rotation: &Rotation3<f64>) -> Pose<f64> {
    let tilt_rad = tilt_of_axis(&(rotation * Vector3::z()));
    let upright = Rotation3::new(Vector3::new(tilt_rad.x, tilt_rad.y, 0.0)).inverse();
    let long = upright * (rotation * Vector3::x());
    Pose {
        tip_mm,
        tilt_rad,
        heading_rad: long.y.atan2(long.x),
    }
}

fn solutions(arm: Arm, pose: &Pose<f64>) -> Vec<[f64; JOINTS_MAX]> {
    let found = (0..8).filter_map(|solution| {
        let joints = inverse(&Kinematics::Arm6 { arm, solution }, pose);
        joints.ok().map(|joints| joints.position)
    });
    found.collect()
}

#[test]
fn published_solutions_are_found_and_no_others() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/arm/opw_cases.yaml");
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("left out: {} is missing", path.display());
        return;
    };
    let (mut arm, mut pose, mut looked, mut listed_in_all) = (IRB, None, 0, 0);
    let mut refused = [0; 3];
    for line in text.lines() {
        if line.contains("parameters:") {
            arm = if line.contains("Irb2400") { IRB } else { KUKA };
        }
        if line.contains("pose:") {
            let tip = numbers(line, "translation: [");
            let q = numbers(line, "quaternion: [");
            let quaternion = UnitQuaternion::new_normalize(Quaternion::new(q[3], q[0], q[1], q[2]));
            let tip_mm = 1e3 * Vector3::new(tip[0], tip[1], tip[2]);
            pose = Some((tip_mm, quaternion.to_rotation_matrix()));
        }
        if !line.contains("solutions:") {
            continue;
        }
        let (tip_mm, rotation) = pose.take().unwrap();
        let tilt_rad = rotation.matrix()[(2, 2)].clamp(-1.0, 1.0).acos();
        if tilt_rad > 150f64.to_radians() {
            // Beyond what poses are for; the tool frame of a printing arm points the other way.
            refused[0] += 1;
            continue;
        }
        let pose = flange_pose(tip_mm, &rotation);
        let list = line.split_once("solutions: [").unwrap().1;
        let listed: Vec<[f64; 6]> = list
            .split('[')
            .map(|part| numbers(&format!("[{part}"), "["))
            .filter(|numbers| numbers.len() == 6)
            .map(|degrees| std::array::from_fn(|joint| degrees[joint].to_radians()))
            .collect();
        let found = solutions(arm, &pose);
        looked += 1;
        for joints in &listed {
            // Only what forward kinematics confirms counts; the file has six digits of a degree.
            let mut all = [0.0; JOINTS_MAX];
            all[..6].copy_from_slice(joints);
            let back = forward(&Kinematics::Arm6 { arm, solution: 0 }, &all);
            let confirmed = (back.tip_mm - pose.tip_mm).norm() < 1e-3
                && (back.tool_axis() - pose.tool_axis()).norm() < 1e-6
                && wrapped(back.heading_rad - pose.heading_rad).abs() < 1e-5;
            let straight = joints[4].sin().abs() < 1e-3;
            if !confirmed || straight {
                refused[1] += 1;
                continue;
            }
            let nearest = found.iter().map(|found| apart(found, joints));
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            assert!(
                nearest < 1e-6,
                "{line}: {joints:?} is {nearest} rad off {found:?}"
            );
            listed_in_all += 1;
        }
        for joints in &found {
            let back = forward(&Kinematics::Arm6 { arm, solution: 0 }, joints);
            assert!((back.tip_mm - pose.tip_mm).norm() < 1e-9, "{line}");
            assert!(
                (back.tool_axis() - pose.tool_axis()).norm() < 1e-11,
                "{line}"
            );
            let nearest = listed.iter().map(|listed| apart(joints, listed));
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            if nearest > 1e-6 {
                refused[2] += 1;
            }
        }
    }
    println!(
        "{looked} poses, {listed_in_all} solutions; {} poses tilted beyond 150°, {} listed that are \
         singular or unconfirmed, {} found that are not listed",
        refused[0], refused[1], refused[2]
    );
    assert!(
        looked > 400 && listed_in_all > 2500,
        "{looked} {listed_in_all}"
    );
    assert_eq!(
        refused[2], 0,
        "right by forward kinematics, but not in the list"
    );
}

/// Goal: FK(IK(pose)) = pose over all that both arms reach, in every solution, and single precision is
/// good to 5 um at 1 m. Method: poses of random joints; a million of each arm by name.
#[test]
fn random_poses_come_back_in_every_solution() {
    for name in ["arm-small.toml", "arm-large.toml"] {
        random_poses(name, 20_000);
    }
}

#[test]
#[ignore = "a minute; run by name"]
fn a_million_random_poses_come_back_in_every_solution() {
    for name in ["arm-small.toml", "arm-large.toml"] {
        random_poses(name, 1_000_000);
    }
    table_and_gantry_poses(1_000_000);
}

#[test]
fn random_poses_of_table_and_gantry_come_back() {
    table_and_gantry_poses(20_000);
}

/// The example as it is, but for a nozzle joint: without one the flange turns the heading.
fn example(name: &str) -> Kinematics {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/machines");
    let text = std::fs::read_to_string(examples.join(name)).unwrap();
    machine_file::from_toml(&text).unwrap().machine.kinematics
}

/// Random poses of table, gantry and upright head, all that they can take.
fn table_and_gantry_poses(count: usize) {
    // A gantry's head has no place of its own at 90 degrees.
    for (name, tilt_max_rad) in [
        ("trunnion.toml", 2.6),
        ("gantry.toml", 1.5),
        ("planar.toml", 0.0),
    ] {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(28);
        let machine = example(name);
        let mut worst_um = 0.0f64;
        for index in 0..count {
            let machine = machine.with_solution((index % 2) as u8 % machine.solutions());
            let (tilt, turn) = (
                random.random_range(0.0..=tilt_max_rad),
                random.random_range(-PI..PI),
            );
            let meant = Pose {
                tip_mm: Vector3::from_fn(|_, _| random.random_range(-300.0..300.0)),
                tilt_rad: tilt * Vector2::new(turn.cos(), turn.sin()),
                heading_rad: random.random_range(-40.0..40.0),
            };
            let joints = inverse(&machine, &meant).unwrap().position;
            let back = forward(&machine, &joints);
            assert!(
                (back.tip_mm - meant.tip_mm).norm() < 1e-9,
                "{name} {meant:?}"
            );
            assert!(
                (back.tilt_rad - meant.tilt_rad).norm() < 1e-9,
                "{name} {meant:?}"
            );
            assert!(
                (back.heading_rad - meant.heading_rad).abs() < 1e-9,
                "{name} {meant:?}"
            );
            let rounded = Pose {
                tip_mm: meant.tip_mm.map(|v| v as f32),
                tilt_rad: meant.tilt_rad.map(|v| v as f32),
                heading_rad: meant.heading_rad as f32,
            };
            let close = inverse(&machine, &rounded).unwrap().position;
            let back = forward(&machine, &close.map(f64::from));
            let error_mm = (back.tip_mm - rounded.tip_mm.map(f64::from)).norm();
            worst_um = worst_um.max(1e3 * error_mm);
        }
        println!("{name}: {count} poses, f32 off by {worst_um:.2} um within 520 mm");
        assert!(worst_um < 5.0, "{name}: {worst_um}");
    }
}

fn random_poses(name: &str, count: usize) {
    let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(27);
    let Kinematics::Arm6 { arm, .. } = example(name) else {
        panic!("{name} is no arm");
    };
    let arm = Arm {
        nozzle: false,
        ..arm
    };
    let (mut came_back, mut single, mut worst_um) = (0, 0, 0.0f64);
    for _ in 0..count {
        let mut joints = [0.0; JOINTS_MAX];
        joints[..6].fill_with(|| random.random_range(-PI..PI));
        let meant = forward(&Kinematics::Arm6 { arm, solution: 0 }, &joints);
        let mut found_again = false;
        for solution in 0..8 {
            let machine = Kinematics::Arm6 { arm, solution };
            let Ok(found) = inverse(&machine, &meant) else {
                continue;
            };
            let back = forward(&machine, &found.position);
            assert!(
                (back.tip_mm - meant.tip_mm).norm() < 1e-6,
                "{joints:?} {solution}"
            );
            assert!((back.tool_axis() - meant.tool_axis()).norm() < 1e-9);
            assert!(wrapped(back.heading_rad - meant.heading_rad).abs() < 1e-8);
            found_again |= apart(&found.position, &joints) < 1e-6;
            came_back += 1;
            let rounded = Pose {
                tip_mm: meant.tip_mm.map(|v| v as f32),
                tilt_rad: meant.tilt_rad.map(|v| v as f32),
                heading_rad: meant.heading_rad as f32,
            };
            // Away from what is singular: there angles are not worth much in single precision.
            let clear = found.position[4].sin().abs() > 0.1;
            if let (Ok(close), true) = (inverse(&machine, &rounded), clear) {
                let back = forward(&machine, &close.position.map(f64::from));
                let meant_mm = rounded.tip_mm.map(f64::from);
                let error_um = 1e3 * (back.tip_mm - meant_mm).norm();
                worst_um = worst_um.max(error_um / meant_mm.norm().max(1000.0) * 1000.0);
                single += 1;
            }
        }
        let refused = (0..8).any(|solution| {
            let found = inverse(&Kinematics::Arm6 { arm, solution }, &meant);
            use KinematicsError::{Singular, TiltOutOfReach};
            matches!(found, Err(Singular | TiltOutOfReach))
        });
        assert!(found_again || refused, "{joints:?}");
    }
    println!(
        "{name}: {came_back} solutions, f32 off by {worst_um:.2} um at 1 m, {single} looked at"
    );
    assert!(came_back > 2 * count, "{came_back}");
    assert!(worst_um < 5.0, "{worst_um}");
}
