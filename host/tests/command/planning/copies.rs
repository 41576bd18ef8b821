//! Goal: several parts on the bed are the part several times, where it is said, and parts that touch or do
//! not fit are refused. Method: the binary on a plate and on a cube; areas and volumes of the figures
//! against one part's, the poses of the job against the places.

use crate::rig::{box_triangles, folder, headway, object, path, stderr, stl, succeeded};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// A plate of 8 x 6 mm with a corner at (1, 2).
fn plate(folder: &Path) -> PathBuf {
    let file = folder.join("plate.json");
    let text = r#"{"units":"mm","exterior":[[1,2],[9,2],[9,8],[1,8]]}"#;
    std::fs::write(&file, text).expect("written");
    file
}

/// A cube of 6 mm on the bed, as text.
fn cube(folder: &Path) -> PathBuf {
    let file = folder.join("cube.stl");
    std::fs::write(&file, stl(box_triangles([[0.0; 3], [6.0; 3]]))).expect("written");
    file
}

fn number(figures: &Map<String, Value>, key: &str) -> f64 {
    figures[key].as_f64().expect(key)
}

/// Box of the beads of a job, machine coordinates of a part at (0, 0, 0), and how many lie in each.
fn beads_in(job: &Path, places: &[[f64; 2]]) -> Vec<usize> {
    let table = succeeded(&headway(&[
        "export",
        path(job),
        "--to",
        "csv",
        "--every-ms",
        "20",
    ]));
    let mut counts = vec![0; places.len()];
    for line in table.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let [x, y] = [3, 4].map(|cell| cells[cell].parse::<f64>().expect("a number"));
        if cells.last() != Some(&"print") {
            continue;
        }
        // The plate against the first one's origin.
        let is_in =
            |[u, v]: &[f64; 2]| (u + 1.0..u + 9.0).contains(&x) && (v + 2.0..v + 8.0).contains(&y);
        let at = places.iter().position(is_in);
        counts[at.unwrap_or_else(|| panic!("a bead at {x}, {y}"))] += 1;
    }
    counts
}

#[test]
fn copies_are_the_part_at_each_place() {
    let folder = folder("copies");
    let (input, job) = (plate(&folder), folder.join("plate.hwj"));
    let plan = |more: &[&str]| {
        headway(&[&["plan", path(&input), "-o", path(&job), "--json"], more].concat())
    };
    let one = object(&plan(&[]));
    let rows = plan(&["--copies", "4", "--copy-gap", "3"]);
    assert!(stderr(&rows).contains("4 parts"), "{}", stderr(&rows));
    let rows = object(&rows);
    for (key, share) in [("area_mm2", 1e-9), ("volume_mm3", 2e-3), ("passes", 1e-9)] {
        let times = number(&rows, key) / number(&one, key);
        assert!((times - 4.0).abs() < 4.0 * share, "{key}: {times}");
    }
    let places = [[0.0, 0.0], [11.0, 0.0], [0.0, 9.0], [11.0, 9.0]];
    let counts = beads_in(&job, &places);
    assert!(counts.iter().all(|count| *count > 20), "{counts:?}");
    let at = object(&plan(&[
        "--at", "60,50,0", "--at", "80,70,0", "--at", "45,70,0",
    ]));
    assert!((number(&at, "area_mm2") / number(&one, "area_mm2") - 3.0).abs() < 1e-9);
    let counts = beads_in(&job, &[[0.0, 0.0], [20.0, 20.0], [-15.0, 20.0]]);
    assert!(counts.iter().all(|count| *count > 20), "{counts:?}");
    let inspected = object(&headway(&["inspect", path(&job), "--json"]));
    assert_eq!(inspected["offset_mm"], serde_json::json!([60.0, 50.0, 0.0]));
}

#[test]
fn copies_of_a_mesh_have_all_its_layers() {
    let folder = folder("copies_mesh");
    let (input, job) = (cube(&folder), folder.join("cube.hwj"));
    let plan = |more: &[&str]| {
        let asked = [
            "plan",
            path(&input),
            "-o",
            path(&job),
            "--json",
            "--layer-height",
            "0.5",
            "--layer-range",
            "1-3",
        ];
        object(&headway(&[&asked, more].concat()))
    };
    let (one, three) = (plan(&[]), plan(&["--copies", "3"]));
    assert_eq!((&one["layers"], &three["layers"]), (&3.into(), &3.into()));
    for (key, share) in [("area_mm2", 1e-9), ("volume_mm3", 2e-3)] {
        let times = number(&three, key) / number(&one, key);
        assert!((times - 3.0).abs() < 3.0 * share, "{key}: {times}");
    }
}

#[test]
fn parts_that_cannot_lie_so_are_refused() {
    let folder = folder("copies_refused");
    let (input, job) = (plate(&folder), folder.join("plate.hwj"));
    let run = folder.join("run.wpt");
    std::fs::write(&run, "0 0 1 0 0 1\n5 0 1 0 0 1\n10 0 1 0 0 1\n").expect("written");
    let plan = |input: &Path, more: &[&str]| {
        headway(&[&["plan", path(input), "-o", path(&job)], more].concat())
    };
    let touching = plan(
        &input,
        &["--at", "60,50,0", "--at", "90,50,0", "--at", "65,53,0"],
    );
    let told = stderr(&touching);
    assert_eq!(touching.status.code(), Some(1), "{told}");
    assert!(told.contains("parts 1 and 3 touch near ("), "{told}");
    let many = plan(&input, &["--copies", "1000"]);
    assert_eq!(many.status.code(), Some(1));
    assert!(
        stderr(&many).contains("do; print fewer --copies"),
        "{}",
        stderr(&many)
    );
    for (input, wrong) in [
        (&input, &["--copies", "0"][..]),
        (&input, &["--copy-gap", "3"]),
        (&input, &["--copies", "2", "--copy-gap", "-1"]),
        (
            &input,
            &["--copies", "2", "--at", "60,50,0", "--at", "90,50,0"],
        ),
        (&input, &["--at", "60,50,0", "--at", "90,50,1"]),
        (&run, &["--copies", "2"]),
        (&run, &["--at", "60,50,0", "--at", "90,50,0"]),
    ] {
        let refused = plan(input, wrong);
        assert_eq!(
            refused.status.code(),
            Some(2),
            "{wrong:?}: {}",
            stderr(&refused)
        );
    }
    assert!(!job.exists());
}
