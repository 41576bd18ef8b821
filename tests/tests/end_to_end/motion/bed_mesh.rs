//! Goal: over a warped bed the first layers are as thick as planned, above the blend the part is planar, and
//! nothing but Z has changed. Method: a bed by formula, its grid as a probe would find it; a part of 20 layers
//! planned flat, lifted by the mesh, streamed to the firmware library; the recorded steps turned back into the
//! nozzle's place by forward kinematics, and its distance to the formula's bed taken.

use headway::bed_mesh::{BedMesh, over_bed};
use headway::drive::dry_run::{DryRun, dry_run};
use headway::drive::simulator::SimulatorSetup;
use headway::input::{Format, ReadOptions, read};
use headway::job::{MotionState, SegmentStream};
use headway::plan_target;
use headway::settings::Settings;
use headway_firmware::configuration::JOINTS_MAX;
use headway_firmware::kinematics::forward;
use headway_tests::limit_oracle;
use std::path::Path;

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/u-part.json");
/// Servo ticks at the ends of a move that are left out: what the motors wait, and more.
const EDGE_TICKS: u64 = 200;
const LAYERS: u32 = 20;
const FADE_MM: [f64; 2] = [0.5, 3.1];

/// Warped by a quarter of a millimetre, and 0.08 mm too high.
fn bed(x_mm: f64, y_mm: f64) -> f64 {
    0.08 + 0.07 * (x_mm / 5.5).sin() * (y_mm / 7.0).cos() + 0.0005 * (x_mm - y_mm)
}

fn probed(settings: &Settings) -> BedMesh {
    let (min_mm, max_mm) = ([85.0, 85.0], [165.0, 165.0]);
    let at = |number: usize| 85.0 + 2.0 * number as f64;
    let row = |row: usize| (0..41).map(|column| bed(at(column), at(row))).collect();
    BedMesh {
        machine_hash: settings.machine.hash(),
        min_mm,
        max_mm,
        heights_mm: (0..41).map(row).collect(),
        fade_start_mm: FADE_MM[0],
        fade_height_mm: FADE_MM[1],
    }
}

/// Each servo tick inside a printing move: its layer, and where the nozzle was, mm, by the steps made.
fn printed(run: &DryRun, stream: &SegmentStream, settings: &Settings) -> Vec<(u32, [f64; 3])> {
    let machine = &settings.machine;
    let motion = &run.simulation.motion;
    let per_servo = u64::from(machine.step_hz / machine.servo_hz);
    let mut counts = motion.start_counts;
    let mut steps = motion.steps.iter().peekable();
    let mut places = Vec::new();
    for mark in &stream.marks {
        let inside = mark.start_tick + EDGE_TICKS..mark.end_tick.saturating_sub(EDGE_TICKS);
        for servo_tick in inside {
            if mark.state != MotionState::Print {
                continue;
            }
            let now = (motion.first_servo_tick + servo_tick) * per_servo;
            while let Some(step) = steps.next_if(|step| step.tick < now) {
                counts[usize::from(step.motor)] += if step.forward { 1 } else { -1 };
            }
            let mut joints = [0.0; JOINTS_MAX];
            for (joint, (limits, count)) in machine.joints.iter().zip(counts).enumerate() {
                joints[joint] = count as f64 / limits.steps_per_unit;
            }
            let tip = forward(&machine.kinematics, &joints).tip_mm;
            places.push((mark.layer, [tip.x, tip.y, tip.z]));
        }
    }
    places
}

#[test]
fn over_a_warped_bed_the_first_layers_are_as_thick_as_planned_and_the_top_is_planar() {
    let settings = Settings {
        layers: LAYERS,
        ..Settings::default()
    };
    let bytes = std::fs::read(EXAMPLE).expect("example");
    let format = Format::of_ending(Path::new(EXAMPLE)).expect("ending");
    let loaded = read(&bytes, "u-part", format, &ReadOptions::default()).expect("valid");
    let flat = plan_target(&loaded.target, &settings).expect("plan").stream;
    let mesh = probed(&settings);
    let over = over_bed(&flat, &mesh, &settings.machine).expect("it follows");
    let run = |stream: &SegmentStream| {
        let run = dry_run(stream, &settings, &SimulatorSetup::default(), |_| {}).expect("a run");
        let figures = &run.simulation.figures;
        assert_eq!(
            (figures.faults, figures.holds, figures.underruns),
            (0, 0, 0)
        );
        run
    };
    let (plain, lifted) = (run(&flat), run(&over));
    assert_eq!(over.marks, flat.marks);
    let counts = |run: &DryRun, motor: usize| run.simulation.figures.final_counts[motor];
    for motor in [0, 1, 3, 4] {
        assert_eq!(
            counts(&lifted, motor),
            counts(&plain, motor),
            "motor {motor}"
        );
    }
    // The board's bound, of the share that plans use.
    let share = settings.plan_share;
    let limits = limit_oracle::sample(&over, &settings);
    assert!(limits.velocity.ratio * share <= 1.05, "{limits:?}");
    assert!(limits.acceleration.ratio * share <= 1.05, "{limits:?}");

    let half_step_mm = 0.5 / settings.machine.joints[2].steps_per_unit;
    let bound_mm = 0.010 + half_step_mm;
    let height_mm = settings.layer_height_mm;
    let (mut first, mut top, mut seen) = (0, 0, [f64::INFINITY, f64::NEG_INFINITY]);
    let (mut worst_first, mut worst_top) = (0.0f64, 0.0f64);
    for (layer, [x, y, z]) in printed(&lifted, &over, &settings) {
        let nominal_mm = height_mm * f64::from(layer + 1);
        if nominal_mm <= FADE_MM[0] {
            let off_mm = z - bed(x, y) - nominal_mm;
            worst_first = worst_first.max(off_mm.abs());
            seen = [seen[0].min(bed(x, y)), seen[1].max(bed(x, y))];
            first += 1;
        } else if nominal_mm >= FADE_MM[1] {
            worst_top = worst_top.max((z - nominal_mm - mesh.mean_mm()).abs());
            top += 1;
        }
    }
    println!(
        "first layers {first} ticks, off by {:.2} um at most over {:.3} mm of bed; top {top} ticks, {:.2} um",
        1e3 * worst_first,
        seen[1] - seen[0],
        1e3 * worst_top
    );
    assert!(
        first > 10_000 && top > 20_000,
        "{first} and {top} ticks looked at"
    );
    assert!(seen[1] - seen[0] > 0.1, "a bed that differs: {seen:?}");
    assert!(worst_first <= bound_mm, "{worst_first} mm");
    assert!(worst_top <= bound_mm, "{worst_top} mm");
    // The test would notice: without the mesh the bed is missed by its warp.
    let missed = printed(&plain, &flat, &settings)
        .iter()
        .filter(|(layer, [x, y, z])| *layer == 0 && (z - bed(*x, *y) - height_mm).abs() > bound_mm)
        .count();
    assert!(missed > 1000, "{missed}");
}
