//! Goal: a pass that joins a wall with the lines inside it keeps both kinds by their place: figures count them, their own
//! speeds hold there alone, and the job file knows them. Method: a small plate of one wall, whose lines are linked to it.

use crate::rig::{folder, headway, object, path, succeeded};

#[test]
fn a_joined_pass_is_slowed_and_counted_by_its_kinds() {
    let folder = folder("plate");
    let (file, job) = (folder.join("plate.json"), folder.join("plate.hwj"));
    let outline = r#"{"units":"mm","exterior":[[0,0],[12,0],[12,10],[0,10]]}"#;
    std::fs::write(&file, outline).expect("written");
    let planned = |more: &[&str]| {
        let plan = ["plan", path(&file), "-o", path(&job), "--force", "--json"];
        let fast = ["--walls", "1", "--quality", "fast"];
        let figures = object(&headway(&[&plan[..], &fast, more].concat()));
        assert_eq!(
            figures["passes"].as_u64(),
            Some(1),
            "the lines are linked to the wall"
        );
        let of = |kind: &str, key: &str| figures["by_kind"][kind][key].as_f64().expect(key);
        ["walls", "solid"].map(|kind| [of(kind, "way_mm"), of(kind, "seconds")])
    };
    let [walls, solid] = planned(&[]);
    // The loop in the middle of a bead of 1.2 mm has 39.2 mm, its lines cover what is inside of it.
    assert!((39.0..50.0).contains(&walls[0]), "{walls:?}");
    assert!((60.0..80.0).contains(&solid[0]), "{solid:?}");
    let known = std::fs::read(&job).expect("a job");
    assert!(known.windows(11).any(|part| part == b"later_kinds"));
    // 95 % of 10 mm/s; where the kinds meet the speed changes.
    for (option, slow, other) in [("--wall-speed", 0, 1), ("--solid-speed", 1, 0)] {
        let slowed = planned(&[option, "10"]);
        let [way_mm, seconds] = slowed[slow];
        assert!(
            (seconds / (way_mm / 9.5) - 1.0).abs() < 0.05,
            "{option} {slowed:?}"
        );
        let before = [walls, solid][other];
        assert!(
            (slowed[other][1] / before[1] - 1.0).abs() < 0.1,
            "{option} {slowed:?}"
        );
    }
    succeeded(&headway(&["inspect", path(&job)]));
}
