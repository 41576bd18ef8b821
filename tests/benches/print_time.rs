//! Seconds a layer of real slices beside a slicer's: the tables of `docs/measurements/print-time.md`.
//!
//! `cargo bench -p headway-tests --bench print_time -- [SPEED] [fine|standard|fast] [slow|quick]`: mm/s asked
//! (60), quality (standard), and another heading axis: `slow` has 200°/s, 1000°/s² and 10⁵°/s³, `quick` ten
//! times the jerk. A layer is (6 layers - 1 layer) / 5, so that neither the way from the machine's rest nor
//! the first lift counts. The slicer's times (`slicer_times.csv`, the better of its two wall generators) and
//! the slices are reference data beside the checkout. Prints, asserts nothing.

use headway::input::{Format, ReadOptions, read};
use headway::plan_target;
use headway::settings::{Quality, Settings};
use headway_tests::cpu_clock::process_s;
use headway_tests::folders::files;
use std::collections::HashMap;
use std::path::Path;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");

/// What one slice came to.
struct Outcome {
    name: String,
    slicer_s: f64,
    layer_s: f64,
    area_mm2: f64,
    covered_of_reachable_pct: f64,
    overlap_pct: f64,
    outside_um: f64,
    /// Deposited volume by covered area times height.
    volume: f64,
    cpu_s: f64,
}

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with('-'))
        .collect();
    let has = |word: &str| words.iter().any(|w| w == word);
    let numbers = words.iter().find_map(|word| word.parse::<f64>().ok());
    let settings = settings(numbers.unwrap_or(60.0), &has);
    let slicer = slicer_times(settings.speed_mm_s);
    let files = ["slices", "peer"].map(|folder| files(format!("{DATA}/{folder}"), "json"));
    let outcomes = files.iter().flatten().filter_map(|file| {
        let name = file.file_stem()?.to_str()?.to_string();
        let &slicer_s = slicer.get(&name)?;
        outcome(file, name, slicer_s, &settings)
    });
    table(&outcomes.collect::<Vec<_>>());
}

fn settings(speed_mm_s: f64, has: &dyn Fn(&str) -> bool) -> Settings {
    let mut settings = Settings {
        speed_mm_s,
        quality: match (has("fine"), has("fast")) {
            (true, _) => Quality::Fine,
            (_, true) => Quality::Fast,
            _ => Quality::Standard,
        },
        ..Settings::default()
    };
    let heading = settings
        .machine
        .joints
        .iter_mut()
        .rfind(|joint| joint.rotary);
    if let Some(heading) = heading {
        if has("slow") {
            heading.speed_max = 200f64.to_radians();
            heading.acceleration_max = 1000f64.to_radians();
            heading.jerk_max = 1e5f64.to_radians();
        } else if has("quick") {
            heading.jerk_max *= 10.0;
        }
    }
    settings
}

/// The better of both generators' seconds a layer, by slice.
fn slicer_times(speed_mm_s: f64) -> HashMap<String, f64> {
    let text = std::fs::read_to_string(format!("{DATA}/peer/slicer_times.csv")).unwrap_or_default();
    let rows = text.lines().filter_map(|line| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |i: usize| cells.get(i)?.parse::<f64>().ok();
        let at_speed = number(1)? == speed_mm_s;
        at_speed.then_some((cells[0].to_string(), number(3)?.min(number(7)?)))
    });
    rows.collect()
}

fn outcome(file: &Path, name: String, slicer_s: f64, settings: &Settings) -> Option<Outcome> {
    let bytes = std::fs::read(file).ok()?;
    let loaded = read(&bytes, &name, Format::Polygon, &ReadOptions::default()).ok()?;
    let planned = |layers: u32| {
        let settings = Settings {
            layers,
            ..settings.clone()
        };
        plan_target(&loaded.target, &settings)
    };
    let started_s = process_s();
    let one = planned(1).ok()?.figures;
    let cpu_s = process_s() - started_s;
    let six = planned(6).ok()?.figures;
    let covered_mm3 = one.area_mm2 * one.covered_pct / 100.0 * settings.layer_height_mm;
    Some(Outcome {
        name,
        slicer_s,
        layer_s: (six.print_s - one.print_s) / 5.0,
        area_mm2: one.area_mm2,
        covered_of_reachable_pct: one.covered_of_reachable_pct,
        overlap_pct: one.overlap_pct,
        outside_um: 1e3 * one.outside_depth_mm,
        volume: one.volume_mm3 / covered_mm3,
        cpu_s,
    })
}

fn table(outcomes: &[Outcome]) {
    println!(
        "| slice | slicer s | here s | here / slicer | covered of reachable % | overlap % | outside µm | \
         volume / covered | planning, CPU s |\n|{}",
        " --- |".repeat(9)
    );
    for o in outcomes {
        println!(
            "| {} | {:.1} | {:.1} | {:.2} | {:.2} | {:.2} | {:.2} | {:.4} | {:.2} |",
            o.name,
            o.slicer_s,
            o.layer_s,
            o.layer_s / o.slicer_s,
            o.covered_of_reachable_pct,
            o.overlap_pct,
            o.outside_um,
            o.volume,
            o.cpu_s
        );
    }
    let sum = |of: &dyn Fn(&Outcome) -> f64| outcomes.iter().map(of).sum::<f64>();
    let area_mm2 = sum(&|o| o.area_mm2);
    let mean = |of: &dyn Fn(&Outcome) -> f64| sum(&|o| o.area_mm2 * of(o)) / area_mm2;
    let (here_s, slicer_s) = (sum(&|o| o.layer_s), sum(&|o| o.slicer_s));
    let slower = outcomes.iter().filter(|o| o.layer_s > o.slicer_s).count();
    let most = |of: &dyn Fn(&Outcome) -> f64| outcomes.iter().map(of).fold(0.0, f64::max);
    println!(
        "| all {} (slower than the slicer: {slower}) | {slicer_s:.0} | {here_s:.0} | {:.3} | {:.2} | {:.2} | \
         {:.2} | {:.4} | {:.1} |",
        outcomes.len(),
        here_s / slicer_s,
        mean(&|o| o.covered_of_reachable_pct),
        mean(&|o| o.overlap_pct),
        most(&|o| o.outside_um),
        mean(&|o| o.volume),
        sum(&|o| o.cpu_s)
    );
}
