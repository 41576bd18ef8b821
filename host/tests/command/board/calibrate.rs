//! Goal: the patterns lie on the bed as `headway calibrate` says. Method: its jobs are run through the firmware
//! library; where each line begins and ends, how it is turned and leans, and how fast it is, is read off the
//! recorded steps through forward kinematics, and held against the table that the command prints.

use crate::rig::{example, folder, headway, object, path, stderr};
use headway::job::file;
use headway_protocol::segment::FlowAction;
use serde_json::{Map, Value};
use std::path::Path;

/// Half a step of X and Y together is 8.9 µm at the tip, the path's own error 1 µm.
const PLACE_MM: f64 = 0.012;
/// Half a step of every joint of the gantry, at the tip: `half_step_um_max` of its run, rounded up.
const TILTED_MM: f64 = 0.04;
/// Half a step of the nozzle is 0.019°, and the path's own error as much again.
const TURN_DEG: f64 = 0.05;

/// A pose of the steps.
struct Pose {
    t_s: f64,
    place_mm: [f64; 3],
    axis: [f64; 3],
    heading_deg: f64,
}

/// Draws a pattern, runs its first job, and gives the table and the poses of each printed pass.
fn laid(test: &str, arguments: &[&str]) -> (Map<String, Value>, Vec<Vec<Pose>>) {
    let folder = folder(test);
    let job = folder.join("pattern.hwj");
    let mut all = vec!["calibrate"];
    all.extend(arguments);
    all.extend(["--json", "-o", path(&job)]);
    let table = object(&headway(&all));
    let file = table["jobs"][0]["file"].as_str().expect("file").to_owned();
    let trace = folder.join("trace.csv");
    let ran = object(&headway(&[
        "simulate",
        &file,
        "--trace",
        path(&trace),
        "--json",
    ]));
    assert_eq!(ran["faults"], 0, "{ran:?}");
    (table, passes(&trace))
}

fn passes(trace: &Path) -> Vec<Vec<Pose>> {
    let text = std::fs::read_to_string(trace).expect("trace");
    let mut passes: Vec<Vec<Pose>> = Vec::new();
    for row in text.lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        if cells[12] != "print" {
            continue;
        }
        let number = |column: usize| cells[column].parse::<f64>().expect("number");
        let pass: usize = cells[2].parse().expect("pass");
        passes.resize_with(passes.len().max(pass + 1), Vec::new);
        passes[pass].push(Pose {
            t_s: number(0),
            place_mm: [3, 4, 5].map(number),
            axis: [6, 7, 8].map(number),
            heading_deg: number(9).to_degrees(),
        });
    }
    passes
}

fn numbers(value: &Value) -> Vec<f64> {
    let numbers = value.as_array().expect("array");
    numbers
        .iter()
        .map(|n| n.as_f64().expect("number"))
        .collect()
}

/// The lines of the first job lie where the table says, turned as it says.
fn assert_laid(table: &Map<String, Value>, passes: &[Vec<Pose>]) {
    let lines = table["lines"].as_array().expect("lines");
    let of_first = lines.iter().filter(|line| line["job"] == 0);
    let of_first: Vec<&Value> = of_first.collect();
    assert_eq!(of_first.len(), passes.len());
    for (line, pass) in of_first.into_iter().zip(passes) {
        let heading_deg = line["heading_deg"].as_f64().expect("heading");
        let ends = [
            (&line["from_mm"], &pass[0]),
            (&line["to_mm"], &pass[pass.len() - 1]),
        ];
        for (said, pose) in ends {
            let off = numbers(said)
                .into_iter()
                .zip(pose.place_mm)
                .map(|(a, b)| (a - b).abs());
            let off_mm = off.fold(0.0, f64::max);
            assert!(off_mm < PLACE_MM, "{line}: {:?}", pose.place_mm);
        }
        for pose in pass {
            let off_deg = (pose.heading_deg - heading_deg).abs();
            assert!(off_deg < TURN_DEG, "{line}: {}", pose.heading_deg);
        }
    }
}

#[test]
fn marks_lie_at_their_distance_and_the_tube_is_as_high_as_told() {
    let (table, passes) = laid("steps", &["steps", "--length", "80"]);
    assert_laid(&table, &passes);
    let middle = |pass: &[Pose]| pass[pass.len() / 2].place_mm;
    let [left, right] = [&passes[0], &passes[1]].map(|pass| middle(pass));
    let [front, back] = [&passes[2], &passes[3]].map(|pass| middle(pass));
    assert!((right[0] - left[0] - 80.0).abs() < PLACE_MM);
    assert!((back[1] - front[1] - 80.0).abs() < PLACE_MM);
    let top_mm = passes[4].last().expect("tube").place_mm[2];
    assert!((top_mm - 10.0).abs() < PLACE_MM, "{top_mm}");
    let read = table["read"].to_string();
    assert!(
        read.contains("80 mm") && read.contains("10.00 mm"),
        "{read}"
    );
    // A tube of radius 10 mm, its wall between the narrowest and the widest bead.
    let ring_mm3 = 50.0 * std::f64::consts::TAU * 10.0 * 0.2;
    let volume_mm3 = table["jobs"][0]["volume_mm3"].as_f64().expect("volume");
    let wall_mm = volume_mm3 / ring_mm3;
    assert!((0.4..1.3).contains(&wall_mm), "{volume_mm3} mm3: {wall_mm}");
}

#[test]
fn fans_and_halves_are_turned_as_told_and_whole_turns_are_kept() {
    let arguments = ["heading", "--lines", "5", "--turns", "2", "--length", "20"];
    let (table, passes) = laid("heading", &arguments);
    assert_laid(&table, &passes);
    let headings = passes.iter().map(|pass| pass[0].heading_deg.round());
    let headings: Vec<f64> = headings.collect();
    let fan = [-30.0, -15.0, 0.0, 15.0, 30.0];
    let turned = fan.map(|deg| deg + 720.0);
    assert_eq!(headings, [&[0.0, 90.0], &fan[..], &turned[..]].concat());
    let (table, passes) = laid("nozzle", &["nozzle", "--lines", "3", "--length", "20"]);
    assert_laid(&table, &passes);
    let headings = passes.iter().map(|pass| pass[0].heading_deg.round());
    // An opening that looks the same after half a turn is turned half a turn nevertheless.
    let rows = [[0.0, 180.0].repeat(3), [90.0, -90.0].repeat(3)].concat();
    assert_eq!(headings.collect::<Vec<f64>>(), rows);
}

#[test]
fn lines_for_the_pivot_lean_to_either_side() {
    let machine = example("machines/gantry.toml");
    let (table, passes) = laid(
        "pivot",
        &["pivot", "-m", &machine, "--lines", "3", "--tilt", "10"],
    );
    let values = table["lines"].as_array().expect("lines").iter();
    let values: Vec<f64> = values
        .map(|line| line["value"].as_f64().expect("value"))
        .collect();
    assert_eq!(passes.len(), 12);
    let sin = 10f64.to_radians().sin();
    for (number, pass) in passes.iter().enumerate() {
        let across = if number < 6 { 1 } else { 0 };
        let lean = if number % 2 == 0 { sin } else { -sin };
        for pose in pass {
            assert!(
                (pose.axis[across] - lean).abs() < 1e-3,
                "{number}: {:?}",
                pose.axis
            );
        }
    }
    // The halves are apart by twice what a pivot of that length in place of 60 mm makes.
    for pair in 0..6 {
        let across = if pair < 3 { 1 } else { 0 };
        let apart_mm =
            passes[2 * pair + 1][0].place_mm[across] - passes[2 * pair][0].place_mm[across];
        let told_mm = 2.0 * (60.0 - values[2 * pair]) * sin;
        // Half a step of the axes that tilt is 20 µm at the end of 60 mm, for each half.
        assert!(
            (apart_mm - told_mm).abs() < 2.0 * TILTED_MM,
            "{apart_mm} {told_mm}"
        );
    }
    let planar = headway(&["calibrate", "pivot"]);
    assert_eq!(planar.status.code(), Some(1));
    assert!(
        stderr(&planar).contains("heads that tilt"),
        "{}",
        stderr(&planar)
    );
}

#[test]
fn each_advance_has_a_job_and_its_machine_and_lines_change_their_speed() {
    let arguments = ["advance", "--lines", "3", "--to", "0.08", "--length", "90"];
    let (table, passes) = laid("advance", &arguments);
    let jobs = table["jobs"].as_array().expect("jobs");
    assert_eq!(jobs.len(), 3);
    let mut lowest_mm = Vec::new();
    for (job, value) in jobs.iter().zip([0.0, 0.04, 0.08]) {
        let file = |key: &str| job[key].as_str().expect("file").to_owned();
        let mut open = std::fs::File::open(file("file")).expect("job");
        let read = file::read(&mut open).expect("a job");
        let extruder = &read.header.machine.extruder;
        assert!((extruder.pressure_advance_s - value).abs() < 1e-12);
        // The machine file beside it is the one that the job is for.
        object(&headway(&[
            "simulate",
            &file("file"),
            "-m",
            &file("machine_file"),
            "--json",
        ]));
    }
    for line in table["lines"].as_array().expect("lines") {
        if line["value"].is_f64() {
            lowest_mm.push(numbers(&line["from_mm"])[1]);
        }
    }
    assert!(
        lowest_mm.windows(2).all(|pair| pair[1] > pair[0] + 4.0),
        "{lowest_mm:?}"
    );
    // Marks at the changes, then the line itself.
    assert_eq!(passes.len(), 3);
    assert!((passes[0][0].place_mm[0] - 30.0).abs() < PLACE_MM);
    assert!((passes[1][0].place_mm[0] - 60.0).abs() < PLACE_MM);
    let speed_mm_s = |from_mm: f64, to_mm: f64| {
        let passed = |x_mm: f64| {
            passes[2]
                .iter()
                .find(|pose| pose.place_mm[0] >= x_mm)
                .expect("pose")
        };
        let (from, to) = (passed(from_mm), passed(to_mm));
        (to.place_mm[0] - from.place_mm[0]) / (to.t_s - from.t_s)
    };
    // 95 % of 15, 60 and 15 mm/s.
    for (from_mm, to_mm, told_mm_s) in [(5.0, 28.0, 14.25), (34.0, 58.0, 57.0), (64.0, 85.0, 14.25)]
    {
        let found = speed_mm_s(from_mm, to_mm);
        assert!(
            (found / told_mm_s - 1.0).abs() < 0.01,
            "{found} {told_mm_s}"
        );
    }
}

#[test]
fn prime_and_retract_step_from_line_to_line() {
    let prime_steps = |action: FlowAction, file: &str| -> Vec<f64> {
        let mut open = std::fs::File::open(file).expect("job");
        let stream = file::read(&mut open)
            .expect("a job")
            .stream()
            .expect("stream");
        let events = stream.events.iter().filter(|event| event.action == action);
        events
            .map(|event| f64::from(event.volume_units) * 1e-6)
            .collect()
    };
    let arguments = |name| {
        [
            name, "--lines", "4", "--from", "0.5", "--to", "2", "--length", "20",
        ]
    };
    let (table, passes) = laid("prime", &arguments("prime"));
    assert_laid(&table, &passes);
    let file = table["jobs"][0]["file"].as_str().expect("file");
    // The lead-in's is the machine's own.
    assert_eq!(
        prime_steps(FlowAction::Prime, file),
        [1.5, 0.5, 1.0, 1.5, 2.0]
    );
    assert_eq!(prime_steps(FlowAction::Retract, file), [1.5; 5]);
    let (table, passes) = laid("retract", &arguments("retract"));
    assert_laid(&table, &passes);
    let file = table["jobs"][0]["file"].as_str().expect("file");
    assert_eq!(
        prime_steps(FlowAction::Retract, file),
        [1.5, 0.5, 1.0, 1.5, 2.0]
    );
    // What was pulled in comes back.
    assert_eq!(
        prime_steps(FlowAction::Prime, file),
        [1.5, 1.5, 0.5, 1.0, 1.5]
    );
}

/// What a frame of one frequency does that is driven by places at times: its distance from them, over the
/// same times. In steps of 20 µs.
fn swing_mm(driven: &[(f64, f64)], hz: f64, damping: f64) -> Vec<(f64, f64)> {
    const STEP_S: f64 = 2e-5;
    let omega = std::f64::consts::TAU * hz;
    let (mut at_mm, mut speed_mm_s) = (driven[0].1, 0.0);
    let mut swung = Vec::new();
    for pair in driven.windows(2) {
        let [(t0_s, from_mm), (t1_s, to_mm)] = [pair[0], pair[1]];
        let count = ((t1_s - t0_s) / STEP_S).ceil().max(1.0);
        let (step_s, rate_mm_s) = ((t1_s - t0_s) / count, (to_mm - from_mm) / (t1_s - t0_s));
        for step in 0..count as usize {
            let place_mm = from_mm + (to_mm - from_mm) * step as f64 / count;
            let pull = omega * omega * (place_mm - at_mm);
            speed_mm_s += step_s * (pull + 2.0 * damping * omega * (rate_mm_s - speed_mm_s));
            at_mm += step_s * speed_mm_s;
        }
        swung.push((t1_s, at_mm - to_mm));
    }
    swung
}

/// Goal: a frame's frequency, read off the walls as the words say, is the frame's. Method: the second leg of a wall
/// through a frame of a known frequency; waves counted by their zeros, by the way of the tip.
#[test]
fn waves_behind_a_corner_tell_the_frequency_of_the_frame() {
    let arguments = ["ringing", "--length", "40", "--speed", "100"];
    let (table, passes) = laid("ringing", &arguments);
    assert_laid(&table, &passes);
    assert_eq!(passes.len(), 30, "two walls of fifteen layers");
    let read = table["read"].to_string();
    assert!(read.contains("95.0 mm/s"), "{read}");
    // The outer wall reads Y along X, the inner one X along Y.
    for (pass, along, across) in [(&passes[0], 0, 1), (&passes[1], 1, 0)] {
        for frame_hz in [28.0, 45.0] {
            let driven = pass.iter().map(|pose| (pose.t_s, pose.place_mm[across]));
            let swung = swing_mm(&driven.collect::<Vec<_>>(), frame_hz, 0.05);
            let corner_mm = pass.iter().map(|pose| pose.place_mm[along]);
            let corner_mm = corner_mm.fold(f64::INFINITY, f64::min);
            let behind = pass
                .iter()
                .skip(1)
                .zip(&swung)
                .filter_map(|(pose, (_, off_mm))| {
                    let way_mm = pose.place_mm[along] - corner_mm;
                    let on_leg = (pose.place_mm[across] - corner_of(pass, across)).abs() < 0.02;
                    (on_leg && (4.0..20.0).contains(&way_mm)).then_some((way_mm, *off_mm))
                });
            let behind: Vec<(f64, f64)> = behind.collect();
            let zeros: Vec<f64> = behind
                .windows(2)
                .filter(|pair| (pair[0].1 < 0.0) != (pair[1].1 < 0.0))
                .map(|pair| {
                    let share = pair[0].1 / (pair[0].1 - pair[1].1);
                    pair[0].0 + share * (pair[1].0 - pair[0].0)
                })
                .collect();
            assert!(zeros.len() >= 5, "{frame_hz} Hz: {zeros:?}");
            let waves = (zeros.len() - 1) as f64 / 2.0;
            let read_hz = 95.0 * waves / (zeros[zeros.len() - 1] - zeros[0]);
            println!("{frame_hz} Hz is read as {read_hz:.2} Hz by {waves} waves");
            // Half a step of the motors against waves of some 20 µm moves a zero by a few per cent of a wave.
            assert!(
                (read_hz / frame_hz - 1.0).abs() < 0.03,
                "{frame_hz} {read_hz}"
            );
        }
    }
}

/// Least place of a pass along an axis: where its corner is.
fn corner_of(pass: &[Pose], axis: usize) -> f64 {
    let places = pass.iter().map(|pose| pose.place_mm[axis]);
    places.fold(f64::INFINITY, f64::min)
}

/// Times and places of a motor, mm, by its recorded steps.
fn steps_of(trace: &Path, motor: &str, steps_per_mm: f64) -> Vec<(f64, f64)> {
    let text = std::fs::read_to_string(trace).expect("steps");
    let mut count = 0;
    let rows = text.lines().skip(1).filter_map(|row| {
        let cells: Vec<&str> = row.split(',').collect();
        (cells[1] == motor).then(|| {
            count += cells[2].parse::<i64>().expect("direction");
            let t_s = cells[0].parse::<f64>().expect("time") * 1e-6;
            (t_s, count as f64 / steps_per_mm)
        })
    });
    rows.collect()
}

/// Goal: each joint is shaken at the told frequency at the told time, within its limits, and a frame shakes most when
/// its own is due. Method: the recorded steps; a period is the time between two passages upwards from the middle.
#[test]
fn each_joint_is_shaken_at_the_told_frequency_at_its_time() {
    let folder = folder("resonance");
    let [job, steps] = ["shake.hwj", "steps.csv"].map(|name| folder.join(name));
    let asked = [
        "calibrate",
        "resonance",
        "--from",
        "20",
        "--to",
        "60",
        "--json",
        "-o",
        path(&job),
    ];
    let table = object(&headway(&asked));
    let ran = [
        "simulate",
        path(&job),
        "--trace-steps",
        path(&steps),
        "--json",
    ];
    let figures = object(&headway(&ran));
    assert_eq!(figures["faults"], 0, "{figures:?}");
    for limit in ["limit_ratio_velocity", "limit_ratio_acceleration"] {
        let ratio = figures[limit].as_f64().expect("ratio");
        assert!(ratio <= 1.0, "{limit} {ratio}");
    }
    let counts = figures["final_counts"].as_array().expect("counts");
    let shaken = table["shaken"].as_array().expect("joints");
    assert_eq!(shaken.len(), 2);
    let (mut worst, mut periods) = (0.0f64, 0);
    for (number, joint) in shaken.iter().enumerate() {
        let of = |key: &str| joint[key].as_f64().expect("number");
        let (begin_s, end_s) = (of("begin_s"), of("end_s"));
        assert!((end_s - begin_s - 40.0).abs() < 0.1, "1 Hz a second");
        let places = steps_of(&steps, &number.to_string(), 80.0);
        // Still before and behind, but for what waits in the line.
        let outside = places
            .iter()
            .filter(|(t_s, _)| *t_s < begin_s || *t_s > end_s + 0.2);
        assert_eq!(outside.count(), 0);
        assert_eq!(places.last().expect("steps").1, 0.0, "{counts:?}");
        let most_mm = places.iter().map(|place| place.1.abs()).fold(0.0, f64::max);
        assert!(
            (most_mm - of("amplitude_mm")).abs() < 0.5 / 80.0 + 1e-9,
            "{most_mm}"
        );
        let upwards: Vec<f64> = places
            .windows(2)
            .filter(|pair| pair[0].1 == 0.0 && pair[1].1 > 0.0)
            .map(|pair| pair[1].0)
            .collect();
        for pair in upwards.windows(2) {
            let middle_s = 0.5 * (pair[0] + pair[1]);
            if middle_s < begin_s + 1.0 || middle_s > end_s - 1.0 {
                // It grows and fades there, so that the middle is passed early or late.
                continue;
            }
            let told_hz = 20.0 + middle_s - begin_s;
            worst = worst.max((1.0 / (pair[1] - pair[0]) / told_hz - 1.0).abs());
            periods += 1;
        }
        for frame_hz in [28.0, 45.0] {
            let swung = swing_mm(&places, frame_hz, 0.05);
            let most = swung.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
            let read_hz = 20.0 + most.expect("a swing").0 - begin_s;
            println!("a frame of {frame_hz} Hz shakes most at {read_hz:.2} Hz");
            assert!(
                (read_hz / frame_hz - 1.0).abs() < 0.03,
                "{frame_hz} {read_hz}"
            );
        }
    }
    println!("{periods} periods, off by {:.2} % at most", 100.0 * worst);
    assert!(periods > 2800, "{periods}");
    // A servo tick of a period of 17 ms is 3 %: the steps are finer than that.
    assert!(worst < 0.02, "{worst}");
}

#[test]
fn options_of_other_things_are_refused() {
    let cases: [(&[&str], i32, &str); 9] = [
        (&["ringing", "--lines", "5"], 2, "--lines does not go"),
        (&["resonance", "--length", "50"], 2, "--length does not go"),
        (&["resonance", "--to", "140"], 2, "less than a step"),
        (
            &["resonance", "--from", "50", "--to", "40"],
            2,
            "--from below --to",
        ),
        (&["steps", "--lines", "5"], 2, "--lines does not go"),
        (&["heading", "--walls", "2"], 2, "--walls"),
        (&["heading", "--aperture", "circle:0.6"], 1, "round"),
        (&["prime", "--length", "900"], 1, "--length"),
        (&["prime", "--at", "100,x,0"], 2, "--at"),
    ];
    for (arguments, code, words) in cases {
        let ran = headway(&[&["calibrate"], arguments].concat());
        assert_eq!(
            ran.status.code(),
            Some(code),
            "{arguments:?}: {}",
            stderr(&ran)
        );
        assert!(stderr(&ran).contains(words), "{}", stderr(&ran));
    }
}

/// Goal: what slugs weighed becomes the curve of the machine file, the wrong one is named, and the board laid out so
/// makes up for it. Method: slugs of an extruder that loses 4 to 25 %, of known volume; the file before and after; E of
/// the export against the volume of the job by the curve as it was put in.
#[test]
fn weights_of_slugs_become_the_curve_of_the_machine_file() {
    let folder = folder("calibrate_flow");
    let machine = folder.join("mine.toml");
    let text = String::from_utf8(headway(&["machine", "new"]).stdout).expect("text");
    let text = text + "\n[material]\nhot_end_c = 210 # mine\ndensity_g_cm3 = 1.24\n";
    std::fs::write(&machine, &text).expect("write");
    let (table, _) = laid(
        "calibrate_flow_job",
        &["flow", "-m", path(&machine), "--lines", "6"],
    );
    let volume_mm3 = table["jobs"][0]["volume_mm3"].as_f64().expect("volume") / 6.0;
    let lines = table["lines"].as_array().expect("lines");
    let mut rows = "g;mm3_s\n".to_string();
    for (number, line) in lines.iter().enumerate() {
        let rate = line["value"].as_f64().expect("value");
        let share = 0.04 + 0.21 * (rate / 38.0).powi(2);
        let fault = if number == 3 { 0.8 } else { 1.0 };
        rows += &format!(
            "{:.5};{rate}\n",
            volume_mm3 * 1.24e-3 * (1.0 - share) * fault
        );
    }
    let weights = folder.join("weights.csv");
    std::fs::write(&weights, rows).expect("write");
    let fit = object(&headway(&[
        "calibrate",
        "flow",
        "-m",
        path(&machine),
        "--weights",
        path(&weights),
        "--write",
        path(&machine),
        "--json",
    ]));
    assert_eq!(fit["doubted"].as_array().expect("rows").len(), 1);
    assert_eq!(fit["doubted"][0]["line"], 5);
    let points = fit["flow_loss"].as_array().expect("points");
    for point in points {
        let [rate, share] = [0, 1].map(|k| point[k].as_f64().expect("number"));
        let law = 0.04 + 0.21 * (rate / 38.0).powi(2);
        assert!((share - law).abs() < 2e-3, "{rate}: {share}");
    }
    let new = std::fs::read_to_string(&machine).expect("written");
    let before = std::fs::read_to_string(folder.join("mine.toml.before")).expect("kept");
    assert_eq!(before, text);
    let added: Vec<&str> = new.lines().filter(|line| !text.contains(line)).collect();
    assert!(
        added.len() == 1 && added[0].starts_with("flow_loss = [["),
        "{added:?}"
    );

    let job = folder.join("gear.hwj");
    let gear = example("gear.json");
    let planned = object(&headway(&[
        "plan",
        &gear,
        "-m",
        path(&machine),
        "--quality",
        "fast",
        "-o",
        path(&job),
        "--json",
    ]));
    let ran = object(&headway(&["simulate", path(&job), "--json"]));
    assert_eq!(ran["faults"], 0, "{ran:?}");
    let file = folder.join("gear.gcode");
    let exported = headway(&[
        "export",
        path(&job),
        "--to",
        "gcode",
        "--dialect",
        "klipper",
        "-o",
        path(&file),
    ]);
    assert!(exported.status.success(), "{}", stderr(&exported));
    // Straight moves alone, by their own rate: E and F of each.
    let arrives = |asked: f64| {
        let mut from = [0.0, 0.0];
        for point in points {
            let [rate, share] = [0, 1].map(|k| point[k].as_f64().expect("number"));
            let to = [rate, rate * (1.0 - share)];
            if asked <= to[0] || point == &points[points.len() - 1] {
                return from[1] + (to[1] - from[1]) * (asked - from[0]) / (to[0] - from[0]);
            }
            from = to;
        }
        asked
    };
    let (mut laid_mm3, mut at, mut feed) = (0.0, [0.0; 2], 1.0);
    for line in std::fs::read_to_string(&file).expect("file").lines() {
        let word = |letter: char| {
            line.split(' ')
                .find_map(|word| word.strip_prefix(letter)?.parse::<f64>().ok())
        };
        if !line.starts_with("G1 ") {
            continue;
        }
        feed = word('F').unwrap_or(feed);
        let to = [word('X').unwrap_or(at[0]), word('Y').unwrap_or(at[1])];
        let way_mm = f64::hypot(to[0] - at[0], to[1] - at[1]);
        at = to;
        if let Some(e_mm) = word('E').filter(|_| way_mm > 1e-3) {
            let (seconds, pushed_mm3) = (
                60.0 * way_mm / feed,
                e_mm * 0.25 * std::f64::consts::PI * 1.75 * 1.75,
            );
            laid_mm3 += if pushed_mm3 > 0.0 {
                arrives(pushed_mm3 / seconds) * seconds
            } else {
                pushed_mm3
            };
        }
    }
    let wanted_mm3 = planned["volume_mm3"].as_f64().expect("volume");
    assert!(
        (laid_mm3 / wanted_mm3 - 1.0).abs() < 2e-3,
        "{laid_mm3} of {wanted_mm3}"
    );

    for (arguments, word) in [
        (&["flow", "--write", "x.toml"][..], "--weights"),
        (&["steps", "--weights", path(&weights)], "`flow`"),
        (&["flow", "--weights", path(&weights)], "density_g_cm3"),
    ] {
        let refused = headway(&[&["calibrate"], arguments].concat());
        assert!(
            !refused.status.success() && stderr(&refused).contains(word),
            "{}",
            stderr(&refused)
        );
    }
}
