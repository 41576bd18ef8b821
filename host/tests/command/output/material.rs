//! Goal: `simulate --material` tells, tabulates and draws what a known extruder lays, the library the same, and a file that
//! cannot be is refused with its key. Method: an example's job with and without a material, by the whole command.

use crate::rig::{example, folder, headway, object, path, stderr, succeeded};
use headway::api::Job;

/// A fifth is lost; the lag is that of the built-in machine's pressure advance.
const MATERIAL: &str = "format = 1\n[extruder]\nflow_loss = [[1, 0.2], [100, 0.2]]\nlag_s = 0.03\n";

#[test]
fn what_a_material_lays_is_told_tabulated_and_drawn() {
    let folder = folder("material");
    let file = |name: &str| folder.join(name);
    let (job, material, report) = (file("a.hwj"), file("a.toml"), file("report"));
    std::fs::write(&material, MATERIAL).expect("written");
    succeeded(&headway(&[
        "plan",
        &example("taper.json"),
        "-o",
        path(&job),
    ]));
    let simulated = |more: &[&str]| headway(&[&["simulate", path(&job), "--json"], more].concat());
    let trace = file("trace.csv");
    let with = [
        "--material",
        path(&material),
        "--report",
        path(&report),
        "--trace",
        path(&trace),
    ];
    let (plain, laid) = (object(&simulated(&[])), object(&simulated(&with)));
    for (key, value) in &plain {
        let is_timed = key == "realtime_factor" || key == "verdict";
        assert!(is_timed || laid[key] == *value, "{key}");
    }
    assert!(!plain.contains_key("laid_mm3"));
    let number = |key: &str| laid[key].as_f64().expect(key);
    assert!((number("laid_mm3") / number("volume_mm3") - 0.8).abs() < 0.01);
    assert!((number("laid_error_pct") + 20.0).abs() < 1.0);
    assert!((number("bead_area_error_pct_mean") - 20.0).abs() < 1.0);
    assert!(number("bead_area_error_pct_max") < 50.0);
    let worst = laid["bead_area_worst"]["worst"].as_f64().expect("a place");
    assert_eq!(worst.abs(), number("bead_area_error_pct_max"));
    let layer = &laid["laid_by_layer"][0];
    assert!(layer["laid_mm3"].as_f64() < layer["asked_mm3"].as_f64());
    let told = laid["verdict"].to_string();
    assert!(
        told.contains("Of the material 79.8 % arrives")
            && told.contains("beads are off by 20.5 % in the mean"),
        "{told}"
    );
    let table = std::fs::read_to_string(&trace).expect("a table");
    let rows: Vec<Vec<&str>> = table
        .lines()
        .map(|line| line.split(',').collect())
        .collect();
    assert_eq!(rows[0][13..], ["laid_mm3_s"]);
    let sum = |column: usize| {
        rows[1..]
            .iter()
            .map(|row| row[column].parse::<f64>().expect("a number"))
            .sum::<f64>()
    };
    assert!(
        (sum(13) / sum(11) - 0.8).abs() < 0.02,
        "{} {}",
        sum(13),
        sum(11)
    );
    let page = std::fs::read_to_string(report.join("index.html")).expect("a page");
    assert!(page.contains("\"laid\":{\"min\":"));
    let of_library = Job::from_bytes(std::fs::read(&job).expect("a job")).expect("a job");
    let of_library = of_library
        .simulate_material("", 1, MATERIAL)
        .expect("a run");
    for key in [
        "laid_mm3",
        "laid_error_pct",
        "bead_area_error_pct_max",
        "bead_area_error_ends_pct_max",
    ] {
        assert_eq!(of_library.figure(key), laid[key].as_f64(), "{key}");
    }
}

#[test]
fn materials_that_cannot_be_are_refused() {
    let folder = folder("no_material");
    let file = folder.join("a.toml");
    for (text, part) in [
        (
            MATERIAL.replace("0.2], [100", "nan], [100"),
            "a.toml: extruder.flow_loss: point 1",
        ),
        (
            MATERIAL.replace("flow_loss", "flow_los"),
            "line 3: flow_los = ",
        ),
        (
            MATERIAL.replace("0.03", "40"),
            "extruder.lag_s is 40, but must be at most 30",
        ),
    ] {
        std::fs::write(&file, text).expect("written");
        let output = headway(&[
            "simulate",
            &example("taper.json"),
            "--material",
            path(&file),
        ]);
        assert_eq!(output.status.code(), Some(1));
        assert!(stderr(&output).contains(part), "{}", stderr(&output));
    }
    let gone = folder.join("gone.toml");
    let output = headway(&[
        "simulate",
        &example("taper.json"),
        "--material",
        path(&gone),
    ]);
    assert!(
        stderr(&output).contains("gone.toml: there is no such file"),
        "{}",
        stderr(&output)
    );
}
