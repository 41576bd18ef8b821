//! Outlines: polygon JSON, GeoJSON, SVG, DXF.

use super::Want::{Area, Refused};
use super::{Case, Kind, Want, case};
use headway::input::Format;
use std::f64::consts::PI;

/// Sides of 100 mm, 100 nm from one to the next.
fn comb() -> String {
    let point = |k: usize| format!("[{},{:.4}]", k % 2 * 100, k as f64 * 1e-4);
    let points: Vec<String> = (0..60_000).map(point).collect();
    format!(r#"{{"units":"mm","exterior":[{}]}}"#, points.join(","))
}

fn polygon() -> Vec<Case> {
    let of = |what, text: &str, want: Want| case(what, Kind::Drawing(Format::Polygon), text, want);
    let square = r#"{"units":"mm","exterior":[[0,0],[10,0],[10,10],[0,10]]}"#;
    let holed = square.replace("]]}", "]],\"holes\":[[[2,2],[4,2],[4,4],[2,4]]]}");
    vec![
        of("a square", square, Area(100.0)),
        of("a square with a hole", &holed, Area(96.0)),
        of(
            "a square the other way round, closed",
            r#"{"units":"mm","exterior":[[0,0],[0,10],[10,10],[10,0],[0,0]]}"#,
            Area(100.0),
        ),
        of(
            "inches",
            &square.replace("mm", "in"),
            Area(100.0 * 25.4 * 25.4),
        ),
        of(
            "a mark before it",
            &format!("\u{feff}{square}"),
            Area(100.0),
        ),
        of(
            "no units",
            r#"{"exterior":[[0,0],[10,0],[10,10]]}"#,
            Refused("no units"),
        ),
        of(
            "a bow tie",
            r#"{"units":"mm","exterior":[[0,0],[10,10],[10,0],[0,10]]}"#,
            Refused("cross"),
        ),
        of(
            "a number beyond all",
            &square.replace("[10,0]", "[1e999,0]"),
            Refused("line 1"),
        ),
        of(
            "a place beyond all",
            &square.replace("[10,0]", "[1e300,0]"),
            Refused("farther than"),
        ),
        of(
            "two points",
            r#"{"units":"mm","exterior":[[0,0],[10,0]]}"#,
            Refused("distinct points"),
        ),
        of(
            "sixty thousand sides within six millimetres",
            &comb(),
            Refused("60000 edges lie so close together"),
        ),
        of(
            "a hundred thousand brackets",
            &"[".repeat(100_000),
            Refused("line 1 column 0"),
        ),
        of("a text cut off", &square[..30], Refused("line 1")),
        of(
            "a key that is meant otherwise",
            &square.replace("exterior", "exteriors"),
            Refused("exterior"),
        ),
    ]
}

fn geojson() -> Vec<Case> {
    let of = |what, text: &str, want: Want| case(what, Kind::Drawing(Format::GeoJson), text, want);
    let square = r#"{"type":"Polygon","coordinates":[[[0,0],[10,0],[10,10],[0,10],[0,0]]]}"#;
    let nested = r#"{"type":"GeometryCollection","geometries":["#.repeat(5_000);
    vec![
        of("a polygon", square, Area(100.0)),
        of(
            "a line",
            r#"{"type":"LineString","coordinates":[[0,0],[10,0]]}"#,
            Refused("no inside"),
        ),
        of(
            "collections in collections",
            &nested,
            Refused("recursion limit"),
        ),
    ]
}

fn page(body: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"40mm\" height=\"40mm\" viewBox=\"0 0 40 40\">{body}</svg>"
    )
}

/// Groups that use the one before ten times each, ten deep.
fn claiming_groups() -> String {
    let mut text = "<defs><g id=\"g0\"><rect width=\"1\" height=\"1\"/></g>".to_string();
    for depth in 1..10 {
        let used = format!("<use href=\"#g{}\"/>", depth - 1).repeat(10);
        text += &format!("<g id=\"g{depth}\">{used}</g>");
    }
    page(&(text + "</defs><use href=\"#g9\"/>"))
}

/// Names that stand for ten of the one before, ten deep.
fn claiming_names() -> String {
    let mut text = "<!DOCTYPE svg [<!ENTITY n0 \"M0 0L9 0L9 9Z\">".to_string();
    for depth in 1..10 {
        text += &format!(
            "<!ENTITY n{depth} \"{}\">",
            format!("&n{};", depth - 1).repeat(10)
        );
    }
    text + "]>" + &page("<path d=\"&n9;\"/>")
}

fn svg() -> Vec<Case> {
    let of = |what, text: &str, want: Want| case(what, Kind::Drawing(Format::Svg), text, want);
    vec![
        of(
            "a rectangle",
            &page(r#"<rect x="5" y="5" width="20" height="10"/>"#),
            Area(200.0),
        ),
        of(
            "a circle",
            &page(r#"<circle cx="20" cy="20" r="10"/>"#),
            Area(100.0 * PI),
        ),
        of(
            "a ring by the even-odd rule",
            &page(r#"<path fill-rule="evenodd" d="M5 5h20v20h-20zM10 10h10v10h-10z"/>"#),
            Area(300.0),
        ),
        of(
            "a turned group",
            &page(
                r#"<g transform="rotate(90 20 20) scale(.5)"><rect width="20" height="10"/></g>"#,
            ),
            Area(50.0),
        ),
        of(
            "a rectangle used twice",
            &page(
                r##"<defs><rect id="a" width="5" height="5"/></defs><use href="#a"/><use href="#a" x="10"/>"##,
            ),
            Area(50.0),
        ),
        of(
            "lines alone",
            &page(r#"<path fill="none" stroke="red" d="M0 0L9 9"/>"#),
            Refused("stroke"),
        ),
        of(
            "a use of itself",
            &page(r##"<g id="a"><use href="#a"/></g>"##),
            Refused("no outline in it"),
        ),
        of(
            "a thousand million groups",
            &claiming_groups(),
            Refused("nodes limit"),
        ),
        of(
            "a thousand million names",
            &claiming_names(),
            Refused("entity reference loop"),
        ),
        of(
            "a path that is none",
            &page(r#"<path d="M0 0Lx y"/>"#),
            Refused("no outline in it"),
        ),
        of(
            "a page cut off",
            &page("<rect")[..85],
            Refused("unexpected end"),
        ),
    ]
}

/// Groups of codes and values of a drawing's entities.
fn drawing(entities: &str) -> String {
    format!("0\nSECTION\n2\nENTITIES\n{entities}0\nENDSEC\n0\nEOF\n")
}

fn dxf() -> Vec<Case> {
    let of = |what, text: &str, want: Want| case(what, Kind::Drawing(Format::Dxf), text, want);
    let square = "0\nLWPOLYLINE\n8\n0\n90\n4\n70\n1\n10\n0\n20\n0\n10\n10\n20\n0\n10\n10\n20\n10\n10\n0\n20\n10\n";
    let disc = "0\nLWPOLYLINE\n8\n0\n90\n2\n70\n1\n10\n0\n20\n0\n42\n1\n10\n10\n20\n0\n42\n1\n";
    let blocks = format!(
        "0\nSECTION\n2\nBLOCKS\n0\nBLOCK\n2\nB\n70\n0\n10\n0\n20\n0\n{square}0\nENDBLK\n0\nENDSEC\n{}",
        drawing("0\nINSERT\n2\nB\n10\n0\n20\n0\n70\n30000\n71\n30000\n44\n20\n45\n20\n")
    );
    vec![
        of("a square of one line", &drawing(square), Area(100.0)),
        of("two half circles", &drawing(disc), Area(25.0 * PI)),
        of(
            "a circle",
            &drawing("0\nCIRCLE\n8\n0\n10\n0\n20\n0\n40\n10\n"),
            Area(100.0 * PI),
        ),
        of(
            "CR LF and blanks",
            &drawing(square).replace('\n', "\r\n  "),
            Area(100.0),
        ),
        of(
            "a square without a side",
            &drawing(
                "0\nLINE\n8\n0\n10\n0\n20\n0\n11\n10\n21\n0\n0\nLINE\n8\n0\n10\n10\n20\n0\n11\n10\n21\n10\n",
            ),
            Refused("is open"),
        ),
        of("nine hundred million squares", &blocks, Refused("1 INSERT")),
        of(
            "a code that is none",
            &drawing("x\nLINE\n"),
            Refused("line 5"),
        ),
        of(
            "a number that is none",
            &drawing(&square.replacen("10\n20\n0", "ten\n20\n0", 1)),
            Refused("line 18"),
        ),
        of(
            "a drawing cut off",
            &drawing(square)[..60],
            Refused("ends at line 17"),
        ),
        of("nothing", "", Refused("it is empty")),
    ]
}

pub fn cases() -> Vec<Case> {
    [polygon(), geojson(), svg(), dxf()]
        .into_iter()
        .flatten()
        .collect()
}
