//! Goal: a nozzle whose hoses wind up keeps within its turns, counted from the index, and it is said where it turns
//! back. Method: rows of rings, each a turn, on a machine with random numbers of turns; the heading of every control
//! point on the wire against the range, travels that turn back against what is reported.

use headway::input::{Format, ReadOptions, read};
use headway::pipeline::findings::unwinding::unwindings;
use headway::plan_target;
use headway::settings::machine_file;
use headway_protocol::units::{CHANNEL_HEADING, UNITS_PER_NATURAL};
use rand::{RngExt, SeedableRng};
use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

/// A planar machine whose nozzle turns so far either way.
fn machine(turns_max: f64) -> headway::settings::Settings {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/machines/planar.toml");
    let text = std::fs::read_to_string(path).unwrap();
    let wound = format!("[joints.c]\nturns_max = {turns_max}");
    machine_file::from_toml(&text.replace("[joints.c]", &wound)).unwrap()
}

/// So many square rings in a row, as GeoJSON.
fn rings(count: usize, side_mm: f64) -> String {
    let mut text = String::from("{\"type\":\"FeatureCollection\",\"features\":[");
    for ring in 0..count {
        let (x, half) = (ring as f64 * (side_mm + 6.0), 0.5 * side_mm);
        let square = |half: f64| {
            let corner = |sx: f64, sy: f64| format!("[{},{}]", x + sx * half, sy * half);
            [
                (-1.0, -1.0),
                (1.0, -1.0),
                (1.0, 1.0),
                (-1.0, 1.0),
                (-1.0, -1.0),
            ]
            .map(|(sx, sy)| corner(sx, sy))
            .join(",")
        };
        let comma = if ring > 0 { "," } else { "" };
        write!(
            text,
            "{comma}{{\"type\":\"Feature\",\"properties\":{{}},\"geometry\":{{\"type\":\"Polygon\",\"coordinates\":[[{}],[{}]]}}}}",
            square(half),
            square(half - 1.6)
        )
        .unwrap();
    }
    text + "]}"
}

fn campaign(cases: usize) {
    let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(5);
    let mut turned_back = 0;
    for case in 0..cases {
        let turns_max: f64 = random.random_range(0.6..2.5);
        let settings = machine(turns_max);
        let text = rings(random.random_range(2..6), random.random_range(8.0..14.0));
        let loaded = read(
            text.as_bytes(),
            "rings",
            Format::GeoJson,
            &ReadOptions::default(),
        )
        .unwrap();
        let plan = plan_target(&loaded.target, &settings).unwrap();
        let units = UNITS_PER_NATURAL[CHANNEL_HEADING];
        let turns = |heading: i32| f64::from(heading) / units / TAU;
        for knot in &plan.stream.knots {
            let turns = turns(knot.control[CHANNEL_HEADING]);
            assert!(
                turns.abs() <= turns_max + 1e-3,
                "case {case}: {turns} of {turns_max}"
            );
        }
        let told = unwindings(&plan.route, &settings);
        turned_back += told.len();
        // Every one goes from one side towards the other, and none is larger than the range.
        for unwinding in &told {
            assert!(unwinding.turns.abs() > 0.5 && unwinding.turns.abs() <= 2.0 * turns_max);
        }
        assert_eq!(
            unwindings(&plan.route, &headway::settings::Settings::planar()),
            []
        );
    }
    println!("{cases} cases, turned back {turned_back} times");
    assert!(turned_back > 0, "nothing was to be unwound");
}

#[test]
fn a_nozzle_with_hoses_keeps_within_its_turns() {
    campaign(4);
}

#[test]
#[ignore = "a thousand plans take minutes; run by name"]
fn a_thousand_nozzles_with_hoses_keep_within_their_turns() {
    campaign(1000);
}
