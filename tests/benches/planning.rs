//! How planning grows with the outline: each stage at 1,000, 10,000 and 100,000 edges, the growth's
//! exponent, and the process's peak memory. Processor time of all threads, whole plans also against
//! a sort of ten million numbers in the same run.
//!
//! Run with `cargo bench -p headway-tests --bench planning [-- NAME]`. Prints, asserts nothing.

use headway::geometry::edge_index::EdgeIndex;
use headway::input::Target;
use headway::plan::axis::medial_axis::{AxisOptions, MedialAxis};
use headway::plan::axis::pruned_axis::Axis;
use headway::plan::beads::passes::{PassSettings, passes};
use headway::plan::headings::profile::TURN_WEIGHT_MM4;
use headway::plan::outline::contour::{Contour, SIMPLIFY_MM};
use headway::plan_target;
use headway::settings::Settings;
use headway_tests::cpu_clock::process_s;
use headway_tests::layer_oracle::Rings;
use headway_tests::outlines::{
    Noise, coast, comb, edge_count, fine_gear, fine_ring, gear, noisy_ring, region,
};
use std::f64::consts::TAU;
use std::time::Instant;

const SIZES: [usize; 3] = [1_000, 10_000, 100_000];

fn main() {
    let only: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with('-'))
        .collect();
    let chosen = |name: &str| only.is_empty() || only.iter().any(|o| name.contains(o.as_str()));
    type Make = fn(usize) -> Rings;
    let growing: [(&str, Make); 4] = [
        ("gear", gear),
        ("solid gear", |n| gear(n)[..1].to_vec()),
        ("noisy", |n| noisy_ring(n, 0.005)),
        ("comb", comb),
    ];
    println!("part grows with the outline: seconds for contour, axis, pruned, passes");
    for (name, make) in growing {
        if chosen(name) {
            let times: Vec<f64> = SIZES
                .iter()
                .map(|&n| stages(name, &make(n), n <= 1_000))
                .collect();
            print_growth(&times);
        }
    }
    let fine: [(&str, Make); 2] = [
        ("fine gear", fine_gear),
        ("fine ring, 5 um of noise", |n| fine_ring(n, 0.005)),
    ];
    let sort_s = sort_s();
    println!("reference: {sort_s:.2} s to sort ten million numbers (standard library, one thread)");
    println!("part of 60 mm, drawn finer and finer: seconds for the whole plan");
    for (name, make) in fine {
        if chosen(name) {
            let times: Vec<f64> = SIZES
                .iter()
                .map(|&n| whole(name, &make(n), sort_s))
                .collect();
            print_growth(&times);
        }
    }
    println!("coast of 2,800 edges, smaller and smaller: bays far below the nozzle in the end");
    for across_mm in [100.0, 30.0, 15.0] {
        if chosen("coast") {
            whole(
                &format!("coast of {across_mm} mm"),
                &coast(2_800, across_mm),
                sort_s,
            );
        }
    }
    println!("large parts");
    type Part = fn() -> Rings;
    let large: [(&str, Part); 3] = [
        ("square of 240 mm with a hole", square_with_hole),
        ("plate of 10,000 holes", plate_of_holes),
        ("star of 10,000 teeth", star_of_teeth),
    ];
    for (name, make) in large {
        if chosen(name) {
            whole(name, &make(), sort_s);
        }
    }
}

/// A circle in so many chords, mm; clockwise for a hole.
fn circle(center: [f64; 2], radius_mm: f64, chords: usize, clockwise: bool) -> Vec<[f64; 2]> {
    let turn = if clockwise { -TAU } else { TAU };
    let point = |k: usize| {
        let (sin, cos) = (turn * k as f64 / chords as f64).sin_cos();
        [center[0] + radius_mm * cos, center[1] + radius_mm * sin]
    };
    (0..chords).map(point).collect()
}

fn square(side_mm: f64) -> Vec<[f64; 2]> {
    vec![
        [0.0, 0.0],
        [side_mm, 0.0],
        [side_mm, side_mm],
        [0.0, side_mm],
    ]
}

fn square_with_hole() -> Rings {
    vec![square(240.0), circle([120.0, 120.0], 40.0, 120, true)]
}

/// 300 x 300 mm, holes of 1 mm every 3 mm.
fn plate_of_holes() -> Rings {
    let at = |k: usize| 1.5 + 3.0 * k as f64;
    let holes = (0..10_000).map(|k| circle([at(k % 100), at(k / 100)], 0.5, 16, true));
    std::iter::once(square(300.0)).chain(holes).collect()
}

/// 30 mm across, teeth of 0.5 mm that no nozzle enters.
fn star_of_teeth() -> Rings {
    let point = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / 20_000.0).sin_cos();
        let radius_mm = if k.is_multiple_of(2) { 15.0 } else { 14.5 };
        [radius_mm * cos, radius_mm * sin]
    };
    vec![(0..20_000).map(point).collect()]
}

/// What the figures are held against: other machines and busy ones sort more slowly too.
fn sort_s() -> f64 {
    let mut noise = Noise::new(1);
    let mut numbers: Vec<f64> = (0..10_000_000).map(|_| noise.share()).collect();
    let started = process_s();
    numbers.sort_unstable_by(f64::total_cmp);
    assert!(numbers.is_sorted());
    process_s() - started
}

fn print_growth(times: &[f64]) {
    let exponents: Vec<String> = times
        .windows(2)
        .map(|w| format!("{:.2}", (w[1] / w[0]).log10()))
        .collect();
    println!("  growth exponents {}", exponents.join(", "));
}

/// Times of the stages whose work follows the outline; returns that of contour and axis.
fn stages(name: &str, rings: &Rings, with_passes: bool) -> f64 {
    let settings = Settings::default();
    let mut marks = vec![process_s()];
    let contour = Contour::of_region(&region(rings), SIMPLIFY_MM).expect(name);
    marks.push(process_s());
    let walls: EdgeIndex = contour.edge_index(settings.aperture.major_mm());
    let axis = MedialAxis::of_edges(&walls, &AxisOptions::default()).expect(name);
    marks.push(process_s());
    let pruned = Axis::of_medial_axis(&axis, &settings.aperture);
    marks.push(process_s());
    let pass_settings = PassSettings {
        aperture: settings.aperture,
        overlap: 0.0,
        one_pass: false,
        law: settings.heading_law,
        turn_weight_mm4: TURN_WEIGHT_MM4,
    };
    let count = if with_passes {
        passes(&contour.region, &walls, &pruned, &pass_settings).len()
    } else {
        0
    };
    marks.push(process_s());
    let times: Vec<f64> = marks.windows(2).map(|w| w[1] - w[0]).collect();
    println!(
        "{name}, {} edges ({} after cleaning): {:.3} {:.3} {:.3} {:.3} s ({count} passes), axis edges \
         {}, dropped {}, peak memory {} MB",
        edge_count(rings),
        walls.edges().len(),
        times[0],
        times[1],
        times[2],
        times[3],
        axis.edges.len(),
        axis.dropped_edges,
        peak_memory_mb()
    );
    times[0] + times[1] + times[2]
}

fn whole(name: &str, rings: &Rings, sort_s: f64) -> f64 {
    let target = Target {
        name: name.to_string(),
        regions: vec![region(rings)],
    };
    let (started, started_cpu) = (Instant::now(), process_s());
    let plan = plan_target(&target, &Settings::default()).expect(name);
    let (wall_s, seconds) = (started.elapsed().as_secs_f64(), process_s() - started_cpu);
    println!(
        "{name}, {} edges, {:.0} mm²: {seconds:.2} s ({wall_s:.2} s on the wall), {:.1} times the reference, {} passes, {:.0} mm printed, covered {:.2} %, \
         peak memory {} MB",
        edge_count(rings),
        plan.figures.area_mm2,
        seconds / sort_s,
        plan.figures.passes,
        plan.figures.print_mm,
        plan.figures.covered_of_reachable_pct,
        peak_memory_mb()
    );
    seconds
}

/// Most memory the process has had, as the system tells it; 0 where it does not.
fn peak_memory_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM"));
    line.and_then(|l| l.split_whitespace().nth(1)?.parse::<u64>().ok())
        .map_or(0, |kb| kb / 1024)
}
