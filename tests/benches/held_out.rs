//! Parts that no constant of the planner was chosen on, planned with the turned ellipse and with a
//! round nozzle as wide as it is thin: the table of `docs/measurements/held-out.md`, and hunts beyond it.
//!
//! `cargo bench -p headway-tests --bench held_out` prints the held-out set;
//! `-- FROM TO [FAMILY]` the parts of these numbers with the ellipse only, worst figures marked.
//! Times are the processor's, of all threads. Prints, asserts nothing.

use headway::geometry::aperture::Aperture;
use headway::input::Target;
use headway::plan_target;
use headway::settings::Settings;
use headway_tests::cpu_clock::process_s;
use headway_tests::judge::{Judged, judge};
use headway_tests::parts::{FAMILIES, Part, held_out};
use std::panic::catch_unwind;

/// What one nozzle made of a part.
struct Outcome {
    judged: Judged,
    passes: usize,
    print_mm: f64,
    plan_s: f64,
}

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with('-'))
        .collect();
    let numbers: Vec<u64> = words.iter().filter_map(|w| w.parse().ok()).collect();
    match numbers[..] {
        [from, to] => {
            let chosen = |name: &str| words[2..].is_empty() || words[2..].iter().any(|w| w == name);
            for number in from..=to {
                for family in FAMILIES.iter().filter(|f| chosen(f.name)) {
                    hunted(&family.part(number));
                }
            }
        }
        _ => table(),
    }
}

fn ellipse(minor_mm: f64, major_mm: f64) -> Settings {
    Settings {
        aperture: Aperture::Ellipse { major_mm, minor_mm },
        ..Settings::default()
    }
}

fn outcome(part: &Part, settings: &Settings) -> Result<Outcome, String> {
    let target = Target {
        name: part.name.clone(),
        regions: part.regions.clone(),
    };
    let started_s = process_s();
    let plan = plan_target(&target, settings).map_err(|e| e.to_string())?;
    let plan_s = process_s() - started_s;
    Ok(Outcome {
        judged: judge(&plan, &part.regions, settings),
        passes: plan.figures.passes,
        print_mm: plan.figures.print_mm,
        plan_s,
    })
}

/// The held-out set against a round nozzle, and the sums.
fn table() {
    println!(
        "| part | area mm² | covered of reachable % | overlap % | outside µm | passes | print mm \
         | round: covered % | passes | print mm |"
    );
    println!("| --- |{}", " --- |".repeat(9));
    // Area, then covered, overlap, passes, path of the ellipse, and covered, passes, path of the
    // round one.
    let mut sums = [0.0; 8];
    for part in held_out() {
        let outcomes = [ellipse(0.2, 0.6), ellipse(0.2, 0.2)].map(|s| outcome(&part, &s));
        let [turned, round] = match outcomes {
            [Ok(turned), Ok(round)] => [turned, round],
            [turned, round] => {
                println!("| {} | {:?} {:?} |", part.name, turned.err(), round.err());
                continue;
            }
        };
        let found = &turned.judged.found;
        let covered = turned.judged.covered_of_reachable_pct;
        let of_round = round.judged.found.covered_pct / turned.judged.found.covered_pct * covered;
        println!(
            "| {} | {:.0} | {covered:.2} | {:.2} | {:.2} | {} | {:.0} | {of_round:.2} | {} | {:.0} |",
            part.name,
            found.area_mm2,
            found.overlap_pct,
            found.outside_depth_mm * 1e3,
            turned.passes,
            turned.print_mm,
            round.passes,
            round.print_mm,
        );
        let area = found.area_mm2;
        let row = [
            area,
            area * covered,
            area * found.overlap_pct,
            turned.passes as f64,
            turned.print_mm,
            area * of_round,
            round.passes as f64,
            round.print_mm,
        ];
        for (sum, value) in sums.iter_mut().zip(row) {
            *sum += value;
        }
    }
    let [
        area,
        covered,
        overlap,
        passes,
        mm,
        of_round,
        round,
        round_mm,
    ] = sums;
    println!(
        "area-weighted: covered {:.2} %, overlap {:.2} %, round {:.2} %; passes {passes} and \
         {round}; {:.1} and {:.1} m, {:.2} times",
        covered / area,
        overlap / area,
        of_round / area,
        mm / 1e3,
        round_mm / 1e3,
        round_mm / mm
    );
}

/// One line about a part, marked where it is outside what is asked.
fn hunted(part: &Part) {
    let outcome = catch_unwind(|| outcome(part, &ellipse(0.2, 0.6)));
    let outcome = match outcome {
        Ok(Ok(outcome)) => outcome,
        Ok(Err(error)) => return println!("!! {}: refused: {error}", part.name),
        Err(_) => return println!("!! {}: panicked", part.name),
    };
    let (found, covered) = (
        outcome.judged.found,
        outcome.judged.covered_of_reachable_pct,
    );
    let outside_um = found.outside_depth_mm * 1e3;
    let marks = [
        (outside_um > 2.0, "OUTSIDE"),
        (covered < 98.0, "COVERED"),
        (found.overlap_pct > 6.0, "OVERLAP"),
        (outcome.plan_s > 10.0, "SLOW"),
    ];
    let marks: Vec<&str> = marks.iter().filter(|m| m.0).map(|m| m.1).collect();
    println!(
        "{:20} area {:7.0} covered {covered:6.2} overlap {:5.2} outside {outside_um:6.2} passes {:3} \
         mm {:7.0} plan {:5.1} s {}",
        part.name,
        found.area_mm2,
        found.overlap_pct,
        outcome.passes,
        outcome.print_mm,
        outcome.plan_s,
        marks.join(" ")
    );
}
