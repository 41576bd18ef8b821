//! Goal: `headway reach` has the share that is known by hand, the same for a part that is turned, every figure that is
//! promised, and refuses what has no answer. Method: a T of two boxes on the gantry of the examples, 64.0 % upright with
//! self-support of 45°.

use crate::rig::{box_triangles, folder, headway, object, path, stderr, stl, succeeded};
use std::path::{Path, PathBuf};

const GANTRY: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/machines/gantry.toml"
);

/// A stem of 12 x 12 mm and an arm of 60 x 12 mm on it, 52 mm high, along x or y.
fn tee(folder: &Path, is_turned: bool) -> PathBuf {
    let turned = |[x, y, z]: [f64; 3]| if is_turned { [y, x, z] } else { [x, y, z] };
    let [stem, arm] = [
        [[-6.0, -6.0, 0.0], [6.0, 6.0, 40.0]],
        [[-30.0, -6.0, 40.0], [30.0, 6.0, 52.0]],
    ];
    let solid = [stem, arm].map(|corners| box_triangles(corners.map(turned)));
    let file = folder.join(if is_turned { "turned.stl" } else { "tee.stl" });
    std::fs::write(&file, stl(solid.concat())).expect("written");
    file
}

fn number(figures: &serde_json::Map<String, serde_json::Value>, key: &str) -> f64 {
    figures[key].as_f64().expect(key)
}

#[test]
fn a_t_has_its_shares_and_the_same_when_it_is_turned() {
    let folder = folder("reach_tee");
    let picture = folder.join("reach.svg");
    let shares = [false, true].map(|is_turned| {
        let part = tee(&folder, is_turned);
        let options = [
            "--voxel",
            "2",
            "--tilt-max",
            "30",
            "--json",
            "-o",
            path(&picture),
        ];
        let given = ["reach", path(&part), "-m", GANTRY];
        let figures = object(&headway(&[&given[..], &options[..]].concat()));
        let keys = ["upright_pct", "found_pct", "bound_pct"];
        for key in ["aperture_pct", "free_tilt_deg", "voxel_mm", "reach_s"] {
            assert!(number(&figures, key) >= 0.0, "{key}");
        }
        assert_eq!(figures["left_out"][0]["why"], "support");
        assert!((2..=5).contains(&figures["pieces"].as_u64().expect("a count")));
        assert!(!figures["directions"].as_array().expect("list").is_empty());
        keys.map(|key| number(&figures, key))
    });
    assert_eq!(shares[0], shares[1]);
    let [upright, found, bound] = shares[0];
    // A grid of 2 mm is off by twice what one of 1 mm is.
    assert!((upright - 64.0).abs() < 4.0, "{upright}");
    assert!(
        (bound - 87.1).abs() < 4.0 && bound - found < 0.5,
        "{found} {bound}"
    );
    let drawn = std::fs::read_to_string(&picture).expect("drawn");
    assert!(drawn.contains("sections") && drawn.contains("30.0°"));
}

#[test]
fn obstacles_and_sides_change_the_answer() {
    let folder = folder("reach_obstacle");
    let part = tee(&folder, false);
    let given = [
        "reach",
        path(&part),
        "-m",
        GANTRY,
        "--voxel",
        "3",
        "--tilt-max",
        "0",
        "--json",
    ];
    let plain = object(&headway(&given));
    // Over the part, which is in the middle of the work area.
    let file = folder.join("roof.stl");
    let corners = [[100.0, 100.0, 56.0], [150.0, 150.0, 60.0]];
    std::fs::write(&file, stl(box_triangles(corners))).expect("written");
    let output = headway(&[&given[..], &["--obstacle", path(&file)]].concat());
    let told = stderr(&output);
    assert!(
        output.status.code() == Some(1) && told.contains("obstacle"),
        "{told}"
    );
    let turned = object(&headway(&[&given[..], &["--orient"]].concat()));
    assert!(number(&turned, "found_pct") > number(&plain, "found_pct"));
    assert_eq!(number(&turned, "found_pct"), 100.0, "upside down");
}

#[test]
fn what_has_no_answer_is_refused() {
    let folder = folder("reach_refused");
    let part = tee(&folder, false);
    let open = folder.join("open.stl");
    let corners = [[0.0; 3], [20.0; 3]];
    std::fs::write(&open, stl(box_triangles(corners)[..10].to_vec())).expect("written");
    for (given, status, named) in [
        (
            vec![path(&part), "-m", GANTRY, "--voxel", "0.01"],
            1,
            "fits",
        ),
        (
            vec![path(&part), "-m", GANTRY, "--voxel", "0"],
            1,
            "--voxel",
        ),
        (
            vec![path(&part), "-m", GANTRY, "--tilt-max", "91"],
            2,
            "--tilt-max",
        ),
        (vec![path(&open), "-m", GANTRY], 1, "open.stl"),
    ] {
        let output = headway(&[&["reach"], &given[..]].concat());
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(status), "{told}");
        assert!(told.contains(named), "{told}");
    }
    let text = succeeded(&headway(&[
        "reach",
        path(&part),
        "-m",
        GANTRY,
        "--voxel",
        "4",
    ]));
    assert!(
        text.contains("not a plan") && text.contains("at most"),
        "{text}"
    );
}
