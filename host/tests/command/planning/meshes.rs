//! Goal: the command takes a mesh from a file to a job that runs, says what it is made of, and leaves
//! nothing behind where it refuses. Method: the binary on the example hook and on broken files.

use crate::rig::{
    box_triangles, command, example, folder, headway, headway_with, object, path, stderr, stdout,
    stl, succeeded,
};

/// A tetrahedron of 10 mm as an ASCII STL.
const TETRAHEDRON: [[[f64; 3]; 3]; 4] = [
    [[0.0, 0.0, 0.0], [0.0, 10.0, 0.0], [10.0, 0.0, 0.0]],
    [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 0.0, 10.0]],
    [[0.0, 0.0, 0.0], [0.0, 0.0, 10.0], [0.0, 10.0, 0.0]],
    [[10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]],
];

/// Goal: what `inspect --json` says of a mesh is what other programs rely on. Method: layers counted
/// and summed up against the volume; turned, scaled and cut otherwise by hand.
#[test]
fn a_mesh_is_inspected_by_layers() {
    let hook = example("hook.stl");
    let found = object(&headway(&["inspect", &hook, "--json"]));
    let layers = found["layers"].as_array().expect("layers");
    assert_eq!(layers.len(), 60);
    assert!((layers[59]["z_mm"].as_f64().expect("a height") - 12.0).abs() < 1e-6);
    assert_eq!(layers[0]["regions"], 1);
    let area_mm2 = |layer: &serde_json::Value| layer["area_mm2"].as_f64().expect("an area");
    let volume_mm3: f64 = layers.iter().map(|layer| 0.2 * area_mm2(layer)).sum();
    let mesh_mm3 = found["volume_mm3"].as_f64().expect("a volume");
    assert!(
        (volume_mm3 / mesh_mm3 - 1.0).abs() < 1e-3,
        "{volume_mm3} {mesh_mm3}"
    );
    let turned = [
        "inspect",
        &hook,
        "--json",
        "--rotate",
        "90,0,0",
        "--scale",
        "0.5",
        "--layer-height",
        "0.25",
        "--first-layer-height",
        "0.4",
        "--layer-range",
        "2-11",
    ];
    let found = object(&headway(&turned));
    let layers = found["layers"].as_array().expect("layers");
    assert_eq!(layers.len(), 10);
    // On its back: 20 mm high from z = 0, the second layer's top above the first.
    assert!((layers[0]["z_mm"].as_f64().expect("a height") - 0.65).abs() < 1e-6);

    // 12 mm high: 20 layers up to 2 mm, the first among them, 50 of 0.2 mm; what lies above is told.
    let ranges = [
        "inspect",
        &hook,
        "--json",
        "--layer-heights",
        "0-2:0.1,20-30:0.1",
    ];
    let found = object(&headway(&ranges));
    let layers = found["layers"].as_array().expect("layers");
    let number = |layer: &serde_json::Value, key: &str| layer[key].as_f64().expect("a number");
    assert_eq!(layers.len(), 70);
    assert!((number(&layers[0], "height_mm") - 0.1).abs() < 1e-9);
    assert!((number(&layers[19], "z_mm") - 2.0).abs() < 1e-9);
    assert!((number(&layers[69], "height_mm") - 0.2).abs() < 1e-9);
    let notes = found["notes"].to_string();
    assert!(notes.contains("20 of 0.1 mm from 0 to 2 mm"), "{notes}");
    assert!(notes.contains("1 of the ranges lie above"), "{notes}");
}

/// Goal: the first layer's height may stand in the machine file, and the option goes over it. Method: the heights of the
/// first two layers.
#[test]
fn a_machine_file_has_the_first_layers_height() {
    let folder = folder("first-height");
    let machine = folder.join("machine.toml");
    let text = succeeded(&headway(&["machine", "new"]));
    let own = "layer_height_mm = 0.2\n";
    let first = format!("{own}first_layer_height_mm = 0.3\n");
    std::fs::write(&machine, text.replacen(own, &first, 1)).expect("written");
    let job = folder.join("hook.hwj");
    let heights = |more: &[&str]| {
        let hook = example("hook.stl");
        let plan = ["plan", &hook, "-m", path(&machine), "-o", path(&job)];
        let some = ["--layer-range", "1-2", "--quality", "fast", "--json"];
        let figures = object(&headway(&[&plan[..], &some, more].concat()));
        let layers = figures["by_layer"].as_array().expect("layers").clone();
        let heights = layers.iter().map(|layer| layer["height_mm"].as_f64());
        heights.map(|mm| mm.expect("a height")).collect::<Vec<_>>()
    };
    assert_eq!(heights(&[]), [0.3, 0.2]);
    assert_eq!(heights(&["--first-layer-height", "0.25"]), [0.25, 0.2]);
}

/// Goal: a range of layers of the hook becomes a job, runs without a fault and lies at its height.
/// Method: simulated; the poses of the job.
#[test]
fn a_mesh_is_printed() {
    let folder = folder("printed");
    let job = folder.join("hook.hwj");
    let output = headway(&[
        "plan",
        &example("hook.stl"),
        "-o",
        path(&job),
        "--layer-range",
        "21-23",
        "--walls",
        "2",
        "--infill-density",
        "20",
        "--layer-heights",
        "4.4-6:0.15",
        "--json",
    ]);
    let figures = object(&output);
    assert_eq!(figures["layers"], 3);
    let layers = figures["by_layer"].as_array().expect("layers");
    let mut heights: Vec<f64> = layers
        .iter()
        .map(|layer| layer["height_mm"].as_f64().expect("a height"))
        .collect();
    heights.sort_by(f64::total_cmp);
    // Eleven layers fit 1.6 mm.
    let expected = [1.6 / 11.0, 0.2, 0.2];
    let pairs = heights.iter().zip(expected);
    assert!(
        pairs
            .clone()
            .all(|(found, asked)| (found - asked).abs() < 1e-9)
    );
    assert_eq!(figures["left_out_places"].as_array().map(Vec::len), Some(0));
    let report = folder.join("report");
    let found = object(&headway(&[
        "simulate",
        path(&job),
        "--report",
        path(&report),
        "--json",
    ]));
    assert_eq!((&found["faults"], &found["layers"]), (&0.into(), &3.into()));
    let poses = succeeded(&headway(&[
        "export",
        path(&job),
        "--to",
        "csv",
        "--every-ms",
        "100",
    ]));
    let printed = poses.lines().filter(|line| line.ends_with(",print"));
    let heights: Vec<f64> = printed
        .map(|line| {
            line.split(',')
                .nth(5)
                .and_then(|z| z.parse().ok())
                .expect("a height")
        })
        .collect();
    assert!(
        heights.iter().all(|z| (4.19..4.61).contains(z)),
        "{heights:?}"
    );
}

/// Goal: a job is the same file for any number of threads, with and without pieces that were kept, after
/// one of these was damaged (told) and after planning was stopped in mid-way, which leaves no job and
/// nothing half. Method: a tetrahedron, whose layers all differ, planned in all these ways; Ctrl-C as a signal.
#[cfg(unix)]
#[test]
fn a_stopped_plan_goes_on_and_makes_the_same_job() {
    let folder = folder("cached");
    let mesh = folder.join("tetrahedron.stl");
    std::fs::write(&mesh, stl(TETRAHEDRON)).expect("a mesh");
    let names = |folder: &std::path::Path| -> Vec<std::path::PathBuf> {
        let entries = std::fs::read_dir(folder).expect("a folder");
        let mut names: Vec<_> = entries.map(|entry| entry.expect("a name").path()).collect();
        names.sort();
        names
    };
    let job = folder.join("job.hwj");
    let cache = folder.join("cache");
    let asked = [
        "plan",
        path(&mesh),
        "-o",
        path(&job),
        "--layer-height",
        "0.4",
        "--walls",
        "1",
        "--infill-density",
        "20",
    ];
    let with_cache = [&asked[..], &["--cache", path(&cache)]].concat();
    let bytes = |output: &std::process::Output| {
        succeeded(output);
        std::fs::read(&job).expect("a job")
    };
    let expected = bytes(&headway_with("1", &asked));
    std::fs::remove_file(&job).expect("a job");

    let mut planning = command(&with_cache).spawn().expect("the command starts");
    while !cache.is_dir()
        || !names(&cache)
            .iter()
            .any(|p| p.extension() == Some("piece".as_ref()))
    {
        std::thread::sleep(std::time::Duration::from_millis(5));
        assert_eq!(
            planning.try_wait().expect("a child"),
            None,
            "planned before it was stopped"
        );
    }
    let interrupt = ["-INT", &planning.id().to_string()];
    let told = std::process::Command::new("kill").args(interrupt).status();
    assert!(told.expect("kill").success());
    let stopped = planning.wait_with_output().expect("an end");
    assert_eq!(stopped.status.code(), Some(130), "{}", stderr(&stopped));
    assert!(stderr(&stopped).contains("goes on"), "{}", stderr(&stopped));
    assert_eq!(names(&folder), [cache.clone(), mesh.clone()]);
    let kept = names(&cache);
    assert!(
        kept.iter().all(|p| p.extension() == Some("piece".as_ref())),
        "{kept:?}"
    );

    assert!(bytes(&headway(&with_cache)) == expected);
    let all = names(&cache);
    assert!(all.len() > kept.len());
    let mut damaged = std::fs::read(&all[0]).expect("a piece");
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    std::fs::write(&all[0], damaged).expect("room");
    let again = headway(&with_cache);
    assert!(bytes(&again) == expected);
    assert!(stderr(&again).contains("is damaged"), "{}", stderr(&again));
    let whole = headway(&with_cache);
    assert!(bytes(&whole) == expected);
    assert!(!stderr(&whole).contains("damaged"), "{}", stderr(&whole));
}

/// Goal: speeds of kinds are kept, short layers are slowed to their least time, and what time and material are
/// spent on adds up to the whole. Method: figures of a prism of six layers against its totals; the way of each kind over
/// its time; a material by hand.
#[test]
fn kinds_and_layer_times_are_kept_and_told() {
    let folder = folder("kinds");
    let machine = folder.join("machine.toml");
    let mut text = succeeded(&headway(&["machine", "new"]));
    text += "\n[material]\nhot_end_c = 0\ndensity_g_cm3 = 1.25\nprice_per_kg = 20\ndiameter_mm = 1.75\n";
    text += "\n[kinds.first_layer]\nspeed_mm_s = 15\nflow_factor = 1.1\n";
    std::fs::write(&machine, text).expect("a machine file");
    let job = folder.join("job.hwj");
    let asked = [
        "plan",
        &example("bracket.json"),
        "-m",
        path(&machine),
        "-o",
        path(&job),
        "--layers",
        "4",
        "--walls",
        "1",
        "--infill-density",
        "20",
        "--bottom",
        "1",
        "--top",
        "1",
        "--json",
    ];
    let plain = object(&headway(&asked));
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    let kinds = |figures: &serde_json::Map<String, serde_json::Value>| {
        figures["by_kind"].as_object().expect("kinds").clone()
    };
    for (key, of_kind) in [("print_s", "seconds"), ("volume_mm3", "volume_mm3")] {
        let sum: f64 = kinds(&plain)
            .values()
            .map(|kind| number(&kind[of_kind]))
            .sum();
        assert!(
            (sum / number(&plain[key]) - 1.0).abs() < 1e-3,
            "{key}: {sum}"
        );
    }
    let volume_mm3 = number(&plain["volume_mm3"]);
    let mass_g = number(&plain["mass_g"]);
    assert!((mass_g - 1.25e-3 * volume_mm3).abs() < 1e-9);
    assert!((number(&plain["material_cost"]) - 0.02 * mass_g).abs() < 1e-9);
    assert!((number(&plain["filament_mm"]) - volume_mm3 / 2.405_281_875).abs() < 1e-3);
    let layers = plain["by_layer"].as_array().expect("layers");
    // The lowest is the slow one, and fuller by a tenth than the highest, which is as solid.
    assert_eq!((&layers[0]["layer"], layers.len()), (&0.into(), 4));
    let top = layers
        .iter()
        .find(|layer| layer["layer"] == 3)
        .expect("a top");
    let fuller = number(&layers[0]["volume_mm3"]) / number(&top["volume_mm3"]);
    assert!((fuller - 1.1).abs() < 0.02, "{fuller}");

    let slow = [
        "--wall-speed",
        "20",
        "--sparse-speed",
        "30",
        "--min-layer-time",
        "12",
    ];
    let slowed = object(&headway(&[&asked[..], &slow].concat()));
    let speed_mm_s = |kind: &str| {
        let kind = &kinds(&slowed)[kind];
        number(&kind["way_mm"]) / number(&kind["seconds"])
    };
    assert!(speed_mm_s("walls") < 20.0 && speed_mm_s("sparse") < 30.0);
    let seconds = |figures: &serde_json::Map<String, serde_json::Value>| -> Vec<f64> {
        let layers = figures["by_layer"].as_array().expect("layers");
        layers
            .iter()
            .map(|layer| number(&layer["seconds"]))
            .collect()
    };
    assert!(
        seconds(&plain).iter().any(|s| *s < 12.0),
        "{:?}",
        seconds(&plain)
    );
    let least = seconds(&slowed).into_iter().fold(f64::INFINITY, f64::min);
    assert!((11.99..14.5).contains(&least), "{least}");
    assert!(number(&slowed["slowed_layers"]) > 0.0);
    let found = object(&headway(&["simulate", path(&job), "--json"]));
    assert_eq!(found["faults"], 0);

    let fast = headway(&[&asked[..], &["--wall-speed", "90"]].concat());
    assert_eq!(fast.status.code(), Some(2));
    assert!(
        stderr(&fast).contains("kinds.walls.speed_mm_s"),
        "{}",
        stderr(&fast)
    );
}

/// Goal: a broken mesh is refused with its place and a remedy, exit 1; senseless options, exit 2;
/// neither leaves a file. Method: files and words.
#[test]
fn broken_meshes_leave_nothing_behind() {
    let folder = folder("broken");
    let whole = stl(TETRAHEDRON);
    let cases: &[(&str, String, &[&str], i32, &str)] = &[
        (
            "open.stl",
            stl(TETRAHEDRON[..3].iter().copied()),
            &[],
            1,
            "open in 1 place",
        ),
        ("sheet.stl", stl([TETRAHEDRON[0]; 2]), &[], 1, "open"),
        (
            "none.stl",
            "solid none\nendsolid none\n".into(),
            &[],
            1,
            "no triangle",
        ),
        (
            "cut.stl",
            whole[..150].to_string(),
            &[],
            1,
            "export it again",
        ),
        (
            "word.stl",
            whole.replace("10", "ten"),
            &[],
            1,
            "export it again",
        ),
        ("far.stl", whole.replace("10", "1e30"), &[], 1, "--units"),
        ("nothing.3mf", "PK".into(), &[], 1, "not a readable 3MF"),
        ("nothing.obj", "# nothing\n".into(), &[], 1, "no triangle"),
        (
            "whole.stl",
            whole.clone(),
            &["--scale", "0.001"],
            1,
            "smaller than",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--units", "m", "--scale", "2"],
            1,
            "larger than",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--layer-height", "1.2", "--scale", "0.05"],
            1,
            "half of its first layer",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--layer-range", "60-70"],
            1,
            "layers 1 to 50",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--scale", "0.04"],
            1,
            "nothing can be printed",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--scale", "100"],
            1,
            "work area",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--layer-range", "b"],
            2,
            "--layer-range 1-20",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--rotate", "90"],
            2,
            "--rotate 90,0,45",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--layers", "5"],
            2,
            "--layer-range",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--layer-heights", "0-2:0.1,1-10:0.2"],
            2,
            "begins below the end of the one before it, 2 mm",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--layer-heights", "2-0:0.1"],
            2,
            "write the lower end first",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--layer-heights", "0-2=0.1"],
            2,
            "--layer-heights 0-2:0.1,2-10:0.2",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--layer-heights", "0-2:0"],
            2,
            "--layer-heights 0: write a height",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--layer-heights", "4-8:1.5"],
            2,
            "widest bead is 1.200 mm wide",
        ),
        (
            "whole.stl",
            whole.clone(),
            &[
                "--layer-heights",
                "0-0.2:0.1",
                "--first-layer-height",
                "0.3",
            ],
            2,
            "lies in the first layer",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--first-layer-height", "0"],
            2,
            "--first-layer-height 0",
        ),
        (
            "whole.stl",
            whole.clone(),
            &["--first-layer-speed", "500"],
            2,
            "--first-layer-speed 500",
        ),
        (
            "flat.json",
            std::fs::read_to_string(example("taper.json")).expect("example"),
            &["--layer-range", "1-2"],
            2,
            "goes with meshes",
        ),
        (
            "flat.json",
            std::fs::read_to_string(example("taper.json")).expect("example"),
            &["--rotate", "1,2,3"],
            2,
            "--rotate turns meshes",
        ),
    ];
    for (name, text, options, status, word) in cases {
        let file = folder.join(name);
        std::fs::write(&file, text).expect("file");
        let job = folder.join("part.hwj");
        let mut arguments = vec!["plan", path(&file), "-o", path(&job)];
        arguments.extend_from_slice(options);
        let output = headway(&arguments);
        let said = stderr(&output);
        assert_eq!(
            output.status.code(),
            Some(*status),
            "{name} {options:?}: {said}"
        );
        assert!(said.contains(word), "{name} {options:?}: {said}");
        std::fs::remove_file(&file).expect("the file");
        let left = std::fs::read_dir(&folder).expect("folder").count();
        assert_eq!(left, 0, "{name} {options:?}");
    }
}

/// A picture of an upper layer had the lowest layer's outline, and was as large; a rib that no bead fits in
/// vanished from a part without a word.
/// Goal: the picture shows the layer, ground that stays open is named with its height. Method: a plate with a
/// rib of 0.3 mm and a smaller plate on it; sizes of the sheets, the outline's points, the note.
#[test]
fn pictures_show_their_layer_and_open_ground_is_named() {
    let folder = folder("steps");
    let file = folder.join("steps.stl");
    let plate = [[0.0, 0.0, 0.0], [9.0, 3.0, 0.2]];
    let rib = [[8.0, 1.0, 0.0], [15.0, 1.3, 0.2]];
    let upper = [[1.0, 1.0, 0.2], [4.0, 3.0, 0.4]];
    std::fs::write(
        &file,
        stl([plate, rib, upper].into_iter().flat_map(box_triangles)),
    )
    .expect("file");
    let job = folder.join("steps.hwj");
    let plan = [
        "plan",
        path(&file),
        "-o",
        path(&job),
        "--layer-height",
        "0.2",
    ];
    let walls = [
        "--walls",
        "1",
        "--infill-density",
        "20",
        "--quality",
        "fast",
    ];
    let output = headway(&[&plan[..], &walls].concat());
    let said = stderr(&output);
    let note = said.lines().find(|line| line.contains("stay open"));
    let note = note.unwrap_or_else(|| panic!("{said}"));
    // The rib's middle, but for what reaches into it and what stays open beside its mouth, and its height.
    let is_middle = |x: &&str| note.contains(&format!("mm² near ({x}"));
    assert!(["11.8", "11.9", "12.0"].iter().any(is_middle), "{note}");
    assert!(note.contains(", 0.20)"), "{note}");
    let picture = |layer: &str| {
        let export = ["export", path(&job), "--to", "svg", "--layer", layer];
        succeeded(&headway(&export))
    };
    let view = |svg: &str| {
        let from = svg
            .split("viewBox=\"")
            .nth(1)
            .and_then(|rest| rest.split('"').next());
        from.unwrap_or_else(|| panic!("{svg}")).to_string()
    };
    let (lower, upper) = (picture("1"), picture("2"));
    assert_ne!(view(&lower), view(&upper));
    let outline = |svg: &str| {
        let path = svg.split("fill=\"#edf2f7\"").next().unwrap_or_default();
        let path = path.rsplit("d=\"").next().unwrap_or_default();
        path.split('"')
            .next()
            .unwrap_or_default()
            .matches('L')
            .count()
    };
    assert!(outline(&lower) > outline(&upper), "{lower}");
    assert_eq!(outline(&upper), 3, "{upper}");
}

/// Goal: shares of a part that are planned by several runs, in any order, give the job of one run, byte for byte, and say
/// which layers they planned; a share of what is no mesh in flat layers, and one that does not exist, are refused.
#[test]
fn shards_of_a_part_give_the_same_job() {
    let folder = folder("shards");
    let mesh = folder.join("tetrahedron.stl");
    std::fs::write(&mesh, stl(TETRAHEDRON)).expect("a mesh");
    let (cache, job) = (folder.join("cache"), folder.join("job.hwj"));
    let asked = ["plan", path(&mesh), "--layer-height", "0.4"];
    let with_cache = [&asked[..], &["--cache", path(&cache)]].concat();
    let shard = |of: &str| headway(&[&with_cache[..], &["--shard", of]].concat());
    let job_of = |asked: &[&str]| {
        succeeded(&headway(&[asked, &["-o", path(&job)]].concat()));
        std::fs::read(&job).expect("a job")
    };
    let mut layers = Vec::new();
    for of in ["2/2", "1/2"] {
        let planned = shard(of);
        succeeded(&planned);
        assert!(!job.exists());
        let said = stdout(&planned);
        assert!(said.contains(&format!("shard {of}: ")), "{said}");
        let own = said.lines().filter(|line| line.ends_with(" planned"));
        layers.extend(own.map(str::to_string));
    }
    assert!(layers.len() > 2, "{layers:?}");
    let pieces = || std::fs::read_dir(&cache).expect("a folder").count();
    assert_eq!(pieces(), layers.len());
    let of_shards = job_of(&with_cache);
    assert_eq!(pieces(), layers.len(), "nothing was planned again");
    assert!(of_shards == job_of(&asked));
    let again = stdout(&shard("1/2"));
    assert!(
        again.contains(" was there") && !again.contains(" planned"),
        "{again}"
    );

    let refused = |more: &[&str], words: &str| {
        let output = headway(&[&with_cache[..], more].concat());
        assert_eq!(output.status.code(), Some(2), "{more:?}");
        assert!(stderr(&output).contains(words), "{}", stderr(&output));
    };
    refused(&["--shard", "3/2"], "3/8");
    refused(&["--shard", "1/2", "-o", path(&job)], "--output");
    refused(
        &["--shard", "1/2", "--curved-layers", "skin"],
        "flat layers",
    );
    let outline = example("u-part.json");
    let output = headway(&["plan", &outline, "--cache", path(&cache), "--shard", "1/2"]);
    assert_eq!(output.status.code(), Some(2));
    let alone = headway(&[&asked[..], &["--shard", "1/2"]].concat());
    assert!(stderr(&alone).contains("--cache"), "{}", stderr(&alone));
}
