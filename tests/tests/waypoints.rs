//! Goal: a six-axis gear, from a waypoint file to steps, in few bytes. Method: the
//! kept example is written again and compared; it is read, planned, simulated at several microstep
//! settings, and its bytes are counted. `HEADWAY_WRITE_EXAMPLES=1` writes the example anew.

use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::input::ReadOptions;
use headway::input::waypoints::{WaypointRun, read};
use headway::plan_waypoints;
use headway::settings::{Settings, machine_file};
use headway_tests::gear;
use std::path::PathBuf;

/// Length of the gear, mm.
const LENGTH_MM: f64 = 400.0;

/// Set, the examples are written anew.
const WRITE: &str = "HEADWAY_WRITE_EXAMPLES";

fn example(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../examples")
        .join(name)
}

/// What is kept must be what is generated.
fn kept(name: &str, text: &str) -> String {
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(example(name), text).unwrap();
    }
    let kept = std::fs::read_to_string(example(name)).unwrap_or_default();
    assert!(
        kept == text,
        "{name} is not what the tests write: run with {WRITE}=1"
    );
    kept
}

fn gear_run() -> WaypointRun {
    let text = kept("gear-6axis.wpt", &gear::waypoint_file(LENGTH_MM));
    read(text.as_bytes(), "gear", &ReadOptions::default()).unwrap()
}

fn free_gantry() -> Settings {
    let text = machine_file::to_toml(&gear::free_gantry());
    let meant = machine_file::from_toml(&text).unwrap();
    let name = "machines/free-gantry.toml";
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(example(name), &text).unwrap();
    }
    // Comments and order may differ: what counts is what is read.
    let kept = std::fs::read_to_string(example(name)).unwrap();
    assert_eq!(
        machine_file::from_toml(&kept).unwrap(),
        meant,
        "{name}: run with {WRITE}=1"
    );
    meant
}

#[test]
fn the_gear_takes_few_bytes_whatever_the_microstepping() {
    let run = gear_run();
    let base = free_gantry();
    assert!((base.speed_mm_s - 60.0).abs() < 1e-12);
    let mut bytes = Vec::new();
    for finer in [0.5, 1.0, 2.0] {
        let mut settings = base.clone();
        for joint in &mut settings.machine.joints {
            joint.steps_per_unit *= finer;
        }
        if finer > 1.0 {
            // Or the joints' top speeds would ask for more than 90 % of the step ticks.
            settings.machine.step_hz *= 2;
        }
        let plan = plan_waypoints(&run, &settings).unwrap();
        let dry_run = dry_run(&plan.stream, &settings, &SimulatorSetup::default(), |_| {}).unwrap();
        let figures = &dry_run.simulation.figures;
        let per_mm = figures.bytes as f64 / LENGTH_MM;
        println!(
            "microsteps x{finer}: {:.1} mm printed, {:.1} mm travel, {} knots, {} bytes in all, \
             {per_mm:.2} a mm, {:.0} a second over {:.2} s; {:?}",
            plan.figures.print_mm,
            plan.figures.travel_mm,
            plan.stream.knots.len(),
            figures.bytes,
            dry_run.bytes_per_s,
            figures.motion_s,
            dry_run.trace,
        );
        assert_eq!(figures.faults, 0, "{:?}", dry_run.simulation.fault);
        assert!(per_mm <= 25.0, "{per_mm} bytes a mm, travel included");
        assert_eq!(dry_run.trace.final_counts, dry_run.trace.expected_counts);
        assert!(dry_run.limits.velocity.ratio <= 1.0);
        assert!(dry_run.limits.acceleration.ratio <= 1.0);
        bytes.push(figures.bytes);
    }
    // Steps are the controller's affair: the stream is the same to the byte.
    assert!(bytes.iter().all(|&each| each == bytes[0]), "{bytes:?}");
}

#[test]
fn the_curve_is_the_gear_between_its_waypoints_too() {
    let run = gear_run();
    let settings = free_gantry();
    let plan = plan_waypoints(&run, &settings).unwrap();
    let print: Vec<_> = plan
        .route
        .stretches
        .iter()
        .filter(|stretch| stretch.pass.is_some())
        .collect();
    assert_eq!(print.len(), 1, "the gear has no corner");
    let curve = &print[0].curve;
    // Samples that are no waypoints, found again by their distance from the curve.
    let points = gear::points(LENGTH_MM);
    let per_mm = curve.span_count() as f64 / points.last().unwrap().length_mm;
    let mut worst_mm: f64 = 0.0;
    for point in points.iter().skip(2).step_by(97) {
        let tip: Vec<f64> = (0..3)
            .map(|axis| point.tip_mm[axis] + plan.transform.offset_mm[axis])
            .collect();
        let guess = point.length_mm * per_mm;
        let nearest_mm = (-4000..4000)
            .map(|k| {
                let at = curve.evaluate(guess + f64::from(k) * 0.001 * per_mm).value;
                (0..3).map(|a| (at[a] - tip[a]).powi(2)).sum::<f64>().sqrt()
            })
            .fold(f64::INFINITY, f64::min);
        worst_mm = worst_mm.max(nearest_mm);
    }
    println!("farthest from the gear: {:.2} um", worst_mm * 1e3);
    // Waypoints 0.2 mm apart on lobes of 1.2 mm radius: 0.2^4 / 384 / 1.2^3 = 0.002 um
    // inside. The parabola at either end is off by about 0.2^3 / 12 / 1.2^2 = 0.5 um: half the
    // tolerance.
    assert!(worst_mm < 1e-3, "{worst_mm} mm");
}
