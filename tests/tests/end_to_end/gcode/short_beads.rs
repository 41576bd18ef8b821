//! Goal: beads too short for the extruder to get from prime to retract run on a board: the planner rests or slows,
//! and the board's own checks pass before a job is written. Method: programs of beads from 0.02 to 2 mm between
//! primes and retracts of several volumes, rates and speeds, with ways between them and without, planned and
//! simulated on the firmware library; limits by the sampler that shares no code with the planner.

use headway::drive::device_check::DeviceCheck;
use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::gcode::{GcodeOptions, read};
use headway::pipeline::gcode::{GcodePlan, plan_gcode};
use headway::settings::Settings;
use headway_firmware::path::spline::Span;
use headway_tests::limit_oracle;

/// Lengths of beads, mm.
const LENGTHS_MM: [f64; 8] = [0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.2, 2.0];
/// Filament of a mm of bead of 0.45 x 0.2 mm, mm.
const FILAMENT_A_MM: f64 = 0.0374;
/// What a plan may be above its share of a limit: primes and retracts last whole servo ticks, half a tick of the
/// shortest of them (10 ms) is 2.5 % of its duration and twice that of its acceleration, but 2 % is spared.
const RATIO_MAX: f64 = 1.03;

/// A bead of each length, `gap_mm` of travel between them, then a long one.
fn program(push_mm: f64, push_mm_min: f64, speed_mm_min: f64, gap_mm: f64) -> String {
    let mut text = String::from("G21\nG90\nM83\nG92 E0\n;LAYER:0\nG1 Z0.2 F1200\n");
    let mut x_mm = 10.0;
    for length_mm in LENGTHS_MM.into_iter().chain([20.0]) {
        let end_mm = x_mm + length_mm;
        let filament_mm = FILAMENT_A_MM * length_mm;
        text += &format!(
            "G1 X{x_mm:.3} Y10 F9000\nG1 E{push_mm} F{push_mm_min}\n\
             G1 X{end_mm:.3} Y10 E{filament_mm:.5} F{speed_mm_min}\nG1 E-{push_mm} F{push_mm_min}\n"
        );
        x_mm = end_mm + gap_mm;
    }
    text
}

fn planned(text: &str, settings: &Settings) -> GcodePlan {
    let program = read(text.as_bytes(), "beads", &GcodeOptions::default()).expect("G-code");
    plan_gcode(&program, None, settings, &()).expect("a plan")
}

/// Plans and runs a program: no fault, no limit exceeded, the board's checks pass.
fn check(name: &str, text: &str, settings: &Settings) {
    let plan = planned(text, settings);
    let mut device = DeviceCheck::default();
    device.add(&plan.stream, &plan.stream.machine(&settings.machine));
    assert_eq!(device.finish(), None, "{name}");
    let setup = SimulatorSetup::default();
    let run = dry_run(&plan.stream, &plan.settings, &setup, |_| {}).expect("a run");
    let fault = run.simulation.fault;
    assert_eq!(run.simulation.figures.faults, 0, "{name}: {fault:?}");
    assert_eq!(run.trace.final_counts, run.trace.expected_counts, "{name}");
    let limits = limit_oracle::sample(&plan.stream, &plan.settings);
    let passes = plan.figures.passes;
    let worst = limits.velocity.ratio.max(limits.acceleration.ratio);
    println!("{name}: {worst:.4} of a limit, {passes} passes");
    assert!(worst <= RATIO_MAX, "{name}: {limits:?}");
    assert!(passes >= LENGTHS_MM.len(), "{name}: {passes} passes");
}

#[test]
fn beads_of_every_length_run_between_primes_and_retracts() {
    for push_mm in [0.1, 0.4, 0.8] {
        for (push_mm_min, speed_mm_min) in [(1200.0, 600.0), (2100.0, 1800.0), (3600.0, 6000.0)] {
            let text = program(push_mm, push_mm_min, speed_mm_min, 3.0);
            let name =
                format!("push {push_mm} mm at {push_mm_min}, beads at {speed_mm_min} mm/min");
            check(&name, &text, &Settings::default());
        }
    }
}

/// Goal: a retract that still runs when the next prime begins. Method: no way between the beads, and long leads.
#[test]
fn beads_that_follow_at_once_run() {
    let mut settings = Settings::default();
    settings.prime_retract.prime_lead_s = 0.05;
    settings.prime_retract.retract_lead_s = 0.05;
    for push_mm in [0.1, 0.4] {
        let text = program(push_mm, 2100.0, 1800.0, 0.0);
        check(&format!("push {push_mm} mm, no way"), &text, &settings);
    }
}

/// Goal: where nothing is too short, no rest comes in. Method: a rest would show as a pass that begins without motion.
#[test]
fn long_beads_are_not_held_up() {
    let text = "G21\nG90\nM83\n;LAYER:0\nG1 Z0.2 F1200\nG1 X10 Y10 F9000\nG1 E0.4 F2100\n\
                G1 X60 Y10 E1.87 F1800\nG1 E-0.4 F2100\nG1 X60 Y20 F9000\nG1 E0.4 F2100\n\
                G1 X10 Y20 E1.87 F1800\nG1 E-0.4 F2100\n";
    let plan = planned(text, &Settings::default());
    let knots = &plan.stream.knots;
    let spans: Vec<Span> = plan.stream.spans().collect();
    let prints = plan.stream.marks.iter().filter(|mark| mark.pass.is_some());
    let mut looked = 0;
    for mark in prints {
        // Span n ends with the control point of knot n: at rest it is the one before.
        let first = spans
            .iter()
            .position(|span| span.start_tick == mark.start_tick);
        let first = first.expect("a span begins with the pass");
        let is_rest = knots[first].control == knots[first - 1].control;
        assert!(!is_rest, "pass {:?} begins with a rest", mark.pass);
        looked += 1;
    }
    assert_eq!(looked, 2);
}
