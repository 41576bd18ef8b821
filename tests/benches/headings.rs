//! How fast F(p) is found, on one core: samples a second on outlines of about 1,000 edges, and the
//! ratio to the published dense search over 8 million configurations on the same shape. Processor
//! time.
//!
//! Run with `cargo bench -p headway-tests --bench headings`. Prints, asserts nothing.

use headway::geometry::aperture::Aperture;
use headway::geometry::edge_index::EdgeIndex;
use headway::plan::feasible::feasible_angles;
use headway::plan::headings::headings_table::{HeadingsRequest, headings_table};
use headway::settings::aperture_text::parse_aperture;
use headway::settings::{HeadingLaw, PassMode};
use headway_tests::cpu_clock::thread_s;
use headway_tests::dense_search::{DenseSearch, SIDE};
use headway_tests::layer_oracle::Rings;
use headway_tests::outlines::{edge_count, gear, noisy_ring, region};
use std::hint::black_box;

const AXES_MM: [f64; 2] = [0.6, 0.2];

fn slices() -> Vec<(String, Rings)> {
    let circle = (0..400)
        .map(|i| (f64::from(i) * std::f64::consts::TAU / 400.0).sin_cos())
        .map(|(sin, cos)| [1.5 * cos, 1.5 * sin])
        .collect();
    let mut all = vec![
        ("gear, 1,000 edges".to_string(), gear(960)),
        (
            "noisy ring 20 um, 1,000 edges".to_string(),
            noisy_ring(1000, 0.02),
        ),
        ("circle r 1.5 mm, 400 facets".to_string(), vec![circle]),
    ];
    let name = "jet-engine-Nozzle-No-Supports_z17700_c0";
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/slices");
    match std::fs::read_to_string(format!("{folder}/{name}.json")) {
        Ok(text) => {
            let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
            let ring = |value: &serde_json::Value| -> Vec<[f64; 2]> {
                serde_json::from_value(value.clone()).expect("a ring of points")
            };
            let mut rings = vec![ring(&json["exterior"])];
            rings.extend(json["holes"].as_array().expect("holes").iter().map(ring));
            all.push((name.to_string(), rings));
        }
        Err(_) => println!("skipped: no reference slices"),
    }
    all
}

/// Microseconds a sample for the whole table and for F(p) alone.
fn times_us(rings: &Rings, aperture: Aperture) -> (usize, f64, f64) {
    let region = region(rings);
    let request = HeadingsRequest {
        aperture,
        spacing_mm: 0.05,
        pass: PassMode::Two,
        law: HeadingLaw::Tangent,
    };
    let started = thread_s();
    let rows = black_box(headings_table(&region, &request));
    let table_us = (thread_s() - started) * 1e6 / rows.len() as f64;
    let walls = EdgeIndex::of_region(&region, aperture.major_mm());
    let started = thread_s();
    for row in &rows {
        black_box(feasible_angles(&aperture, &walls, row.point, row.normal));
    }
    let query_us = (thread_s() - started) * 1e6 / rows.len() as f64;
    (rows.len(), table_us, query_us)
}

fn main() {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let [major_mm, minor_mm] = AXES_MM;
    let ellipse = Aperture::Ellipse { major_mm, minor_mm };
    one.expect("a thread").install(|| {
        for (name, rings) in slices() {
            let (samples, table_us, query_us) = times_us(&rings, ellipse);
            println!(
                "{name} ({} edges), ellipse: {samples} samples, table {table_us:.2} us a sample = \
                 {:.0} a second; F(p) alone {query_us:.2} us = {:.0} a second",
                edge_count(&rings),
                1e6 / table_us,
                1e6 / query_us
            );
            for text in ["stadium:1.2x0.4", "rect:1.2x0.4x0.05"] {
                let (_, _, query_us) = times_us(&rings, parse_aperture(text).expect(text));
                println!("  {text}: F(p) {query_us:.2} us");
            }
            compare_with_dense(&rings, ellipse, query_us);
        }
    });
}

/// The dense search on the same shape: its P once, then all its configurations for each sample.
fn compare_with_dense(rings: &Rings, aperture: Aperture, query_us: f64) {
    let walls = EdgeIndex::of_region(&region(rings), aperture.major_mm());
    let edge = walls.edges()[walls.edges().len() / 3];
    let p = edge.a + (edge.b - edge.a) * 0.5;
    let started = thread_s();
    let search = DenseSearch::new(rings, AXES_MM, [p.x, p.y], 1.6);
    let grid_s = thread_s() - started;
    let started = thread_s();
    let rounds = 5;
    for _ in 0..rounds {
        black_box(search.headings_at(black_box([p.x, p.y])));
    }
    let dense_us = (thread_s() - started) * 1e6 / f64::from(rounds);
    println!(
        "  dense search, {} configurations: {dense_us:.0} us a sample (its P found before, {grid_s:.1} \
         s for one window): {:.0} times ours",
        SIDE * SIDE * SIDE,
        dense_us / query_us
    );
}
