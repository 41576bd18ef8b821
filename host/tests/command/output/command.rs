//! Goal: other programs can rely on the command: exit status, what goes to stdout and what to
//! stderr, machines, apertures and places as they are given. Method: run the binary on small
//! examples and read what it writes.

use crate::rig::{example, folder, headway, object, path, stderr, stdout, succeeded};

#[test]
fn wrong_usage_is_2_an_impossible_job_is_1() {
    let folder = folder("status");
    let bow_tie = folder.join("bow-tie.json");
    let text = r#"{"units":"mm","exterior":[[0,0],[10,10],[10,0],[0,10]]}"#;
    std::fs::write(&bow_tie, text).expect("file");
    let tiny = folder.join("tiny.json");
    let text = r#"{"units":"mm","exterior":[[0,0],[0.2,0],[0.2,0.2],[0,0.2]]}"#;
    std::fs::write(&tiny, text).expect("file");
    let machine = folder.join("bad.toml");
    std::fs::write(&machine, "name = \"x\"\ncolour = \"red\"\n").expect("file");
    let job = folder.join("job.hwj");
    let taper = example("taper.json");
    let cases: &[(&[&str], i32, &str)] = &[
        (&[], 2, "Usage"),
        (&["fly"], 2, "unrecognized subcommand"),
        (&["plan", &taper], 2, "--output"),
        (
            &["simulate", &taper, "--aperture", "star:3"],
            2,
            "ellipse:LxW",
        ),
        (
            &["simulate", &taper, "--speed", "-5"],
            2,
            "print.speed_mm_s",
        ),
        (
            &["simulate", &taper, "--infill-density", "20"],
            2,
            "--walls",
        ),
        (
            &[
                "simulate",
                &taper,
                "--walls",
                "2",
                "--infill-density",
                "120",
            ],
            2,
            "infill.density_pct",
        ),
        (&["simulate", &taper, "--walls", "0"], 2, "infill.walls"),
        (
            &["simulate", &taper, "--keep-out", &taper],
            1,
            "leave no ground",
        ),
        (
            &["simulate", &taper, "--keep-out", "nothing.json"],
            1,
            "nothing.json",
        ),
        (&["simulate", &taper, "--at", "1,2"], 2, "three numbers"),
        (&["simulate", &taper, "--scale", "0"], 2, "--scale"),
        (&["simulate", &taper, "--link", "drop=2"], 2, "probability"),
        (&["headings", &taper, "--spacing", "0"], 2, "--spacing"),
        (&["headings", "drawing.dwg"], 2, "--from"),
        (&["inspect", "not-there.json"], 1, "not-there.json"),
        (&["machine", "check", path(&machine)], 1, "line 2"),
        (
            &["plan", path(&bow_tie), "-o", path(&job)],
            1,
            "(5.0000, 5.0000) mm",
        ),
        (
            &["plan", path(&tiny), "-o", path(&job)],
            1,
            "nothing can be printed",
        ),
        (&["simulate", &taper, "--at", "240,0,0"], 1, "work area"),
        (&["simulate", &taper, "--scale", "20"], 1, "work area"),
        (&["export", &taper, "--to", "csv"], 1, "not a Headway job"),
    ];
    for (arguments, status, part) in cases {
        let output = headway(arguments);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(*status), "{arguments:?}: {said}");
        assert!(said.contains(part), "{arguments:?}: {said}");
        assert!(
            output.stdout.is_empty(),
            "{arguments:?}: {}",
            stdout(&output)
        );
    }
    for arguments in [&["--help"][..], &["simulate", "--help"], &["--version"]] {
        assert!(!succeeded(&headway(arguments)).is_empty());
    }
    assert!(!job.exists(), "a refused plan leaves no job");
    std::fs::remove_dir_all(folder).expect("clean up");
}

/// Goal: who writes another program's option, a CAD model or no machine file at all reads what to do, in a few lines; and
/// every plan says which beads its nozzle lays. Method: each mistake once.
#[test]
fn mistakes_of_a_first_day_are_answered_with_the_remedy() {
    let folder = folder("first-day");
    let (job, model, machine) = (
        folder.join("job.hwj"),
        folder.join("part.STEP"),
        folder.join("bad.toml"),
    );
    std::fs::write(&model, "ISO-10303-21;").expect("file");
    std::fs::write(&machine, "x".repeat(100_000)).expect("file");
    let taper = example("taper.json");
    let plan = |more: &[&str]| {
        let arguments = [&["plan", &taper, "--output", path(&job)], more].concat();
        headway(&arguments)
    };
    for (option, ours) in [
        (["--infill", "20"], "'--infill-density'"),
        (["--nozzle", "0.4"], "'--aperture'"),
        (["--perimeters", "2"], "'--walls'"),
    ] {
        let out = plan(&option);
        assert_eq!(out.status.code(), Some(2), "{option:?}");
        assert!(stderr(&out).contains(ours), "{}", stderr(&out));
        assert!(!stdout(&headway(&["plan", "--help"])).contains(&format!("{} ", option[0])));
    }
    let out = plan(&["-m", path(&machine)]);
    assert!(stderr(&out).contains("line 1 is no line of a machine file"));
    assert!(stderr(&out).len() < 1_000, "{} bytes", stderr(&out).len());
    let out = headway(&["plan", path(&model), "--output", path(&job)]);
    assert!(stderr(&out).contains("export it as a mesh"));
    let out = plan(&["--aperture", "stadium:1.6x0.5"]);
    succeeded(&out);
    assert!(stderr(&out).contains("beads of 0.5 to 1.6 mm"));
    std::fs::remove_dir_all(folder).expect("clean up");
}

/// Goal: `compare` says of each nozzle what `plan` says of it, and what a slower heading axis costs. Method: two nozzles
/// and one that fits nowhere, each against a plan of its own; the axis at 40 degrees/s turns the nozzle slower, and the
/// round one not.
#[test]
fn compare_says_what_each_nozzle_takes() {
    let folder = folder("compare");
    let taper = example("taper.json");
    let nozzles = ["ellipse:1.2x0.4", "circle:0.6", "circle:40"];
    let with: Vec<&str> = nozzles
        .iter()
        .flat_map(|nozzle| ["--aperture", nozzle])
        .collect();
    let rows = |more: &[&str]| -> Vec<serde_json::Value> {
        let compare = ["compare", &taper, "--json", "--quality=standard"];
        let arguments = [&compare, with.as_slice(), more].concat();
        serde_json::from_str(&succeeded(&headway(&arguments))).expect("a list")
    };
    let picture = folder.join("compare.svg");
    let found = rows(&["--picture", path(&picture)]);
    assert_eq!(found.len(), 3);
    let job = folder.join("job.hwj");
    for (row, nozzle) in found.iter().zip(&nozzles[..2]) {
        let arguments = [
            "plan",
            &taper,
            "--aperture",
            nozzle,
            "--json",
            "-o",
            path(&job),
        ];
        let planned = object(&headway(&arguments));
        for key in [
            "print_s",
            "unreachable_mm",
            "flow_interruptions",
            "volume_mm3",
        ] {
            assert_eq!(row[key], planned[key], "{nozzle}: {key}");
        }
        assert_eq!(row["aperture"], *nozzle);
    }
    assert!(found[2]["refused"].is_string() && found[2]["print_s"].is_null());
    let drawn = std::fs::read_to_string(&picture).expect("a picture");
    assert_eq!(drawn.matches("<image").count(), 2);
    let slow = rows(&["--heading-speed", "40"]);
    let print_s = |row: &serde_json::Value| row["print_s"].as_f64().expect("seconds");
    assert!(print_s(&slow[0]) > print_s(&found[0]));
    assert_eq!(slow[1]["print_s"], found[1]["print_s"]);
    // A motor of 20 turns a minute behind a gear of 3 turns the nozzle with 40 degrees/s.
    let machine = folder.join("machine.toml");
    let motor = "[drivers.c]\ntorque_nm = 0.1\nrotor_inertia_g_cm2 = 20\nload_inertia_g_cm2 = 180\n\
                 gear_ratio = 3\nmotor_speed_max_rpm = 20\n";
    let planar = succeeded(&headway(&["machine", "new"])) + motor;
    std::fs::write(&machine, planar).expect("written");
    let geared = rows(&["-m", path(&machine)]);
    assert_eq!(geared[0]["print_s"], slow[0]["print_s"]);
    let speed = geared[0]["heading_speed_max_deg_s"].as_f64();
    assert!((speed.expect("a speed") - 40.0).abs() < 1e-9);
    let check = headway(&["machine", "check", path(&machine)]);
    assert!(succeeded(&check).contains("the motor of c reaches 40°/s and "));
    assert!(
        stderr(&check).contains("would lose steps"),
        "{}",
        stderr(&check)
    );
    let alone = headway(&["compare", &taper, "--aperture", "circle:0.6"]);
    assert_eq!(alone.status.code(), Some(2));
    std::fs::remove_dir_all(folder).expect("clean up");
}

/// Goal: nozzles are compared at the same shell where it is asked for, and the table says what it compares. Method: a
/// ring's shell of 1.2 mm with a wide and a narrow nozzle, by walls and by millimetres.
#[test]
fn nozzles_are_compared_at_the_same_shell() {
    let folder = folder("same_shell");
    let file = folder.join("square.json");
    let square = r#"{"units":"mm","exterior":[[0,0],[30,0],[30,30],[0,30]]}"#;
    std::fs::write(&file, square).expect("written");
    let square = path(&file);
    let table = |more: &[&str]| {
        let compare = ["compare", square, "--infill-density", "0"];
        let nozzles = ["--aperture", "ellipse:1.2x0.4", "--aperture", "circle:0.4"];
        succeeded(&headway(&[&compare[..], &nozzles[..], more].concat()))
    };
    let by_walls = table(&["--walls", "1"]);
    assert!(by_walls.contains("ellipse 1.2 x 0.4 mm "), "{by_walls}");
    assert!(
        by_walls.contains("in mass: two walls of one nozzle"),
        "{by_walls}"
    );
    assert!(
        by_walls.contains("planned with --quality fast; "),
        "{by_walls}"
    );
    let by_shell = table(&["--shell", "1.2"]);
    assert!(!by_shell.contains("in mass"), "{by_shell}");
    let both = ["--shell", "1.2", "--walls", "1"];
    let refused = headway(&[&["compare", square, "--aperture=circle:1"], &both[..]].concat());
    assert_eq!(refused.status.code(), Some(2));
}

/// Goal: what `compare` calls open is that of all layers, without what a sparse infill leaves open on purpose. Method: three
/// layers of an outline against one; the walls of a sparse part, whose ground is nearly all covered.
#[test]
fn open_ground_is_that_of_all_layers() {
    let nozzles = ["--aperture", "ellipse:1.2x0.4", "--aperture", "circle:0.6"];
    let open_mm2 = |input: &str, more: &[&str]| -> f64 {
        let compare = ["compare", input, "--json", "--quality=standard"];
        let arguments = [&compare, &nozzles[..], more].concat();
        let rows: Vec<serde_json::Value> =
            serde_json::from_str(&succeeded(&headway(&arguments))).expect("a list");
        rows[0]["open_mm2"].as_f64().expect("an area")
    };
    let taper = example("taper.json");
    let (one, three) = (open_mm2(&taper, &[]), open_mm2(&taper, &["--layers", "3"]));
    // A layer that begins elsewhere leaves a little more or less.
    assert!((three / one - 3.0).abs() < 0.3, "{one} and {three} mm²");
    let sparse = [
        "--layers=3",
        "--walls=1",
        "--infill-density=40",
        "--bottom=1",
        "--top=1",
    ];
    let letter = open_mm2(&example("letter.json"), &sparse);
    // 3 x 159 mm², of which less than a hundredth part stays open.
    assert!((0.1..5.0).contains(&letter), "{letter} mm²");
}

/// Goal: `inspect` tells the length of a path from how far its waypoints are apart. Method: eleven waypoints on 20 mm.
#[test]
fn inspect_tells_the_length_of_a_path_from_its_spacing() {
    let folder = folder("spacing");
    let file = folder.join("run.wpt");
    let points = (0..=10).map(|i| format!("{} 0 1 0 0 1\n", 2 * i));
    let text: String = std::iter::once("x y z nx ny nz\n".to_string())
        .chain(points)
        .collect();
    std::fs::write(&file, text).expect("a run");
    let said = succeeded(&headway(&["inspect", path(&file)]));
    let expected = "11 waypoints, 20.000 mm long, usually 2.000 mm from one waypoint to the next";
    assert!(said.contains(expected), "{said}");
    let found = object(&headway(&["inspect", path(&file), "--json"]));
    assert_eq!(
        (&found["length_mm"], &found["spacing_mm"]),
        (&20.0.into(), &2.0.into())
    );
}

#[test]
fn a_machine_for_the_firmware_reads_back_as_the_same_machine() {
    let folder = folder("firmware");
    let file = folder.join("machine.toml");
    let text = succeeded(&headway(&["machine", "new", "--kind", "gantry"]));
    std::fs::write(&file, text).expect("file");
    let bytes = folder.join("machine.bin");
    let said = headway(&["machine", "firmware", path(&file), "-o", path(&bytes)]);
    assert!(succeeded(&said).contains("6 joints"));
    let bytes = std::fs::read(&bytes).expect("file");
    let settings =
        headway_firmware::settings::BoardSettings::decode(&bytes).expect("what a board reads");
    assert_eq!(
        settings.machine,
        headway::settings::Settings::gantry().machine
    );
}

#[test]
fn a_new_machine_is_in_order() {
    let folder = folder("machine");
    for kind in ["planar", "gantry"] {
        let text = succeeded(&headway(&["machine", "new", "--kind", kind]));
        let file = folder.join("machine.toml");
        std::fs::write(&file, &text).expect("file");
        let summary = object(&headway(&["machine", "check", path(&file), "--json"]));
        assert_eq!(summary["name"], kind);
        assert!(
            summary["motors"]
                .as_array()
                .is_some_and(|motors| motors.len() > 4)
        );
    }
    std::fs::remove_dir_all(folder).expect("clean up");
}

#[test]
fn headings_writes_the_contract_s_columns() {
    let taper = example("taper.json");
    let text = succeeded(&headway(&["headings", &taper, "--spacing", "0.5"]));
    let mut lines = text.lines();
    let header = "x_mm,y_mm,nx,ny,r_mm,weight,law_alpha_deg,min_alpha_deg,alpha_deg,reachable,\
                  center_x_mm,center_y_mm,phi_rad";
    assert_eq!(lines.next(), Some(header));
    // 83.76 mm in pieces of at most 0.5 mm, at least one an edge.
    let rows: Vec<&str> = lines.collect();
    assert!((168..176).contains(&rows.len()), "{}", rows.len());
    assert!(rows.iter().all(|row| row.split(',').count() == 13));
    let summary = object(&headway(&[
        "headings",
        &taper,
        "--spacing",
        "0.5",
        "--json",
    ]));
    assert_eq!(summary["samples"], rows.len());
}

#[test]
fn placing_the_part_moves_the_machine_not_the_figures() {
    let folder = folder("place");
    let taper = example("taper.json");
    let tables = ["100,100,0", "10,20,0"].map(|at| {
        let job = folder.join("job.hwj");
        let plan = ["plan", &taper, "--at", at, "-o", path(&job), "--json"];
        let figures = object(&headway(&plan));
        let summary = object(&headway(&["inspect", path(&job), "--json"]));
        let offset: Vec<f64> = at.split(',').map(|v| v.parse().expect("number")).collect();
        assert_eq!(summary["offset_mm"], serde_json::json!(offset));
        (figures["print_mm"].clone(), figures["passes"].clone())
    });
    let print_mm = |k: usize| tables[k].0.as_f64().expect("mm");
    // Control points are rounded to 0.1 µm on the machine: micrometres over the whole path.
    assert!((print_mm(0) - print_mm(1)).abs() < 0.01);
    assert_eq!(tables[0].1, tables[1].1);
    std::fs::remove_dir_all(folder).expect("clean up");
}

/// Goal: a polygon aperture comes from its file, on the line and in a machine file beside it, and a
/// job stands on its own without that file.
#[test]
fn a_polygon_aperture_comes_from_its_file() {
    let folder = folder("aperture");
    let drop = folder.join("drop.json");
    let text =
        r#"{"units":"mm","exterior":[[-0.35,-0.25],[0.1,-0.3],[0.6,0],[0.1,0.3],[-0.35,0.25]]}"#;
    std::fs::write(&drop, text).expect("file");
    let given = format!("polygon:{}", path(&drop));
    let taper = example("taper.json");
    let arguments = ["headings", &taper, "--spacing", "2", "--aperture", &given];
    let on_the_line = succeeded(&headway(&arguments));
    let new = succeeded(&headway(&["machine", "new"]));
    let machine = folder.join("machine.toml");
    let own = new.replace("ellipse:1.2x0.4", "polygon:drop.json");
    assert_ne!(own, new);
    std::fs::write(&machine, own).expect("file");
    let in_the_file = ["headings", &taper, "--spacing", "2", "-m", path(&machine)];
    assert_eq!(succeeded(&headway(&in_the_file)), on_the_line);

    let job = folder.join("taper.hwj");
    let plan = [
        "plan",
        &taper,
        "-m",
        path(&machine),
        "-o",
        path(&job),
        "--json",
    ];
    let planned = object(&headway(&plan));
    std::fs::remove_file(&drop).expect("clean up");
    let simulated = object(&headway(&["simulate", path(&job), "--json"]));
    assert_eq!(simulated["passes"], planned["passes"]);
    assert_eq!(simulated["faults"], 0);
    let output = headway(&arguments);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("drop.json"), "{}", stderr(&output));
    std::fs::remove_dir_all(folder).expect("clean up");
}

/// Goal: the lines that a new machine file has of a material are one that prints its first layer hot and slow without the fan.
/// Method: their marks taken away, the file planned with.
#[test]
fn a_new_machine_files_material_can_be_filled_in() {
    let folder = folder("material");
    let (machine, job) = (folder.join("machine.toml"), folder.join("part.hwj"));
    let new = ["machine", "new", "--kind", "corexy", "-o", path(&machine)];
    succeeded(&headway(&new));
    let text = std::fs::read_to_string(&machine).expect("a machine file");
    let (own, material) = text.split_once("# [material]").expect("lines to fill in");
    let filled = material
        .replace("# The fan", "## The fan")
        .replace("\n# ", "\n");
    std::fs::write(&machine, format!("{own}[material]{filled}")).expect("written");
    let file = example("taper.json");
    let plan = [
        "plan",
        &file,
        "-m",
        path(&machine),
        "--layers",
        "2",
        "-o",
        path(&job),
    ];
    succeeded(&headway(&[&plan[..], &["--quality", "fast"]].concat()));
    let heat = object(&headway(&["inspect", path(&job), "--json"]))["heat"].to_string();
    let at = |part: &str| {
        heat.find(part)
            .unwrap_or_else(|| panic!("{part} in {heat}"))
    };
    assert!(at("220") < at("215") && at("65") < at("60"), "{heat}");
    assert!(
        at("215") < at("fan"),
        "the fan comes with the second layer: {heat}"
    );
}
