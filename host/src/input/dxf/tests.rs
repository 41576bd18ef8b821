//! Goal: contours of DXF drawings are read with the areas that they are drawn with, and anything
//! that is not an outline is refused with reason and place. Method: drawings written here pair by
//! pair; areas from formulas; bounds from the flattening's tolerance, 1 µm along the perimeter.

use crate::geometry::polygon::Region;
use crate::input::{Format, Loaded, ReadOptions, Units, read};
use crate::text::refusal::Refusal;
use std::f64::consts::PI;

fn pairs(given: &[(i32, &str)]) -> String {
    let each = given
        .iter()
        .map(|(code, value)| format!("{code}\n{value}\n"));
    each.collect()
}

fn entity(kind: &str, numbers: &[(i32, f64)]) -> String {
    on("0", kind, numbers)
}

fn on(layer: &str, kind: &str, numbers: &[(i32, f64)]) -> String {
    let head = pairs(&[(0, kind), (8, layer)]);
    let each = numbers.iter().map(|&(code, number)| match code {
        70..=79 | 62 | 67 => format!("{code}\n{number:.0}\n"),
        _ => format!("{code}\n{number:?}\n"),
    });
    head + &each.collect::<String>()
}

fn line(a: [f64; 2], b: [f64; 2]) -> String {
    let ends = [(10, a[0]), (20, a[1]), (11, b[0]), (21, b[1])];
    entity("LINE", &ends)
}

fn circle(layer: &str, x: f64, y: f64, radius: f64) -> String {
    on(layer, "CIRCLE", &[(10, x), (20, y), (40, radius)])
}

/// A closed polyline, corners with bulges.
fn ring(layer: &str, corners: &[[f64; 3]]) -> String {
    let mut numbers = vec![(70, 1.0)];
    for [x, y, bulge] in corners {
        numbers.extend([(10, *x), (20, *y), (42, *bulge)]);
    }
    on(layer, "LWPOLYLINE", &numbers)
}

fn rectangle(layer: &str, x: f64, y: f64) -> String {
    let corners = [[0.0; 3], [x, 0.0, 0.0], [x, y, 0.0], [0.0, y, 0.0]];
    ring(layer, &corners)
}

fn slot() -> String {
    let corners = [
        [20.0, 20.0, 0.0],
        [40.0, 20.0, 1.0],
        [40.0, 30.0, 0.0],
        [20.0, 30.0, 1.0],
    ];
    ring("0", &corners)
}

fn file(units: Option<i32>, layers: &str, entities: &str) -> String {
    let units = units.map_or(String::new(), |units| {
        format!("0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n{units:6}\n0\nENDSEC\n")
    });
    let tables = "0\nSECTION\n2\nTABLES\n0\nTABLE\n2\nLAYER\n";
    format!(
        "{units}{tables}{layers}0\nENDTAB\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{entities}0\nENDSEC\n0\nEOF\n"
    )
}

fn layer(name: &str, flags: &str, colour: &str) -> String {
    pairs(&[(0, "LAYER"), (2, name), (70, flags), (62, colour)])
}

fn load(text: &str, options: &ReadOptions) -> Result<Loaded, Refusal> {
    read(text.as_bytes(), "part", Format::Dxf, options)
}

fn loaded(entities: &str) -> Loaded {
    load(&file(Some(4), "", entities), &ReadOptions::default()).unwrap()
}

fn refused(entities: &str) -> String {
    let text = file(Some(4), "", entities);
    let refused = load(&text, &ReadOptions::default()).unwrap_err();
    refused.to_string()
}

fn area(loaded: &Loaded) -> f64 {
    loaded.target.regions.iter().map(Region::area_mm2).sum()
}

/// The area within a micrometre of the perimeter.
fn has_area(loaded: &Loaded, area_mm2: f64) {
    let rings = loaded.target.regions.iter().flat_map(Region::rings);
    let edges = rings.flat_map(|ring| ring.edges().map(|(a, b)| (b - a).norm()));
    let bound = 0.001 * edges.sum::<f64>();
    let found = area(loaded);
    assert!((found - area_mm2).abs() <= bound, "{found} for {area_mm2}");
}

fn notes_have(loaded: &Loaded, part: &str) {
    let notes = loaded.notes.join("\n");
    assert!(notes.contains(part), "`{part}` in {notes}");
}

#[test]
fn a_plate_with_a_slot_and_a_hole() {
    let drawn = rectangle("0", 100.0, 50.0) + &slot() + &circle("0", 70.0, 25.0, 4.0);
    let loaded = loaded(&drawn);
    assert_eq!(loaded.target.regions.len(), 1);
    assert_eq!(loaded.target.regions[0].holes.len(), 2);
    has_area(&loaded, 5000.0 - (200.0 + 25.0 * PI) - 16.0 * PI);
    assert!(loaded.notes.iter().all(|note| !note.contains("units")));
    // The chords are on the arc: no point is further from its centre than the radius.
    let far = loaded.target.regions[0]
        .rings()
        .flat_map(|ring| &ring.points);
    let slot_end = far.filter(|p| p.x > 40.0 && p.x < 50.0 && p.y > 19.0 && p.y < 31.0);
    let radii: Vec<f64> = slot_end.map(|p| (p.x - 40.0).hypot(p.y - 25.0)).collect();
    assert!(radii.len() > 20);
    assert!(radii.iter().all(|radius| (radius - 5.0).abs() < 1e-9));
}

#[test]
fn old_polylines_arcs_and_lines_in_any_order_and_direction() {
    // A stadium of two arcs and two lines; the second arc seen from below.
    let arcs = entity(
        "ARC",
        &[(10, 0.0), (20, 0.0), (40, 5.0), (50, 90.0), (51, 270.0)],
    ) + &line([0.0, 5.0], [20.0, 5.0])
        + &entity(
            "ARC",
            &[
                (10, -20.0),
                (20, 0.0),
                (40, 5.0),
                (50, 90.0),
                (51, 270.0),
                (230, -1.0),
            ],
        )
        + &line([20.0, -5.0], [0.0, -5.0]);
    has_area(&loaded(&arcs), 200.0 + 25.0 * PI);
    // A lens: two corners, each with the bulge of a quarter of a circle.
    let bulge = (PI / 8.0).tan();
    let corner = |x| entity("VERTEX", &[(10, x), (20, 0.0), (42, bulge)]);
    let lens = entity("POLYLINE", &[(70, 1.0)]) + &corner(0.0) + &corner(10.0) + "0\nSEQEND\n";
    // Two segments of a circle of radius 10/√2 and a right angle: r² (π/2 - 1) both.
    has_area(&loaded(&lens), 50.0 * (PI / 2.0 - 1.0));
    // A triangle whose y come before their x.
    let corners = [[0.0, 0.0], [0.0, 4.0], [3.0, 4.0]].map(|[y, x]| [(20, y), (10, x)]);
    let triangle = [&[(70, 1.0)], corners.as_flattened()].concat();
    has_area(&loaded(&entity("LWPOLYLINE", &triangle)), 6.0);
}

#[test]
fn splines_and_ellipses() {
    let knots = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0].map(|knot| (40, knot));
    let mut numbers = vec![(70, 8.0), (71, 3.0)];
    numbers.extend(knots);
    for [x, y] in [[0.0, 0.0], [0.0, 10.0], [10.0, 10.0], [10.0, 0.0]] {
        numbers.extend([(10, x), (20, y), (30, 0.0)]);
    }
    // The cubic has 60 mm² under it; the box below it 50. A joint is 5 µm apart.
    let closing = line([0.0, 0.005], [0.0, -5.0])
        + &line([10.0, -5.0], [0.0, -5.0])
        + &line([10.0, 0.0], [10.0, -5.0]);
    let closed = loaded(&(entity("SPLINE", &numbers) + &closing));
    has_area(&closed, 110.0);
    notes_have(&closed, "1 of 4 joints had a gap, up to 0.0050 mm");
    // A quarter of a circle as a rational curve.
    let mut numbers = vec![(70, 12.0), (71, 2.0)];
    numbers.extend([0.0, 0.0, 0.0, 1.0, 1.0, 1.0].map(|knot| (40, knot)));
    numbers.extend([1.0, 0.5_f64.sqrt(), 1.0].map(|weight| (41, weight)));
    for [x, y] in [[10.0, 0.0], [10.0, 10.0], [0.0, 10.0]] {
        numbers.extend([(10, x), (20, y)]);
    }
    let legs = line([0.0, 0.0], [10.0, 0.0]) + &line([0.0, 0.0], [0.0, 10.0]);
    has_area(&loaded(&(entity("SPLINE", &numbers) + &legs)), 25.0 * PI);
    let axis = [(10, 3.0), (20, 4.0), (11, 6.0), (21, 8.0), (40, 0.3)];
    has_area(&loaded(&entity("ELLIPSE", &axis)), PI * 10.0 * 3.0);
    let half: Vec<(i32, f64)> = axis.into_iter().chain([(41, 0.0), (42, PI)]).collect();
    let chord = line([9.0, 12.0], [-3.0, -4.0]);
    has_area(&loaded(&(entity("ELLIPSE", &half) + &chord)), PI * 15.0);
}

#[test]
fn units_of_the_file_and_over_it() {
    let square = rectangle("0", 2.0, 2.0);
    for (number, mm) in [(1, 25.4), (4, 1.0), (5, 10.0), (6, 1000.0), (13, 0.001)] {
        let text = file(Some(number), "", &square);
        let loaded = load(&text, &ReadOptions::default()).unwrap();
        assert!(
            (area(&loaded) / (4.0 * mm * mm) - 1.0).abs() < 1e-9,
            "{number}"
        );
    }
    let told = ReadOptions {
        units: Some(Units::Cm),
        ..ReadOptions::default()
    };
    for number in [Some(1), Some(2), None] {
        let loaded = load(&file(number, "", &square), &told).unwrap();
        assert!((area(&loaded) - 400.0).abs() < 1e-9);
    }
    for number in [None, Some(0)] {
        let loaded = load(&file(number, "", &square), &ReadOptions::default()).unwrap();
        assert!((area(&loaded) - 4.0).abs() < 1e-12);
        notes_have(&loaded, "mm were taken");
    }
    let feet = load(&file(Some(2), "", &square), &ReadOptions::default());
    let message = feet.unwrap_err().to_string();
    assert!(
        message.contains("feet") && message.contains("--units"),
        "{message}"
    );
}

#[test]
fn layers_are_chosen_or_hidden() {
    let layers = layer("Cut", "0", "7") + &layer("Frozen", "1", "7") + &layer("Off", "0", "-7");
    let drawn = rectangle("Cut", 10.0, 10.0)
        + &circle("Frozen", 5.0, 5.0, 1.0)
        + &circle("Off", 5.0, 5.0, 2.0)
        + &circle("Bend", 50.0, 5.0, 3.0);
    let text = file(Some(4), &layers, &drawn);
    let of = |names: &[&str]| {
        let dxf_layers = names.iter().map(|name| name.to_string()).collect();
        let options = ReadOptions {
            dxf_layers,
            ..ReadOptions::default()
        };
        load(&text, &options)
    };
    let seen = of(&[]).unwrap();
    has_area(&seen, 100.0 + 9.0 * PI);
    notes_have(
        &seen,
        "2 entities on layers that are frozen or off were left out: Frozen, Off",
    );
    let cut = of(&["cut"]).unwrap();
    has_area(&cut, 100.0);
    notes_have(&cut, "3 entities on layers that were not chosen");
    has_area(&of(&["CUT", "Frozen"]).unwrap(), 100.0 - PI);
    let message = of(&["Engrave"]).unwrap_err().to_string();
    let names = "no layer 'Engrave'; the drawing has Bend, Cut, Frozen, Off";
    assert!(message.contains(names), "{message}");
}

#[test]
fn what_is_not_read_is_told_with_counts() {
    let other = |kind| entity(kind, &[(10, 0.0), (20, 0.0)]);
    let drawn = rectangle("0", 10.0, 10.0) + &other("TEXT") + &other("INSERT") + &other("TEXT");
    let told = loaded(&(drawn + &other("HATCH")));
    notes_have(&told, "left out: 1 HATCH, 1 INSERT, 2 TEXT (explode blocks");
    let twice = rectangle("0", 10.0, 10.0) + &rectangle("0", 10.0, 10.0);
    let twice = loaded(&twice);
    has_area(&twice, 100.0);
    notes_have(&twice, "1 entities are drawn twice");
    let message = refused(&(other("TEXT") + &other("DIMENSION")));
    assert!(message.contains("1 DIMENSION, 1 TEXT"), "{message}");
}

#[test]
fn gaps_and_branches_are_refused_with_the_place() {
    let sides = [
        line([0.0, 0.0], [10.0, 0.0]),
        line([10.0, 0.0], [10.0, 10.0]),
        line([10.0, 10.0], [0.0, 10.0]),
        line([0.0, 10.0], [0.0, 0.5]),
    ]
    .concat();
    let message = refused(&sides);
    for part in [
        "LINE of line",
        "open",
        "0.5000 mm",
        "(0.0000, 0.5000) mm",
        "--repair",
    ] {
        assert!(message.contains(part), "`{part}` in {message}");
    }
    let repair = ReadOptions {
        repair: true,
        ..ReadOptions::default()
    };
    let mended = load(&file(Some(4), "", &sides), &repair).unwrap();
    has_area(&mended, 100.0);
    let whole = sides.replace("0.5\n", "0.0\n") + &line([10.0, 10.0], [20.0, 20.0]);
    let message = refused(&whole);
    let place = "more than two ends meet at (10.0000, 10.0000) mm";
    assert!(message.contains(place), "{message}");
}

#[test]
fn many_lines_in_any_order_are_one_contour() {
    // A circle of 30,000 lines, every 7919th after the one before (a prime), far from the origin.
    let count = 30_000;
    let at = |k: usize| {
        let angle = 2.0 * PI * (k % count) as f64 / count as f64;
        [5.0e5 + 100.0 * angle.cos(), 100.0 * angle.sin()]
    };
    let lines = (0..count).map(|k| k * 7919 % count);
    let lines: String = lines.map(|k| line(at(k), at(k + 1))).collect();
    let loaded = loaded(&lines);
    assert_eq!(loaded.target.regions.len(), 1);
    has_area(&loaded, PI * 1e4);
}

#[test]
fn broken_files_are_refused() {
    let good = file(Some(4), "", &rectangle("0", 10.0, 10.0));
    let spline = |degree: f64, knots: &[f64]| {
        let mut numbers = vec![(71, degree)];
        numbers.extend(knots.iter().map(|knot| (40, *knot)));
        numbers.extend([(10, 0.0), (20, 0.0), (10, 5.0), (20, 5.0)]);
        file(None, "", &entity("SPLINE", &numbers))
    };
    let one = |entity: String| file(None, "", &entity);
    let cases: Vec<(String, &str)> = vec![
        (String::new(), "empty"),
        ("AutoCAD Binary DXF\r\n\u{1a}\0\0\0".to_string(), "binary"),
        ("AC1032\0\0".to_string(), "DWG"),
        (good.replace("EOF", ""), "cut off"),
        (good.replace("ENDSEC", "END"), "has no end"),
        (
            good.replace("20\n10.0", "20\nnan"),
            "'nan' is no finite number",
        ),
        (good.replace("20\n10.0", "20\n1e999"), "no finite number"),
        (
            good.replace("20\n10.0", "x\n10.0"),
            "'x' where a group code",
        ),
        (good.replace("10\n10.0", "10\n1e200"), "farther than"),
        (good.replace("10\n10.0", "10\n1e6"), "larger than"),
        (good.replace("70\n1\n", "70\n99999\n"), "no whole number"),
        (one(circle("0", 0.0, 0.0, -1.0)), "radius"),
        (one(line([1.0, 1.0], [1.0, 1.0])), "no points"),
        (one(entity("LINE", &[(10, 0.0)])), "no group 20"),
        (one(entity("VERTEX", &[(10, 0.0)])), "no POLYLINE"),
        (good.replace("70\n1\n", "42\n1\n"), "before its corner"),
        (spline(3.0, &[0.0, 1.0]), "degree 3"),
        (spline(1.0, &[0.0, 3.0, 1.0, 4.0]), "do not rise"),
        (
            one(circle("0", 0.0, 0.0, 3.0).replace("40", "230\n0\n210\n1\n40")),
            "tilted",
        ),
        (
            "0\nSECTION\n2\nENTITIES\n0\nENDSEC\n0\nEOF\n".to_string(),
            "no lines, arcs",
        ),
    ];
    for (text, part) in cases {
        let message = load(&text, &ReadOptions::default())
            .unwrap_err()
            .to_string();
        assert!(message.contains(part), "`{part}` in {message}");
    }
}

/// Every cut and every absurd number is read or refused, never a panic.
#[test]
fn nothing_broken_ends_the_program() {
    let drawn = rectangle("0", 100.0, 50.0)
        + &slot()
        + &circle("0", 70.0, 25.0, 4.0)
        + &entity(
            "ELLIPSE",
            &[(10, 3.0), (20, 4.0), (11, 1.0), (21, 1.0), (40, 0.3)],
        )
        + &entity("POLYLINE", &[(70, 1.0)])
        + &entity("VERTEX", &[(10, 80.0), (20, 5.0), (42, 0.5)])
        + &entity("VERTEX", &[(10, 85.0), (20, 5.0), (42, 0.5)])
        + "0\nSEQEND\n";
    let good = file(Some(4), &layer("0", "0", "7"), &drawn);
    assert!(load(&good, &ReadOptions::default()).is_ok());
    let mut refused = 0;
    for end in 0..good.len() - 5 {
        refused += usize::from(load(&good[..end], &ReadOptions::default()).is_err());
    }
    assert_eq!(refused, good.len() - 5);
    let lines: Vec<&str> = good.lines().collect();
    // Two spaces: an empty line.
    for absurd in "nan 1e308 -1 0  -2147483648 SECTION 1e-320 1e6".split(' ') {
        for index in 0..lines.len() {
            let mut broken = lines.clone();
            broken[index] = absurd;
            refused += usize::from(load(&broken.join("\n"), &ReadOptions::default()).is_err());
        }
    }
    assert!(refused > 2 * good.len() / 2);
}
