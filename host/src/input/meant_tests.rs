//! Goal: a file is read as intended, or refused where it most likely means something else: misspelt
//! keys, units that would be lost, lines among polygons, names that are commands. Method: files that
//! were once misread silently.
use super::*;
use crate::text::refusal::Refusal;

const SQUARE: &str = "[[0,0],[10,0],[10,10],[0,10]]";
const HOLE: &str = "[[[2,2],[2,4],[4,4],[4,2]]]";

fn read_as(format: Format, text: &str, units: Option<Units>) -> Result<Loaded, Refusal> {
    let options = ReadOptions {
        units,
        ..ReadOptions::default()
    };
    read(text.as_bytes(), "test", format, &options)
}

fn area(loaded: &Loaded) -> f64 {
    loaded.target.regions.iter().map(Region::area_mm2).sum()
}

#[test]
fn misspelt_keys_of_polygons_are_refused_with_the_near_one() {
    for (keys, part) in [
        (format!(r#""units":"mm","hole":{HOLE}"#), "'holes' meant"),
        (format!(r#""units":"mm","Holes":{HOLE}"#), "'holes' meant"),
        (
            format!(r#""units":"mm","interiors":{HOLE}"#),
            "'interiors' holds points",
        ),
        (
            format!(r#""units":"mm","voids":{HOLE}"#),
            "'voids' holds points",
        ),
        (r#""unit":"in","units":"mm""#.to_string(), "'units' meant"),
    ] {
        let text = format!(r#"{{"exterior":{SQUARE},{keys}}}"#);
        let message = read_as(Format::Polygon, &text, None)
            .unwrap_err()
            .to_string();
        assert!(message.contains(part), "{text}: {message}");
    }
    let own = r#""valid":true,"note":"x","notes":["y"],"about":{"a":[1,2]},"sizes":[3,4]"#;
    let text = format!(r#"{{"units":"mm","exterior":{SQUARE},"holes":{HOLE},{own}}}"#);
    let loaded = read_as(Format::Polygon, &text, None).unwrap();
    assert!((area(&loaded) - 96.0).abs() < 1e-9);
}

#[test]
fn misspelt_members_of_geojson_are_refused() {
    let polygon = r#""type":"Polygon","coordinates":[[[0,0],[10,0],[10,10],[0,0]]]"#;
    for (text, near) in [
        (format!(r#"{{{polygon},"unit":"in"}}"#), "units"),
        (
            format!(
                r#"{{"type":"Feature","properties":{{}},"geometry":null,"geometri":{{{polygon}}}}}"#
            ),
            "geometry",
        ),
    ] {
        let message = read_as(Format::GeoJson, &text, None)
            .unwrap_err()
            .to_string();
        assert!(message.contains(&format!("'{near}' meant")), "{message}");
    }
    let text = format!(r#"{{{polygon},"unity":1,"source":"mine"}}"#);
    // One edit from a known member is near, whatever it holds.
    assert!(read_as(Format::GeoJson, &text, None).is_err());
}

#[test]
fn lines_among_polygons_are_left_out_and_told() {
    let feature =
        |geometry: &str| format!(r#"{{"type":"Feature","properties":{{}},"geometry":{geometry}}}"#);
    let polygon = feature(r#"{"type":"Polygon","coordinates":[[[0,0],[10,0],[10,10],[0,0]]]}"#);
    let line = feature(r#"{"type":"LineString","coordinates":[[0,0],[1,1]]}"#);
    let point = feature(r#"{"type":"Point","coordinates":[5,5]}"#);
    let all = |features: &[&str]| {
        let features = features.join(",");
        let text =
            format!(r#"{{"type":"FeatureCollection","units":"mm","features":[{features}]}}"#);
        read_as(Format::GeoJson, &text, None)
    };
    let loaded = all(&[&line, &polygon, &point]).unwrap();
    assert!((area(&loaded) - 50.0).abs() < 1e-9);
    let [note] = loaded.notes.as_slice() else {
        panic!("{:?}", loaded.notes);
    };
    assert!(
        note.contains("2 geometries") && note.contains("feature 0, a LineString"),
        "{note}"
    );
    let message = all(&[&line, &point]).unwrap_err().to_string();
    assert!(message.contains("LineString"), "{message}");
}

#[test]
fn units_of_an_svg_are_its_user_units() {
    let page = |head: &str| {
        format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" {head}><rect width="10" height="5"/></svg>"#
        )
    };
    for (head, units, size_mm, note) in [
        // Ten units are ten inches, however large the page says that it is.
        (
            "width='10in' height='10in' viewBox='0 0 10 10'",
            Some(Units::In),
            [254.0, 127.0],
            "--units",
        ),
        (
            "width='40mm' height='20mm' viewBox='0 0 80 40'",
            Some(Units::Mm),
            [10.0, 5.0],
            "--units",
        ),
        (
            "width='200' height='200'",
            Some(Units::Mm),
            [10.0, 5.0],
            "--units",
        ),
        (
            "viewBox='-5 -5 80 40'",
            Some(Units::Cm),
            [100.0, 50.0],
            "--units",
        ),
        // The page is wider than its drawing: the drawing is not stretched, unless it says so.
        (
            "width='80mm' height='20mm' viewBox='0 0 80 40'",
            Some(Units::Mm),
            [10.0, 5.0],
            "--units",
        ),
        (
            "width='80mm' height='20mm' viewBox='0 0 80 40' preserveAspectRatio='none'",
            Some(Units::Mm),
            [10.0, 5.0],
            "--units",
        ),
        (
            "width='80mm' height='20mm' viewBox='0 0 80 40' preserveAspectRatio='none'",
            None,
            [10.0, 2.5],
            "0.500000 mm up (as its width says)",
        ),
        (
            "width='40mm' height='20mm' viewBox='0 0 80 40'",
            None,
            [5.0, 2.5],
            "0.500000 mm (as its width",
        ),
        (
            "width='96' height='96'",
            None,
            [10.0 * 25.4 / 96.0, 5.0 * 25.4 / 96.0],
            "96 to the inch",
        ),
    ] {
        let loaded = read_as(Format::Svg, &page(head), units).unwrap();
        let found = loaded.target.regions[0].bounds().size();
        // usvg counts in f32.
        assert!(
            (found.x - size_mm[0]).abs() < 1e-4 * size_mm[0],
            "{head}: {found}"
        );
        assert!(
            (found.y - size_mm[1]).abs() < 1e-4 * size_mm[1],
            "{head}: {found}"
        );
        let told = loaded.notes.iter().any(|n| n.contains(note));
        assert!(told, "{head}: {:?}", loaded.notes);
    }
}

#[test]
fn names_are_text_and_short() {
    let name = format!("a\u{1b}[2J\u{9b}b\u{202e}{}", "c".repeat(300));
    let json = serde_json::json!({"name": name, "units": "mm",
        "exterior": [[0, 0], [10, 0], [10, 10]]})
    .to_string();
    let loaded = read_as(Format::Polygon, &json, None).unwrap();
    assert!(
        loaded.target.name.starts_with("a[2Jbc"),
        "{}",
        loaded.target.name
    );
    assert_eq!(loaded.target.name.chars().count(), names::NAME_CHARS_MAX);
    let empty = serde_json::json!({"name": "\u{7}", "units": "mm",
        "exterior": [[0, 0], [10, 0], [10, 10]]});
    let loaded = read_as(Format::Polygon, &empty.to_string(), None).unwrap();
    assert_eq!(loaded.target.name, "test");
}

#[test]
fn waypoints_that_would_be_misread_are_refused() {
    let rows = "0 0 0 0 0 1 0\n5 0 0 0 0 1 0\n";
    let run = |text: &str| waypoints::read(text.as_bytes(), "run", &ReadOptions::default());
    let refused =
        |text: &str, with: &str| run(text).is_err_and(|error| error.to_string().contains(with));
    let units = |text: &str| refused(text, "is not read as units");
    for head in ["# unit: in\n", "# Units: in\n", "# units = in\n"] {
        assert!(units(&format!("{head}{rows}")), "{head}");
    }
    assert!(units(&format!("{rows}# units: in\n")));
    assert!(
        run(&format!(
            "# units: in\n# note: by hand\n# 10:30 today\n{rows}"
        ))
        .is_ok()
    );
    assert!(run(&format!("x,y,z,nx,ny,nz,angle\n{rows}")).is_ok());
    assert!(refused(
        &format!("nx ny nz x y z heading_deg\n{rows}"),
        "column 1 is called"
    ));
    assert!(refused(
        "0 0 0 0 0 1 1e300\n5 0 0 0 0 1 0\n",
        "line 1: a heading of"
    ));
    assert!(run("0 0 0 0 0 1 720\n5 0 0 0 0 1 -3600\n").is_ok());
}

/// Goal: a scribble that would take hours to look through is refused at once. Method: 60,000 points in
/// turn from side to side, which is 900 million crossings.
#[test]
fn a_scribble_is_refused_at_once() {
    let points = (0..60_000u64).map(|k| {
        let y = (k * 7919 % 60_000) as f64 / 600.0;
        [if k % 2 == 0 { 0.0 } else { 100.0 }, y]
    });
    let points: Vec<[f64; 2]> = points.collect();
    let json = serde_json::json!({"units": "mm", "exterior": points}).to_string();
    let began = std::time::Instant::now();
    let message = read_as(Format::Polygon, &json, None)
        .unwrap_err()
        .to_string();
    assert!(message.contains("no outline"), "{message}");
    assert!(began.elapsed().as_secs() < 10);
}
