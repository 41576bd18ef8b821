//! Goal: lines that are drawn as the middles of walls are printed as beads, and what is no line, or is filled though it may be
//! one, says so. Method: the binary on drawings written here; lengths and volumes by hand.

use crate::rig::{Table, example, folder, headway, object, path, stderr, succeeded};
use std::path::{Path, PathBuf};

const DRAWING: &str =
    "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n";

/// A drawing of polylines, the closed ones marked.
fn drawing(folder: &Path, lines: &[(bool, &[[f64; 2]])]) -> PathBuf {
    let line = |(closed, corners): &(bool, &[[f64; 2]])| {
        let corner = |[x, y]: &[f64; 2]| format!("10\n{x}\n20\n{y}\n");
        let corners: String = corners.iter().map(corner).collect();
        format!(
            "0\nLWPOLYLINE\n8\nWalls\n70\n{}\n{corners}",
            u8::from(*closed)
        )
    };
    let lines: String = lines.iter().map(line).collect();
    written(
        folder,
        "walls.dxf",
        &format!("{DRAWING}{lines}0\nENDSEC\n0\nEOF\n"),
    )
}

fn written(folder: &Path, name: &str, text: &str) -> PathBuf {
    let file = folder.join(name);
    std::fs::write(&file, text).expect("written");
    file
}

/// Rows of a job's table of one state: x, y, z, mm, and the flow, mm³/s.
fn rows(job: &Path, state: &str) -> Vec<[f64; 4]> {
    let export = ["export", path(job), "--to", "csv", "--every-ms", "10"];
    let table = Table::of(&succeeded(&headway(&export)));
    let columns = ["x_mm", "y_mm", "z_mm", "flow_mm3_s"].map(|name| table.column(name));
    let states = table.texts("state").into_iter().enumerate();
    let own = states.filter(|(_, of)| *of == state);
    own.map(|(at, _)| [0, 1, 2, 3].map(|k| columns[k][at]))
        .collect()
}

/// Goal: a closed polyline is filled with a note that names the option, and with it is one bead per layer of the width that
/// lies across the nozzle, without an interruption; its volume is that of the line's length less the opening of its seam.
#[test]
fn the_middle_line_of_a_wall_is_printed_as_one_bead() {
    let folder = folder("wall");
    let corners = [[0.0, 0.0], [401.0, 0.0], [401.0, 400.0], [0.0, 400.0]];
    let (file, job) = (
        drawing(&folder, &[(true, &corners)]),
        folder.join("wall.hwj"),
    );
    let concrete = example("machines/concrete.toml");
    let plan = [
        "plan",
        path(&file),
        "-m",
        &concrete,
        "-o",
        path(&job),
        "--json",
    ];
    let filled = headway(&[&plan[..], &["--quality", "fast"]].concat());
    let said = stderr(&filled);
    assert!(
        said.contains("160400 mm²") && said.contains("--centre-lines prints each"),
        "{said}"
    );
    let lines = [&plan[..], &["--centre-lines", "--layers", "2", "--force"]].concat();
    let output = headway(&lines);
    let (said, figures) = (stderr(&output), object(&output));
    assert!(
        said.contains("beads 40 mm wide") && !said.contains("are filled"),
        "{said}"
    );
    let number = |key: &str| figures[key].as_f64().expect(key);
    assert_eq!((number("layers"), number("passes")), (2.0, 2.0));
    // Two rounds of 1602 mm, 12 mm high, each 1.4 times half of the nozzle's 20 mm short at its seam.
    let volume_mm3 = 2.0 * (1602.0 - 14.0) * 40.0 * 12.0;
    assert!(
        (number("volume_mm3") / volume_mm3 - 1.0).abs() < 2e-3,
        "{figures:?}"
    );
    // The line is the path, its corners rounded.
    for [x, y, ..] in rows(&job, "print") {
        let [u, v] = [(x - 200.5).abs(), (y - 200.0).abs()];
        assert!((u - 200.5).abs().min((v - 200.0).abs()) < 2.0, "{x} {y}");
    }
}

/// Goal: strokes of a page and LineStrings are refused with the option's name and printed with it; lines whose ends meet
/// are one pass, others one each, also those of a junction of three; a narrower bead lays less in proportion.
#[test]
fn strokes_and_line_strings_are_beads() {
    let folder = folder("strokes");
    let job = folder.join("lines.hwj");
    let svg = "<svg xmlns='http://www.w3.org/2000/svg' width='60mm' height='40mm' viewBox='0 0 60 40'>\
               <path d='M5 5 H30 M30 5 V25' fill='none' stroke='black'/><path d='M0 30 h3 v3 z' fill='red'/></svg>";
    let geojson = r#"{"type":"GeometryCollection","units":"mm","geometries":[
        {"type":"LineString","coordinates":[[0,0],[20,0]]}, {"type":"Point","coordinates":[3,4]},
        {"type":"MultiLineString","coordinates":[[[20,0],[40,0]],[[20,0],[20,15]]]}]}"#;
    let svg = written(&folder, "page.svg", svg);
    let geojson = written(&folder, "map.geojson", geojson);
    let strokes = written(
        &folder,
        "strokes.svg",
        &std::fs::read_to_string(&svg)
            .expect("text")
            .replace("red", "none"),
    );
    for (file, refused, passes, length_mm) in [
        (&strokes, true, 1.0, 45.0),
        (&svg, false, 1.0, 45.0),
        (&geojson, true, 3.0, 55.0),
    ] {
        let plan = ["plan", path(file), "-o", path(&job), "--force", "--json"];
        let filled = headway(&plan);
        assert_eq!(
            filled.status.code(),
            Some(i32::from(refused)),
            "{}",
            stderr(&filled)
        );
        assert!(
            stderr(&filled).contains("--centre-lines"),
            "{}",
            stderr(&filled)
        );
        let volume_mm3 = |more: &[&str]| {
            let figures = object(&headway(&[&plan[..], &["--centre-lines"], more].concat()));
            assert_eq!(figures["passes"].as_f64(), Some(passes), "{figures:?}");
            figures["volume_mm3"].as_f64().expect("a volume")
        };
        let wide_mm3 = volume_mm3(&[]);
        let height_mm = 0.2;
        assert!(
            (wide_mm3 / (length_mm * 1.2 * height_mm) - 1.0).abs() < 1e-3,
            "{wide_mm3}"
        );
        let share = volume_mm3(&["--bead-width", "0.6"]) / wide_mm3;
        assert!((share - 0.5).abs() < 1e-3, "{share}");
    }
}

/// Goal: between lines the head is lifted; what cannot be is refused with what to do instead.
#[test]
fn travel_between_lines_is_lifted_and_wrong_options_are_named() {
    let folder = folder("refused");
    let job = folder.join("lines.hwj");
    let file = drawing(
        &folder,
        &[
            (false, &[[0.0, 0.0], [10.0, 0.0]]),
            (false, &[[0.0, 10.0], [10.0, 10.0]]),
        ],
    );
    let plan = [
        "plan",
        path(&file),
        "-o",
        path(&job),
        "--centre-lines",
        "--force",
    ];
    succeeded(&headway(&plan));
    let heights = rows(&job, "print");
    assert!(
        heights
            .iter()
            .all(|[.., z, _]| (z - heights[0][2]).abs() < 0.01)
    );
    let lifted = rows(&job, "travel");
    assert!(
        lifted
            .iter()
            .any(|[_, y, z, _]| (y - 5.0).abs() < 2.0 && *z > heights[0][2] + 0.2)
    );
    let mesh = example("dome.stl");
    for (input, more, part) in [
        (
            path(&file),
            &["--bead-width", "3"][..],
            "lays beads of 0.4 to 1.2 mm",
        ),
        (
            path(&file),
            &["--walls", "2"],
            "--walls goes with what is filled",
        ),
        (mesh.as_str(), &[], "--centre-lines goes with drawings"),
    ] {
        let output =
            headway(&[&["plan", input, "-o", path(&job), "--centre-lines"], more].concat());
        assert_ne!(output.status.code(), Some(0));
        assert!(
            stderr(&output).contains(part),
            "`{part}` in {}",
            stderr(&output)
        );
    }
    let output = headway(&["plan", path(&file), "-o", path(&job), "--bead-width", "1"]);
    assert!(stderr(&output).contains("is open") || stderr(&output).contains("--centre-lines"));
}
