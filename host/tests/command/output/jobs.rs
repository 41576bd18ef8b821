//! Goal: other programs can rely on what the command writes: jobs, tables, pictures and figures
//! tell of the same job, which is the same for any number of threads. Method: run the binary on
//! small examples and read what it writes.

use crate::rig::{example, folder, headway, headway_with, object, path, stderr, succeeded};
use std::path::Path;

fn poses_every_5_ms(job: &Path) -> String {
    let export = ["export", path(job), "--to", "csv", "--every-ms", "5"];
    succeeded(&headway(&export))
}

/// Walls, lines, loops around, keep-outs and seams, all at once: figures and pictures show them,
/// the job reads back, and is the same for any number of threads.
#[test]
fn what_is_inside_and_around_is_in_the_job() {
    let folder = folder("around");
    let clamp = folder.join("clamp.json");
    let text = r#"{"units":"mm","exterior":[[13,-3],[16,-3],[16,5],[13,5]]}"#;
    std::fs::write(&clamp, text).expect("file");
    let bracket = example("bracket.json");
    let options = [
        "--walls",
        "2",
        "--infill-density",
        "40",
        "--brim",
        "1",
        "--skirt",
        "1",
        "--avoid-crossing",
        "--seam",
        "sharpest",
        "--keep-out",
        path(&clamp),
    ];
    let job = folder.join("bracket.hwj");
    let again = folder.join("again.hwj");
    let plan = |output| [&["plan", &bracket, "--json", "-o", output][..], &options].concat();
    let figures = object(&headway(&plan(path(&job))));
    succeeded(&headway_with("1", &plan(path(&again))));
    let bytes = std::fs::read(&job).expect("job");
    assert!(bytes == std::fs::read(&again).expect("job"), "threads");
    let number = |key: &str| figures[key].as_f64().expect(key);
    assert!(number("skirt_mm") > 150.0 && number("print_mm") > number("skirt_mm"));
    assert!(number("infill_covered_pct") > 15.0 && number("infill_covered_pct") < 40.0);
    assert!(number("kept_out_mm2") > 10.0 && number("outside_depth_mm") < 0.002);
    let report = folder.join("report");
    let simulate = ["simulate", &bracket, "--json", "--report", path(&report)];
    let direct = object(&headway(&[&simulate[..], &options].concat()));
    let read_back = object(&headway(&["simulate", path(&job), "--json"]));
    assert_eq!(direct["step_digest"], read_back["step_digest"]);
    let picture = std::fs::read_to_string(report.join("plan.svg")).expect("picture");
    for name in ["infill", "skirt and brim", "keep-out"] {
        assert!(picture.contains(name), "{name}");
    }
    let run = example("gear-6axis.wpt");
    let machine = example("machines/gantry.toml");
    let waypoints = headway(&["simulate", &run, "-m", &machine, "--brim", "2"]);
    assert_eq!(waypoints.status.code(), Some(2), "{}", stderr(&waypoints));
    assert!(stderr(&waypoints).contains("--brim goes with outlines"));
    std::fs::remove_dir_all(folder).expect("clean up");
}

/// Plan, look, export, simulate: the same job all along, and for any number of threads.
#[test]
fn a_job_is_the_same_wherever_it_goes() {
    let folder = folder("job");
    let web = example("thin-web.json");
    let job = folder.join("web.hwj");
    let again = folder.join("again.hwj");
    let figures = object(&headway(&["plan", &web, "-o", path(&job), "--json"]));
    succeeded(&headway_with("1", &["plan", &web, "-o", path(&again)]));
    let bytes = std::fs::read(&job).expect("job");
    assert!(
        bytes == std::fs::read(&again).expect("job"),
        "one thread plans another job than two"
    );

    let summary = object(&headway(&["inspect", path(&job), "--json"]));
    assert_eq!(summary["knots"], figures["segments"]);
    assert_eq!(summary["name"], "thin-web");

    let table = poses_every_5_ms(&job);
    let figure = |key: &str| figures[key].as_f64().expect(key);
    let flowed_mm3 = check_poses(&table, figure("print_s"), 5e-3);
    let volume_mm3 = figure("volume_mm3");
    // What flows in 5 ms at the ends of a pass.
    assert!((flowed_mm3 / volume_mm3 - 1.0).abs() < 2e-3, "{flowed_mm3}");
    // A layer of 0.2 mm over what is covered; the rasters of both know it to some 0.2 %.
    let covered_mm2 = figure("area_mm2") * figure("covered_pct") / 100.0;
    assert!(
        (volume_mm3 / (0.2 * covered_mm2) - 1.0).abs() < 0.005,
        "{volume_mm3}"
    );
    assert!(succeeded(&headway(&["export", path(&job), "--to", "svg"])).starts_with("<svg"));
    let by_width = ["export", path(&job), "--to", "svg", "--colour", "width"];
    assert!(succeeded(&headway(&by_width)).contains("bead width"));
    let no_picture = headway(&["export", path(&job), "--to", "csv", "--colour", "width"]);
    assert_eq!(no_picture.status.code(), Some(2));
    let knots = object(&headway(&["export", path(&job), "--to", "json"]));
    assert_eq!(
        knots["knots"].as_array().map(Vec::len),
        figures["segments"].as_u64().map(|n| n as usize)
    );

    let direct = object(&headway(&["simulate", &web, "--json"]));
    let report = folder.join("report");
    let from_file = object(&headway(&[
        "simulate",
        path(&job),
        "--json",
        "--report",
        path(&report),
    ]));
    // The outline rides along: the pictures are there without the input.
    for name in ["plan.svg", "index.html"] {
        assert!(report.join(name).exists(), "{name}");
    }
    assert_eq!(direct["step_digest"], from_file["step_digest"]);
    assert_eq!(direct["final_counts"], from_file["final_counts"]);
    assert_eq!(direct["covered_pct"], from_file["covered_pct"]);

    // A changed byte is refused with its place.
    let mut damaged = bytes;
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0x10;
    std::fs::write(&again, damaged).expect("file");
    let output = headway(&["simulate", path(&again)]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("damaged"), "{}", stderr(&output));
    std::fs::remove_dir_all(folder).expect("clean up");
}

/// Columns, even times, poses in the drawing's coordinates (30 x 12 mm). What flows in all, mm³.
fn check_poses(table: &str, print_s: f64, every_s: f64) -> f64 {
    let mut lines = table.lines();
    let header = "t_s,layer,pass,x_mm,y_mm,z_mm,nx,ny,nz,heading_rad,speed_mm_s,flow_mm3_s,state";
    assert_eq!(lines.next(), Some(header));
    let mut printed = 0;
    let mut count = 0usize;
    let mut flowed_mm3 = 0.0;
    for (number, row) in lines.enumerate() {
        let cells: Vec<&str> = row.split(',').collect();
        let value = |k: usize| -> f64 { cells[k].parse().expect("number") };
        assert!((value(0) - number as f64 * every_s).abs() < 1e-6, "{row}");
        assert_eq!((value(6), value(7), value(8)), (0.0, 0.0, 1.0), "{row}");
        flowed_mm3 += value(11) * every_s;
        if cells[12] == "print" {
            printed += 1;
            assert!(
                (0.0..=30.0).contains(&value(3)) && (0.0..=12.0).contains(&value(4)),
                "{row}"
            );
            assert!((value(5) - 0.2).abs() < 1e-6 && value(2) >= 0.0, "{row}");
        } else {
            assert!(value(11) == 0.0, "{row}");
        }
        count = number + 1;
    }
    assert!(printed * 2 > count, "{printed} of {count} rows print");
    let expected = print_s / every_s + 1.0;
    assert!(
        (count as f64 - expected).abs() <= 1.0,
        "{count} rows, {expected} expected"
    );
    flowed_mm3
}

#[test]
fn simulate_writes_report_and_traces() {
    let folder = folder("report");
    let report = folder.join("report");
    let (trace, steps) = (folder.join("trace.csv"), folder.join("steps.csv"));
    let output = headway(&[
        "simulate",
        &example("taper.json"),
        "--report",
        path(&report),
        "--trace",
        path(&trace),
        "--trace-steps",
        path(&steps),
        "--json",
    ]);
    let figures = object(&output);
    // No bars in a pipe.
    assert!(
        !stderr(&output).contains(['\r', '\u{1b}']),
        "{:?}",
        stderr(&output)
    );
    for key in [
        "area_mm2",
        "reachable_pct",
        "covered_pct",
        "covered_of_reachable_pct",
        "outside_depth_mm",
        "overlap_pct",
        "unreachable_mm",
        "passes",
        "flow_interruptions",
        "print_mm",
        "travel_mm",
        "print_s",
        "time_bound_s",
        "volume_mm3",
        "plan_s",
        "heading_travel_rad",
        "heading_rate_max_rad_s",
        "segments",
        "bytes",
        "bytes_per_s",
        "limit_ratio_velocity",
        "limit_ratio_acceleration",
        "limit_ratio_jerk",
        "time_share_by_limit",
        "slow_places",
        "tip_error_um_max",
        "tip_error_um_rms",
        "heading_error_mrad_max",
        "half_step_um_max",
        "half_step_mrad_max",
        "volume_error_pct",
        "step_time_error_us_max",
        "step_time_error_us_rms",
        "steps",
        "step_digest",
        "final_counts",
        "resent_frames",
        "underruns",
        "holds",
        "faults",
        "realtime_factor",
    ] {
        assert!(
            figures.get(key).is_some_and(|v| !v.is_null()),
            "{key} is missing"
        );
    }
    let text = std::fs::read_to_string(report.join("report.json")).expect("report");
    let written: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(written.as_object(), Some(&figures));
    let picture = std::fs::read_to_string(report.join("plan.svg")).expect("picture");
    assert!(picture.starts_with("<svg") && picture.trim_end().ends_with("</svg>"));
    let rows = std::fs::read_to_string(&steps)
        .expect("steps")
        .lines()
        .count()
        - 1;
    assert_eq!(Some(rows as u64), figures["steps"].as_u64());
    let first = std::fs::read_to_string(&trace).expect("trace");
    assert!(first.starts_with("t_s,layer,pass,x_mm"), "{}", &first[..60]);
    std::fs::remove_dir_all(folder).expect("clean up");
}

/// Layers are in the figures, the tables, the pictures and the simulation; a job from a file draws
/// the same layers as one planned just now.
#[test]
fn layers_are_in_everything_that_tells_of_them() {
    let folder = folder("layers");
    let job = folder.join("web.hwj");
    let web = example("thin-web.json");
    let print = ["--layers", "3", "--walls", "1", "--infill-density", "30"];
    let ends = ["--bottom", "1", "--top", "0"];
    let plan = ["plan", &web, "-o", path(&job), "--json"];
    let figures = object(&headway(&[&plan[..], &print, &ends].concat()));
    assert_eq!(figures["layers"], 3);
    let kinds = figures["layer_kinds"].as_array().expect("kinds");
    let whats: Vec<[f64; 4]> = kinds
        .iter()
        .map(|kind| {
            let keys = [
                "first_layer",
                "layers",
                "infill_density_pct",
                "infill_angle_deg",
            ];
            keys.map(|key| kind[key].as_f64().expect(key).round())
        })
        .collect();
    assert_eq!(
        whats,
        [
            [0.0, 1.0, 100.0, 45.0],
            [1.0, 1.0, 30.0, 135.0],
            [2.0, 1.0, 30.0, 45.0]
        ]
    );
    let value = |key: &str| figures[key].as_f64().expect(key);
    assert!(value("covered_pct_min") < value("covered_pct"));
    assert!(value("overlap_pct_max") >= value("overlap_pct"));

    let table = poses_every_5_ms(&job);
    let mut seen = [0; 3];
    for row in table.lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        let layer: usize = cells[1].parse().expect("layer");
        let z_mm: f64 = cells[5].parse().expect("z");
        let bed_mm = 0.2 * (layer + 1) as f64;
        if cells[12] == "print" {
            assert!((z_mm - bed_mm).abs() < 1e-4, "{row}");
            seen[layer] += 1;
        }
        // Travel to a layer begins on the one below.
        assert!(z_mm > bed_mm - 0.2001, "{row}");
    }
    assert!(seen.iter().all(|rows| *rows > 100), "{seen:?}");

    let reports = [path(&job), &web].map(|input| {
        let report = folder.join("report");
        let simulate = ["simulate", input, "--figures", "--report", path(&report)];
        let output = if input == web {
            headway(&[&simulate[..], &print, &ends].concat())
        } else {
            headway(&simulate)
        };
        let text = succeeded(&output);
        assert!(
            text.contains("layer 2      ") && text.contains("30 % lines at 135°"),
            "{text}"
        );
        let page = std::fs::read_to_string(report.join("index.html")).expect("page");
        let (_, block) = page.split_once("id=\"data\">").expect("data");
        let (block, _) = block.split_once("</script>").expect("its end");
        let block: serde_json::Value = serde_json::from_str(block).expect("JSON");
        std::fs::remove_dir_all(&report).expect("clean up");
        [0, 1, 2].map(|layer| block["layers"][layer]["ground"].clone())
    });
    assert_eq!(reports[0], reports[1]);
    assert_ne!(reports[0][1], reports[0][2]);
    assert!(reports[0][2][0]["twice"].as_object().is_some());

    let svg = |layer| headway(&["export", path(&job), "--to", "svg", "--layer", layer]);
    assert_ne!(succeeded(&svg("1")), succeeded(&svg("2")));
    assert!(succeeded(&svg("3")).contains("layer 3 of 3"));
    let is_refused = |layer, range: &str| {
        let output = svg(layer);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(range), "{}", stderr(&output));
    };
    is_refused("0", "layers 1 to 3");
    is_refused("4", "layers 1 to 3");
    // A job of the upper layers has no picture of the lowest, and none is drawn that is empty.
    let mesh = example("hook.stl");
    let upper = [
        "--layer-height",
        "0.2",
        "--layer-range",
        "2-3",
        "--quality",
        "fast",
    ];
    succeeded(&headway(
        &[&["plan", &mesh, "-o", path(&job)], &upper[..]].concat(),
    ));
    let first = headway(&["export", path(&job), "--to", "svg"]);
    assert!(succeeded(&first).contains("layer 2 of 3"));
    is_refused("1", "layers 2 to 3");
    std::fs::remove_dir_all(folder).expect("clean up");
}

/// Goal: the page shows each layer by its own motion, layers planned alike too. Method: the data of a page of three
/// alike layers: each begins when the one below ends,
/// and only the first comes from the home position.
#[test]
fn the_page_shows_alike_layers_by_their_own_motion() {
    let folder = folder("alike");
    let report = folder.join("report");
    let taper = example("taper.json");
    let input = ["simulate", &taper, "--layers", "3", "--layer-height", "0.2"];
    succeeded(&headway(
        &[&input[..], &["--report", path(&report)]].concat(),
    ));
    let page = std::fs::read_to_string(report.join("index.html")).expect("page");
    let (_, block) = page.split_once("id=\"data\">").expect("data");
    let (block, _) = block.split_once("</script>").expect("its end");
    let block: serde_json::Value = serde_json::from_str(block).expect("JSON");
    let layers = block["layers"].as_array().expect("layers");
    let label = |layer: usize| layers[layer]["label"].as_str().expect("a label");
    assert_eq!((layers.len(), label(2)), (3, "layer 3 of 3, like layer 1"));
    let number = |layer: usize, key: &str| layers[layer][key].as_f64().expect(key);
    for layer in 1..3 {
        let below_s = number(layer - 1, "start_s") + number(layer - 1, "seconds");
        assert!(
            (number(layer, "start_s") - below_s).abs() < 1e-9,
            "{}",
            label(layer)
        );
    }
    assert!(number(1, "seconds") < number(0, "seconds"));
    std::fs::remove_dir_all(folder).expect("clean up");
}

/// A bad line costs time, never a step.
#[test]
fn a_bad_line_changes_no_step() {
    let taper = example("taper.json");
    let clean = object(&headway(&["simulate", &taper, "--json"]));
    let link = "drop=0.1,flip=1e-4,dup=0.02";
    // A short job is a few dozen frames: one seed alone may lose none of them.
    let mut resent_frames = 0;
    for seed in ["1", "2", "3", "4"] {
        let noisy = object(&headway(&[
            "simulate", &taper, "--link", link, "--seed", seed, "--json",
        ]));
        resent_frames += noisy["resent_frames"].as_u64().expect("a count");
        // Where the queue never ran dry, every step comes at the very same tick.
        assert_eq!(noisy["underruns"], 0, "seed {seed}");
        assert_eq!(clean["step_digest"], noisy["step_digest"], "seed {seed}");
        assert_eq!(clean["final_counts"], noisy["final_counts"], "seed {seed}");
    }
    assert!(resent_frames > 0, "the line lost nothing");
}
