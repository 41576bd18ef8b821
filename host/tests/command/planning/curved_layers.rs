//! Goal: a part in curved layers is planned by the command with its figures, and what does not go with them is refused
//! with what to do. Method: the example part at two fifths of its size, and options that contradict each other.

use crate::rig::{headway, stderr};
use std::path::Path;

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

/// Plans the example; the figures, or what was said.
fn planned(arguments: &[&str], folder: &Path) -> Result<serde_json::Value, String> {
    let job = folder.join("cap.hwj");
    let part = format!("{EXAMPLES}/cap.stl");
    let gantry = format!("{EXAMPLES}/machines/gantry.toml");
    let mut all = vec!["plan", part.as_str(), "-m", gantry.as_str(), "--json", "-o"];
    all.push(job.to_str().unwrap());
    all.extend(arguments);
    let output = headway(&all);
    match output.status.success() {
        true => Ok(serde_json::from_slice(&output.stdout).unwrap()),
        false => Err(stderr(&output)),
    }
}

#[test]
fn a_skin_is_planned_with_its_figures() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [
        "--curved-layers",
        "skin:2",
        "--scale",
        "0.4",
        "--quality",
        "fast",
    ];
    let figures = planned(&arguments, folder.path()).unwrap();
    let curved = &figures["curved_layers"];
    assert_eq!(curved["curved_layers"], 2, "{curved}");
    let number = |key: &str| curved[key].as_f64().unwrap();
    assert!(
        number("stair_error_mm3") < 0.4 * number("stair_error_flat_mm3"),
        "{curved}"
    );
    assert!(
        number("thickness_min") > 0.48 && number("thickness_max") < 1.52,
        "{curved}"
    );
    assert!(number("slope_max_deg") < 18.0, "{curved}");
    assert!(figures["covered_pct"].as_f64().unwrap() > 98.0, "{figures}");
}

#[test]
fn what_does_not_go_with_curved_layers_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, said) in [
        (&["--curved-layers", "all"][..], "skin:M"),
        (&["--curved-layers", "auto"], "skin:3"),
        (&["--curved-layers", "skin:0"], "M from 1"),
        (&["--curved-layers", "skin:30"], "fits"),
        (
            &["--curved-layers", "skin", "--layer-range", "1-3"],
            "--layer-range",
        ),
        (
            &[
                "--curved-layers",
                "skin",
                "--infill-density",
                "10",
                "--walls",
                "2",
            ],
            "17 or more",
        ),
        (
            &["--curved-layers", "skin", "--copies", "2"],
            "in one mesh file",
        ),
        (
            &[
                "--curved-layers",
                "skin",
                "--at",
                "100,80,0",
                "--at",
                "150,80,0",
            ],
            "in one mesh file",
        ),
        (
            &["--curved-layers", "skin", "--layer-range", "1-3"],
            "cut the mesh",
        ),
        (
            &["--curved-layers", "skin", "--cache", "kept"],
            "leave --cache out",
        ),
        (
            &["--curved-layers", "skin", "--first-layer-height", "0.3"],
            "give one --layer-height",
        ),
        (
            &["--curved-layers", "skin", "--first-layer-speed", "20"],
            "lower --speed",
        ),
        (
            &["--curved-layers", "skin", "--continuous-z"],
            "leave --continuous-z out",
        ),
        (
            &["--curved-layers", "skin", "--surface", "dome.stl"],
            "--surface",
        ),
    ] {
        let error = planned(arguments, folder.path()).unwrap_err();
        assert!(error.contains(said), "{arguments:?}: {error}");
    }
}
