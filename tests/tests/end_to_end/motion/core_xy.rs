//! Goal: a machine on two belts prints what the planar one prints: the same stream where its motors do not bind,
//! steps that bring the nozzle to the same places, and motors within limits of their own. Method: a part with
//! edges in all directions, planned and simulated on both; the recorded steps of the two belts integrated to the
//! tip with the belts' own formula (x = (a + b) / 2, y = (a - b) / 2), speeds taken from counts.

use headway::drive::dry_run::{DryRun, dry_run};
use headway::drive::simulator::SimulatorSetup;
use headway::input::{Format, ReadOptions, read};
use headway::job::SegmentStream;
use headway::plan_target;
use headway::settings::{Settings, machine_file};
use headway_tests::limit_oracle;
use std::path::Path;

fn machine(name: &str) -> Settings {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/machines");
    let text = std::fs::read_to_string(folder.join(name)).expect("an example");
    machine_file::from_toml(&text).expect("a machine")
}

fn printed(settings: &Settings) -> (SegmentStream, DryRun) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/gear.json");
    let bytes = std::fs::read(&path).expect("example");
    let format = Format::of_ending(&path).expect("ending");
    let loaded = read(&bytes, "gear", format, &ReadOptions::default()).expect("valid");
    let stream = plan_target(&loaded.target, settings).expect("plan").stream;
    let run = dry_run(&stream, settings, &SimulatorSetup::default(), |_| {}).expect("a run");
    let figures = &run.simulation.figures;
    assert_eq!(
        (figures.faults, figures.holds, figures.underruns),
        (0, 0, 0)
    );
    assert_eq!(run.trace.final_counts, run.trace.expected_counts);
    (stream, run)
}

/// Counts of all motors at each servo tick.
fn counts_at_ticks(run: &DryRun, settings: &Settings) -> Vec<[i64; 8]> {
    let machine = &settings.machine;
    let motion = &run.simulation.motion;
    let per_servo = u64::from(machine.step_hz / machine.servo_hz);
    let mut counts = motion.start_counts;
    let (mut now, mut all) = (0, Vec::new());
    for step in motion.steps.iter() {
        while step.tick >= now {
            all.push(counts);
            now += per_servo;
        }
        counts[usize::from(step.motor)] += if step.forward { 1 } else { -1 };
    }
    all.push(counts);
    all
}

/// Largest speed over 10 ms, mm/s, of a count of motors.
fn fastest_mm_s(counts: &[[i64; 8]], settings: &Settings, of: impl Fn(&[i64; 8]) -> i64) -> f64 {
    let ticks = (0.010 * f64::from(settings.machine.servo_hz)) as usize;
    let pairs = counts.iter().zip(counts.iter().skip(ticks));
    let steps = pairs.map(|(from, to)| (of(to) - of(from)).abs()).max();
    steps.unwrap_or(0) as f64 / settings.machine.joints[0].steps_per_unit / 0.010
}

#[test]
fn two_belts_print_what_the_planar_machine_prints() {
    let (planar, core) = (machine("planar.toml"), machine("corexy.toml"));
    assert_eq!(
        planar,
        Settings {
            machine_name: "planar".into(),
            ..Settings::planar()
        }
    );
    let mut free = core.clone();
    let pair = free.machine.motors.pair.as_mut().expect("a pair");
    (pair.speed_max, pair.acceleration_max, pair.jerk_max) = (1e4, 1e6, 1e9);
    let ((stream, run), (free_stream, free_run)) = (printed(&planar), printed(&free));
    assert!(stream.knots == free_stream.knots, "its motors do not bind");

    let steps_per_mm = planar.machine.joints[0].steps_per_unit;
    let all = counts_at_ticks(&run, &planar);
    let belts = counts_at_ticks(&free_run, &free);
    let mut worst_mm = 0.0f64;
    for (direct, [a, b, z, c, ..]) in all.iter().zip(&belts) {
        let x_mm = 0.5 * (a + b) as f64 / steps_per_mm;
        let y_mm = 0.5 * (a - b) as f64 / steps_per_mm;
        let off_mm = [
            x_mm - direct[0] as f64 / steps_per_mm,
            y_mm - direct[1] as f64 / steps_per_mm,
        ];
        worst_mm = worst_mm.max(off_mm[0].abs()).max(off_mm[1].abs());
        assert_eq!([*z, *c], [direct[2], direct[3]]);
    }
    println!(
        "{} ticks, tip of the belts off by {:.1} um",
        all.len(),
        1e3 * worst_mm
    );
    assert!(all.len() > 5000);
    // Half a step of the planar machine's rounding and half of one of the belts'.
    assert!(worst_mm <= 1.0001 / steps_per_mm, "{worst_mm}");
    // The copy of Z's motor makes its steps, and only it is behind the extruder.
    let last = belts.last().expect("ticks");
    assert_eq!(
        last[5] - free_run.simulation.motion.start_counts[5],
        last[2] - belts[0][2]
    );
}

#[test]
fn motors_of_two_belts_keep_their_own_limits() {
    let slow = |mut settings: Settings| {
        for joint in 0..2 {
            settings.machine.joints[joint].speed_max = 60.0;
        }
        if let Some(pair) = &mut settings.machine.motors.pair {
            pair.speed_max = 60.0;
        }
        settings
    };
    let (planar, core) = (slow(machine("planar.toml")), slow(machine("corexy.toml")));
    let ((_, direct), (stream, belts)) = (printed(&planar), printed(&core));
    let sum = fastest_mm_s(&counts_at_ticks(&direct, &planar), &planar, |c| c[0] + c[1]);
    let counts = counts_at_ticks(&belts, &core);
    let motors = [0, 1].map(|motor| fastest_mm_s(&counts, &core, |counts| counts[motor]));
    println!("planar: x + y up to {sum:.1} mm/s; belts {motors:.1?} mm/s");
    // A step in 10 ms is 1.25 mm/s.
    let limit = 60.0 * core.plan_share + 1.3;
    assert!(
        sum > 1.3 * limit,
        "the planar machine's plan would be too fast: {sum}"
    );
    assert!(
        motors
            .iter()
            .all(|speed| *speed <= limit && *speed > 0.9 * limit),
        "{motors:?}"
    );
    let limits = limit_oracle::sample(&stream, &core);
    assert!(
        limits.velocity.ratio <= 1.0 && limits.acceleration.ratio <= 1.0,
        "{limits:?}"
    );
    assert!(limits.jerk.ratio <= 1.02, "{limits:?}");
}
