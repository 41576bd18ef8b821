//! Goal: a sensor's program corrects the flow, and none that is broken or lies ends a print or takes the flow beyond its
//! bounds. Method: the command streams to the firmware library behind a socket, beside programs of a few lines of shell;
//! what the board was sent and where its motors stand is read from the log and from the board, not from the command.
#![cfg(unix)]

use crate::rig::board::{Board, Host};
use crate::rig::{folder, headway, object, path, stderr, succeeded};
use headway::drive::link_log::{Entry, Way, read_log};
use headway::settings::Settings;
use headway_protocol::frame::FrameDecoder;
use headway_protocol::message::{Control, HostMessage};
use headway_tests::scanner::{Scanner, Truth, csv, scan};
use serde_json::Value;
use std::path::Path;
use std::time::{Duration, Instant};

/// A spiral of some seconds, and the counts at its planned flow. The correction changes and is missed sooner than usual.
fn job(folder: &Path, measure: &str) -> (String, Vec<i64>) {
    let (machine, run) = (folder.join("machine.toml"), folder.join("spiral.wpt"));
    let text = succeeded(&headway(&["machine", "new"]));
    let keys = "\n[measure]\nflow_change_per_s = 0.5\nsilent_s = 0.5\n";
    std::fs::write(&machine, text + keys + measure).unwrap();
    let turns = (0..=36 * 3).map(|i| {
        let angle = f64::from(i) * 10f64.to_radians();
        let radius = 15.0 + 0.3 * angle;
        format!(
            "{} {} 0.2 0 0 1\n",
            radius * angle.cos(),
            radius * angle.sin()
        )
    });
    std::fs::write(&run, turns.collect::<String>()).unwrap();
    let job = folder.join("spiral.hwj").display().to_string();
    succeeded(&headway(&[
        "plan",
        path(&run),
        "-m",
        path(&machine),
        "-o",
        &job,
    ]));
    let simulated = object(&headway(&["simulate", &job, "--json"]));
    (job, numbers(&simulated["final_counts"]))
}

fn numbers(counts: &Value) -> Vec<i64> {
    let counts = counts.as_array().unwrap().iter();
    counts.map(|count| count.as_i64().unwrap()).collect()
}

/// A program that asks for this flow at each status.
pub fn with_flow(folder: &Path, flow: &str) -> String {
    let script = format!("while read -r line; do echo '{{\"flow\": {flow}}}'; done");
    std::fs::write(folder.join("flow.sh"), script).unwrap();
    format!("sh \"{}\"", path(&folder.join("flow.sh")))
}

/// A print beside a program.
struct Print {
    figures: Value,
    said: String,
    /// Overrides that the board was sent, with their times in seconds.
    overrides: Vec<(f64, u16)>,
    /// Extruder's steps, a share of the planned ones.
    laid: f64,
    took: Duration,
}

fn print(name: &str, script: &str) -> Print {
    let folder = folder(name);
    let (job, planned) = job(&folder, "");
    let program = folder.join("sensor.sh");
    std::fs::write(&program, script).unwrap();
    let log = folder.join("print.log").display().to_string();
    let board = Board::unix(&folder, 2.0);
    let sensor = format!("sh \"{}\"", path(&program));
    let begun = Instant::now();
    let host = Host::start(&[
        "stream",
        &job,
        "--port",
        &board.port,
        "--sensor",
        &sensor,
        "--log",
        &log,
        "--json",
    ]);
    let (well, figures, said) = host.end();
    let took = begun.elapsed();
    assert!(well, "{name}: {said}");
    let status = object(&headway(&[
        "board",
        "status",
        "--port",
        &board.port,
        "--json",
    ]));
    assert_eq!(status["flow_percent"], 100, "the next job has its own flow");
    let counts = board.end().counts;
    let extruder = planned.len() - 1;
    assert_eq!(counts[..extruder], planned[..extruder], "{name}");
    Print {
        figures,
        said,
        overrides: overrides(&log),
        laid: counts[extruder] as f64 / planned[extruder] as f64,
        took,
    }
}

/// Overrides in a log, by the wire.
fn overrides(log: &str) -> Vec<(f64, u16)> {
    let text = std::fs::read(log).unwrap();
    let mut decoder = FrameDecoder::new();
    let mut overrides = Vec::new();
    for entry in read_log(&mut &text[..]).unwrap().entries {
        let Entry::Bytes {
            at_us,
            way: Way::Down,
            bytes,
        } = entry
        else {
            continue;
        };
        for byte in bytes {
            let Some(Ok(frame)) = decoder.push(byte) else {
                continue;
            };
            if let Ok(HostMessage::Control(Control::FlowOverride(percent))) =
                HostMessage::decode(frame.payload)
            {
                overrides.push((at_us as f64 / 1e6, percent));
            }
        }
    }
    overrides
}

impl Print {
    /// Between the default bounds, and no faster than asked for: half a second's worth more for late rounds of the loop.
    fn is_within_bounds(&self) {
        let mut before = (0.0, 100);
        for &(at_s, percent) in &self.overrides {
            assert!((80..=120).contains(&percent), "{:?}", self.overrides);
            let most = 50.0 * (at_s - before.0 + 0.5) + 1.0;
            assert!(
                f64::from(percent.abs_diff(before.1)) <= most,
                "{:?}",
                self.overrides
            );
            before = (at_s, percent);
        }
        assert!((0.8..=1.2).contains(&self.laid), "{}", self.laid);
    }

    fn bad_lines(&self) -> u64 {
        self.figures["sensor"]["bad_lines"].as_u64().unwrap()
    }
}

#[test]
fn a_program_reads_the_print_and_sets_its_flow() {
    let heard = folder("heard").join("lines");
    let script = format!(
        "while read -r line; do echo \"$line\" >> '{}'; echo '{{\"t_s\": 1, \"flow\": 0.9}}'; done",
        path(&heard)
    );
    let print = print("sets", &script);
    print.is_within_bounds();
    // The first steps of the rate aside.
    assert!((0.88..0.96).contains(&print.laid), "{}", print.laid);
    assert_eq!(print.figures["sensor"]["correction"], 0.9);
    assert_eq!(print.overrides.last().unwrap().1, 90);
    let text = std::fs::read_to_string(heard).unwrap();
    let lines: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let (first, last) = (&lines[0], &lines[lines.len() - 1]);
    assert_eq!(
        (&first["headway"], &first["layers"]),
        (&Value::from(1), &Value::from(1))
    );
    assert_eq!(last["ended"], "done");
    let running = lines.iter().filter(|line| line["state"] == "running");
    let places: Vec<f64> = running.map(|line| line["done"].as_f64().unwrap()).collect();
    assert!(places.len() > 10 && places.is_sorted(), "{places:?}");
    let middle = &lines[lines.len() / 2];
    assert_eq!(middle["at_mm"].as_array().unwrap().len(), 3);
    assert!(
        (0.9..1.0).contains(&middle["flow_correction"].as_f64().unwrap())
            || middle["flow_correction"] == 0.9,
        "{middle}"
    );
    assert_eq!(middle["flow_percent"], 100);
}

#[test]
fn a_program_that_dies_or_is_silent_leaves_the_plans_flow() {
    for (name, script, words) in [
        (
            "dies",
            "echo '{\"flow\": 0.85}'; sleep 0.7; exit 3",
            "has ended",
        ),
        (
            "killed",
            "echo '{\"flow\": 0.85}'; sleep 0.7; kill -9 $$",
            "has ended",
        ),
        (
            "silent",
            "echo '{\"flow\": 0.85}'; exec sleep 1000",
            "prints no readings",
        ),
        (
            "deaf",
            "trap '' TERM HUP INT; exec 0<&-; echo '{\"flow\": 0.85}'; exec sleep 1000",
            "prints no readings",
        ),
    ] {
        let print = print(name, script);
        print.is_within_bounds();
        assert_eq!(
            print.said.matches(words).count(),
            1,
            "{name}: {}",
            print.said
        );
        let least = print.overrides.iter().map(|(_, percent)| *percent).min();
        assert!(
            least.is_some_and(|least| least < 95),
            "{name}: {:?}",
            print.overrides
        );
        // A tenth of it a second, for some seconds.
        let last = print.overrides.last().unwrap().1;
        assert!(last > 90, "{name}: {:?}", print.overrides);
        assert!(print.took < Duration::from_secs(60), "{name}");
    }
}

#[test]
fn a_program_that_floods_or_lies_moves_nothing_beyond_the_bounds() {
    for (name, script, is_bad) in [
        ("flood", "exec yes '{\"flow\": 1.19}'", false),
        ("lies", "exec yes '{\"flow\": 9.7}'", true),
        (
            "swings",
            "while :; do echo '{\"flow\": 0.1}'; sleep 0.3; echo '{\"flow\": 2}'; sleep 0.3; done",
            false,
        ),
        ("endless", "exec cat /dev/zero", true),
        ("no_text", "exec yes \"$(printf '\\377\\376{\\300')\"", true),
        ("no_json", "exec yes '{\"flow\": 1e999, [[[['", true),
        (
            "not_its_keys",
            "exec yes '{\"flow\": 1, \"speed\": 7}'",
            true,
        ),
    ] {
        let print = print(name, script);
        print.is_within_bounds();
        assert_eq!(print.bad_lines() > 0, is_bad, "{name}: {}", print.figures);
        if is_bad {
            assert_eq!(print.overrides, [], "{name}");
            assert_eq!(
                print.said.matches("what is no reading").count(),
                1,
                "{name}: {}",
                print.said
            );
        }
    }
}

#[test]
fn what_cannot_be_started_or_kept_to_is_refused_before_anything_moves() {
    let folder = folder("refused");
    let (job, _) = job(&folder, "");
    for (sensor, status, words) in [
        (
            "/no/such/program --fast",
            1,
            "/no/such/program --fast: there is no such file",
        ),
        (" ", 1, "there is no such file"),
    ] {
        // There is no board either: that is never looked for.
        let refused = headway(&[
            "stream",
            &job,
            "--port",
            "unix:/no/such/board",
            "--sensor",
            sensor,
        ]);
        assert_eq!(refused.status.code(), Some(status), "{}", stderr(&refused));
        assert!(stderr(&refused).contains(words), "{}", stderr(&refused));
    }
    let text = succeeded(&headway(&["machine", "new"]));
    for (keys, words) in [
        ("flow_range = [1.1, 1.2]", "measure.flow_range"),
        ("flow_range = [0.05, 1.2]", "0.1 to 1"),
        ("flow_range = [0.8, nan]", "measure.flow_range"),
        ("flow_change_per_s = 0", "measure.flow_change_per_s"),
        ("controller = \"pressure\"", "measure.pressure"),
        ("controller = \"fuzzy\"", "layer"),
        ("gain = 1", "unknown key"),
    ] {
        let machine = folder.join("wrong.toml");
        std::fs::write(&machine, format!("{text}\n[measure]\n{keys}\n")).unwrap();
        let refused = headway(&["machine", "check", path(&machine)]);
        assert!(!refused.status.success(), "{keys}");
        assert!(
            stderr(&refused).contains(words),
            "{keys}: {}",
            stderr(&refused)
        );
    }
}

/// Scans are files, measured beside the print: one that is a tenth too high lowers the flow, ones that are none are counted
/// and the first of them is told.
#[test]
fn scans_are_measured_beside_the_print() {
    let folder = folder("scans");
    let machine = folder.join("machine.toml");
    let text = succeeded(&headway(&["machine", "new"]));
    let keys =
        "\n[measure]\ncontroller = \"layer\"\nheight_noise_mm = 0.002\nflow_change_per_s = 0.5\n";
    std::fs::write(&machine, text + keys).unwrap();
    let job = folder.join("part.hwj").display().to_string();
    let (machine, log) = (path(&machine), folder.join("print.log"));
    let outline = folder.join("part.json");
    // Small, since it is measured while it prints, on a busy machine.
    let corners = "[0, 0], [12, 0], [12, 4], [5, 4], [5, 10], [0, 10]";
    std::fs::write(
        &outline,
        format!(r#"{{"units": "mm", "exterior": [{corners}]}}"#),
    )
    .unwrap();
    succeeded(&headway(&[
        "plan",
        path(&outline),
        "-m",
        machine,
        "--layers",
        "8",
        "--speed",
        "10",
        "-o",
        &job,
    ]));
    let file = headway::job::file::read(&mut std::fs::File::open(&job).unwrap()).unwrap();
    let as_asked = Truth::of(&Settings::default());
    let truth = Truth {
        flow: 1.1,
        ..as_asked
    };
    let offset_mm = file.header.transform.offset_mm;
    let points = scan(
        &file.stream().unwrap(),
        offset_mm,
        0,
        &truth,
        &Scanner::default(),
    );
    let layer = folder.join("l0.csv");
    std::fs::write(&layer, csv(&points)).unwrap();
    let program = folder.join("sensor.sh");
    let script = format!(
        "while read -r line; do case \"$line\" in *'\"layer\":1,'*) if [ -z \"$said\" ]; then said=1\n\
         for scan in /no/such/scan.csv {machine} '{}'; do\n\
         echo \"{{\\\"layer\\\":0,\\\"scan\\\":\\\"$scan\\\"}}\"; done; fi;; esac; done",
        path(&layer)
    );
    std::fs::write(&program, script).unwrap();
    let board = Board::unix(&folder, 2.0);
    let host = Host::start(&[
        "stream",
        &job,
        "--port",
        &board.port,
        "--sensor",
        &format!("sh \"{}\"", path(&program)),
        "--log",
        path(&log),
        "--json",
    ]);
    let (well, figures, said) = host.end();
    assert!(well, "{said}");
    board.end();
    assert_eq!(figures["sensor"]["readings"], 1, "{figures}");
    assert_eq!(figures["sensor"]["bad_lines"], 2, "{figures}");
    assert_eq!(said.matches("there is no such file").count(), 1, "{said}");
    assert!(!said.contains("machine.toml"), "{said}");
    // A tenth too much, of which each layer takes a third away: the first one most.
    let overrides = overrides(path(&log));
    let least = overrides.iter().map(|(_, percent)| *percent).min();
    assert!(
        least.is_some_and(|least| (88..98).contains(&least)),
        "{overrides:?}, {figures}"
    );
}

/// The operator's own override multiplies the correction; both are the terminal's to see.
#[test]
fn the_operators_override_multiplies_the_correction() {
    let folder = folder("operator");
    let (job, _) = job(&folder, "");
    let log = folder.join("print.log").display().to_string();
    let board = Board::unix(&folder, 1.0);
    let sensor = with_flow(&folder, "0.9");
    let mut host = Host::start(&[
        "stream",
        &job,
        "--port",
        &board.port,
        "--sensor",
        &sensor,
        "--log",
        &log,
    ]);
    let begun = Instant::now();
    while !overrides(&log_so_far(&log))
        .iter()
        .any(|(_, percent)| *percent == 90)
    {
        assert!(begun.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(50));
    }
    host.type_line("flow 80");
    let (well, _, said) = host.end();
    assert!(well, "{said}");
    assert_eq!(overrides(&log).last().unwrap().1, 72);
    let status = object(&headway(&[
        "board",
        "status",
        "--port",
        &board.port,
        "--json",
    ]));
    assert_eq!(status["flow_percent"], 80);
    board.end();
}

/// A copy of a log without the line that is being written.
fn log_so_far(log: &str) -> String {
    let text = std::fs::read_to_string(log).unwrap_or_default();
    let whole = text
        .rfind('\n')
        .map_or("# headway link log 1\n", |end| &text[..=end]);
    let copy = format!("{log}.copy");
    std::fs::write(&copy, whole).unwrap();
    copy
}
