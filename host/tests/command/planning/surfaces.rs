//! Goal: the ways to say what of a surface is printed on do what the guide says. Method: an OBJ of an arch of R 20,
//! 10 x 10 mm, with a wall in a group of its own: planned by itself, by group and by lean, with an outline drawn on it, and with
//! regions and outlines that are not there; figures from `--json`.

use crate::rig::{headway, stderr};
use std::fmt::Write;
use std::path::{Path, PathBuf};

const GANTRY: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/machines/gantry.toml"
);

/// A point of the arch.
fn arch(x: f64, y: f64) -> [f64; 3] {
    [x, y, (400.0 - x * x).sqrt() - 15.0]
}

/// An arch of 1 mm squares as group `top`, and an upright wall at its end as group `wall`.
fn obj(folder: &Path) -> PathBuf {
    let mut text = String::new();
    for j in 0..=10 {
        for i in 0..=10 {
            let [x, y, z] = arch(f64::from(i) - 5.0, f64::from(j) - 5.0);
            writeln!(text, "v {x} {y} {z}").unwrap();
        }
    }
    for (x, z) in [(-5.0, 1.0), (5.0, 1.0)] {
        writeln!(text, "v {x} -5 {z}").unwrap();
    }
    writeln!(text, "g top").unwrap();
    for j in 0..10 {
        for i in 0..10 {
            let corner = 11 * j + i + 1;
            writeln!(
                text,
                "f {} {} {} {}",
                corner,
                corner + 1,
                corner + 12,
                corner + 11
            )
            .unwrap();
        }
    }
    writeln!(text, "g wall\nf 122 123 11 1").unwrap();
    let path = folder.join("arch.obj");
    std::fs::write(&path, text).unwrap();
    path
}

/// Plans; the figures, or what was said.
fn planned(arguments: &[&str], folder: &Path) -> Result<serde_json::Value, String> {
    let job = folder.join("out.hwj");
    let mut all = vec!["plan"];
    all.extend(arguments);
    all.extend([
        "-m",
        GANTRY,
        "--quality",
        "fast",
        "--json",
        "-o",
        job.to_str().unwrap(),
    ]);
    let output = headway(&all);
    match output.status.success() {
        true => Ok(serde_json::from_slice(&output.stdout).unwrap()),
        false => Err(stderr(&output)),
    }
}

fn figure(figures: &serde_json::Value, key: &str) -> f64 {
    figures[key]
        .as_f64()
        .unwrap_or_else(|| panic!("no {key}: {figures}"))
}

/// The arch is 10.11 mm wide along its arc at the ground, and 10.21 on the first layer's top.
#[test]
fn a_patch_is_planned_by_itself_and_by_region() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = obj(folder.path());
    let mesh = mesh.to_str().unwrap();
    for region in ["group:top", "normal:60"] {
        let figures = planned(
            &["--surface", mesh, "--surface-region", region],
            folder.path(),
        )
        .unwrap();
        let area_mm2 = figure(&figures, "area_mm2");
        // Cells at the rims.
        assert!((area_mm2 - 102.1).abs() < 0.8, "{area_mm2}");
        assert!(figure(&figures, "covered_pct") > 97.0, "{figures}");
        assert!(figure(&figures, "outside_depth_mm") < 2e-3, "{figures}");
        assert!(figure(&figures, "open_largest_mm2") < 1.0, "{figures}");
    }
    let said = planned(
        &["--surface", mesh, "--surface-region", "group:side"],
        folder.path(),
    )
    .unwrap_err();
    assert!(said.contains("its groups: top, wall"), "{said}");
    let said = planned(
        &["--surface", mesh, "--surface-region", "side"],
        folder.path(),
    )
    .unwrap_err();
    assert!(said.contains("write group:NAME"), "{said}");
}

#[test]
fn an_outline_is_drawn_on_a_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = obj(folder.path());
    let mesh = mesh.to_str().unwrap();
    let write = |name: &str, raised: f64| {
        let corners = [[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]];
        let points = corners.map(|[x, y]| {
            let [x, y, z] = arch(x, y);
            [x, y, z + raised]
        });
        let text = serde_json::json!({"units": "mm", "exterior": points});
        let path = folder.path().join(name);
        std::fs::write(&path, text.to_string()).unwrap();
        path
    };
    let drawn = write("drawn.json", 0.0);
    let options = ["--surface", mesh, "--surface-region", "group:top"];
    let with = |path: &PathBuf| {
        let mut all = vec![path.to_str().unwrap()];
        all.extend(options);
        planned(&all, folder.path())
    };
    let figures = with(&drawn).unwrap();
    let area_mm2 = figure(&figures, "area_mm2");
    // 6 mm by an arc of 6.02 mm, longer by a hundredth on the layer's top.
    assert!((area_mm2 - 36.5).abs() < 0.4, "{area_mm2}");
    assert!(figure(&figures, "covered_pct") > 97.0, "{figures}");
    let said = with(&write("raised.json", 0.5)).unwrap_err();
    assert!(
        said.contains("off the surface, more than half a layer"),
        "{said}"
    );
}
