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
use headway_tests::limit_oracle;
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
    // No example: its second turn is below its first, where the nozzle touches it.
    let text = kept(
        "../tests/benches/gear-6axis.wpt",
        &gear::waypoint_file(LENGTH_MM),
    );
    read(text.as_bytes(), "gear", &ReadOptions::default()).unwrap()
}

fn free_gantry() -> Settings {
    let text = machine_file::to_toml(&gear::free_gantry());
    let meant = machine_file::from_toml(&text).unwrap();
    // No example: it stands for no machine.
    let name = "../tests/benches/free-gantry.toml";
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
        let limits = limit_oracle::sample(&plan.stream, &settings);
        assert!(limits.velocity.ratio <= 1.0 && limits.acceleration.ratio <= 1.0);
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
        .moves
        .iter()
        .filter(|route_move| route_move.pass.is_some())
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

/// A straight run of 40 mm along x at this y, with further columns.
fn straight(head: &str, y_mm: f64, further: impl Fn(f64) -> String) -> WaypointRun {
    let line = |i: i32| {
        let x_mm = 2.0 * f64::from(i);
        format!("{x_mm} {y_mm} 1 0 0 1 {}\n", further(x_mm))
    };
    let text: String = (0..=20).map(line).collect();
    let text = format!("x y z nx ny nz {head}\n{text}");
    read(text.as_bytes(), "run", &ReadOptions::default()).unwrap()
}

/// Goal: widths and heights of the waypoints are laid. Method: straight runs whose volume is known; without
/// headings the nozzle turns until its bead is that wide, with them the flow alone follows.
#[test]
fn widths_and_heights_of_waypoints_are_laid() {
    let settings = Settings::default();
    // Along 40 mm, and the aperture's own area at the start (0.6 x 0.2 mm semi-axes, 0.2 mm high).
    let start_mm3 = std::f64::consts::PI * 0.6 * 0.2 * 0.2;
    let volume_mm3 = |run: &WaypointRun| plan_waypoints(run, &settings).unwrap().figures.volume_mm3;
    let near = |found: f64, expected: f64| {
        assert!((found / expected - 1.0).abs() < 0.005, "{found} {expected}")
    };
    let plain = straight("heading_deg", 0.0, |_| "90".to_string());
    near(volume_mm3(&plain), 40.0 * 1.2 * 0.2 + start_mm3);
    let wide = straight("heading_deg width_mm height_mm", 0.0, |_| {
        "90 1.5 0.3".to_string()
    });
    near(volume_mm3(&wide), 40.0 * 1.5 * 0.3 + start_mm3);
    let growing = straight("height_mm", 0.0, |x_mm| format!("{}", 0.2 + 0.005 * x_mm));
    near(volume_mm3(&growing), 40.0 * 1.2 * 0.3 + start_mm3);

    // From 0.6 to 1.0 mm: the heading goes along, and the volume is that of the mean.
    let turned = straight("width_mm", 0.0, |x_mm| format!("{}", 0.6 + 0.01 * x_mm));
    let plan = plan_waypoints(&turned, &settings).unwrap();
    near(plan.figures.volume_mm3, 40.0 * 0.8 * 0.2 + start_mm3);
    let printed = |route_move: &&headway::plan::route::moves::RouteMove| route_move.pass.is_some();
    let route_move = plan.route.moves.iter().find(printed).unwrap();
    for share in [0.1, 0.5, 0.9] {
        let pose = route_move
            .curve
            .evaluate(share * route_move.curve.span_count() as f64)
            .value;
        let (sin, cos) = pose[5].sin_cos();
        let width_mm = 2.0 * (0.6 * sin).hypot(0.2 * cos);
        assert!(
            (width_mm - (0.6 + 0.4 * share)).abs() < 0.002,
            "{share}: {width_mm}"
        );
    }
}

/// Goal: several files are one job in their order, passes of their own even where one ends near the other's
/// beginning. Method: three lines 0.5 mm apart, from both ends.
#[test]
fn several_runs_are_one_job_in_order() {
    let none = |_: f64| String::new();
    let run = straight("", 0.0, none);
    let mut back = straight("", 0.5, none);
    back.points.reverse();
    let all = run.then(back, None).then(straight("", 1.0, none), None);
    let plan = plan_waypoints(&all, &Settings::default()).unwrap();
    assert_eq!(plan.figures.passes, 3);
    let starts: Vec<[f64; 2]> = (0..3)
        .map(|pass| {
            let mut moves = plan.route.moves.iter();
            let first = moves
                .find(|route_move| route_move.pass == Some(pass))
                .unwrap();
            let [x, y, ..] = first.curve.control[0];
            let [dx, dy, _] = plan.transform.offset_mm;
            [x - dx, y - dy].map(|way| (way * 1e6).round() / 1e6)
        })
        .collect();
    assert_eq!(starts, [[0.0, 0.0], [40.0, 0.5], [0.0, 1.0]]);
}

/// Goal: the tip goes at the speeds that waypoints ask for, without resting where they change. Method: a straight run
/// along x at 20 mm/s, faster from 10 to 20 mm, then at 80 mm/s, the print speed, and at 35 mm/s
/// from 32 mm on; the speed by the times of the simulated steps, half a millimetre each.
#[test]
fn waypoints_are_passed_at_the_speeds_they_ask_for() {
    let asked = |x_mm: f64| match x_mm {
        x_mm if x_mm <= 10.0 => 20.0,
        x_mm if x_mm <= 20.0 => 20.0 + 6.0 * (x_mm - 10.0),
        x_mm if x_mm <= 30.0 => 80.0,
        _ => 35.0,
    };
    let run = straight("speed_mm_s", 0.0, |x_mm| format!("{}", asked(x_mm)));
    let mut settings = Settings::default();
    let refused = plan_waypoints(&run, &settings).unwrap_err().to_string();
    assert!(refused.contains("line 11: asks for 68 mm/s"), "{refused}");
    settings.speed_mm_s = 80.0;
    let plan = plan_waypoints(&run, &settings).unwrap();
    let simulated = dry_run(&plan.stream, &settings, &SimulatorSetup::default(), |_| {}).unwrap();
    assert_eq!(simulated.simulation.figures.faults, 0);
    let limits = limit_oracle::sample(&plan.stream, &settings);
    assert!(limits.velocity.ratio <= 1.0 && limits.acceleration.ratio <= 1.0);
    let record = &simulated.simulation.motion;
    let steps_per_mm = settings.machine.joints[0].steps_per_unit;
    // When X was last at each place of the part; the head leaves straight up.
    let mut count = record.start_counts[0];
    let mut passed: Vec<(f64, f64)> = Vec::new();
    for step in record.steps.iter().filter(|step| step.motor == 0) {
        count += if step.forward { 1 } else { -1 };
        let x_mm = count as f64 / steps_per_mm - plan.transform.offset_mm[0];
        let at_s = step.tick as f64 / f64::from(settings.machine.step_hz);
        passed.retain(|(before_mm, _)| *before_mm < x_mm - 1e-9);
        passed.push((x_mm, at_s));
    }
    let speed_mm_s = |x_mm: f64| {
        let after = |x_mm: f64| passed[passed.partition_point(|(at, _)| *at < x_mm)];
        let (from, to) = (after(x_mm - 0.25), after(x_mm + 0.25));
        (to.0 - from.0) / (to.1 - from.1)
    };
    // A step is made within 5 us of its time, the motion aims at 0.998 of a speed, and its fit takes the rest. Where the
    // asked speed rises it is kept below by the smoothing of the acceleration as well.
    for x_mm in [4.0, 6.0, 8.0, 13.0, 15.0, 17.0, 23.0, 26.0, 35.0, 37.0] {
        let (found, expected) = (speed_mm_s(x_mm), settings.plan_share * asked(x_mm));
        println!("x {x_mm} mm: {found:.2} of {expected:.2} mm/s");
        assert!(found <= 1.005 * expected, "x {x_mm} mm: {found} mm/s");
        let least = if (10.0..=20.0).contains(&x_mm) {
            0.95
        } else {
            0.99
        };
        assert!(found >= least * expected, "x {x_mm} mm: {found} mm/s");
    }
    // Nowhere does it rest.
    let slowest = (20..380).map(|tenth| speed_mm_s(0.1 * f64::from(tenth)));
    assert!(slowest.fold(f64::INFINITY, f64::min) > 15.0, "a rest");
}
