//! Goal: drawings are read in mm with the correct interior, and those that cannot be printed are
//! refused with the place. Method: small drawings whose area is known.

use super::*;
use crate::text::refusal::Refusal;

fn polygon(text: &str) -> Result<Loaded, Refusal> {
    read(
        text.as_bytes(),
        "test",
        Format::Polygon,
        &ReadOptions::default(),
    )
}

fn svg(text: &str) -> Result<Loaded, Refusal> {
    read(
        text.as_bytes(),
        "test",
        Format::Svg,
        &ReadOptions::default(),
    )
}

fn geojson(text: &str) -> Result<Loaded, Refusal> {
    read(
        text.as_bytes(),
        "test",
        Format::GeoJson,
        &ReadOptions::default(),
    )
}

fn area(loaded: &Loaded) -> f64 {
    loaded.target.regions.iter().map(Region::area_mm2).sum()
}

fn refusal(result: Result<Loaded, Refusal>) -> String {
    result.expect_err("must be refused").to_string()
}

const SQUARE: &str = "[[0,0],[10,0],[10,10],[0,10]]";

#[test]
fn polygon_units_scale_and_orientation() {
    for (units, factor) in [
        ("mm", 1.0),
        ("cm", 10.0),
        ("m", 1000.0),
        ("um", 1e-3),
        ("in", 25.4),
    ] {
        let text = format!(
            r#"{{"units":"{units}","exterior":{SQUARE},"holes":[[[2,2],[4,2],[4,4],[2,4]]]}}"#
        );
        let loaded = polygon(&text).expect(units);
        let expected = 96.0 * factor * factor;
        // Six products of numbers with 53 bits.
        assert!(
            (area(&loaded) - expected).abs() <= 1e-12 * expected,
            "{units}"
        );
        // The hole was counter-clockwise: turned, and said.
        assert_eq!(loaded.notes.len(), 1, "{:?}", loaded.notes);
        let hole = &loaded.target.regions[0].holes[0];
        assert!(hole.signed_area_mm2() < 0.0);
    }
    let options = ReadOptions {
        scale: 3.0,
        units: Some(Units::Cm),
        ..ReadOptions::default()
    };
    let text = format!(r#"{{"units":"degree","exterior":{SQUARE}}}"#);
    let loaded = read(text.as_bytes(), "x", Format::Polygon, &options).expect("scaled");
    assert!((area(&loaded) - 90_000.0).abs() < 1e-6);
}

#[test]
fn polygon_refusals_say_what_and_where() {
    let units = r#""units":"mm","#;
    for (text, part) in [
        (format!(r#"{{{units}"exterior":[]}}"#), "no points"),
        (
            format!(r#"{{{units}"exterior":[[0,0],[1,1]]}}"#),
            "2 distinct points",
        ),
        (
            format!(r#"{{{units}"exterior":[[0,0],[5,5],[2,2],[9,9]]}}"#),
            "no area",
        ),
        (
            format!(r#"{{{units}"exterior":[[0,0],[1,0,3],[1,1]]}}"#),
            "point 1 is 3 numbers",
        ),
        (
            format!(r#"{{{units}"exterior":[[0,0],[1e999,0],[1,1]]}}"#),
            "line 1 column",
        ),
        (
            format!(r#"{{{units}"exterior":[[0,0],[null,0],[1,1]]}}"#),
            "line 1 column",
        ),
        (
            format!(r#"{{{units}"exterior":[[0,0],[1e308,0],[1,1]]}}"#),
            "farther than",
        ),
        (
            format!(r#"{{{units}"exterior":[[0,0],[3e5,0],[1,1]]}}"#),
            "larger than 100000 mm",
        ),
        (
            format!(r#"{{{units}"exterior":[[0,0],[3e-5,0],[0,1e-5]]}}"#),
            "smaller than 0.001 mm",
        ),
        (
            format!(r#"{{"units":"furlong","exterior":{SQUARE}}}"#),
            "'furlong' are not known",
        ),
        (format!(r#"{{"exterior":{SQUARE}}}"#), "says no units"),
        ("{\"units\":\"mm\"}".to_string(), "missing field `exterior`"),
        ("[1,2".to_string(), "line 1"),
    ] {
        let message = refusal(polygon(&text));
        assert!(message.contains(part), "{text}: {message}");
    }
    for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let options = ReadOptions {
            scale,
            ..ReadOptions::default()
        };
        let text = format!(r#"{{"units":"mm","exterior":{SQUARE}}}"#);
        let message = refusal(read(text.as_bytes(), "x", Format::Polygon, &options));
        assert!(message.contains("--scale"), "{message}");
    }
}

#[test]
fn repeated_points_are_dropped() {
    let text = r#"{"units":"mm","exterior":[[0,0],[10,0],[10,0],[10,10],[0,10],[0,0]]}"#;
    let loaded = polygon(text).expect("closed ring");
    assert_eq!(loaded.target.regions[0].exterior.points.len(), 4);
}

#[test]
fn svg_lengths_and_viewbox_become_mm() {
    // The page is 40 x 20 mm, a view box unit is 0.5 mm; the rectangle is 10 x 5 mm, its lower
    // left corner 5 mm right of and 10 mm above the page's.
    let page = r#"<svg xmlns="http://www.w3.org/2000/svg" width="40mm" height="20mm"
        viewBox="0 0 80 40"><rect x="10" y="10" width="20" height="10"/></svg>"#;
    let loaded = svg(page).expect("page in mm");
    let bounds = loaded.target.regions[0].bounds();
    // usvg counts in f32: 1e-7 of 151 px.
    for (found, wanted) in [
        (bounds.min.x, 5.0),
        (bounds.min.y, 10.0),
        (bounds.max.x, 15.0),
        (bounds.max.y, 15.0),
    ] {
        assert!((found - wanted).abs() < 1e-4, "{found} is not {wanted}");
    }
    // Without a unit a pixel is 1/96 inch.
    let page = r#"<svg xmlns="http://www.w3.org/2000/svg" width="200" height="200">
        <g transform="translate(10 20) scale(2)"><rect width="48" height="48"/></g></svg>"#;
    let loaded = svg(page).expect("page in pixels");
    assert!((area(&loaded) - 25.4 * 25.4).abs() < 1e-3);
    // --units: a user unit is a mm, a pixel where there is no view box.
    let options = ReadOptions {
        units: Some(Units::Mm),
        ..ReadOptions::default()
    };
    let loaded = read(page.as_bytes(), "x", Format::Svg, &options).expect("units");
    assert!((area(&loaded) - 96.0 * 96.0).abs() < 1e-2);
}

#[test]
fn svg_fill_rules_decide_what_is_a_hole() {
    let rings = "M0 0H30V30H0Z M10 10H20V20H10Z";
    let against = "M0 0H30V30H0Z M10 10V20H20V10Z";
    let mm = (25.4f64 / 96.0).powi(2);
    for (rule, path, wanted) in [
        ("evenodd", rings, 800.0),
        ("nonzero", rings, 900.0),
        ("nonzero", against, 800.0),
        ("evenodd", against, 800.0),
    ] {
        let page = format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" width="40" height="40">
            <path fill-rule="{rule}" d="{path}"/></svg>"#
        );
        let found = area(&svg(&page).expect(rule));
        assert!((found - wanted * mm).abs() < 1e-3, "{rule} {path}: {found}");
    }
    // An island in a hole is a region of its own.
    let page = r#"<svg xmlns="http://www.w3.org/2000/svg" width="40" height="40">
        <path fill-rule="evenodd" d="M0 0H30V30H0Z M5 5H25V25H5Z M10 10H20V20H10Z"/></svg>"#;
    let loaded = svg(page).expect("island");
    assert_eq!(loaded.target.regions.len(), 2);
    assert!((area(&loaded) - 600.0 * mm).abs() < 1e-3);
}

#[test]
fn svg_curves_keep_the_tolerance() {
    let page = r#"<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="100mm"
        viewBox="0 0 100 100"><circle cx="50" cy="50" r="20"/>
        <path d="M0 0 Q 10 0 10 10 T 20 20 H 0 Z"/></svg>"#;
    let loaded = svg(page).expect("curves");
    let circle = &loaded.target.regions[0].exterior;
    for (a, b) in circle.edges() {
        for p in [a, nalgebra::center(&a, &b)] {
            let error = (p - crate::geometry::Point2::new(50.0, 50.0)).norm() - 20.0;
            // 0.03 % of the radius from usvg's cubics, 0.001 mm from flattening.
            assert!(error.abs() < 0.006 + 0.001, "{error}");
        }
    }
    let finer = ReadOptions {
        flatten_mm: 1e-5,
        ..ReadOptions::default()
    };
    let fine = read(page.as_bytes(), "x", Format::Svg, &finer).expect("finer");
    let count = |loaded: &Loaded| loaded.target.regions[0].exterior.points.len();
    // A hundredth of the tolerance takes ten times the chords.
    let ratio = count(&fine) as f64 / count(&loaded) as f64;
    assert!((8.0..12.0).contains(&ratio), "{ratio}");
}

#[test]
fn svg_refuses_strokes_and_open_contours() {
    let page = |inner: &str| {
        format!(r#"<svg xmlns="http://www.w3.org/2000/svg" width="96" height="96">{inner}</svg>"#)
    };
    let stroke = r#"<path id="wire" fill="none" stroke="black" d="M0 0L10 0L10 10"/>"#;
    let message = refusal(svg(&page(stroke)));
    assert!(
        message.contains("wire") && message.contains("no fill"),
        "{message}"
    );
    let open = r#"<path d="M0 0H96V96"/>"#;
    let message = refusal(svg(&page(open)));
    assert!(
        message.contains("is open") && message.contains("(25.4000, 0.0000) mm"),
        "{message}"
    );
    let closed_by_hand = r#"<path d="M0 0H96V96L0 0"/><text>hello</text>"#;
    let both = format!("{closed_by_hand}{stroke}");
    let loaded = svg(&page(&both)).expect("one shape is filled");
    assert!((area(&loaded) - 25.4 * 25.4 / 2.0).abs() < 1e-3);
    assert!(
        loaded.notes.iter().any(|n| n.contains("wire")),
        "{:?}",
        loaded.notes
    );
    assert!(
        loaded.notes.iter().any(|n| n.contains("<text>")),
        "{:?}",
        loaded.notes
    );
    assert!(refusal(svg(&page(""))).contains("no points"));
    assert!(refusal(svg("<svg")).contains("SVG"));
    let repaired = read(
        page(open).as_bytes(),
        "x",
        Format::Svg,
        &ReadOptions {
            repair: true,
            ..ReadOptions::default()
        },
    )
    .expect("repair closes");
    assert!(
        repaired.notes.iter().any(|n| n.contains("joined")),
        "{:?}",
        repaired.notes
    );
}

#[test]
fn geojson_geometries_features_and_collections() {
    let ring = "[[0,0],[10,0],[10,10],[0,10],[0,0]]";
    let hole = "[[2,2],[2,4],[4,4],[4,2],[2,2]]";
    let far = "[[20,0],[30,0],[30,10],[20,10],[20,0]]";
    let polygon = format!(r#"{{"type":"Polygon","coordinates":[{ring},{hole}]}}"#);
    let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{ring},{hole}],[{far}]]}}"#);
    let feature =
        format!(r#"{{"type":"Feature","properties":{{"name":"part"}},"geometry":{multi}}}"#);
    let collection =
        format!(r#"{{"type":"FeatureCollection","units":"cm","features":[{feature}]}}"#);
    for (text, regions, wanted, name) in [
        (&polygon, 1, 96.0, "test"),
        (&multi, 2, 196.0, "test"),
        (&feature, 2, 196.0, "part"),
        (&collection, 2, 19_600.0, "part"),
    ] {
        let loaded = geojson(text).expect(text);
        assert_eq!(loaded.target.regions.len(), regions);
        assert_eq!(loaded.target.name, name);
        assert!((area(&loaded) - wanted).abs() < 1e-9, "{text}");
    }
    for (text, part) in [
        (
            r#"{"type":"LineString","coordinates":[[0,0],[1,1]]}"#,
            "LineString",
        ),
        (
            r#"{"type":"Polygon","coordinates":[[[0,0],[10,0],[10,10]]]}"#,
            "is open",
        ),
        (
            r#"{"type":"FeatureCollection","features":[]}"#,
            "no outline",
        ),
        (r#"{"type":"Polygon","coordinates":"x"}"#, "GeoJSON"),
    ] {
        let message = refusal(geojson(text));
        assert!(
            message.contains(part) || message.contains("no points"),
            "{text}: {message}"
        );
    }
}

#[test]
fn overlapping_regions_are_refused_touching_ones_taken() {
    let multi = |second: &str| {
        geojson(&format!(
            r#"{{"type":"MultiPolygon","coordinates":[
            [[[0,0],[10,0],[10,10],[0,10],[0,0]]],[[{second}]]]}}"#
        ))
    };
    let message = refusal(multi("[5,5],[15,5],[15,15],[5,15],[5,5]"));
    assert!(
        message.contains("overlap near (10.0000, 5.0000) mm"),
        "{message}"
    );
    assert!(refusal(multi("[2,2],[4,2],[4,4],[2,4],[2,2]")).contains("overlap"));
    assert!(refusal(multi("[10,2],[20,2],[20,8],[10,8],[10,2]")).contains("overlap"));
    // One common corner is fine.
    assert!(multi("[10,10],[20,10],[20,20],[10,20],[10,10]").is_ok());
}

#[test]
fn invalid_outlines_are_refused_with_the_place() {
    let polygon = |rings: &str| polygon(&format!(r#"{{"units":"mm",{rings}}}"#));
    for (rings, part) in [
        (
            r#""exterior":[[0,0],[10,10],[10,0],[0,10]]"#,
            "crosses itself at (5.0000, 5.0000) mm",
        ),
        (
            r#""exterior":[[0,0],[10,0],[10,10],[0,10]],"holes":[[[8,4],[8,6],[12,6],[12,4]]]"#,
            "(10.0000, ",
        ),
        (
            r#""exterior":[[0,0],[10,0],[10,10],[0,10]],"holes":[[[20,4],[20,6],[22,6],[22,4]]]"#,
            "outside the exterior at (20.0000, ",
        ),
    ] {
        let message = refusal(polygon(rings));
        assert!(message.contains(part), "{rings}: {message}");
    }
    // Two contours of one path cross: the fill rule cannot be asked before that is settled.
    let page = |rule: &str| {
        format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" width="96" height="96">
            <path fill-rule="{rule}" d="M0 0H48V48H0Z M24 24H72V72H24Z"/></svg>"#
        )
    };
    let message = refusal(svg(&page("nonzero")));
    assert!(
        message.contains("contour 0 and shape 0, contour 1"),
        "{message}"
    );
    let repair = ReadOptions {
        repair: true,
        ..ReadOptions::default()
    };
    let inch = 25.4f64 * 25.4;
    for (rule, wanted) in [("nonzero", 7.0 / 16.0), ("evenodd", 6.0 / 16.0)] {
        let loaded = read(page(rule).as_bytes(), "x", Format::Svg, &repair).expect(rule);
        assert!(
            (area(&loaded) - wanted * inch).abs() < 0.01,
            "{rule} {}",
            area(&loaded)
        );
        let is_told = loaded.notes.iter().any(|note| note.contains("repaired"));
        assert!(is_told, "{:?}", loaded.notes);
    }
}

#[test]
fn repair_takes_holes_from_the_exterior_and_merges_parts() {
    let repair = ReadOptions {
        repair: true,
        ..ReadOptions::default()
    };
    let polygon = |rings: &str| {
        let text = format!(r#"{{"units":"mm",{rings}}}"#);
        read(text.as_bytes(), "x", Format::Polygon, &repair).expect(rings)
    };
    // A hole half outside takes only what is inside; a bow tie keeps both wings.
    for (rings, wanted) in [
        (
            r#""exterior":[[0,0],[10,0],[10,10],[0,10]],"holes":[[[8,4],[8,6],[12,6],[12,4]]]"#,
            96.0,
        ),
        (r#""exterior":[[0,0],[10,10],[10,0],[0,10]]"#, 50.0),
        (
            r#""exterior":[[0,0],[10,0],[10,10],[0,10]],
            "holes":[[[2,2],[2,6],[6,6],[6,2]],[[4,4],[4,8],[8,8],[8,4]]]"#,
            100.0 - 28.0,
        ),
        (
            r#""exterior":[[0,0],[10,0],[10,10],[0,10]],"holes":[[[20,4],[20,6],[22,6],[22,4]]]"#,
            100.0,
        ),
    ] {
        let loaded = polygon(rings);
        // The repair works on a grid of a millionth of the part.
        assert!(
            (area(&loaded) - wanted).abs() < 1e-3,
            "{rings}: {}",
            area(&loaded)
        );
        assert!(
            loaded.notes.iter().any(|n| n.starts_with("repaired")),
            "{:?}",
            loaded.notes
        );
    }
    let overlapping = r#"{"type":"MultiPolygon","coordinates":[
        [[[0,0],[10,0],[10,10],[0,10],[0,0]]],[[[5,5],[15,5],[15,15],[5,15],[5,5]]]]}"#;
    let loaded = read(overlapping.as_bytes(), "x", Format::GeoJson, &repair).expect("merged");
    assert_eq!(loaded.target.regions.len(), 1);
    assert!((area(&loaded) - 175.0).abs() < 1e-3, "{}", area(&loaded));
}

/// Goal: what a page does not show is no part of it, and is counted; a clip is told only where it cuts.
/// Method: a rectangle of 200 mm² beside shapes that browsers do not show, each in one of the ways.
#[test]
fn svg_shapes_that_are_not_shown_are_left_out_and_counted() {
    let page = |inner: &str| {
        format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
            width="60mm" height="40mm" viewBox="0 0 60 40">{inner}<rect x="10" y="25" width="20" height="10"/></svg>"#
        )
    };
    let side = r#"x="40" width="20" height="20""#;
    let clear_stops = r#"<linearGradient id="g"><stop offset="0" stop-opacity="0"/>
        <stop offset="1" stop-opacity="0"/></linearGradient>"#;
    for (hidden, what) in [
        (format!(r#"<rect {side} style="fill:transparent"/>"#), "1 shapes"),
        (format!(r##"<rect {side} fill="#00000000"/>"##), "1 shapes"),
        (format!(r#"<rect {side} style="fill:rgba(9,9,9,0)"/>"#), "1 shapes"),
        (format!(r#"<g fill-opacity="0%"><rect {side}/></g>"#), "1 shapes"),
        (format!(r#"<g opacity="0"><g opacity="1"><rect {side}/><circle r="5"/></g></g>"#), "2 shapes"),
        (format!("<style>.h{{display:none}}</style><rect class='h' {side}/>"), "1 shapes"),
        (format!("<style>.h{{visibility:hidden}}</style><g class='h'><rect {side}/></g>"), "1 shapes"),
        (format!("<style>.h{{opacity:0}}</style><g class='h'><rect {side}/></g>"), "1 shapes"),
        (r##"<defs><rect id="r" width="20" height="20"/></defs><use xlink:href="#r" opacity="0"/>"##.into(), "1 shapes"),
        (
            r##"<symbol id="s"><rect width="9" height="9"/></symbol><use xlink:href="#s" visibility="hidden"/>"##.into(),
            "1 shapes",
        ),
        (format!("{clear_stops}<rect {side} fill='url(#g)'/>"), "1 shapes"),
        (format!(r##"<rect {side} fill="none" stroke="#000" stroke-opacity="0"/>"##), "1 shapes"),
        (format!(r##"<rect {side} fill-opacity="0" stroke="#000"/>"##), "1 shapes with a stroke"),
        (format!(r##"<clipPath id="c"><rect width="9" height="9"/></clipPath><rect {side} clip-path="url(#c)"/>"##), "1 shapes"),
        (r#"<rect width="60" height="40" fill-opacity="0.0"/>"#.into(), "1 shapes"),
    ] {
        let loaded = svg(&page(&hidden)).expect(&hidden);
        // usvg counts in f32.
        assert!((area(&loaded) - 200.0).abs() < 1e-3, "{hidden}: {}", area(&loaded));
        let told = |word: &str| loaded.notes.iter().any(|note| note.contains(word));
        assert!(told(what) && told("left out") && !told("clip"), "{hidden}: {:?}", loaded.notes);
    }
    let whole = svg(&page("")).expect("nothing hidden");
    assert_eq!(whole.notes.len(), 1, "{:?}", whole.notes);
    let all = svg(&page("").replace("<rect", "<rect opacity='0'"));
    assert!(refusal(all).contains("1 shapes that are not shown"));
}

/// Goal: a clip path is told where it cuts, and nowhere else. Method: a symbol with its frame, whole and cut.
#[test]
fn svg_frames_of_symbols_are_told_where_they_cut() {
    let page = |width: u8| {
        format!(
            r##"<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
            width="100mm" height="100mm" viewBox="0 0 100 100"><symbol id="s" viewBox="0 0 10 10">
            <rect x="1" y="1" width="{width}" height="4"/></symbol>
            <use xlink:href="#s" x="10" y="10" width="50" height="50"/></svg>"##
        )
    };
    let told = |width| {
        svg(&page(width))
            .expect("a symbol")
            .notes
            .join("; ")
            .contains("clip path")
    };
    assert!(!told(9) && told(10));
}

/// Goal: the remedy of an overlap gives what the page shows. Method: two shapes, in one colour and in two.
#[test]
fn svg_shapes_of_two_colours_are_not_to_be_merged() {
    let page = |colour: &str| {
        format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" width="60mm" height="40mm" viewBox="0 0 60 40">
            <rect width="60" height="40" fill="{colour}"/><rect x="10" y="10" width="20" height="10"/></svg>"#
        )
    };
    assert!(refusal(svg(&page("black"))).contains("--repair"));
    let message = refusal(svg(&page("white")));
    assert!(
        message.contains("(#ffffff)") && message.contains("background"),
        "{message}"
    );
    assert!(!message.contains("--repair"), "{message}");
}
