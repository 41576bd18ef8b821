//! Goal: six-joint arms without a joint for the nozzle lay outlines with their wrist within its range. Method: three arms by
//! their makers' lengths; the joints of the finished stream against their ranges, step by step; the simulated controller's
//! steps; the stops as headings against random poses of the box, one by one, and just beyond them.

use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::input::{self, Format, ReadOptions, Target};
use headway::joint_export::samples::joint_samples;
use headway::plan::motion::box_reach::box_reach;
use headway::plan_target;
use headway::settings::{Place, Settings, machine_file};
use headway_firmware::configuration::{JOINTS_MAX, Kinematics};
use headway_firmware::kinematics::inverse;
use headway_firmware::kinematics::pose::Pose;
use headway_protocol::units::CHANNELS;
use rand::{RngExt, SeedableRng};
use std::f64::consts::TAU;
use std::path::Path;

/// Number of the wrist.
const WRIST: usize = 5;

/// An example arm without a joint for its nozzle, its wrist between these degrees.
pub fn arm(name: &str, wrist_deg: f64) -> Settings {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../examples/machines/{name}"));
    let text = std::fs::read_to_string(path).unwrap();
    let nozzle = text.find("[joints.h]").unwrap();
    let extruder = text.find("[extruder]").unwrap();
    let mut settings =
        machine_file::from_toml(&(text[..nozzle].to_string() + &text[extruder..])).unwrap();
    let wrist = &mut settings.machine.joints[WRIST];
    (wrist.position_min, wrist.position_max) = (-wrist_deg.to_radians(), wrist_deg.to_radians());
    settings
}

/// ABB's IRB 4600-60/2.05 in front of the same bed.
fn third_arm() -> Settings {
    let mut settings = arm("arm-large.toml", 400.0);
    let Kinematics::Arm6 { arm, .. } = &mut settings.machine.kinematics else {
        panic!("an arm");
    };
    (arm.a1_mm, arm.a2_mm, arm.c1_mm) = (175.0, -175.0, 495.0);
    (arm.c2_mm, arm.c3_mm, arm.c4_mm) = (900.0, 960.0, 135.0);
    arm.base.origin_mm = [200.0, -900.0, -500.0];
    settings
}

pub fn target(name: &str) -> Target {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../examples/{name}"));
    let format = match name.ends_with(".json") {
        true => Format::Polygon,
        false => Format::GeoJson,
    };
    let bytes = std::fs::read(path).unwrap();
    let read = input::read(&bytes, name, format, &ReadOptions::default());
    read.unwrap().target
}

/// Plans an example and checks its joints; returns the number of its passes.
fn planned(name: &str, settings: &Settings) -> usize {
    let plan = plan_target(&target(name), settings).unwrap_or_else(|e| panic!("{name}: {e}"));
    let joints = &settings.machine.joints;
    let mut before: Option<[f64; JOINTS_MAX]> = None;
    for sample in joint_samples(&plan.stream, &settings.machine, 10.0) {
        let at = sample.unwrap().position;
        for (position, joint) in at.iter().zip(joints) {
            let range = joint.position_min - 1e-6..=joint.position_max + 1e-6;
            assert!(range.contains(position), "{name}: {at:?}");
        }
        if let Some(before) = before {
            let steps = before.iter().zip(&at).map(|(a, b)| (a - b).abs());
            assert!(steps.fold(0.0, f64::max) < 0.5, "{name}: {before:?} {at:?}");
        }
        before = Some(at);
    }
    let run = dry_run(&plan.stream, settings, &SimulatorSetup::default(), |_| {}).unwrap();
    let fault = &run.simulation.fault;
    assert_eq!(run.simulation.figures.faults, 0, "{name}: {fault:?}");
    let covered_pct = plan.figures.covered_pct;
    println!(
        "{name}: {} passes, {covered_pct:.2} %, {:.1} s",
        plan.figures.passes, plan.motion.duration_s
    );
    assert!(covered_pct > 97.5, "{name}: {covered_pct}");
    plan.figures.passes
}

#[test]
fn an_outline_is_laid_by_each_of_three_arms() {
    for settings in [
        arm("arm-large.toml", 400.0),
        arm("arm-small.toml", 350.0),
        third_arm(),
    ] {
        planned("taper.json", &settings);
    }
}

/// All seven on the three, by name: `cargo test -p headway-tests --test end_to_end seven_outlines -- --ignored --nocapture`.
#[test]
#[ignore = "21 plans: 3 minutes"]
fn seven_outlines_are_laid_by_three_arms() {
    for settings in [
        arm("arm-large.toml", 400.0),
        arm("arm-small.toml", 350.0),
        third_arm(),
    ] {
        for name in [
            "gear.json",
            "washers.geojson",
            "u-part.json",
            "bracket.json",
            "letter.json",
            "taper.json",
            "thin-web.json",
        ] {
            planned(name, &settings);
        }
    }
}

/// Goal: a wrist that turns little is turned back between passes. Method: one that turns by 280 degrees in all, on a part
/// whose walls meet at a small angle.
#[test]
fn passes_are_cut_where_the_wrist_has_to_turn_back() {
    let free = planned("taper.json", &arm("arm-large.toml", 400.0));
    let cut = planned("taper.json", &arm("arm-large.toml", 140.0));
    assert!(cut > free, "{cut} {free}");
}

/// Goal: within its stops every heading is one for the wrist, all over the box, and they are no narrower than they have to
/// be. Method: random places; the wrist's angle followed from the job's first pose on by small steps.
#[test]
fn the_stops_hold_all_over_the_box() {
    let settings = arm("arm-small.toml", 350.0);
    let start = [0.0, 0.0, 0.6, 0.0, 0.0, 0.0, 0.0];
    let box_mm = [[20.0, 10.0, 0.0], [130.0, 140.0, 60.0]];
    let reach = box_reach(box_mm, &start, &settings).unwrap();
    let [low, high] = reach.settings.wrist.expect("stops").headings_rad;
    let kinematics = reach.settings.machine.kinematics;
    let wrist_at = |pose: &[f64; CHANNELS]| {
        let joints = inverse(&kinematics, &Pose::from_channels(pose)).unwrap();
        joints.position[WRIST]
    };
    let joint = &settings.machine.joints[WRIST];
    let mut random = rand_pcg::Pcg64::seed_from_u64(3);
    let mut closest_rad = f64::INFINITY;
    for _ in 0..200 {
        let mut end = start;
        for axis in 0..3 {
            end[axis] = random.random_range(box_mm[0][axis]..box_mm[1][axis]);
        }
        end[5] = if random.random() { low } else { high };
        let mut wrist = wrist_at(&start);
        for step in 1..=400 {
            let share = f64::from(step) / 400.0;
            let pose = std::array::from_fn(|c| start[c] + share * (end[c] - start[c]));
            let own = wrist_at(&pose);
            wrist = own + TAU * ((wrist - own) / TAU).round();
        }
        let left = (wrist - joint.position_min).min(joint.position_max - wrist);
        assert!(left > -1e-3, "{end:?}: {wrist}");
        closest_rad = closest_rad.min(left);
    }
    assert!(closest_rad < 0.1, "{closest_rad}");
}

/// Goal: a place is found for an outline where the middle of the table is out of reach. Method: as for waypoints, a bed far
/// longer than the arm.
#[test]
fn an_outline_is_placed_where_the_arm_reaches() {
    let mut settings = arm("arm-small.toml", 350.0);
    settings.work_area_mm[1][1] = 700.0;
    let target = target("taper.json");
    let refused = plan_target(&target, &settings).unwrap_err().to_string();
    assert!(refused.contains("--place best"), "{refused}");
    settings.place = Place::Best;
    let found = plan_target(&target, &settings)
        .unwrap()
        .found_place
        .unwrap();
    assert!(
        found.reached > 0 && found.reached < found.tried,
        "{found:?}"
    );
    assert!(found.shift_mm[1] < -50.0, "{found:?}");
}
