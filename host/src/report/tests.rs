//! Goal: pictures are well-formed SVG with the given contents; tables have the specified columns.
//! Method: small invented plans, read back as XML or numbers.

use super::*;
use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::Region;
use crate::geometry::test_shapes::{SQUARE, region};
use crate::job::transform::PartTransform;
use crate::job::{Mark, MotionState, SegmentStream};
use crate::settings::Settings;
use headway_protocol::segment::Knot;
use plan_marks::Colouring;
use plan_picture::{PicturePass, Zone};
use usvg::roxmltree::Document;

fn square() -> Vec<Region> {
    vec![region(&[SQUARE])]
}

fn count(text: &str, name: &str) -> usize {
    let xml = Document::parse(text).expect("well-formed");
    xml.descendants()
        .filter(|node| node.tag_name().name() == name)
        .count()
}

#[test]
fn the_plan_shows_passes_nozzles_and_interruptions() {
    let regions = square();
    let at = |x: f64, zone| {
        let center = Point2::new(x, 5.0);
        (
            Configuration {
                center,
                heading_rad: 0.3,
            },
            zone,
        )
    };
    let zone = |x: f64| {
        if x < 5.0 {
            Zone::TwoPass
        } else {
            Zone::OnePass
        }
    };
    let passes = (0..2)
        .map(|_| PicturePass {
            placements: (0..=8)
                .map(|k| at(1.0 + k as f64, zone(1.0 + k as f64)))
                .collect(),
            speeds_mm_s: (0..=8).map(f64::from).collect(),
        })
        .collect();
    let picture = PlanPicture {
        keep_out: &[],
        title: "a < b & c",
        regions: &regions,
        aperture: Aperture::Ellipse {
            major_mm: 0.6,
            minor_mm: 0.2,
        },
        axis: vec![vec![Point2::new(0.0, 0.0), Point2::new(5.0, 5.0)]],
        passes,
        travel: vec![vec![Point2::new(9.0, 5.0), Point2::new(1.0, 5.0)]],
        unreachable: Vec::new(),
        colouring: Colouring::Zone,
    };
    let text = plan_picture::draw(&picture);
    // Starts and ends of two passes, and two dots of the legend.
    assert_eq!(count(&text, "circle"), 6);
    // Nine placements 1 mm apart, every one of two passes drawn (two arcs each).
    assert_eq!(text.matches('A').count(), 2 * 2 * 9);
    assert!(text.contains("one bead across") && text.contains("1 mm") && text.contains("&lt;"));
    // Both passes run to the right, 100 px a mm: an arrow each 70 px, so that each of 8 steps has one, but for the
    // half distance before the first; its tip is to the right of its other corners.
    let arrows = arrows(&text);
    assert_eq!(arrows.len(), 2 * 8);
    assert!(
        arrows
            .iter()
            .all(|[tip, left, right]| tip > left && tip > right)
    );
    assert!(
        text.contains("\n1\n") && text.contains("\n2\n"),
        "passes are numbered"
    );
    // Speeds of 0 to 8 mm/s in steps of 1: each step of a pass is of the next colour, and the last two of the last.
    let coloured = PlanPicture {
        colouring: Colouring::Speed,
        ..picture
    };
    let text = plan_picture::draw(&coloured);
    assert!(text.contains("speed 7.00 to 8.00 mm/s") && !text.contains("one bead across"));
    let xml = Document::parse(&text).expect("well-formed");
    for (colour, from_px) in [
        ("#440154", "M124"),
        ("#277f8e", "M424"),
        ("#fde725", "M824"),
    ] {
        let line = xml
            .descendants()
            .find(|n| n.attribute("stroke") == Some(colour) && n.tag_name().name() == "path");
        let data = line.and_then(|n| n.attribute("d")).unwrap_or_default();
        assert_eq!(data.matches(from_px).count(), 2, "{colour}: {data}");
    }
    let by_width = PlanPicture {
        colouring: Colouring::Width,
        ..coloured
    };
    assert!(plan_picture::draw(&by_width).contains("bead width"));
}

/// The x of the corners of each arrow of a sheet, the tip first.
fn arrows(text: &str) -> Vec<[f64; 3]> {
    let xml = Document::parse(text).expect("well-formed");
    let marks = xml
        .descendants()
        .find(|n| n.attribute("class") == Some("direction"));
    let data = marks
        .and_then(|n| n.attribute("d"))
        .unwrap_or_default()
        .to_owned();
    let triangles = data.split('Z').filter(|triangle| !triangle.is_empty());
    triangles
        .map(|triangle| {
            let corners = triangle
                .split(['M', 'L'])
                .filter(|corner| !corner.is_empty());
            let x = corners.map(|corner| corner.split(' ').next().and_then(|x| x.parse().ok()));
            let x: Vec<f64> = x.map(|x| x.expect("a number")).collect();
            [x[0], x[1], x[2]]
        })
        .collect()
}

/// 5 mm along x in 100 spans of 10 ticks, from rest to rest.
fn stream() -> SegmentStream {
    let control = |k: i32| {
        [
            1_000_000 + 500 * k.clamp(0, 100),
            0,
            2000,
            0,
            0,
            3 * k.min(100),
            7 * k,
        ]
    };
    let knots: Vec<Knot> = (0..104)
        .map(|k| Knot {
            control: control(k.min(100)),
            duration_ticks: 10,
        })
        .collect();
    let mark = |start_tick, end_tick, state, pass| Mark {
        start_tick,
        end_tick,
        state,
        layer: 0,
        pass,
    };
    SegmentStream {
        start: control(0),
        knots,
        events: Vec::new(),
        marks: vec![
            mark(0, 500, MotionState::Travel, None),
            mark(500, 1036, MotionState::Print, Some(0)),
        ],
        solution: 0,
        units: headway_protocol::units::Units::BASE,
    }
}

fn empty_plan() -> PlanPicture<'static> {
    PlanPicture {
        title: "plan",
        regions: &[],
        keep_out: &[],
        aperture: Settings::default().aperture,
        axis: Vec::new(),
        passes: vec![PicturePass {
            placements: vec![(
                Configuration {
                    center: Point2::new(1.0, 2.0),
                    heading_rad: 0.0,
                },
                Zone::Unknown,
            )],
            speeds_mm_s: Vec::new(),
        }],
        travel: Vec::new(),
        unreachable: Vec::new(),
        colouring: Colouring::Zone,
    }
}

fn empty(figures: &Figures) -> Report<'_> {
    Report {
        title: "part",
        figures,
        layers: Vec::new(),
        more_layers: Vec::new(),
        notes: &[],
        machine: None,
        servo_hz: 2000.0,
        flow_limit_mm3_s: 50.0,
        limits: &[],
        facts: page_layer::PageFacts::default(),
        slow_places: &[],
        left_out: &[],
    }
}

#[test]
fn a_layer_is_sampled_as_it_is_in_the_whole() {
    let mut stream = stream();
    stream.marks[1].layer = 1;
    assert_eq!(stream.layers(), 2);
    let layers = [0, 1, 2].map(|layer| stream.ticks_of_layer(layer));
    assert_eq!(layers, [[0, 500], [500, 1036], [0, 0]]);
    let whole: Vec<_> = pose_table::samples(&stream, 2000.0, 4.0).collect();
    for [from, to] in [[0, 500], [500, 1036], [496, 512]] {
        let part: Vec<_> = pose_table::samples_within(&stream, 2000.0, 4.0, [from, to]).collect();
        let (first, last) = (from as usize / 4, to as usize / 4);
        assert_eq!(part, whole[first..=last], "{from} to {to}");
    }
}

#[test]
fn the_pose_table_keeps_its_columns() {
    let stream = stream();
    let transform = PartTransform {
        offset_mm: [100.0, 0.0, 0.0],
    };
    let mut out = Vec::new();
    pose_table::write_csv(&mut out, &stream, 2000.0, 1.0, &transform).expect("to memory");
    let text = String::from_utf8(out).expect("text");
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some(pose_table::POSE_HEADER));
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    // 2 virtual spans of 8 ticks and 102 of 10 at 2 kHz: 518 ms, both ends included.
    assert_eq!(pose_table::duration_ticks(&stream), 1036);
    assert_eq!(rows.len(), 519);
    assert!(rows.iter().all(|row| row.len() == 13));
    assert_eq!(rows[0][3..6], ["0.00000", "0.00000", "0.20000"]);
    assert_eq!(rows[518][3..6], ["5.00000", "0.00000", "0.20000"]);
    assert_eq!(
        (rows[0][2], rows[0][12], rows[0][11]),
        ("-1", "travel", "0.00000")
    );
    assert_eq!((rows[400][2], rows[400][12]), ("0", "print"));
    // Midway: 0.05 mm every 10 ticks of 0.5 ms is 10 mm/s.
    let speed: f64 = rows[250][10].parse().expect("number");
    assert!((speed - 10.0).abs() < 1e-3, "{speed}");
}

#[test]
fn a_report_has_a_picture_of_each_drawn_layer() {
    let figures = Figures {
        passes: Some(1),
        ..Figures::default()
    };
    let notes = ["two < three".to_string()];
    let files = write_report(&Report {
        layers: [(0, "layer 1 of 9"), (4, "layer 5 of 9 and 2 like it")]
            .map(|(layer, label)| DrawnLayer {
                layer,
                label,
                plan: empty_plan(),
                swept: Vec::new(),
                motion: LayerMotion::default(),
            })
            .to_vec(),
        notes: &notes,
        ..empty(&figures)
    });
    let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(
        names,
        ["report.json", "plan.svg", "plan-layer-5.svg", "index.html"]
    );
    let page = &files[3].text;
    assert!(page.contains("layer 5 of 9 and 2 like it") && page.contains("two &lt; three"));
    assert!(page.contains("href=\"plan-layer-5.svg\""));
}

/// Goal: the page's samples and its path are the stream's. Method: the columns read back from the page's block, as
/// its script does, against the pose table's samples; a name that would end the block stays inside.
#[test]
fn the_page_holds_the_motion() {
    use base64::Engine;
    let (stream, settings) = (stream(), Settings::default());
    let transform = PartTransform {
        offset_mm: [100.0, 0.0, 0.0],
    };
    let index = pose_table::StreamIndex::of(&stream);
    let of = track::TrackOf {
        stream: &stream,
        settings: &settings,
        index: &index,
        ticks: [0, 1036],
        samples_max: 300,
    };
    let of_path = layer_path::PathOf {
        stream: &stream,
        index: &index,
        transform: &transform,
        reach_mm: 0.6,
        ticks: [0, 1036],
        points_max: 1000,
    };
    let motion = LayerMotion {
        laid: Vec::new(),
        track: track::track(of, |_, _| Some(2)),
        path: layer_path::layer_path(of_path, |mark, _| {
            (layer_path::What::of(mark.state, layer_path::What::Wall), 7)
        }),
    };
    // 1036 ticks in steps of 4, both ends included; the second half prints.
    let track = &motion.track;
    assert_eq!((track.every_s, track.limit.len()), (0.002, 260));
    let printed = track.limit.iter().map(|&limit| limit == 2);
    assert!(printed.eq((0..260).map(|k| 4 * k >= 500)));
    // X of the default machine: 10 of 250 mm/s, away from the shorter first spans.
    let x_pct = &track.joints_pct[0].1;
    assert!(x_pct[50..200].iter().all(|pct| (pct - 4.0).abs() < 1e-2));
    let figures = Figures::default();
    let limits = ["x speed", "</script><b>", "tip speed"].map(String::from);
    let files = write_report(&Report {
        layers: vec![DrawnLayer {
            layer: 0,
            label: "",
            plan: empty_plan(),
            swept: Vec::new(),
            motion,
        }],
        limits: &limits,
        ..empty(&figures)
    });
    let page = &files.last().expect("the page").text;
    assert_eq!(page.matches("</script>").count(), 2);
    let (_, block) = page.split_once("id=\"data\">").expect("the block");
    let (block, _) = block.split_once("</script>").expect("its end");
    let block: serde_json::Value = serde_json::from_str(block).expect("JSON");
    assert_eq!(block["limits"][1], "</script><b>");
    let bytes = |column: &serde_json::Value| {
        let text = column["b64"].as_str().expect("text");
        let decoded = base64::engine::general_purpose::STANDARD.decode(text);
        decoded.expect("base64")
    };
    let column = |column: &serde_json::Value| -> Vec<f64> {
        let end = |name: &str| column[name].as_f64().expect("a number");
        let (min, max) = (end("min"), end("max"));
        let number = |pair: &[u8]| f64::from(u16::from_le_bytes([pair[0], pair[1]]));
        let pairs = bytes(column);
        let pairs = pairs.chunks(2);
        pairs
            .map(|pair| min + (max - min) * number(pair) / 65535.0)
            .collect()
    };
    let steps = |column: &serde_json::Value| -> Vec<f64> {
        let unit = column["unit"].as_f64().expect("a number");
        let (mut sum, mut value, mut shift) = (0i64, 0u64, 0);
        let mut found = Vec::new();
        for byte in bytes(column) {
            value |= u64::from(byte & 0x7f) << shift;
            shift += 7;
            if byte < 0x80 {
                sum += (value >> 1) as i64 ^ -((value & 1) as i64);
                found.push(unit * sum as f64);
                (value, shift) = (0, 0);
            }
        }
        found
    };
    let layer = &block["layers"][0];
    let samples: Vec<_> = pose_table::samples(&stream, 2000.0, 1.0).collect();
    for (speed, sample) in column(&layer["speed"])
        .iter()
        .zip(samples.iter().step_by(4))
    {
        assert!((speed - sample.speed_mm_s()).abs() < 1e-3, "{speed}");
    }
    let path = &layer["path"];
    assert_eq!(path["runs"][0], 7, "travel");
    let (ticks, x) = (steps(&path["ticks"]), steps(&path["x"]));
    assert!(ticks.len() > 4 && ticks.len() == x.len(), "{ticks:?}");
    // Half of the unit that places are rounded to.
    for (tick, x) in ticks.iter().zip(&x) {
        let place = samples[*tick as usize].position[0] - 100.0;
        assert!((x - place).abs() < 0.501e-3, "{x} {place}");
    }
    assert!(steps(&path["line"]).iter().all(|line| *line == 7.0));
}
