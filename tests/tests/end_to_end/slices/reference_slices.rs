//! Goal: every real slice (by default every second one) plans and simulates within the figures below, the invalid ones are
//! refused with the place. Method: the whole way from file to steps; coverage, overlap and outside
//! depth by the oracle of `headway_tests::layer_oracle`, which knows only the knots. Slices are
//! reference data beside the checkout: without them the test says so and passes.

use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::input::{Format, ReadOptions, read};
use headway::plan_target;
use headway::settings::{Quality, Settings};
use headway_tests::folders::{files, skipped};
use headway_tests::judge::{judge, judge_finely};
use headway_tests::limit_oracle;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

const SLICES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/slices");
const PEER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/peer");

/// One row of the table.
struct Row {
    area_mm2: f64,
    covered_of_reachable_pct: f64,
    overlap_pct: f64,
}

/// Plans, simulates and checks one slice; `None` where it was refused.
fn run(file: &Path, settings: &Settings) -> Option<Row> {
    let name = file
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .to_string();
    let bytes = std::fs::read(file).expect("slice");
    let loaded = match read(&bytes, &name, Format::Polygon, &ReadOptions::default()) {
        Ok(loaded) => loaded,
        Err(error) => {
            let text = error.to_string();
            println!("| {name} | refused: {text} |");
            assert!(
                String::from_utf8_lossy(&bytes)
                    .replace(" ", "")
                    .contains("\"valid\":false"),
                "{name}: {text}"
            );
            assert!(
                text.contains(" at (") || text.contains("near ("),
                "no place in: {text}"
            );
            return None;
        }
    };
    let plan = plan_target(&loaded.target, settings).unwrap_or_else(|e| panic!("{name}: {e}"));
    let judged = judge(&plan, &loaded.target.regions, settings);
    let (found, of_reachable) = (judged.found, judged.covered_of_reachable_pct);
    let dry_run =
        dry_run(&plan.stream, settings, &SimulatorSetup::default(), |_| {}).expect("dry_run");
    let unreachable_mm: f64 = plan
        .regions()
        .iter()
        .flat_map(|r| &r.unreachable)
        .map(|run| run.length_mm())
        .sum();
    let (figures, trace) = (&dry_run.simulation.figures, &dry_run.trace);
    println!(
        "| {name} | {:.1} | {of_reachable:.2} | {:.2} | {:.2} | {} | {:.1} | {:.1} | {:.2} | {:.2} |",
        found.area_mm2,
        found.overlap_pct,
        found.outside_depth_mm * 1e3,
        plan.figures.passes,
        plan.figures.print_mm,
        plan.figures.print_s,
        trace.tip_error_um_max,
        unreachable_mm,
    );
    assert_eq!(figures.faults, 0, "{name}: {:?}", dry_run.simulation.fault);
    assert_eq!(trace.final_counts, trace.expected_counts, "{name}");
    assert!(
        trace.tip_error_um_max <= trace.half_step_um_max + 2.0,
        "{name}: {trace:?}"
    );
    assert!(found.outside_depth_mm <= 0.002, "{name}: {found:?}");
    // The floor of standard quality.
    assert!(of_reachable >= 97.5, "{name}: {found:?}");
    // The planner's own raster has to agree: half a per cent is its coarser border on the
    // smallest slices.
    assert!(
        (found.covered_pct - plan.figures.covered_pct).abs() < 0.5,
        "{name}: {found:?} against {:?}",
        plan.figures
    );
    let limits = limit_oracle::sample(&plan.stream, settings);
    let worst = limits.velocity.ratio.max(limits.acceleration.ratio);
    assert!(worst <= 1.0 + 1e-6, "{name}: {limits:?}");
    Some(Row {
        area_mm2: found.area_mm2,
        covered_of_reachable_pct: of_reachable,
        overlap_pct: found.overlap_pct,
    })
}

/// Runs these slices, and holds what all together are asked.
fn hold(files: &[PathBuf]) {
    let settings = Settings::default();
    println!(
        "| slice | area mm² | covered of reachable % | overlap % | outside µm | passes | print mm \
         | print s | tip error µm | unreachable mm |"
    );
    let rows: Vec<Row> = files
        .par_iter()
        .filter_map(|file| run(file, &settings))
        .collect();
    if files.is_empty() {
        return;
    }
    assert_eq!(
        files.len() - rows.len(),
        2,
        "two slices are invalid on purpose"
    );
    let area: f64 = rows.iter().map(|r| r.area_mm2).sum();
    let mean =
        |value: fn(&Row) -> f64| rows.iter().map(|r| r.area_mm2 * value(r)).sum::<f64>() / area;
    let covered = mean(|r| r.covered_of_reachable_pct);
    let overlap = mean(|r| r.overlap_pct);
    println!("area-weighted: covered of reachable {covered:.2} %, overlap {overlap:.2} %");
    // The floors of standard quality: what is left open beyond saves more time than it is worth.
    assert!(covered >= 99.5, "covered of reachable {covered:.2} %");
    assert!(overlap <= 0.5, "overlap {overlap:.2} %");
}

/// The sample: every second slice by name. The two invalid ones, the smallest (4 mm²) and the lattice that takes longest
/// are among them.
#[test]
fn every_second_slice_plans_and_simulates_within_the_figures() {
    let files: Vec<PathBuf> = files(SLICES, "json").into_iter().step_by(2).collect();
    hold(&files);
}

#[test]
#[ignore = "twice the time of every second one; run by name when the planner changes"]
fn every_slice_plans_and_simulates_within_the_figures() {
    hold(&files(SLICES, "json"));
}

/// What is asked of a part that a slicer sliced for a round nozzle of 0.4 mm.
struct Asked {
    part: &'static str,
    passes_max: usize,
    /// At standard and at fine quality.
    covered_pct_min: [f64; 2],
    overlap_pct_max: f64,
}

const ASKED: [Asked; 2] = [
    Asked {
        part: "gear",
        passes_max: 8,
        covered_pct_min: [98.0, 99.2],
        overlap_pct_max: 2.5,
    },
    Asked {
        part: "uwall",
        passes_max: 3,
        covered_pct_min: [99.0, 99.6],
        overlap_pct_max: 2.5,
    },
];

/// Goal: the two parts that slicers were measured on keep the figures asked of them at both qualities. Method:
/// the same oracle, with closer poses.
#[test]
fn parts_of_the_peers_are_covered_in_fewer_passes() {
    let qualities = [Quality::Standard, Quality::Fine];
    for (asked, which) in ASKED
        .iter()
        .flat_map(|asked| [0, 1].map(|which| (asked, which)))
    {
        let part = asked.part;
        let settings = Settings {
            quality: qualities[which],
            ..Settings::default()
        };
        let file = Path::new(PEER).join(format!("{part}.json"));
        let Ok(bytes) = std::fs::read(&file) else {
            skipped(file.display());
            continue;
        };
        let loaded =
            read(&bytes, part, Format::Polygon, &ReadOptions::default()).expect("a valid part");
        let plan = plan_target(&loaded.target, &settings).expect("a plan");
        let judged = judge_finely(&plan, &loaded.target.regions, &settings);
        let figures = format!("{part}: {} passes, {judged:?}", plan.figures.passes);
        println!("{figures}");
        assert!(plan.figures.passes <= asked.passes_max, "{figures}");
        assert!(
            judged.covered_of_reachable_pct >= asked.covered_pct_min[which],
            "{figures}"
        );
        assert!(
            judged.found.overlap_pct <= asked.overlap_pct_max,
            "{figures}"
        );
        assert!(judged.found.outside_depth_mm <= 0.002, "{figures}");
    }
}
