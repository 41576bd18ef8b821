//! Goal: a part in pieces is planned by the command with its figures, what `auto` finds is a file that gives the same job, and
//! what does not go with pieces is refused with what to do. Method: a small T of two boxes.

use crate::rig::{box_triangles, folder, headway, object, path, stderr, stl, succeeded};
use std::path::Path;

const GANTRY: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/machines/gantry.toml"
);

fn tee(folder: &Path) -> String {
    let file = folder.join("tee.stl");
    let boxes = [
        [[-2.0, -2.0, 0.0], [2.0, 2.0, 10.0]],
        [[-7.5, -2.0, 9.0], [7.5, 2.0, 13.0]],
    ];
    let triangles: Vec<_> = boxes.into_iter().flat_map(box_triangles).collect();
    std::fs::write(&file, stl(triangles)).expect("written");
    path(&file).to_string()
}

fn planned(folder: &Path, job: &str, more: &[&str]) -> std::process::Output {
    let (part, job) = (tee(folder), folder.join(job));
    let own = ["plan", &part, "--json", "-o", path(&job)];
    let nozzle = [
        "--aperture",
        "ellipse:2x1",
        "--layer-height",
        "0.5",
        "--quality",
        "fast",
    ];
    headway(&[&own[..], &nozzle, more].concat())
}

#[test]
fn what_auto_finds_gives_the_same_job_from_its_file() {
    let folder = folder("directions");
    let output = planned(&folder, "auto.hwj", &["-m", GANTRY, "--directions", "auto"]);
    succeeded(&output);
    let figures = object(&output);
    let pieces = figures["pieces"].as_array().expect("pieces");
    assert!((2..=5).contains(&pieces.len()), "{pieces:?}");
    let sum = |key: &str| {
        pieces
            .iter()
            .map(|of| of[key].as_f64().expect(key))
            .sum::<f64>()
    };
    assert!(sum("overhang_upright_mm2") > 30.0, "{pieces:?}");
    assert!(
        sum("overhang_mm2") < 0.06 * sum("overhang_upright_mm2"),
        "{pieces:?}"
    );
    // Of both boxes once: layers and voxels of half a millimetre.
    let volume_mm3 = 16.0 * 10.0 + 15.0 * 16.0 - 16.0;
    assert!(
        (sum("volume_mm3") / volume_mm3 - 1.0).abs() < 0.06,
        "{pieces:?}"
    );
    assert_eq!(figures["touched_mm"], 0.0, "{figures:?}");
    let file = folder.join("auto.directions.toml");
    let again = planned(
        &folder,
        "again.hwj",
        &["-m", GANTRY, "--directions", path(&file)],
    );
    succeeded(&again);
    let bytes =
        ["auto.hwj", "again.hwj"].map(|job| std::fs::read(folder.join(job)).expect("a job"));
    assert!(bytes[0] == bytes[1], "other bytes");
    // A file that is somebody's own is not replaced.
    std::fs::write(&file, "[[piece]]\n").expect("written");
    let kept = planned(&folder, "auto.hwj", &["-m", GANTRY, "--directions", "auto"]);
    assert!(
        !kept.status.success() && stderr(&kept).contains("auto.directions.toml"),
        "{}",
        stderr(&kept)
    );
}

#[test]
fn files_that_name_no_pieces_are_refused() {
    let folder = folder("directions_refused");
    let file = folder.join("cuts.toml");
    let piece = |text: &str| format!("[[piece]]\n{text}\n");
    let side = piece("direction = [1, 0, 1]\nat_mm = [2, 0, 9.5]");
    let many = side.repeat(17);
    for (text, said) in [
        ("", "0 tables [[piece]]: write 1 to 16"),
        (many.as_str(), "17 tables [[piece]]: write 1 to 16"),
        (&piece("direction = [1, 0, 0]"), "missing field `at_mm`"),
        (
            &piece("direction = [1, 0, 0]\nat_mm = [2, 0, 9]\nname = 1"),
            "unknown field `name`",
        ),
        (
            &piece("direction = [0, 0, 0]\nat_mm = [2, 0, 9]"),
            "piece 1: direction = [0, 0, 0] has no length",
        ),
        (
            &piece("direction = [1, 0, -1]\nat_mm = [2, 0, 9]"),
            "piece 1: direction = [1, 0, -1] leads into the bed",
        ),
        (
            &piece("direction = [1, 0, 1]\nat_mm = [2, 0, 1e9]"),
            "piece 1: at_mm",
        ),
        (
            &format!(
                "{side}{}",
                piece("direction = [1, 0, 1]\nat_mm = [9, 0, 20]")
            ),
            "piece 2: nothing of the part lies above",
        ),
        (
            &piece("direction = [0, 0, 1]\nat_mm = [0, 0, 0]"),
            "piece 1: without it the rest",
        ),
        (
            &piece("direction = [1, 0, 0]\nat_mm = [2, 0, 11]"),
            "piece 1: no joints within their ranges",
        ),
    ] {
        std::fs::write(&file, text).expect("written");
        let output = planned(
            &folder,
            "x.hwj",
            &["-m", GANTRY, "--directions", path(&file)],
        );
        let told = stderr(&output);
        assert!(
            !output.status.success() && told.contains(said),
            "{text}: {told}"
        );
    }
    for (more, said) in [
        (&["--directions", "auto"][..], "do not tilt"),
        (
            &["-m", GANTRY, "--directions", "auto", "--place", "best"],
            "--place goes with",
        ),
        (
            &["-m", GANTRY, "--directions", "auto", "--layer-range", "1-3"],
            "--layer-range does not go with --directions",
        ),
        (
            &["-m", GANTRY, "--directions", "auto", "--copies", "2"],
            "--copies does not go with --directions",
        ),
        (
            &["-m", GANTRY, "--directions", "auto", "--vase"],
            "leave --continuous-z out",
        ),
        (
            &[
                "-m",
                GANTRY,
                "--directions",
                "auto",
                "--curved-layers",
                "skin",
            ],
            "does not go with --curved-layers",
        ),
        (&["-m", GANTRY, "--directions", "none.toml"], "none.toml"),
    ] {
        let output = planned(&folder, "x.hwj", more);
        assert!(
            !output.status.success() && stderr(&output).contains(said),
            "{more:?}: {}",
            stderr(&output)
        );
    }
    assert!(!folder.join("x.hwj").exists());
}
