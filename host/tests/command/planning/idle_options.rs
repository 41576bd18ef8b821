//! Goal: no option is given up in silence. Method: every option of the table on inputs where most of them can do nothing;
//! the job is another one, or the option is named in a note, a reason or the refusal.

use crate::rig::{box_triangles, folder, headway, object, path, stderr, stl, succeeded};
use headway::api::OPTION_NAMES;
use headway::settings::{Settings, machine_file};
use std::path::Path;

/// A value for each option that is not the default's.
const VALUES: [(&str, &str); 36] = [
    ("speed", "30"),
    ("wall-speed", "20"),
    ("solid-speed", "20"),
    ("sparse-speed", "20"),
    ("min-layer-time", "9"),
    ("max-layer-time", "0.01"),
    ("max-outer-inner-ratio", "1.2"),
    ("continuous-z", ""),
    ("layer-height", "0.3"),
    ("layers", "2"),
    ("pass", "one"),
    ("law", "linear"),
    ("quality", "fast"),
    ("tolerance", "0.05"),
    ("overlap", "20"),
    ("walls", "1"),
    ("infill-density", "30"),
    ("infill-spacing", "3"),
    ("bridge-max", "5"),
    ("bottom", "1"),
    ("top", "1"),
    ("infill-angle", "10"),
    ("skirt", "1"),
    ("skirt-distance-mm", "5"),
    ("brim", "1"),
    ("bead-width", "1"),
    ("avoid-crossing", ""),
    ("copies", "2"),
    ("copy-gap", "9"),
    ("first-layer-height", "0.3"),
    ("layer-range", "1-1"),
    ("curved-layers", "skin"),
    ("directions", "auto"),
    ("gap", "0.5"),
    ("corner-tolerance", "0.1"),
    ("place", "best"),
];
const OF_SEAMS: [(&str, &str); 2] = [("seam", "aligned"), ("seam-direction", "10")];
/// What bounds or allows: where nothing exceeds it, or nothing is in its way, it is kept. A strip as
/// narrow as its walls has the same with and without --walls, and its seam anywhere.
const KEPT: [&str; 7] = [
    "max-outer-inner-ratio",
    "tolerance",
    "quality",
    "avoid-crossing",
    "pass",
    "seam",
    "walls",
];

/// What shows that a job is another one.
fn motion(figures: &serde_json::Map<String, serde_json::Value>) -> Vec<String> {
    let keys = ["print_s", "volume_mm3", "segments", "travel_mm", "print_mm"];
    keys.map(|key| figures[key].to_string()).to_vec()
}

fn outline(folder: &Path, text: &str) -> String {
    let file = folder.join("outline.json");
    std::fs::write(&file, format!(r#"{{"units": "mm", "exterior": {text}}}"#)).expect("written");
    path(&file).to_string()
}

/// `headway plan` of these, with figures; the job is not looked at.
fn planned(folder: &Path, arguments: &[&[&str]]) -> std::process::Output {
    let job = folder.join("job.hwj");
    headway(
        &[
            &["plan", "--json", "-o", path(&job)],
            &arguments.concat()[..],
        ]
        .concat(),
    )
}

/// The options that neither change the job of `input` nor are told.
fn silent(folder: &Path, input: &[&str], kept: &[&str]) -> Vec<String> {
    let plain = motion(&object(&planned(folder, &[input])));
    let mut silent = Vec::new();
    for (option, value) in VALUES.iter().chain(&OF_SEAMS) {
        let name = format!("--{option}");
        if kept.contains(option) || input.contains(&name.as_str()) {
            continue;
        }
        let given: &[&str] = match *value {
            "" => &[&name],
            value => &[&name, value],
        };
        let output = planned(folder, &[input, given]);
        let messages = stderr(&output);
        if !output.status.success() {
            assert_eq!(output.status.code(), Some(2), "{messages}");
            let is_named = messages.contains(&name) || messages.contains("--walls");
            assert!(is_named, "{name}: {messages}");
            continue;
        }
        let figures = object(&output);
        let told = format!("{messages} {}", figures["verdict"]);
        // Reasons may name the key of the machine file.
        let other_name = match *option {
            "continuous-z" => "--vase",
            "max-layer-time" => "layer_time_max_s",
            _ => &name,
        };
        let is_told = told.contains(&name) || told.contains(other_name);
        if motion(&figures) == plain && !is_told {
            silent.push(name);
        }
    }
    silent
}

#[test]
fn every_option_changes_the_job_or_is_told() {
    let mut named: Vec<&str> = VALUES
        .iter()
        .chain(&OF_SEAMS)
        .map(|(name, _)| *name)
        .collect();
    let mut all: Vec<&str> = OPTION_NAMES.iter().map(|(name, _)| *name).collect();
    named.sort_unstable();
    all.sort_unstable();
    assert_eq!(named, all, "a new option needs a value above");
    let folder = folder("idle_options");
    let none: Vec<String> = Vec::new();
    let strip = outline(&folder, "[[0, 0], [6, 0], [6, 0.9], [0, 0.9]]");
    // One solid pass; the same with walls, which leave no ground inside; a path.
    assert_eq!(silent(&folder, &[&strip], &KEPT), none);
    let kept = [&KEPT[..], &["law"]].concat();
    assert_eq!(silent(&folder, &[&strip, "--walls", "3"], &kept), none);
    let line = folder.join("line.wpt");
    let rows = (0..12).map(|k| format!("{} 0 0.2 0 0 1\n", 2 * k));
    std::fs::write(&line, rows.collect::<String>()).expect("written");
    let kept = ["max-outer-inner-ratio", "corner-tolerance", "place"];
    let found = silent(&folder, &[path(&line)], &kept);
    assert_eq!(found, none);
}

#[test]
fn idle_options_say_why() {
    let folder = folder("idle_options_why");
    let strip = outline(&folder, "[[0, 0], [6, 0], [6, 0.9], [0, 0.9]]");
    let notes = |options: &[&str]| {
        let output = planned(&folder, &[&[&strip], options]);
        succeeded(&output);
        stderr(&output)
    };
    let told = notes(&["--seam-direction", "30", "--skirt-distance-mm", "5"]);
    assert!(
        told.contains("--seam aligned") && told.contains("--skirt N"),
        "{told}"
    );
    let told = notes(&["--aperture", "circle:0.4", "--law", "linear"]);
    assert!(told.contains("a round nozzle has no heading"), "{told}");
}

/// Goal: layers that no bead lies well in come first in the verdict, those that none can lay are refused. Method: heights
/// below and above 0.8 of the narrowest bead of 0.4 mm, and above the widest of 1.2 mm, with and without a mesh.
#[test]
fn layers_that_no_nozzle_lays_are_told() {
    let folder = folder("high_layers");
    let strip = outline(&folder, "[[0, 0], [6, 0], [6, 0.9], [0, 0.9]]");
    let plate = folder.join("plate.stl");
    let corners = [[0.0, 0.0, 0.0], [6.0, 0.9, 0.72]];
    std::fs::write(&plate, stl(box_triangles(corners))).expect("written");
    for input in [&strip[..], path(&plate)] {
        let reasons = |height: &str| {
            let figures = object(&planned(&folder, &[&[input, "--layer-height", height]]));
            figures["verdict"]["reasons"].to_string()
        };
        assert_eq!(reasons("0.32"), "[]");
        let told = reasons("0.36");
        assert!(
            told.starts_with("[\"HIGH LAYERS: layers of 0.36 mm"),
            "{told}"
        );
        for (more, status) in [
            (["0.36", "--refuse=layer-height"], 1),
            (["1.3", "--figures"], 2),
        ] {
            let asked = [&[input, "--layer-height"][..], &more[..]];
            assert_eq!(
                planned(&folder, &asked).status.code(),
                Some(status),
                "{input} {more:?}"
            );
        }
    }
}

/// Goal: a flow that the material's hot end does not melt is the first reason not to start, and refuses on request. Method: a
/// strip with bounds far below and above its flow.
#[test]
fn a_flow_that_no_hot_end_melts_is_told() {
    let folder = folder("melt");
    let strip = outline(&folder, "[[0, 0], [6, 0], [6, 0.9], [0, 0.9]]");
    let machine = folder.join("machine.toml");
    let asked = |most: &str, more: &[&str]| {
        let own = machine_file::to_new_toml(&Settings::planar());
        let text = format!("{own}\n[material]\nhot_end_c = 0\nmelt_max_mm3_s = {most}\n");
        std::fs::write(&machine, text).expect("written");
        planned(&folder, &[&[&strip, "-m", path(&machine)], more])
    };
    let reasons = |most: &str| object(&asked(most, &[]))["verdict"]["reasons"].to_string();
    assert!(!reasons("1000").contains("MELT"));
    let told = reasons("0.1");
    assert!(told.starts_with("[\"MELT: the flow reaches "), "{told}");
    assert_eq!(asked("0.1", &["--refuse=melt"]).status.code(), Some(1));
}

/// Goal: what lies on nothing is a reason not to start, with its place, and refuses on request. Method: a plate above
/// another one with layers between them that are empty, and one that stands.
#[test]
fn plates_that_float_are_reasons() {
    let folder = folder("floating");
    let file = |name: &str, boxes: &[[[f64; 3]; 2]]| {
        let file = folder.join(name);
        let triangles = boxes.iter().flat_map(|corners| box_triangles(*corners));
        std::fs::write(&file, stl(triangles)).expect("written");
        path(&file).to_string()
    };
    let base = [[0.0, 0.0, 0.0], [3.0, 3.0, 0.6]];
    let floats = file("floats.stl", &[base, [[0.5, 0.5, 1.2], [2.5, 2.0, 1.4]]]);
    let stands = file("stands.stl", &[base, [[0.5, 0.5, 0.6], [2.5, 2.0, 1.4]]]);
    let reasons = |file: &str| object(&planned(&folder, &[&[file]]))["verdict"]["reasons"].clone();
    assert_eq!(reasons(&stands).as_array().map(Vec::len), Some(0));
    let reason = reasons(&floats)[0].to_string();
    assert!(
        reason.contains("FLOATS: 3.00 mm²") && reason.contains("on layer 7 "),
        "{reason}"
    );
    assert!(reason.contains("layers 4 to 6 are empty"), "{reason}");
    let refused = planned(&folder, &[&[&floats, "--refuse", "floating"]]);
    assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
}
