//! Goal: a part with its machine, nozzle, layer and speeds made larger is planned alike: the same motion in other units.
//! Method: the built-in machine's file, each number by the unit that its key ends with, and two outlines, ten and a
//! hundred times as large.

use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::input::Target;
use headway::job::frames::WireFrames;
use headway::settings::{Settings, machine_file};
use headway::{Plan, plan_target};
use headway_tests::limit_oracle;
use headway_tests::outlines::{example, region};
use headway_tests::segment_oracle::{Oracle, sample_limits};

/// Print times of the same part in other sizes: rounding leads the planner to other seams, which are as good.
const TIME_RATIO_MAX: f64 = 1.03;
/// The same of what is covered, per cent.
const COVERED_PCT: f64 = 0.1;
/// The same of the stream's bytes: units are powers of two, sizes are not.
const BYTES_SHARE: f64 = 0.1;

/// The exponent of length in the unit of a key.
fn exponent(section: &str, key: &str) -> i32 {
    match key {
        "steps_per_mm" => -1,
        "steps_per_mm3" => -3,
        "min_mm" | "max_mm" => 1,
        _ if key.contains("mm3") => 3,
        _ if key.contains("_mm") && section != "[shaping]" => 1,
        _ => 0,
    }
}

/// The built-in machine, `times` as large.
fn machine(times: f64) -> Settings {
    let mut section = String::new();
    let text = machine_file::to_toml(&Settings::planar());
    let scaled = text.lines().map(|line| {
        if line.starts_with('[') {
            section = line.to_string();
        }
        match line.split_once(" = ") {
            Some(("aperture", _)) => {
                format!("aperture = \"ellipse:{}x{}\"", 1.2 * times, 0.4 * times)
            }
            Some((key, value)) if !line.starts_with('#') => {
                let factor = times.powi(exponent(&section, key));
                format!("{key} = {}", scaled_numbers(value, factor))
            }
            _ => line.to_string(),
        }
    });
    let text = scaled.collect::<Vec<_>>().join("\n");
    machine_file::from_toml(&text).unwrap()
}

/// A number, or a list of them, times a factor; what is none stays.
fn scaled_numbers(value: &str, factor: f64) -> String {
    let of_number = |text: &str| match text.trim().parse::<f64>() {
        Ok(number) if factor != 1.0 => format!("{}", number * factor),
        _ => text.trim().to_string(),
    };
    match value
        .strip_prefix('[')
        .and_then(|list| list.strip_suffix(']'))
    {
        Some(list) => {
            let numbers: Vec<String> = list.split(',').map(of_number).collect();
            format!("[{}]", numbers.join(", "))
        }
        None => of_number(value),
    }
}

fn planned(name: &str, times: f64) -> Plan {
    let mut rings = example(name);
    for at_mm in rings.iter_mut().flatten().flatten() {
        *at_mm *= times;
    }
    let target = Target {
        name: name.to_string(),
        regions: vec![region(&rings)],
    };
    plan_target(&target, &machine(times)).unwrap()
}

/// Bytes of the stream on the line.
fn line_bytes(plan: &Plan) -> f64 {
    WireFrames::encode(&plan.stream).unwrap().line_bytes() as f64
}

/// The same print as `small`, `times` as large.
fn check(name: &str, small: &Plan, large: &Plan, times: f64) {
    let ratio = large.figures.print_s / small.figures.print_s;
    let covered = [small, large].map(|plan| plan.figures.covered_of_reachable_pct);
    let bytes = line_bytes(large) / line_bytes(small);
    println!(
        "{name} x {times}: {:.3} and {:.3} s, {:.3} and {:.3} % covered, {bytes:.3} of the bytes",
        small.figures.print_s, large.figures.print_s, covered[0], covered[1]
    );
    assert!(
        (1.0 / TIME_RATIO_MAX..=TIME_RATIO_MAX).contains(&ratio),
        "{name}: {ratio}"
    );
    assert!(
        (covered[0] - covered[1]).abs() <= COVERED_PCT,
        "{name}: {covered:?}"
    );
    assert!((bytes - 1.0).abs() <= BYTES_SHARE, "{name}: {bytes}");
    assert_eq!(small.figures.passes, large.figures.passes, "{name}");
    let volume = large.figures.volume_mm3 / small.figures.volume_mm3;
    assert!(
        (volume / times.powi(3) - 1.0).abs() < 2e-3,
        "{name}: {volume}"
    );
}

/// The gear takes long, and so do its steps: the smaller part alone goes as far as the built-in machine's axes allow.
#[test]
fn ten_and_a_hundred_times_as_large_is_the_same_print() {
    for (name, sizes) in [("u-part", &[10.0, 100.0][..]), ("gear", &[10.0])] {
        let small = planned(name, 1.0);
        for &times in sizes {
            let large = planned(name, times);
            check(name, &small, &large, times);
            if times == 100.0 {
                runs_as_planned(&large, times);
            }
        }
    }
}

/// Goal: a board runs a stream of coarse units as it was planned. Method: the simulator's steps, turned back into
/// poses; an evaluator of the wire's integers of its own.
fn runs_as_planned(plan: &Plan, times: f64) {
    let (stream, settings) = (&plan.stream, machine(times));
    assert_eq!(
        [stream.units.length_exponent, stream.units.volume_exponent],
        [6, 19]
    );
    let setup = SimulatorSetup::default();
    let run = dry_run(stream, &settings, &setup, |_| {}).unwrap();
    let (figures, trace) = (&run.simulation.figures, &run.trace);
    let limits = limit_oracle::sample(stream, &settings);
    println!("{figures:?}\n{trace:?}\n{limits:?}");
    assert_eq!(
        (figures.faults, figures.underruns, figures.holds),
        (0, 0, 0)
    );
    // As of the part in its own size: a tick's own rounding and the averaged parabola, `times` as large.
    assert!(trace.tip_error_um_max <= trace.half_step_um_max + 2.0 * times);
    assert!(trace.heading_error_mrad_max <= trace.half_step_mrad_max + 0.2);
    assert_eq!(trace.final_counts, trace.expected_counts);
    assert_eq!(trace.volume_error_pct, 0.0);
    assert!(limits.velocity.ratio <= 1.0 + 1e-6, "{limits:?}");
    assert!(limits.acceleration.ratio <= 1.0 + 1e-6, "{limits:?}");
    let oracle = Oracle::new(stream);
    let laid_mm3 = oracle.at(oracle.end_tick(), 0)[6] - oracle.at(0.0, 0)[6];
    let planned_mm3 = plan.figures.volume_mm3;
    // A unit of the volume.
    assert!(
        (laid_mm3 - planned_mm3).abs() <= 0.53,
        "{laid_mm3} {planned_mm3}"
    );
    let worst = sample_limits(stream, &settings, 1);
    assert!(worst.all() <= 1.0 + 1e-6, "{worst:?}");
}
