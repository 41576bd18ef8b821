//! Goal: 6-axis print paths as people publish them come out of the simulated firmware without a
//! fault, or are refused before a job is written. Method: the runs in ../shared/data/waypoints (left
//! out where that folder is missing), planned for example machines and simulated; tip, axis and limits
//! judged from the recorded steps.

use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::input::ReadOptions;
use headway::input::waypoints::read;
use headway::settings::{Settings, machine_file};
use headway::{Plan, PlanError, plan_waypoints};
use headway_tests::limit_oracle;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn machine(name: &str) -> Settings {
    let path = root().join("examples/machines").join(name);
    machine_file::from_toml(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A run as planned; `None` where the shared data are missing.
fn planned(name: &str, settings: &Settings) -> Option<Result<Plan, PlanError>> {
    let path = root().join("../shared/data/waypoints").join(name);
    let Ok(text) = std::fs::read(&path) else {
        eprintln!("left out: {} is missing", path.display());
        return None;
    };
    let run = read(&text, name, &ReadOptions::default()).unwrap();
    Some(plan_waypoints(&run, settings))
}

/// A run printed in simulation: no fault, limits kept, and the pose within what half a step and 5 um explain. Nothing
/// where the shared data are missing.
fn assert_printed(name: &str, settings: &Settings) {
    let Some(plan) = planned(name, settings) else {
        return;
    };
    let plan = plan.unwrap_or_else(|error| panic!("{name}: {error}"));
    let dry_run = dry_run(&plan.stream, settings, &SimulatorSetup::default(), |_| {}).unwrap();
    let limits = limit_oracle::sample(&plan.stream, settings);
    let (figures, trace) = (&dry_run.simulation.figures, &dry_run.trace);
    println!("{name}: {:.1} s, {trace:?}, {limits:?}", figures.motion_s);
    assert_eq!(figures.faults, 0, "{name}: {:?}", dry_run.simulation.fault);
    assert!(limits.velocity.ratio <= 1.0, "{name}");
    assert!(limits.acceleration.ratio <= 1.0, "{name}");
    assert!(limits.jerk.ratio <= 1.02, "{name}");
    assert!(
        trace.tip_error_um_max <= trace.half_step_um_max + 5.0,
        "{name}"
    );
    let angle_mrad_max = trace.half_step_mrad_max + 0.5;
    assert!(trace.heading_error_mrad_max <= angle_mrad_max, "{name}");
    assert!(trace.axis_error_mrad_max <= angle_mrad_max, "{name}");
    assert_eq!(trace.final_counts, trace.expected_counts, "{name}");
}

/// Goal: what the planner passes the controller does not refuse. Method: runs whose heads swing so that
/// the pivot's motion cancels the tip's: they once ended with "knot N cannot be run".
#[test]
fn swinging_heads_are_not_refused_by_the_controller() {
    let settings = machine("gantry.toml");
    for name in ["dome_cut_132.txt", "freeform_17.txt", "model_2_14.txt"] {
        assert_printed(name, &settings);
    }
}

/// Goal: published runs with tilts from 0 to 97 degrees, jumps and a broken axis are printed on a tilting
/// table. Method: a run that passes the pole closely, one with jumps beyond 90 degrees; all of them by
/// name (`--ignored`), for they print for hours.
#[test]
fn a_tilting_table_prints_steep_runs_with_jumps() {
    let settings = machine("trunnion.toml");
    for name in ["0.txt", "topology_10301.txt"] {
        assert_printed(name, &settings);
    }
}

/// Goal: the same on a head that turns and then tilts, and on a table that tilts about Y. Method: a run without
/// jumps; all of them by name.
#[test]
fn other_heads_and_tables_print_a_run() {
    for machine_name in ["head-cb.toml", "table-bc.toml"] {
        let settings = machine(machine_name);
        assert_printed("0.txt", &settings);
    }
}

#[test]
#[ignore = "minutes; run by name"]
fn other_heads_and_tables_print_all_runs() {
    for machine_name in ["head-cb.toml", "table-bc.toml"] {
        let settings = machine(machine_name);
        for name in RUNS {
            assert_printed(name, &settings);
        }
    }
}

#[test]
#[ignore = "minutes; run by name"]
fn a_tilting_table_prints_all_runs() {
    let settings = machine("trunnion.toml");
    for name in RUNS {
        assert_printed(name, &settings);
    }
}

/// Goal: what the small arm reaches it prints, and of what it does not the joint and the place are told.
/// Method: a gentle run in the middle of its bed, and one for which its fourth joint would have to go a
/// little beyond its end.
#[test]
fn a_small_arm_prints_what_it_reaches_and_tells_the_rest() {
    let settings = machine("arm-small.toml");
    assert_printed("0.txt", &settings);
    if let Some(Err(error)) = planned("dome_cut_132.txt", &settings) {
        let text = error.to_string();
        assert!(text.contains("joint j4 would go to"), "{text}");
        assert!(
            text.contains("tip at") && text.contains("turn the part"),
            "{text}"
        );
    }
}

const RUNS: [&str; 12] = [
    "0.txt",
    "1.txt",
    "2.txt",
    "3.txt",
    "4.txt",
    "5.txt",
    "bunnyHead_13900.txt",
    "dome_cut_132.txt",
    "freeform_17.txt",
    "model_2_14.txt",
    "simple_curve_16.txt",
    "topology_10301.txt",
];
