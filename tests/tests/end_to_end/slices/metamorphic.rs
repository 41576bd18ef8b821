//! The same part given another way is planned the same: shifted, turned, mirrored, with points
//! doubled or added on straight edges, begun elsewhere, with the holes in another order.

use headway::geometry::Point2;
use headway::geometry::polygon::Region;
use headway::input::{Format, ReadOptions, Target, Units, read};
use headway::plan_target;
use headway::settings::Settings;
use headway_tests::folders::skipped;
use headway_tests::judge::print_without_approach_s;
use headway_tests::layer_oracle::Rings;
use headway_tests::outlines::{example, region};
use headway_tests::parts::held_out;
use rayon::prelude::*;

/// Change of the printing time that is allowed: 2 % but for the U-part, mirrored and turned (2.2 %), where
/// one place of 0.1 s is slowed less.
const TIME_SHARE: f64 = 0.025;
const POLYGONS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/polygons");

const PARTS: [&str; 5] = ["u-part", "taper", "bracket", "gear", "thin-web"];

struct Outcome {
    name: String,
    passes: usize,
    print_s: f64,
    print_mm: f64,
    covered_pct: f64,
}

fn mapped(rings: &Rings, map: impl Fn([f64; 2]) -> [f64; 2]) -> Rings {
    let ring = |points: &Vec<[f64; 2]>| points.iter().map(|&p| map(p)).collect();
    rings.iter().map(ring).collect()
}

fn turned(rings: &Rings, angle_rad: f64) -> Rings {
    let (sin, cos) = angle_rad.sin_cos();
    mapped(rings, |[x, y]| [x * cos - y * sin, x * sin + y * cos])
}

/// Every edge with two more points on it.
fn with_points(rings: &Rings, shares: &[f64]) -> Rings {
    let ring = |points: &Vec<[f64; 2]>| {
        let mut more = Vec::new();
        for (i, &p) in points.iter().enumerate() {
            let q = points[(i + 1) % points.len()];
            more.push(p);
            for t in shares {
                more.push([p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
            }
        }
        more
    };
    rings.iter().map(ring).collect()
}

fn ways(rings: &Rings) -> Vec<(&'static str, Rings)> {
    let begun = |points: &Vec<[f64; 2]>| {
        let mut points = points.clone();
        let third = points.len() / 3;
        points.rotate_left(third);
        points
    };
    let back = |points: &Vec<[f64; 2]>| points.iter().rev().copied().collect::<Vec<_>>();
    let mirrored = mapped(rings, |[x, y]| [-x, y]);
    let mut holes_reversed = rings.clone();
    holes_reversed[1..].reverse();
    vec![
        ("as it is", rings.clone()),
        (
            "shifted by 1.4 km",
            mapped(rings, |[x, y]| [x + 1e6, y - 1e6]),
        ),
        (
            "turned by 90 deg",
            turned(rings, std::f64::consts::FRAC_PI_2),
        ),
        ("turned by 17 deg", turned(rings, 0.3)),
        ("turned by 143 deg", turned(rings, 2.5)),
        ("mirrored", mirrored.iter().map(back).collect()),
        (
            "mirrored and turned",
            turned(&mirrored.iter().map(back).collect(), 1.0),
        ),
        ("begun elsewhere", rings.iter().map(begun).collect()),
        ("holes in reverse", holes_reversed),
        ("points on edges", with_points(rings, &[0.25, 0.8])),
        ("points doubled", with_points(rings, &[0.0])),
    ]
}

fn outcome(name: &str, rings: &Rings) -> Outcome {
    let regions: Vec<Region> = vec![region(rings)];
    let target = Target {
        name: name.to_string(),
        regions,
    };
    let settings = Settings::default();
    let plan = plan_target(&target, &settings).expect(name);
    Outcome {
        name: name.to_string(),
        passes: plan.figures.passes,
        print_s: print_without_approach_s(&plan, &settings),
        print_mm: plan.figures.print_mm,
        covered_pct: plan.figures.covered_pct,
    }
}

/// Goal: time from the first prime on within 2.5 %, path length within 0.5 %, coverage within 0.1: rounding
/// may choose between optima that are alike. Method: each part planned whole, in every way.
///
/// By default each part in four of the ways and each way with two of the parts.
#[test]
fn the_same_part_is_planned_the_same() {
    for (index, part) in PARTS.iter().enumerate() {
        let mut ways = ways(&example(part));
        let own = ways.remove(0);
        let mut asked = vec![own];
        let others = ways.into_iter().enumerate();
        let kept = others.filter(|(way, _)| [0, 2].contains(&((way + 2 * index) % PARTS.len())));
        asked.extend(kept.map(|(_, way)| way));
        assert_eq!(asked.len(), 5);
        is_planned_the_same(part, &asked);
    }
}

#[test]
#[ignore = "a minute; run by name when frames, outlines or ties change"]
fn the_same_part_is_planned_the_same_in_every_way() {
    for part in PARTS {
        is_planned_the_same(part, &ways(&example(part)));
    }
}

/// Goal: neither does rounding choose where a part is symmetric, up to the last digits (a hinge leaf, a
/// truss), or its teeth are alike (gears): these differed by up to 3.4 % of path and 0.3 of coverage.
/// Method: the way whose digits differ most; the others by name.
#[test]
fn symmetric_parts_are_planned_the_same() {
    let asked = ["as it is", "mirrored and turned"];
    symmetric_parts_in(|way| asked.contains(&way));
}

#[test]
#[ignore = "minutes; run by name"]
fn symmetric_parts_are_planned_the_same_in_every_way() {
    symmetric_parts_in(|_| true);
}

fn symmetric_parts_in(is_asked: impl Fn(&str) -> bool) {
    let parts = held_out();
    for name in ["gear 1", "gear 2", "hinge leaf 1", "truss 1"] {
        let part = parts.iter().find(|part| part.name == name).expect(name);
        let mut ways = ways(&rings_of(&part.regions[0]));
        ways.retain(|(way, _)| is_asked(way));
        is_planned_the_same(name, &ways);
    }
}

/// Goal: neither do needless points choose which points of a fine curve are kept: a blade differed by
/// 0.28 % of path, a cookie cutter by 0.06 of coverage. Method: points on the edges.
#[test]
fn fine_curves_with_points_on_edges_are_planned_the_same() {
    let parts = held_out();
    for name in ["blade 2", "cookie cutter 1", "hook 2"] {
        let part = parts.iter().find(|part| part.name == name).expect(name);
        let rings = rings_of(&part.regions[0]);
        let with_points = with_points(&rings, &[0.25, 0.8]);
        is_planned_the_same(
            name,
            &[("as it is", rings), ("points on edges", with_points)],
        );
    }
}

fn rings_of(region: &Region) -> Rings {
    let ring = |points: &[Point2]| points.iter().map(|p| [p.x, p.y]).collect();
    region.rings().map(|r| ring(&r.points)).collect()
}

/// Goal: neither does from which end a pass is gone along, nor by how many turns its headings are
/// counted on: a coast differed by 0.13 % of path, taken off its walls another way. Method: the
/// reference polygon, 80 mm across; skipped where it is not there.
#[test]
fn a_coast_is_planned_the_same() {
    a_coast_in(|way| way == "mirrored and turned");
}

#[test]
#[ignore = "a minute; run by name when frames, outlines or ties change"]
fn a_coast_is_planned_the_same_in_every_way() {
    // Far away its 2,500 points have lost digits that count on the grid.
    a_coast_in(|way| way.contains("turned") || way.contains("mirrored"));
}

fn a_coast_in(is_asked: impl Fn(&str) -> bool) {
    let name = "ne50m_land_2";
    let Some(rings) = reference_polygon(name) else {
        return;
    };
    let mut ways = ways(&rings);
    ways.retain(|(way, _)| *way == "as it is" || is_asked(way));
    is_planned_the_same(name, &ways);
}

/// Goal: neither does a coordinate that comes out a step beside where it is settled: it turned the
/// frame that water was planned in and moved all others, by 0.26 % of path. Method: the same, shifted
/// by what leaves its digits but for one.
#[test]
#[ignore = "40 s of a processor; run by name when frames or the grid of coordinates change"]
fn a_coordinate_settled_beside_is_planned_the_same() {
    let name = "water";
    let Some(rings) = reference_polygon(name) else {
        return;
    };
    let shifted = mapped(&rings, |[x, y]| [x + 1234.567, y - 765.4]);
    is_planned_the_same(name, &[("as it is", rings), ("shifted by 1.5 m", shifted)]);
}

/// A reference polygon of one region, 80 mm across; none, and a message, where it is not there.
fn reference_polygon(name: &str) -> Option<Rings> {
    let Ok(bytes) = std::fs::read(format!("{POLYGONS}/{name}.json")) else {
        skipped(POLYGONS);
        return None;
    };
    let options = ReadOptions {
        units: Some(Units::Mm),
        repair: true,
        ..ReadOptions::default()
    };
    let loaded = read(&bytes, name, Format::Polygon, &options).expect(name);
    let region = &loaded.target.regions[0];
    let bounds = region.bounds();
    let (low, size) = (bounds.min, bounds.size());
    let scale = 80.0 / size.x.max(size.y);
    let scaled = |[x, y]: [f64; 2]| [(x - low.x) * scale, (y - low.y) * scale];
    Some(mapped(&rings_of(region), scaled))
}

fn is_planned_the_same(part: &str, ways: &[(&str, Rings)]) {
    let outcomes: Vec<Outcome> = ways
        .par_iter()
        .map(|(name, rings)| outcome(name, rings))
        .collect();
    let own = &outcomes[0];
    for o in &outcomes {
        println!(
            "{part} {}: {:.2} s, {} passes, {:.3} mm ({:+.3} %), covered {:.3} ({:+.3})",
            o.name,
            o.print_s,
            o.passes,
            o.print_mm,
            100.0 * (o.print_mm / own.print_mm - 1.0),
            o.covered_pct,
            o.covered_pct - own.covered_pct
        );
        let slower = o.print_s / own.print_s - 1.0;
        assert!(slower.abs() <= TIME_SHARE, "{part} {}: {slower}", o.name);
        let longer = o.print_mm / own.print_mm - 1.0;
        assert!(longer.abs() <= 5e-3, "{part} {}: {longer}", o.name);
        let covered = o.covered_pct - own.covered_pct;
        assert!(covered.abs() <= 0.1, "{part} {}: {covered}", o.name);
    }
}
