//! Goal: the library's documented surface does what the command does, and only grows. Method: its jobs
//! against the command's byte for byte, the examples run, its public lines against a list that is kept.

#[path = "../../../examples/plan_polygon.rs"]
mod plan_polygon;
#[path = "../../../examples/simulate_faults.rs"]
mod simulate_faults;
#[path = "../../../examples/watch_and_stop.rs"]
mod watch_and_stop;

use crate::rig::board::{Board, job};
use crate::rig::{headway, stderr};
use headway::api::{
    CurvedLayers, Error, Job, Machine, Options, Part, Quality, Reading, plan, plan_watched,
};
use headway::drive::transport::Port;
use std::fmt::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

fn read(name: &str) -> Part {
    let path = PathBuf::from(EXAMPLES).join(name);
    let ending = path.extension().unwrap().to_str().unwrap().to_string();
    let stem = path.file_stem().unwrap().to_str().unwrap().to_string();
    let bytes = std::fs::read(&path).unwrap();
    Part::from_bytes(&stem, &ending, &bytes, &Reading::default()).unwrap()
}

/// The same job by command and by library, outlines and paths, with options and a machine.
#[test]
fn a_job_is_that_of_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let gantry = format!("{EXAMPLES}/machines/gantry.toml");
    let machine = Machine::from_toml(&std::fs::read_to_string(&gantry).unwrap()).unwrap();
    let mut walls = Options::default();
    walls.walls = Some(1);
    walls.infill_density_pct = Some(40.0);
    walls.infill_angle_rad = Some(30f64.to_radians());
    walls.layers = Some(2);
    walls.speed_mm_s = Some(45.0);
    walls.quality = Some(Quality::Fast);
    let of_walls =
        "--walls 1 --infill-density 40 --infill-angle 30 --layers 2 --speed 45 --quality fast";
    let plain = (Machine::default(), Options::default());
    let cases = [
        ("taper.json", String::new(), plain.clone()),
        ("letter.svg", String::new(), plain.clone()),
        (
            "taper.json",
            of_walls.to_string(),
            (Machine::default(), walls),
        ),
        (
            "gear-6axis.wpt",
            format!("-m {gantry}"),
            (machine, Options::default()),
        ),
    ];
    for (number, (name, options, (machine, with))) in cases.into_iter().enumerate() {
        let output = folder.path().join(format!("{number}.hwj"));
        let output = output.display().to_string();
        let input = format!("{EXAMPLES}/{name}");
        let mut words = vec!["plan", &input, "--json", "-o", &output];
        words.extend(options.split_whitespace());
        let planned = headway(&words);
        assert!(planned.status.success(), "{}", stderr(&planned));
        let job = plan(&read(name), &machine, &with).unwrap();
        let printed: serde_json::Value = serde_json::from_slice(&planned.stdout).unwrap();
        let own: serde_json::Value = serde_json::from_str(&job.figures_json()).unwrap();
        assert!(own["verdict"]["lines"].is_array() && own["verdict"] == printed["verdict"]);
        assert!(
            job.bytes() == std::fs::read(&output).unwrap(),
            "{name} {options}"
        );
        // And a job that was read is the one that was written.
        let again = Job::from_bytes(job.bytes().to_vec()).unwrap();
        assert_eq!(again.duration_s(), job.duration_s());
        assert_eq!(again.figure("passes"), job.figure("passes"));
    }
}

/// The same of meshes, surfaces and a slicer's file.
#[test]
fn every_kind_of_input_is_planned_as_by_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let gantry = format!("{EXAMPLES}/machines/gantry.toml");
    let on_gantry = Machine::from_toml(&std::fs::read_to_string(&gantry).unwrap()).unwrap();
    let sliced = folder.path().join("sliced.gcode");
    std::fs::write(&sliced, SLICED).unwrap();
    let dome = std::fs::read(format!("{EXAMPLES}/dome.stl")).unwrap();
    let reading = Reading::default();
    let laid = read("dome-ring.json").on_surface("stl", &dome, &reading);
    let mut some_layers = Options::default();
    some_layers.first_layer_height_mm = Some(0.3);
    some_layers.layer_range = Some([1, 3]);
    let mut several = Options::default();
    several.copies = Some(2);
    several.copy_gap_mm = Some(3.0);
    let plain = Options::default();
    let planar = Machine::default();
    let cases = [
        (
            format!("{EXAMPLES}/hook.stl --first-layer-height 0.3 --layer-range 1-3"),
            (read("hook.stl"), planar.clone(), some_layers),
        ),
        (
            format!("{EXAMPLES}/taper.json --copies 2 --copy-gap 3"),
            (read("taper.json"), planar.clone(), several),
        ),
        (
            format!("{EXAMPLES}/dome-ring.json --surface {EXAMPLES}/dome.stl -m {gantry}"),
            (laid.unwrap(), on_gantry.clone(), plain.clone()),
        ),
        (
            format!("--surface {EXAMPLES}/dome.stl -m {gantry}"),
            (
                Part::from_surface("dome", "stl", &dome, &reading).unwrap(),
                on_gantry,
                plain.clone(),
            ),
        ),
        (
            sliced.display().to_string(),
            (
                Part::from_bytes("sliced", "gcode", SLICED.as_bytes(), &reading).unwrap(),
                planar,
                plain,
            ),
        ),
    ];
    for (options, (part, machine, with)) in cases {
        let output = folder.path().join("job.hwj").display().to_string();
        let mut words = vec!["plan", "-o", &output];
        words.extend(options.split_whitespace());
        let planned = headway(&words);
        assert!(planned.status.success(), "{}", stderr(&planned));
        let job = plan(&part, &machine, &with).unwrap();
        assert!(job.bytes() == std::fs::read(&output).unwrap(), "{options}");
    }
}

/// Two beads of a slicer.
const SLICED: &str = "M83\nG1 Z0.2 F600\nG1 X10 Y10 F9000\nG1 X30 Y10 E1.2 F1800\nG1 X30 Y30 E1.2\nG1 X10 Y30 F9000\n\
                      G1 X10 Y12 E1.1 F1800\n";

/// Options of another kind of part are refused with what they go with, before anything is planned.
#[test]
fn options_of_another_kind_are_refused() {
    let refused = |name: &str, set: &dyn Fn(&mut Options)| {
        let mut options = Options::default();
        set(&mut options);
        let refused = plan(&read(name), &Machine::default(), &options);
        match refused {
            Err(Error::Options(text)) => text,
            other => panic!("{name}: {other:?}"),
        }
    };
    let text = refused("taper.json", &|o| o.gap_mm = Some(3.0));
    assert!(text.contains("--gap goes with runs of waypoints"), "{text}");
    let text = refused("taper.json", &|o| {
        o.curved_layers = Some(CurvedLayers::Skin(3))
    });
    assert!(text.contains("--curved-layers goes with meshes"), "{text}");
    let text = refused("hook.stl", &|o| {
        (o.curved_layers, o.copies) = (Some(CurvedLayers::Skin(3)), Some(2));
    });
    assert!(text.contains("in one mesh file"), "{text}");
    let text = refused("taper.json", &|o| o.layer_range = Some([1, 2]));
    assert!(text.contains("--layer-range goes with meshes"), "{text}");
    let text = refused("gear-6axis.wpt", &|o| o.copies = Some(2));
    assert!(
        text.contains("--copies goes with outlines and meshes"),
        "{text}"
    );
    let text = refused("hook.stl", &|o| o.layers = Some(2));
    assert!(text.contains("--layers goes with outlines"), "{text}");
    let text = refused("hook.stl", &|o| o.first_layer_height_mm = Some(0.0));
    assert!(text.contains("--first-layer-height 0"), "{text}");
    let text = refused("gear-6axis.wpt", &|o| o.gap_mm = Some(-1.0));
    assert!(text.contains("--gap -1"), "{text}");
    let text = refused("gear-6axis.wpt", &|o| o.corner_tolerance_mm = Some(50.0));
    assert!(text.contains("--corner-tolerance 50"), "{text}");
    let text = refused("taper.json", &|o| o.copy_gap_mm = Some(3.0));
    assert!(text.contains("--copy-gap goes with --copies"), "{text}");
}

/// A mesh in curved layers: the command's job byte for byte, with layers that follow its top.
#[test]
fn a_part_in_curved_layers_is_planned() {
    let folder = tempfile::tempdir().unwrap();
    let gantry = format!("{EXAMPLES}/machines/gantry.toml");
    let machine = Machine::from_toml(&std::fs::read_to_string(&gantry).unwrap()).unwrap();
    let mut reading = Reading::default();
    reading.scale = 0.3;
    let bytes = std::fs::read(format!("{EXAMPLES}/cap.stl")).unwrap();
    let part = Part::from_bytes("cap", "stl", &bytes, &reading).unwrap();
    let mut options = Options::default();
    options.curved_layers = Some(CurvedLayers::Skin(2));
    options.quality = Some(Quality::Fast);
    let job = plan(&part, &machine, &options).unwrap();
    let figures: serde_json::Value = serde_json::from_str(&job.figures_json()).unwrap();
    let curved = &figures["curved_layers"];
    assert_eq!(curved["curved_layers"], 2, "{curved}");
    let number = |key: &str| curved[key].as_f64().unwrap();
    let stairs_mm3 = number("stair_error_mm3");
    // The rounded foot is larger in a smaller part.
    assert!(
        stairs_mm3 < 0.6 * number("stair_error_flat_mm3"),
        "{curved}"
    );
    assert!(job.figure("covered_pct").unwrap() > 97.0, "{figures}");
    let output = folder.path().join("cap.hwj");
    let output = output.to_str().unwrap();
    let cap = format!("{EXAMPLES}/cap.stl");
    let words = [
        "plan",
        &cap,
        "--scale",
        "0.3",
        "--curved-layers",
        "skin:2",
        "--quality",
        "fast",
        "-m",
        &gantry,
        "-o",
        output,
    ];
    let planned = headway(&words);
    assert!(planned.status.success(), "{}", stderr(&planned));
    assert!(job.bytes() == std::fs::read(output).unwrap());
}

/// Poses against figures and table: the volume is the flow's integral, the width between the
/// aperture's two, rows as many as the table's.
#[test]
fn poses_and_table_agree() {
    let job = plan(
        &read("taper.json"),
        &Machine::default(),
        &Options::default(),
    )
    .unwrap();
    let poses: Vec<_> = job.poses(0.001).unwrap().collect();
    let volume_mm3: f64 = poses.iter().map(|pose| 0.001 * pose.flow_mm3_s).sum();
    let expected_mm3 = job.figure("volume_mm3").unwrap();
    // Rectangles of a millisecond: half a step at each end of a pass.
    assert!(
        (volume_mm3 / expected_mm3 - 1.0).abs() < 0.01,
        "{volume_mm3} {expected_mm3}"
    );
    let widths: Vec<f64> = poses.iter().filter_map(|pose| pose.width_mm).collect();
    assert!(widths.len() > 1000);
    assert!(
        widths
            .iter()
            .all(|width| (0.4 - 1e-9..=1.2 + 1e-9).contains(width))
    );
    assert!(widths.iter().any(|width| *width > 1.0));
    let mut table = Vec::new();
    job.write_csv(&mut table, 0.001).unwrap();
    let rows = table.iter().filter(|byte| **byte == b'\n').count();
    assert_eq!(rows, poses.len() + 1);
    assert!(job.poses(0.0).is_err() && job.poses(f64::NAN).is_err());
    assert!(job.poses(1e-12).is_err(), "more rows than any table has");
}

/// What cannot be is an error of its kind with a remedy.
#[test]
fn bad_input_is_an_error() {
    let crossing = vec![[0.0, 0.0], [5.0, 5.0], [5.0, 0.0], [0.0, 5.0]];
    let cases: [&[Vec<Vec<[f64; 2]>>]; 5] = [
        &[],
        &[vec![]],
        &[vec![vec![]]],
        &[vec![vec![[0.0, 0.0], [f64::NAN, 0.0], [1.0, 1.0]]]],
        &[vec![crossing]],
    ];
    for polygons in cases {
        let refused = Part::from_polygons("bad", polygons);
        assert!(matches!(refused, Err(Error::Part(_))), "{polygons:?}");
    }
    let reading = Reading::default();
    assert!(Part::from_bytes("p", "stl", b"solid", &reading).is_err());
    assert!(Part::from_bytes("p", "png", b"", &reading).is_err());
    assert!(matches!(
        Machine::from_toml("kind = 3"),
        Err(Error::Options(_))
    ));
    let mut options = Options::default();
    options.speed_mm_s = Some(-1.0);
    let taper = read("taper.json");
    let refused = plan(&taper, &Machine::default(), &options).unwrap_err();
    assert!(
        matches!(&refused, Error::Options(text) if text.contains("speed")),
        "{refused}"
    );
    let dot = vec![[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]];
    let dot = Part::from_polygons("dot", &[vec![dot]]).unwrap();
    let refused = plan(&dot, &Machine::default(), &Options::default()).unwrap_err();
    assert!(
        matches!(&refused, Error::Plan(text) if text.contains("aperture")),
        "{refused}"
    );
    assert!(matches!(
        Job::from_bytes(b"HEADWAYJ".to_vec()),
        Err(Error::Job(_))
    ));
    assert!(taper.clone().placed_at([0.0, f64::INFINITY, 0.0]).is_err());
    let far = taper.placed_at([1e6, 0.0, 0.0]).unwrap();
    assert!(matches!(
        plan(&far, &Machine::default(), &Options::default()),
        Err(Error::Plan(_))
    ));
}

/// A stop at any step ends the planning, and the next one is as if nothing had been.
#[test]
fn planning_stops_where_it_is_told_to() {
    let (told, whole) = watch_and_stop::run(usize::MAX);
    let whole = whole.unwrap();
    for steps in [1, told / 2, told] {
        let (told, stopped) = watch_and_stop::run(steps);
        assert_eq!(stopped, Err(Error::Stopped), "after {steps}");
        assert!(told >= steps);
    }
    assert_eq!(watch_and_stop::run(usize::MAX), (told, Ok(whole)));
    let part = read("taper.json");
    let watched = plan_watched(&part, &Machine::default(), &Options::default(), &|_| {
        ControlFlow::Continue(())
    });
    let plain = plan(&part, &Machine::default(), &Options::default()).unwrap();
    assert!(watched.unwrap().bytes() == plain.bytes());
}

#[test]
fn the_examples_run() {
    let folder = tempfile::tempdir().unwrap();
    plan_polygon::run(folder.path()).unwrap();
    for name in ["frame.hwj", "frame.csv", "frame.gcode"] {
        assert!(
            std::fs::metadata(folder.path().join(name)).unwrap().len() > 1000,
            "{name}"
        );
    }
    let [clean, faulty] = simulate_faults::run().unwrap();
    assert_eq!(clean, faulty);
    assert!(clean.len() > 16, "{clean}");
}

/// A job to a board in this process: to its end, and aborted on the way.
#[test]
fn a_job_is_streamed() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = job(folder.path(), 1);
    let job = Job::from_bytes(std::fs::read(path).unwrap()).unwrap();
    let any = Port::Tcp("127.0.0.1:0".to_string());
    let board = Board::start(&any, 20.0);
    let mut done = Vec::new();
    let streamed = job.stream(&board.port, 115_200, &mut |step| {
        done.push(step.done);
        ControlFlow::Continue(())
    });
    assert_eq!(streamed, Ok(()));
    assert!(done.last().is_some_and(|done| *done > 0.5), "{done:?}");
    drop(board);
    let board = Board::start(&any, 2.0);
    let aborted = job.stream(&board.port, 115_200, &mut |step| match step.done > 0.1 {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    });
    assert_eq!(aborted, Err(Error::Stopped));
    let nowhere = job.stream("tcp:", 115_200, &mut |_| ControlFlow::Continue(()));
    assert!(matches!(nowhere, Err(Error::Line(_))));
}

/// Public lines of the sources of the surface: items, fields, methods and variants, as rustfmt lays them.
fn surface(file: &Path) -> String {
    let text = std::fs::read_to_string(file).unwrap();
    let text = text.split("#[cfg(test)]").next().unwrap_or_default();
    let mut found = String::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let item = line.trim_start();
        // Options stand in a list: name on the command line, name of its value, field and type.
        if let Some((_, declared)) = item
            .strip_prefix('"')
            .and_then(|rest| rest.split_once("\" "))
        {
            let declared = declared
                .rsplit_once('"')
                .map_or(declared, |(_, field)| field);
            if let Some((field, kind)) = declared.split_once(": ") {
                let kind = kind.split(" [").next().unwrap_or_default();
                writeln!(found, "pub {}: Option<{kind}>", field.trim()).unwrap();
            }
            continue;
        }
        // What a macro makes of that list is none of it.
        let is_macro = item.contains('$');
        if !item.starts_with("pub ") || item.starts_with("pub mod") || is_macro {
            continue;
        }
        let mut item = item.to_string();
        // A head goes on to its brace, a list of names to its semicolon.
        let is_field = |item: &str| item.ends_with(',') && !item.contains('(');
        while !item.contains('{') && !item.ends_with(';') && !is_field(&item) {
            let Some(more) = lines.next() else { break };
            item += &format!(" {}", more.trim());
        }
        while item.starts_with("pub use") && !item.ends_with(';') {
            let Some(more) = lines.next() else { break };
            item += &format!(" {}", more.trim());
        }
        let is_enum = item.starts_with("pub enum");
        writeln!(found, "{}", item.trim_end_matches([' ', '{', ',', ';'])).unwrap();
        if !is_enum {
            continue;
        }
        for line in lines.by_ref().take_while(|line| *line != "}") {
            let is_variant = line.starts_with("    ") && !line.starts_with("     ");
            if is_variant && line.trim_start().starts_with(char::is_uppercase) {
                writeln!(found, "  {}", line.trim().trim_end_matches(',')).unwrap();
            }
        }
    }
    found
}

/// Goal: nothing of the surface goes or changes unseen. `HEADWAY_WRITE_SURFACE=1` writes the list anew,
/// after a line was added; one that goes or changes asks for a new version (CONTRIBUTING.md).
#[test]
fn the_surface_is_the_one_that_is_kept() {
    let host = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files: Vec<PathBuf> = std::fs::read_dir(host.join("src/api"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    files.push(host.join("src/settings/options.rs"));
    let found: String = files.iter().map(|file| surface(file)).collect();
    // It sees what it is to see.
    for line in [
        "pub fn plan(part: &Part",
        "  Stopped",
        "pub speed_mm_s: Option<f64>",
    ] {
        assert!(found.contains(line), "{line} is missing in\n{found}");
    }
    let kept = host.join("tests/api_surface.txt");
    if std::env::var_os("HEADWAY_WRITE_SURFACE").is_some() {
        std::fs::write(&kept, &found).unwrap();
    }
    let kept = std::fs::read_to_string(kept).unwrap_or_default();
    assert!(kept == found, "the surface is now\n{found}");
}
