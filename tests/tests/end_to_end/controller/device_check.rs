//! Goal: what a board would stop is found before a job is written, with its place, and what it runs passes. Method: a
//! plan whose primes and ranges are made worse, checked in one piece and in two, against the fault of the simulated board.
//! By name, what the checks cost beside planning:
//! `cargo test --release -p headway-tests --test end_to_end device_check -- --ignored --nocapture`.

use headway::drive::device_check::{DeviceCheck, Refusal, Refused};
use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::gcode::{GcodeOptions, read};
use headway::input::Target;
use headway::job::SegmentStream;
use headway::pipeline::gcode::plan_gcode;
use headway::plan_target;
use headway::settings::{Infill, Settings};
use headway_protocol::message::{Fault, FaultCause};
use headway_protocol::segment::FlowAction;
use headway_tests::cpu_clock::{process_s, thread_s};
use headway_tests::folders::files;
use headway_tests::outlines::{example, region};

fn outline(name: &str) -> Target {
    Target {
        name: name.to_string(),
        regions: vec![region(&example(name))],
    }
}

fn checked(pieces: &[&SegmentStream], settings: &Settings) -> Option<Refused> {
    let mut check = DeviceCheck::default();
    for piece in pieces {
        check.add(piece, &piece.machine(&settings.machine));
    }
    check.finish()
}

/// The fault of the simulated board.
fn simulated(stream: &SegmentStream, settings: &Settings) -> Option<Fault> {
    let run = dry_run(stream, settings, &SimulatorSetup::default(), |_| {});
    run.expect("a run").simulation.fault
}

fn fault_of(refused: &Refused) -> Fault {
    match refused.refusal {
        Refusal::Fault(fault) => fault,
        other => panic!("{other:?}"),
    }
}

/// Goal: a plan passes, whole and in pieces; primes that are too much together are the very fault of the simulated
/// board, at their place; a joint that leaves its range is named. Method: a taper of one pass, four primes at once in
/// place of one, X cut off.
#[test]
fn what_a_board_would_stop_is_found_before() {
    let settings = Settings::default();
    let plan = plan_target(&outline("taper"), &settings).expect("a plan");
    let stream = &plan.stream;
    assert_eq!(checked(&[stream], &settings), None);
    assert_eq!(checked(&[], &settings), None);
    let mut back = stream.clone();
    back.start = stream.knots.last().expect("knots").control;
    for knot in &mut back.knots {
        knot.control = back.start;
    }
    back.events.clear();
    assert_eq!(checked(&[stream, &back], &settings), None, "a second piece");

    let mut primed = stream.clone();
    let is_prime =
        |event: &&headway_protocol::segment::FlowEvent| event.action == FlowAction::Prime;
    let prime = *primed.events.iter().find(is_prime).expect("a prime");
    for _ in 0..3 {
        primed.events.insert(0, prime);
    }
    let refused = checked(&[&primed], &settings).expect("too much");
    let fault = fault_of(&refused);
    let extruder = settings.machine.joints.len() as u8;
    assert_eq!((fault.cause, fault.index), (FaultCause::Limit, extruder));
    assert_eq!(simulated(&primed, &settings), Some(fault));
    let begins = stream.knots[prime.span as usize].control;
    for (axis, at_mm) in refused.at_mm.iter().enumerate() {
        let begins_mm = f64::from(begins[axis]) * 1e-4;
        // The primes are over before the tip has gone a millimetre.
        assert!((at_mm - begins_mm).abs() < 1.0, "{refused:?} {begins:?}");
    }

    let highest = stream.knots.iter().map(|knot| knot.control[0]).max();
    let highest_mm = f64::from(highest.expect("knots")) * 1e-4;
    let mut narrow = settings.clone();
    narrow.machine.joints[0].position_max = highest_mm - 1.0;
    let refused = checked(&[stream], &narrow).expect("outside");
    let fault = fault_of(&refused);
    assert_eq!((fault.cause, fault.index), (FaultCause::SoftLimit, 0));
    assert!((refused.at_mm[0] - highest_mm).abs() < 2.0, "{refused:?}");
    assert!(refused.time_s > 0.0, "{refused:?}");
}

/// Most that the checks may take of the planner's processor time.
const SHARE_MAX: f64 = 0.05;

/// The system tells a thread's time in steps of a few milliseconds, longer than the checks of a small job.
const REPEATS: u32 = 20;

/// Runs the checks of a plan that took so many processor seconds.
fn check(name: &str, stream: &SegmentStream, settings: &Settings, plan_s: f64) {
    let machine = stream.machine(&settings.machine);
    let begun_s = thread_s();
    for _ in 0..REPEATS {
        let mut device = DeviceCheck::default();
        device.add(stream, &machine);
        assert_eq!(device.finish(), None, "{name}");
    }
    let check_s = (thread_s() - begun_s) / f64::from(REPEATS);
    let ticks = stream.marks.last().map_or(0, |mark| mark.end_tick);
    let share = check_s / plan_s;
    println!(
        "{name}: {:.1} s of print, planned in {plan_s:.2} s, checked in {check_s:.4} s ({:.0} ns a tick): {:.2} %",
        ticks as f64 / f64::from(machine.servo_hz),
        1e9 * check_s / ticks as f64,
        100.0 * share
    );
    assert!(share <= SHARE_MAX, "{name}: {share}");
}

#[test]
#[ignore = "a measurement; wants an optimised build"]
fn the_boards_checks_cost_little_beside_planning() {
    let tower = Settings {
        layers: 100,
        infill: Some(Infill {
            walls: 1,
            density_pct: 0.0,
            spacing_mm: None,
            angle_rad: 0.0,
            bottom_layers: Some(0),
            top_layers: Some(0),
        }),
        ..Settings::default()
    };
    for (name, what, settings) in [
        ("gear", "gear", Settings::default()),
        ("u-part", "tower of 100 layers, one wall", tower),
    ] {
        let begun_s = process_s();
        let plan = plan_target(&outline(name), &settings).expect("a plan");
        let plan_s = process_s() - begun_s;
        check(what, &plan.stream, &settings, plan_s);
    }
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/peer");
    for path in files(folder, "gcode") {
        let text = std::fs::read(&path).expect("a file");
        let begun_s = process_s();
        let program = read(text.as_slice(), "slice", &GcodeOptions::default()).expect("G-code");
        let plan = plan_gcode(&program, None, &Settings::default(), &()).expect("a plan");
        let plan_s = process_s() - begun_s;
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        check(&name, &plan.stream, &plan.settings, plan_s);
    }
}
