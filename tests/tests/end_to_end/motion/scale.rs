//! Goal: a part with its machine, nozzle, layer and speeds made larger is planned alike: the same motion in other units.
//! Method: the built-in machine's file, each number by the unit that its key ends with, and two outlines, ten times as
//! large.

use headway::input::Target;
use headway::settings::{Settings, machine_file};
use headway::{Plan, plan_target};
use headway_tests::outlines::{example, region};

/// Print times of the same part in other sizes: rounding leads the planner to other seams, which are as good.
const TIME_RATIO_MAX: f64 = 1.03;
/// The same of what is covered, per cent.
const COVERED_PCT: f64 = 0.1;

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
                format!("aperture = \"ellipse:{}x{}\"", 0.6 * times, 0.2 * times)
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

#[test]
fn ten_times_as_large_is_the_same_print() {
    for name in ["u-part", "gear"] {
        let [small, large] = [1.0, 10.0].map(|times| planned(name, times));
        let ratio = large.figures.print_s / small.figures.print_s;
        let covered = [&small, &large].map(|plan| plan.figures.covered_of_reachable_pct);
        println!(
            "{name}: {:.3} and {:.3} s, {:.3} and {:.3} % covered",
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
        assert_eq!(small.figures.passes, large.figures.passes, "{name}");
        let volume = large.figures.volume_mm3 / small.figures.volume_mm3;
        assert!((volume / 1000.0 - 1.0).abs() < 2e-3, "{name}: {volume}");
    }
}
