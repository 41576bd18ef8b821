//! Goal: a job does not begin with a touch. What keeps a job from being good is the verdict's first line and exit
//! status 1, and the job is not written, unless it is allowed by name; heat that is missing refuses what prints,
//! not the plan. Method: short runs of waypoints whose fault is known, planned, simulated and exported by the command.

use crate::rig::{example, folder, headway, object, path, stderr, stdout, succeeded};
use std::path::{Path, PathBuf};

/// A straight run of 20 mm along x, the tool leaning along it by so many degrees; its file.
fn leaning_run(folder: &Path, lean_deg: f64) -> PathBuf {
    let (sin, cos) = lean_deg.to_radians().sin_cos();
    let lines = (0..=10).map(|i| format!("{} 0 1 {sin} 0 {cos}\n", 2 * i));
    let file = folder.join("run.wpt");
    let text: String = std::iter::once("x y z nx ny nz\n".to_string())
        .chain(lines)
        .collect();
    std::fs::write(&file, text).expect("a run");
    file
}

fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}

/// Goal: a touch refuses plan and simulation, and is said first; allowed by name it is said first all the same. Method:
/// a nozzle of 0.8 mm radius that leans by 30° one layer above the table is 0.2 mm in it.
#[test]
fn a_touch_is_said_first_and_refuses_the_job() {
    let folder = folder("touch");
    let (run, machine) = (leaning_run(&folder, 30.0), example("machines/gantry.toml"));
    let job = folder.join("run.hwj");
    let plan = ["plan", path(&run), "-m", &machine, "-o", path(&job)];
    let refused = headway(&plan);
    assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
    let said = stdout(&refused);
    assert!(first_line(&said).starts_with("TOUCHES on "), "{said}");
    assert!(first_line(&said).contains("in the table"), "{said}");
    assert!(said.contains("\nTakes "), "the time comes after it: {said}");
    let error = stderr(&refused);
    assert!(error.contains("the job is not written"), "{error}");
    assert!(error.contains("--allow touches"), "{error}");
    assert!(!job.exists());
    let as_json = headway(&[&plan[..], &["--json"]].concat());
    assert_eq!(as_json.status.code(), Some(1));
    let figures: serde_json::Value = serde_json::from_str(&stdout(&as_json)).expect("an object");
    let line = figures["objections"][0].as_str().unwrap_or_default();
    assert_eq!(line, first_line(&said));

    let simulate = ["simulate", path(&run), "-m", &machine];
    let refused = headway(&simulate);
    assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
    assert_eq!(first_line(&stdout(&refused)), first_line(&said));

    let allowed = succeeded(&headway(&[&plan[..], &["--allow", "touches"]].concat()));
    assert_eq!(first_line(&allowed), first_line(&said));
    assert!(job.exists());
    // Of the job that was taken it is still the first line.
    let simulated = succeeded(&headway(&["simulate", path(&job)]));
    assert_eq!(first_line(&simulated), first_line(&said));
    let both = headway(&[&simulate[..], &["--allow", "touches,range"]].concat());
    succeeded(&both);
}

/// Goal: a run that touches nothing is written with no objection; names that nothing has, and a fault, are not
/// allowed. Method: the same run with the tool upright.
#[test]
fn a_good_job_has_no_objection_and_a_fault_has_no_name() {
    let folder = folder("good");
    let (run, machine) = (leaning_run(&folder, 0.0), example("machines/gantry.toml"));
    let job = folder.join("run.hwj");
    let plan = ["plan", path(&run), "-m", &machine, "-o", path(&job)];
    let figures = object(&headway(&[&plan[..], &["--json"]].concat()));
    assert!(!figures.contains_key("objections"), "{figures:?}");
    assert!(job.exists());
    for name in ["fault", "heat", "touch"] {
        let wrong = headway(&[&plan[..], &["--allow", name]].concat());
        assert_eq!(wrong.status.code(), Some(2), "{name}: {}", stderr(&wrong));
    }
}

/// Goal: a joint that leaves its range refuses the job; allowed by name, the job is written for the machine as it is,
/// and what a board would do shows when it is simulated. Method: a tool that
/// leans by 15° on a head that tilts by 10°.
#[test]
fn a_joint_outside_its_range_is_said_first_and_refuses_the_job() {
    let folder = folder("range");
    let run = leaning_run(&folder, 15.0);
    let gantry = std::fs::read_to_string(example("machines/gantry.toml")).expect("a machine");
    let file = folder.join("narrow.toml");
    let narrow = gantry.replace("position_max_deg = 60", "position_max_deg = 10");
    let narrow = narrow.replace("position_min_deg = -60", "position_min_deg = -10");
    std::fs::write(&file, narrow).expect("a machine");
    let (machine, job) = (path(&file), folder.join("run.hwj"));
    let plan = ["plan", path(&run), "-m", machine, "-o", path(&job)];
    let refused = headway(&plan);
    let error = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{error}");
    assert!(error.contains("joint b would go to"), "{error}");
    assert!(error.contains("--allow range"), "{error}");
    assert!(!job.exists());
    let touches_only = headway(&[&plan[..], &["--allow", "touches"]].concat());
    assert_eq!(touches_only.status.code(), Some(1));
    let said = succeeded(&headway(
        &[&plan[..], &["--allow", "touches,range"]].concat(),
    ));
    assert!(first_line(&said).starts_with("RANGE: joint b"), "{said}");
    assert!(job.exists());
    let simulated = headway(&["simulate", path(&job), "-m", machine]);
    assert_eq!(simulated.status.code(), Some(1), "{}", stderr(&simulated));
    let said = stdout(&simulated);
    assert!(first_line(&said).starts_with("FAULT: "), "{said}");
}

/// Goal: README's own example of six axes is good. Method: planned as README says, on both machines with a head.
#[test]
fn the_six_axis_example_touches_nothing() {
    let folder = folder("example");
    let run = example("gear-6axis.wpt");
    for name in ["gantry", "trunnion"] {
        let machine = example(&format!("machines/{name}.toml"));
        let job = folder.join(format!("{name}.hwj"));
        let plan = ["plan", &run, "-m", &machine, "-o", path(&job), "--json"];
        let figures = object(&headway(&plan));
        assert_eq!(figures["touched_mm"], 0.0, "{name}");
        assert!(!figures.contains_key("objections"), "{name}");
    }
}

/// Goal: a job for a machine with a hot end that nothing heats is planned, but neither streamed nor written as
/// G-code, unless that is meant. Method: one outline, with and without a material; a port that nobody has.
#[test]
fn missing_heat_refuses_stream_and_export_but_not_plan() {
    let folder = folder("heat");
    let machine = std::fs::read_to_string(example("machines/planar.toml")).expect("a machine");
    let cold = folder.join("cold.toml");
    let hot = folder.join("hot.toml");
    let heater = "\n[heaters.hot_end]\npower_w = 40\n";
    std::fs::write(&cold, format!("{machine}{heater}")).expect("a machine");
    let material = "\n[material]\nhot_end_c = 215\n";
    std::fs::write(&hot, format!("{machine}{material}{heater}")).expect("a machine");
    let taper = example("taper.json");
    let plan = |machine: &Path, name: &str| {
        let job = folder.join(name);
        succeeded(&headway(&[
            "plan",
            &taper,
            "-m",
            path(machine),
            "-o",
            path(&job),
        ]));
        job
    };
    let (cold, hot) = (plan(&cold, "cold.hwj"), plan(&hot, "hot.hwj"));
    let export = |job: &Path, more: &[&str]| {
        let arguments = ["export", path(job), "--to", "gcode", "--dialect", "klipper"];
        headway(&[&arguments[..], more].concat())
    };
    let refused = export(&cold, &[]);
    assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("nothing in the job heats it"));
    assert_eq!(stdout(&refused), "");
    succeeded(&export(&cold, &["--no-heat"]));
    let start = folder.join("start.gcode");
    std::fs::write(&start, "M109 S215\n").expect("a block");
    succeeded(&export(&cold, &["--start", path(&start)]));
    succeeded(&export(&hot, &[]));
    succeeded(&headway(&["export", path(&cold), "--to", "csv"]));
    let nobody = format!("unix:{}", folder.join("nobody").display());
    let stream = |job: &Path, more: &[&str]| {
        let arguments = ["stream", path(job), "--port", &nobody];
        let streamed = headway(&[&arguments[..], more].concat());
        assert_eq!(streamed.status.code(), Some(1), "{}", stderr(&streamed));
        stderr(&streamed)
    };
    let says_heat = |said: &str| said.contains("nothing in the job heats it");
    assert!(says_heat(&stream(&cold, &[])));
    // These get as far as the port.
    assert!(!says_heat(&stream(&cold, &["--no-heat"])));
    assert!(!says_heat(&stream(&cold, &["--hot-end", "210"])));
    assert!(!says_heat(&stream(&hot, &[])));
}

/// Goal: a machine file without heaters and material makes no G-code that prints cold, unless that is meant, and export
/// tells what the controller makes of it. Method: the built-in machine's job, with and without the option, as JSON.
#[test]
fn export_tells_of_missing_heat_and_of_the_controllers_time() {
    let folder = folder("export-heat");
    let (job, out) = (folder.join("taper.hwj"), folder.join("taper.gcode"));
    succeeded(&headway(&[
        "plan",
        &example("taper.json"),
        "-o",
        path(&job),
    ]));
    let export = |more: &[&str]| {
        let arguments = [
            "export",
            path(&job),
            "--to",
            "gcode",
            "--dialect",
            "klipper",
        ];
        headway(&[&arguments[..], more].concat())
    };
    let refused = export(&[]);
    assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
    assert!(
        stderr(&refused).contains("no [material]"),
        "{}",
        stderr(&refused)
    );
    assert_eq!(export(&["--no-heat", "--json"]).status.code(), Some(2));
    let written = export(&["--no-heat", "--json", "-o", path(&out)]);
    let told: serde_json::Value = serde_json::from_str(&succeeded(&written)).expect("JSON");
    let seconds = |key: &str| told[key].as_f64().expect(key);
    // This short part is half corners.
    assert!(
        (seconds("controller_time_s") / seconds("duration_s") - 1.1).abs() < 0.1,
        "{told}"
    );
    let needed = cross_section_needed(&std::fs::read_to_string(&out).expect("G-code"));
    let stated = told["max_extrude_cross_section_mm2"].as_f64().expect("mm²");
    // Stated in steps of 0.01 mm².
    assert!(
        needed > 0.1 && (0.0..0.01 + 1e-6).contains(&(stated - needed)),
        "{stated} mm² for {needed}"
    );
    assert!(stderr(&written).contains(&format!("max_extrude_cross_section: {stated}")));
    assert!(
        told["needs"]
            .as_str()
            .expect("needs")
            .contains("manual_stepper")
    );
    assert!(
        stderr(&written).contains("klipper takes about"),
        "{}",
        stderr(&written)
    );
    let text = std::fs::read_to_string(&out).expect("text");
    assert!(
        text.contains("GCODE_AXIS=C LIMIT_VELOCITY=1080 INSTANTANEOUS_CORNER_VELOCITY=400"),
        "the heading follows: it has no acceleration of its own"
    );
}

/// Goal: a job that tilts is exported only for a machine file that names the controller's axes. Method: a short run of
/// waypoints on the gantry, with and without the group.
#[test]
fn tilting_jobs_are_exported_with_the_axes_that_the_machine_file_names() {
    let folder = folder("export-tilts");
    let mut run = String::new();
    for k in 0..30 {
        let tilt = 0.01 * f64::from(k);
        let (sin, cos) = tilt.sin_cos();
        run += &format!("{:.3} 0 5 {sin:.6} 0 {cos:.6}\n", 0.4 * f64::from(k));
    }
    let input = folder.join("run.wpt");
    std::fs::write(&input, run).expect("a run");
    let gantry = std::fs::read_to_string(example("machines/gantry.toml")).expect("a machine");
    let export = |letters: &str, name: &str| {
        let (machine, job) = (
            folder.join(format!("{name}.toml")),
            folder.join(format!("{name}.hwj")),
        );
        std::fs::write(&machine, format!("{gantry}{letters}")).expect("a machine");
        let plan = ["plan", path(&input), "-m", path(&machine), "-o", path(&job)];
        succeeded(&headway(&plan));
        let to = [
            "export",
            path(&job),
            "--to",
            "gcode",
            "--dialect",
            "linuxcnc",
            "--no-heat",
        ];
        headway(&to)
    };
    let refused = export("", "unnamed");
    assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
    assert!(
        stderr(&refused).contains("[gcode] letters"),
        "{}",
        stderr(&refused)
    );
    let written = succeeded(&export("\n[gcode]\nletters = \"A,V,W\"\n", "named"));
    assert!(
        written.starts_with(";headway extruder=U turns=AVW"),
        "{}",
        &written[..80]
    );
}

/// Goal: a bead of 0.1 mm between prime and retract, which a slicer wrote and which stopped the board at 119 % of its
/// extruder's limits, is planned and runs. Method: a program of a few lines, simulated by the command.
#[test]
fn a_bead_of_a_tenth_of_a_millimetre_runs() {
    let folder = folder("bead");
    let file = folder.join("bead.gcode");
    let bead = "G21\nG90\nM83\n;LAYER:0\nG1 Z0.2 F1200\nG1 X10 Y10 F9000\nG1 E0.4 F2100\n\
                G1 X10.1 Y10 E0.00374 F1800\nG1 E-0.4 F2100\nG1 X20 Y10 F9000\nG1 E0.4 F2100\n\
                G1 X40 Y10 E0.748 F1800\nG1 E-0.4 F2100\n";
    std::fs::write(&file, bead).expect("a program");
    let figures = object(&headway(&["simulate", path(&file), "--json"]));
    assert_eq!(figures["faults"], 0);
    assert!(!figures.contains_key("objections"), "{figures:?}");
    let ratio = figures["limit_ratio_acceleration"]
        .as_f64()
        .expect("a ratio");
    // Durations of primes and retracts are whole ticks: 0.1 % of a limit.
    assert!(ratio <= 1.001, "{ratio}");
}

/// Goal: one verdict on terminal and in `--json`, first and last where all figures are shown, and at most twelve lines
/// of it all on a terminal. Method: a part whose reading, planning and boundary are worth several notes, planned in a
/// pipe with and without `--figures`, and on a pseudo-terminal of `script`.
#[test]
fn the_verdict_is_short_and_the_figures_are_asked_for() {
    let folder = folder("short");
    let (letter, job) = (example("letter.svg"), folder.join("letter.hwj"));
    let plan = ["plan", &letter, "--walls", "1", "-o", path(&job)];
    let short = succeeded(&headway(&plan));
    let lines: Vec<&str> = short.lines().collect();
    assert_eq!(lines[0], "Nothing was found against starting it.");
    for (line, begins) in lines[1..].iter().zip(["Takes ", "Lays "]) {
        assert!(line.starts_with(begins), "{short}");
    }
    assert!(short.contains("no [material]"), "{short}");
    assert!(short.contains("Covers ") && lines.len() <= 7, "{short}");
    let figures = object(&headway(&[&plan[..], &["--json"]].concat()));
    let told = figures["verdict"]["lines"].as_array().expect("lines");
    assert_eq!(told.len(), lines.len() - 1);
    assert!(told.iter().zip(&lines[1..]).all(|(of, line)| of == line));
    assert_eq!(figures["verdict"]["reasons"], serde_json::json!([]));
    let all = succeeded(&headway(&[&plan[..], &["--figures"]].concat()));
    assert!(all.starts_with(&short) && all.ends_with(&short), "{all}");
    assert!(all.contains("\nCoverage\n") && all.contains("\nMotion\n"));
    // Job files hold none of it: their bytes are those of the libraries.
    let inspected = object(&headway(&["inspect", path(&job), "--json"]));
    assert!(inspected["figures"].get("verdict").is_none());

    let words = plan.map(|word| format!("'{word}'")).join(" ");
    let line = format!("{} {words}", env!("CARGO_BIN_EXE_headway"));
    let log = folder.join("log");
    let ran = std::process::Command::new("script")
        .args(["-q", "-e", "-c", &line, path(&log)])
        .stdin(std::process::Stdio::null())
        .output();
    let Ok(ran) = ran else {
        println!("script is not there: the terminal is left out");
        return;
    };
    assert!(ran.status.success(), "{ran:?}");
    // A bar is drawn again and again in its own line, and cleared; what stays ends with a new line.
    let shown = String::from_utf8_lossy(&ran.stdout).into_owned();
    let shown = shown.lines().filter(|line| {
        let kept = line.rsplit('\r').find(|part| !part.is_empty());
        kept.is_some_and(|kept| !kept.contains('\u{1b}') || kept.contains("note: "))
    });
    let shown: Vec<&str> = shown.collect();
    assert!((6..=12).contains(&shown.len()), "{shown:#?}");
    let notes = stderr(&headway(&plan)).matches("note: ").count();
    let hidden = notes.saturating_sub(2);
    let told = shown.iter().any(|line| line.contains("--figures shows"));
    assert_eq!(told, hidden > 0, "{notes} notes: {shown:#?}");
}

/// Goal: a nozzle that nothing heats is the first thing that is said of a plan, which is written all the same; another
/// nozzle's time stands beside the own. Method: a machine with a heater, with and without a material; a round nozzle
/// planned by itself; simulate, which says what its steps do.
#[test]
fn a_cold_nozzle_is_said_first_and_a_round_one_stands_beside() {
    let folder = folder("cold");
    let planar = std::fs::read_to_string(example("machines/planar.toml")).expect("a machine");
    let machine = folder.join("cold.toml");
    std::fs::write(
        &machine,
        format!("{planar}\n[heaters.hot_end]\npower_w = 40\n"),
    )
    .expect("file");
    let (taper, job) = (example("taper.json"), folder.join("taper.hwj"));
    let plan = ["plan", &taper, "-m", path(&machine), "-o", path(&job)];
    let said = succeeded(&headway(&plan));
    assert!(
        first_line(&said).starts_with("COLD: machine planar"),
        "{said}"
    );
    assert!(job.exists());
    let figures = object(&headway(&[&plan[..], &["--json"]].concat()));
    assert_eq!(figures["verdict"]["reasons"][0], first_line(&said));
    assert!(!figures.contains_key("objections"));

    let against = ["--against", "circle:0.6"];
    let round = [
        "plan",
        &taper,
        "--aperture",
        "circle:0.6",
        "-o",
        path(&job),
        "--json",
    ];
    let round_s = object(&headway(&round))["print_s"]
        .as_f64()
        .expect("seconds");
    let simulate = ["simulate", &taper, "--json"];
    let figures = object(&headway(&[&simulate[..], &against].concat()));
    assert_eq!(figures["against"]["print_s"], round_s);
    let ratio = figures["print_s"].as_f64().expect("seconds") / round_s;
    let time = figures["verdict"]["lines"][0].as_str().expect("a line");
    assert!(time.contains(&format!(", {ratio:.2} of the ")), "{time}");
    assert!(time.ends_with("with circle 0.6 mm."), "{time}");
    let said = succeeded(&headway(&["simulate", &taper, "--against", "circle:40"]));
    assert!(
        said.contains("; it cannot be printed with circle 40 mm."),
        "{said}"
    );
    assert!(said.contains("The simulated steps stay within "), "{said}");
    let of_job = headway(&["simulate", path(&job), "--against", "circle:0.6"]);
    assert_eq!(of_job.status.code(), Some(2), "{}", stderr(&of_job));
}

/// What Klipper's check of an extruding move needs with a nozzle of 0.4 mm and filament of 1.75 mm, mm².
fn cross_section_needed(text: &str) -> f64 {
    let filament_mm2 = 0.25 * std::f64::consts::PI * 1.75f64.powi(2);
    let (mut at, mut most) = ([0.0; 3], 0.0f64);
    for line in text.lines().filter(|line| line.starts_with('G')) {
        let (mut to, mut pushed_mm) = (at, 0.0);
        for word in line.split_whitespace().skip(1) {
            let number = word[1..].parse().unwrap_or(0.0);
            match word.as_bytes()[0] {
                b'E' => pushed_mm = number,
                letter @ b'X'..=b'Z' => to[usize::from(letter - b'X')] = number,
                _ => {}
            }
        }
        let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| to[axis] - at[axis]);
        if pushed_mm > 0.0 && (x, y) != (0.0, 0.0) {
            let way_mm = (x * x + y * y + z * z).sqrt();
            most = most.max(pushed_mm * filament_mm2 / way_mm.max(0.4));
        }
        at = to;
    }
    most
}

/// Goal: a region that no bead fits into is told, not left out in silence. Method: a square, and a speck beside it.
#[test]
fn a_region_too_small_for_the_nozzle_is_told() {
    let folder = folder("speck");
    let (drawing, job) = (folder.join("speck.geojson"), folder.join("speck.hwj"));
    let square = "[[0,0],[9,0],[9,9],[0,9],[0,0]]";
    let speck = "[[15,0],[15.1,0],[15.1,0.1],[15,0.1],[15,0]]";
    let text = format!(r#"{{"type":"MultiPolygon","coordinates":[[{square}],[{speck}]]}}"#);
    std::fs::write(&drawing, text).expect("written");
    let plan = ["plan", path(&drawing), "-o", path(&job), "--json"];
    let output = headway(&plan);
    let figures = object(&output);
    let places = figures["left_out_places"].as_array().expect("places");
    assert_eq!(places.len(), 1, "{figures:?}");
    let told = stderr(&output);
    assert!(
        told.contains("1 region, 0.010 mm², is not printed"),
        "{told}"
    );
    assert!(told.contains("too narrow for the aperture"), "{told}");
    let verdict = succeeded(&headway(&plan[..4]));
    assert!(verdict.contains("1 region is not printed"), "{verdict}");
}
