//! Goal: the command takes a DXF drawing to figures and to a job, layers chosen by option, and refuses
//! broken ones without a result. Method: the binary on a plate written here, sizes by hand.

use crate::rig::{folder, headway, object, path, stderr, succeeded};

/// A plate of 30 x 20 mm with a slot of two arcs, and a hole on a layer of its own.
fn plate() -> String {
    let corner = |[x, y, bulge]: [f64; 3]| format!("10\n{x}\n20\n{y}\n42\n{bulge}\n");
    let ring = |corners: &[[f64; 3]]| {
        let corners: String = corners.iter().copied().map(corner).collect();
        format!("0\nLWPOLYLINE\n8\nCut\n90\n4\n70\n1\n{corners}")
    };
    let edge = ring(&[
        [0.0; 3],
        [30.0, 0.0, 0.0],
        [30.0, 20.0, 0.0],
        [0.0, 20.0, 0.0],
    ]);
    let slot = ring(&[
        [6.0, 8.0, 0.0],
        [12.0, 8.0, 1.0],
        [12.0, 12.0, 0.0],
        [6.0, 12.0, 1.0],
    ]);
    let hole =
        "0\nCIRCLE\n8\nHoles\n10\n22\n20\n10\n40\n3\n0\nTEXT\n8\nCut\n10\n0\n20\n0\n1\nplate\n";
    let header = "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n";
    format!("{header}0\nSECTION\n2\nENTITIES\n{edge}{slot}{hole}0\nENDSEC\n0\nEOF\n")
}

#[test]
fn a_drawing_is_inspected_and_planned() {
    let folder = folder("dxf");
    let file = folder.join("plate.dxf");
    std::fs::write(&file, plate()).expect("file");
    let area_mm2 = |arguments: &[&str]| {
        let all = [&["inspect", path(&file), "--json"], arguments].concat();
        object(&headway(&all))["area_mm2"]
            .as_f64()
            .expect("an area")
    };
    let pi = std::f64::consts::PI;
    let whole = 600.0 - (24.0 + 4.0 * pi) - 9.0 * pi;
    assert!((area_mm2(&[]) - whole).abs() < 0.05);
    let without_hole = whole + 9.0 * pi;
    assert!((area_mm2(&["--dxf-layer", "cut"]) - without_hole).abs() < 0.03);
    assert!((area_mm2(&["--units", "cm", "--from", "dxf"]) - 100.0 * whole).abs() < 1.0);
    let said = stderr(&headway(&["inspect", path(&file)]));
    assert!(said.contains("1 TEXT"), "{said}");
    let job = folder.join("plate.hwj");
    succeeded(&headway(&["plan", path(&file), "-o", path(&job)]));
    assert!(job.exists());
}

#[test]
fn what_cannot_be_read_is_refused_with_status_1() {
    let folder = folder("dxf-broken");
    let file = folder.join("broken.dxf");
    let job = folder.join("broken.hwj");
    let good = plate();
    for (text, options, status, part) in [
        (good.replace("EOF", ""), None, 1, "cut off"),
        (
            good.replace("20\n20", "20\ninf"),
            None,
            1,
            "no finite number",
        ),
        (
            "AutoCAD Binary DXF\r\n\u{1a}\0".to_string(),
            None,
            1,
            "binary",
        ),
        (good.replace("70\n1\n", "70\n0\n"), None, 1, "is open"),
        (good.clone(), Some("Bend"), 1, "the drawing has Cut, Holes"),
        ("{}".to_string(), None, 1, "group code"),
    ] {
        std::fs::write(&file, text).expect("file");
        let mut arguments = vec!["plan", path(&file), "-o", path(&job)];
        arguments.extend(options.iter().flat_map(|name| ["--dxf-layer", name]));
        let output = headway(&arguments);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(status), "{said}");
        assert!(said.contains(part), "`{part}` in {said}");
        assert!(output.stdout.is_empty() && !job.exists());
    }
    let svg = crate::rig::example("letter.svg");
    let output = headway(&["inspect", &svg, "--dxf-layer", "Cut"]);
    assert_eq!(output.status.code(), Some(2));
}
