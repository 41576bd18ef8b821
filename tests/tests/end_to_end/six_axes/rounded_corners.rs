//! Goal: corners of a run of waypoints are rounded within the tolerances on real machines, and blunt ones are printed
//! faster for it. Method: a way with blunt and sharp corners whose tool axis has corners of its own, planned for the
//! example gantry and the tilting table and simulated. The recorded steps, made into tips and axes by the machines'
//! equations written out here, are held against the polyline that was given. Times are those of the same run
//! without a tolerance.

use headway::drive::dry_run::{DryRun, dry_run};
use headway::drive::simulator::SimulatorSetup;
use headway::geometry::aperture::Aperture;
use headway::input::ReadOptions;
use headway::input::waypoints::{WaypointRun, read};
use headway::job::MotionState;
use headway::settings::{Settings, machine_file};
use headway::{Plan, plan_waypoints};
use headway_firmware::configuration::Kinematics;
use headway_tests::limit_oracle;
use nalgebra::{Rotation3, Vector3};
use std::path::Path;

const CORNER_MM: f64 = 0.3;
/// Distance of waypoints.
const STEP_MM: f64 = 0.1;
/// Waypoints at either end that are not looked at: 3 mm.
const ENDS: usize = 30;

fn machine(name: &str, corner_mm: f64) -> Settings {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../examples/machines")
        .join(name);
    let mut settings = machine_file::from_toml(&std::fs::read_to_string(path).unwrap()).unwrap();
    settings.aperture = Aperture::Ellipse {
        major_mm: 0.4,
        minor_mm: 0.4,
    };
    settings.tolerances.corner_mm = corner_mm;
    settings
}

/// A waypoint: tip and tool axis.
type Place = (Vector3<f64>, Vector3<f64>);

/// Legs of 12 mm that turn by these angles, level; the axis leans along x by 15 degrees, and where it is to have
/// corners by another 12 in the middle 4 mm of each fourth leg, back on the next such.
fn way(turns_deg: &[f64], axis_turns: bool) -> Vec<Place> {
    let (mut tip, mut direction, mut lean_deg) = (Vector3::new(0.0, 0.0, 5.0), 0.0f64, 15.0f64);
    let axis = |lean_deg: f64| {
        let (sin, cos) = lean_deg.to_radians().sin_cos();
        Vector3::new(sin, 0.0, cos)
    };
    let mut places = vec![(tip, axis(lean_deg))];
    let mut rate = 12.0 / 4.0;
    for leg in 0..=turns_deg.len() {
        for step in 0..120 {
            tip += STEP_MM * Vector3::new(direction.cos(), direction.sin(), 0.0);
            if axis_turns && leg % 4 == 2 && (40..80).contains(&step) {
                lean_deg += rate * STEP_MM;
            }
            places.push((tip, axis(lean_deg)));
        }
        if leg % 4 == 2 {
            rate = -rate;
        }
        direction += turns_deg.get(leg).map_or(0.0, |turn| turn.to_radians());
    }
    places
}

fn run(places: &[Place]) -> WaypointRun {
    let line = |(tip, axis): &Place| {
        format!(
            "{:.7} {:.7} {:.7} {:.9} {:.9} {:.9}\n",
            tip.x, tip.y, tip.z, axis.x, axis.y, axis.z
        )
    };
    let text: String = places.iter().map(line).collect();
    read(text.as_bytes(), "way", &ReadOptions::default()).unwrap()
}

/// Tip in the part's coordinates and tool axis, from joints in mm and rad.
fn forward(kinematics: &Kinematics, joints: &[f64]) -> Place {
    let about = |axis: Vector3<f64>, angle: f64| Rotation3::new(axis * angle);
    let (x, z) = (Vector3::x(), Vector3::z());
    let slides = Vector3::new(joints[0], joints[1], joints[2]);
    match kinematics {
        Kinematics::Gantry { pivot_length_mm } => {
            let axis = about(x, joints[3]) * about(Vector3::y(), joints[4]) * z;
            (slides - *pivot_length_mm * (axis - z), axis)
        }
        Kinematics::Trunnion { centre_mm, .. } => {
            let centre = Vector3::from(*centre_mm);
            let to_part = (about(x, joints[3]) * about(z, joints[4])).inverse();
            (centre + to_part * (slides - centre), to_part * z)
        }
        _ => panic!("another machine"),
    }
}

/// Largest distance of the printed tips from the polyline, mm, and of their axes from its axes there, rad; and how
/// near the tips come to each waypoint at worst, mm.
fn off(places: &[Place], plan: &Plan, done: &DryRun, settings: &Settings) -> [f64; 3] {
    let machine = &settings.machine;
    let record = &done.simulation.motion;
    let print = plan.stream.marks.iter();
    let print: Vec<_> = print.filter(|m| m.state == MotionState::Print).collect();
    let per_servo = u64::from(machine.step_hz / machine.servo_hz);
    // Steps come up to 40 ms after their pose, which pressure advance and its window make: the first 60 ms may show
    // the way down, the last are not looked at, and neither are the waypoints that are passed there.
    let late = u64::from(machine.step_hz) * 6 / 100;
    let begin = (record.first_servo_tick + print[0].start_tick) * per_servo + late;
    let end = (record.first_servo_tick + print[print.len() - 1].end_tick) * per_servo;
    let offset = Vector3::from(plan.transform.offset_mm);
    let mut counts = record.start_counts;
    let (mut worst, mut nearest_mm) = ([0.0f64; 2], vec![f64::INFINITY; places.len()]);
    let (mut near, mut looked) = (0usize, begin);
    for step in record.steps.iter() {
        while looked < step.tick.min(end) {
            let per_unit = machine.joints.iter().map(|joint| joint.steps_per_unit);
            let joints = per_unit
                .zip(counts)
                .map(|(per_unit, count)| count as f64 / per_unit);
            let joints: Vec<f64> = joints.collect();
            let (tip, axis) = forward(&machine.kinematics, &joints);
            let tip = tip - offset;
            let window = near.saturating_sub(20)..(near + 20).min(places.len() - 1);
            let mut best = (f64::INFINITY, 0.0);
            for i in window {
                let [(from, from_axis), (to, to_axis)] = [places[i], places[i + 1]];
                let along: Vector3<f64> = to - from;
                let share = ((tip - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
                let away_mm = (tip - from - share * along).norm();
                if away_mm < best.0 {
                    near = i;
                    best = (away_mm, axis.angle(&from_axis.lerp(&to_axis, share)));
                }
                nearest_mm[i] = nearest_mm[i].min((tip - from).norm());
            }
            worst = [worst[0].max(best.0), worst[1].max(best.1)];
            looked += per_servo;
        }
        counts[usize::from(step.motor)] += if step.forward { 1 } else { -1 };
    }
    assert!(near + ENDS > places.len(), "followed to {near}");
    let passed = &nearest_mm[ENDS..places.len() - ENDS];
    [
        worst[0],
        worst[1],
        passed.iter().copied().fold(0.0, f64::max),
    ]
}

fn simulated(name: &str, places: &[Place], settings: &Settings) -> (Plan, DryRun) {
    let plan = plan_waypoints(&run(places), settings).unwrap_or_else(|e| panic!("{name}: {e}"));
    let mut settings = settings.clone();
    settings.machine = plan.stream.machine(&settings.machine);
    let done = dry_run(&plan.stream, &settings, &SimulatorSetup::default(), |_| {}).unwrap();
    let figures = &done.simulation.figures;
    let limits = limit_oracle::sample(&plan.stream, &settings);
    assert_eq!(figures.faults, 0, "{name}: {:?}", done.simulation.fault);
    assert!(limits.velocity.ratio <= 1.0, "{name}");
    assert!(limits.acceleration.ratio <= 1.0, "{name}");
    assert!(limits.jerk.ratio <= 1.02, "{name}");
    (plan, done)
}

#[test]
fn corners_of_path_and_axis_are_rounded_within_their_tolerances() {
    let places = way(&[40.0, -25.0, 60.0, -90.0, 150.0, -35.0, 75.0, -15.0], true);
    for name in ["gantry.toml", "trunnion.toml"] {
        let settings = machine(name, CORNER_MM);
        let (plan, done) = simulated(name, &places, &settings);
        let told = &plan.rounded;
        let [tip_mm, axis_rad, passed_mm] = off(&places, &plan, &done, &settings);
        let trace = &done.trace;
        println!(
            "{name}: {told:?}; tip {tip_mm:.4} mm, axis {:.3}°",
            axis_rad.to_degrees()
        );
        // All turns but the one of 150 degrees; four corners of the axis on two straight legs.
        assert_eq!((told.path, told.axis, told.rests), (7, 4, 1), "{name}");
        let half_mm = 1e-3 * (trace.half_step_um_max + 5.0);
        assert!(tip_mm <= CORNER_MM + half_mm, "{name}: {tip_mm}");
        // Waypoints are a tenth of a millimetre apart.
        assert!(
            passed_mm <= CORNER_MM + half_mm + STEP_MM,
            "{name}: {passed_mm}"
        );
        assert!(
            tip_mm > 0.5 * CORNER_MM,
            "{name}: nothing rounded, {tip_mm}"
        );
        let angle_rad = 1e-3 * (trace.half_step_mrad_max + 0.5);
        assert!(
            axis_rad <= settings.axis_tolerance_rad + angle_rad,
            "{name}: {axis_rad}"
        );
        assert!((told.path_off_mm - CORNER_MM).abs() < 1e-6, "{name}");
        assert!(
            told.axis_off_rad <= 0.5 * settings.axis_tolerance_rad + 1e-9,
            "{name}"
        );
        // Without a tolerance the same oracle finds the corners where they are.
        let plain = machine(name, 0.0);
        let (plan, done) = simulated(name, &places, &plain);
        assert_eq!(plan.rounded, Default::default(), "{name}");
        let [_, _, passed_mm] = off(&places, &plan, &done, &plain);
        assert!(passed_mm <= half_mm + STEP_MM, "{name}: {passed_mm}");
    }
}

#[test]
fn blunt_corners_are_printed_faster() {
    let places = way(&[BLUNT_DEG, -BLUNT_DEG].repeat(4), false);
    for (name, least) in [("gantry.toml", 0.95), ("trunnion.toml", 0.95)] {
        let seconds = [0.0, CORNER_MM].map(|corner_mm| {
            let settings = machine(name, corner_mm);
            let (_, done) = simulated(name, &places, &settings);
            done.simulation.figures.motion_s
        });
        println!("{name}: {seconds:.2?} s");
        assert!(seconds[1] < least * seconds[0], "{name}: {seconds:?}");
    }
}

/// Turns of the blunt corners.
const BLUNT_DEG: f64 = 35.0;
