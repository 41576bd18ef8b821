//! Goal: the simulated steps reproduce the plan, and the finished segments keep every limit
//! Method: examples planned at 60 and 150 mm/s, streamed to the firmware
//! library, steps turned back into poses; an independent sampler over the segments.

use headway::drive::dry_run::{DryRun, dry_run};
use headway::drive::simulator::SimulatorSetup;
use headway::drive::time_by_limit::time_by_limit;
use headway::input::{Format, ReadOptions, read};
use headway::job::SegmentStream;
use headway::plan::motion::segments::lay_segments;
use headway::plan_target;
use headway::settings::Settings;
use headway_tests::gear;
use headway_tests::limit_oracle::{LimitFigures, sample};
use std::path::Path;

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

fn planned(example: &str, settings: &Settings) -> SegmentStream {
    let path = Path::new(EXAMPLES).join(example);
    let bytes = std::fs::read(&path).expect("example");
    let format = Format::of_ending(&path).expect("ending");
    let loaded = read(&bytes, example, format, &ReadOptions::default()).expect("valid");
    plan_target(&loaded.target, settings).expect("plan").stream
}

fn run_dry(example: &str, settings: &Settings) -> (LimitFigures, DryRun) {
    run_dry_stream(&planned(example, settings), settings)
}

fn run_dry_stream(stream: &SegmentStream, settings: &Settings) -> (LimitFigures, DryRun) {
    let run = dry_run(stream, settings, &SimulatorSetup::default(), |_| {}).expect("dry_run");
    let limits = sample(stream, settings);
    // The product's figures look up to half a tick away from where a speed is largest: 2e-4 at 150 mm/s.
    let figures = time_by_limit(stream, settings).ratios;
    let sampled = [limits.velocity, limits.acceleration, limits.jerk];
    for (figure, sampled) in figures.into_iter().zip(sampled) {
        assert!(
            (figure / sampled.ratio - 1.0).abs() < 1e-3,
            "{figure} {sampled:?}"
        );
    }
    (limits, run)
}

/// Issue 3: a tick's own rounding is 1.44 us rms; the rest is the averaged parabola.
fn check_step_times(name: &str, dry_run: &DryRun) {
    let trace = &dry_run.trace;
    assert!(trace.step_time_error_us_rms <= 1.6, "{name}: {trace:?}");
    assert!(trace.step_time_error_us_max <= 5.0, "{name}: {trace:?}");
}

fn check(name: &str, (limits, dry_run): &(LimitFigures, DryRun)) {
    let trace = &dry_run.trace;
    let figures = &dry_run.simulation.figures;
    println!("{name}: {figures:?}\n{trace:?}\n{limits:?}");
    assert_eq!(figures.faults, 0, "{name}: {:?}", dry_run.simulation.fault);
    assert_eq!((figures.underruns, figures.holds), (0, 0), "{name}");
    let tip_bound_um = trace.half_step_um_max + 2.0;
    assert!(trace.tip_error_um_max <= tip_bound_um, "{name}: {trace:?}");
    let heading_bound_mrad = trace.half_step_mrad_max + 0.2;
    assert!(
        trace.heading_error_mrad_max <= heading_bound_mrad,
        "{name}: {trace:?}"
    );
    assert!(trace.volume_error_pct <= 0.1, "{name}: {trace:?}");
    assert_eq!(trace.final_counts, trace.expected_counts, "{name}");
    check_step_times(name, dry_run);
    // Issue 2's bound is 1 + 1e-6 of the planned share.
    assert!(limits.velocity.ratio <= 1.0 + 1e-6, "{name}: {limits:?}");
    assert!(
        limits.acceleration.ratio <= 1.0 + 1e-6,
        "{name}: {limits:?}"
    );
}

#[test]
fn steps_reproduce_the_plan_on_the_planar_machine() {
    for speed_mm_s in [60.0, 150.0] {
        let settings = Settings {
            speed_mm_s,
            ..Settings::default()
        };
        for example in ["u-part.json", "taper.json"] {
            let name = format!("{example} at {speed_mm_s} mm/s");
            check(&name, &run_dry(example, &settings));
        }
    }
}

#[test]
fn steps_of_the_planar_gear_come_in_time_at_60_and_150_mm_per_s() {
    for speed_mm_s in [60.0, 150.0] {
        let settings = Settings {
            speed_mm_s,
            ..Settings::default()
        };
        let (_, dry_run) = run_dry("gear.json", &settings);
        check_step_times(&format!("gear.json at {speed_mm_s} mm/s"), &dry_run);
        assert_eq!(dry_run.simulation.figures.faults, 0);
        let steps = dry_run.simulation.figures.steps;
        assert!(steps > 100_000, "{steps}");
    }
}

#[test]
fn a_plan_at_its_limits_is_not_held_up_on_a_full_queue() {
    // Found on the bracket: spans at 0.95 of the nozzle's acceleration made the time warp slow down
    // nine times for nothing, so that steps depended on when knots had arrived.
    check(
        "bracket.json",
        &run_dry("bracket.json", &Settings::default()),
    );
}

fn dry_run_of_the_gear(speed_mm_s: f64) -> (LimitFigures, DryRun) {
    let settings = Settings {
        speed_mm_s,
        ..gear::gantry()
    };
    let (stream, _) = lay_segments(&gear::route(200.0), &settings).expect("segments");
    run_dry_stream(&stream, &settings)
}

#[test]
fn steps_reproduce_the_six_axis_gear_on_a_gantry() {
    check("gear-6axis", &dry_run_of_the_gear(60.0));
}

#[test]
fn steps_of_the_six_axis_gear_come_in_time_as_fast_as_its_limits_allow() {
    let (_, dry_run) = dry_run_of_the_gear(150.0);
    check_step_times("gear-6axis at 150 mm/s", &dry_run);
    assert_eq!(dry_run.simulation.figures.faults, 0);
}
