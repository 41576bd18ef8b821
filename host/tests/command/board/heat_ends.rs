//! Goal: heat ends with whatever began it, and a stop is heard from the first byte to the last. Method: the command
//! itself, on boards with modelled heaters behind real sockets; it is broken off by signals, by its page, by its
//! stdin, by what cannot be done. The board would switch off by itself after 30 s of silence, and says so by a fault:
//! targets of 0 without one were ordered.
#![cfg(unix)]

use crate::rig::board::{Board, Host};
use crate::rig::{folder, headway, object, path, stderr};
use headway::drive::transport::Port;
use headway::settings::Settings;
use headway_firmware::configuration::heat::HeatConfiguration;
use serde_json::{Map, Value};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

/// Longest that anything may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);
/// Twice as fast as real: silence is noticed after 15 s, long after every check here.
const SPEED: f64 = 2.0;

/// A small job of the built-in machine.
fn job(folder: &Path) -> String {
    let part = folder.join("square.json");
    let square = r#"{"units":"mm","exterior":[[0,0],[8,0],[8,8],[0,8]]}"#;
    std::fs::write(&part, square).unwrap();
    let job = folder.join("square.hwj").display().to_string();
    let planned = headway(&["plan", path(&part), "-o", &job]);
    assert!(planned.status.success(), "{}", stderr(&planned));
    job
}

/// Its jobs heat little, so that heating is short: melt may move cold.
fn board_with(folder: &Path, mut heat: HeatConfiguration) -> Board {
    for heater in &mut heat.heaters {
        heater.extrude_min_c = 0.0;
    }
    let port = Port::Unix(folder.join("board"));
    Board::of_machine(&port, SPEED, Settings::default().machine, heat)
}

fn board(folder: &Path) -> Board {
    board_with(folder, HeatConfiguration::standard())
}

fn status(board: &Board) -> Map<String, Value> {
    let asked = ["board", "status", "--port", &board.port, "--json"];
    object(&headway(&asked))
}

fn targets(status: &Map<String, Value>) -> Vec<f64> {
    let heaters = status["heaters"].as_array().unwrap();
    let target = |heater: &Value| heater["target_celsius"].as_f64().unwrap();
    heaters.iter().map(target).collect()
}

fn wait_until(board: &Board, what: &str, there: impl Fn(&Map<String, Value>) -> bool) {
    let begun = Instant::now();
    loop {
        let status = status(board);
        if there(&status) {
            return;
        }
        assert!(begun.elapsed() < PATIENCE, "never {what}: {status:?}");
    }
}

/// Off by order: the board takes one over once in 0.1 s.
fn assert_ordered_off(board: &Board, what: &str) {
    wait_until(board, &format!("off after {what}"), |status| {
        let fault = status["fault"].as_str().unwrap_or_default();
        assert!(!fault.contains("no host was heard"), "{what}: {fault}");
        targets(status).iter().all(|target| *target == 0.0)
    });
}

/// Posts an order to the page of a host.
fn post(host: &Host, order: &str) {
    host.wait_for("page: http://");
    let said = host.said.lock().unwrap().clone();
    let url = said.split("page: http://").nth(1).unwrap();
    let url = url.split_whitespace().next().unwrap();
    let (address, token) = url.split_once('/').unwrap();
    let mut line = TcpStream::connect(address).unwrap();
    let length = order.len();
    write!(
        line,
        "POST /{token}order HTTP/1.1\r\nHost: {address}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{order}"
    )
    .unwrap();
    let mut answer = String::new();
    line.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 202"), "{answer}");
}

#[test]
fn what_cannot_begin_leaves_nothing_hot() {
    let folder = folder("begin");
    let job = job(&folder);
    // A log that is a folder; a bed that is not there, after a hot end that is.
    let mut hot_end_alone = HeatConfiguration::standard();
    hot_end_alone.heaters.truncate(1);
    let log = path(&folder).to_string();
    let cases = [
        (HeatConfiguration::standard(), vec!["--log", &log]),
        (hot_end_alone, vec!["--bed", "60"]),
    ];
    for (heat, more) in cases {
        let board = board_with(&folder, heat);
        let stream = ["stream", &job, "--port", &board.port, "--hot-end", "200"];
        let failed = headway(&[&stream[..], &more[..]].concat());
        assert_eq!(failed.status.code(), Some(1), "{}", stderr(&failed));
        assert_ordered_off(&board, &format!("{more:?}"));
        board.end();
    }
}

#[test]
fn a_stream_that_a_signal_ends_leaves_nothing_hot() {
    let folder = folder("signals");
    let job = job(&folder);
    for name in ["-TERM", "-HUP", "-INT"] {
        let board = board(&folder);
        let host = Host::start(&["stream", &job, "--port", &board.port, "--hot-end", "200"]);
        wait_until(&board, "heating", |status| status["state"] == "heating");
        let times = if name == "-INT" { 3 } else { 1 };
        for time in 1..=times {
            host.signal(name);
            if time < times {
                host.wait_for(["pausing on the path", "aborting on the path"][time - 1]);
            }
        }
        let (well, _, said) = host.end();
        assert!(!well, "{name}: {said}");
        assert_ordered_off(&board, name);
        board.end();
    }
}

/// Goal: a stream that is ended while it heats prints nothing, least of all cold, and nobody is told to go on with it.
/// Method: a board whose melt may move cold, which would print on once its heaters are off; then the same job anew.
#[test]
fn a_stream_that_is_ended_while_it_heats_prints_nothing() {
    let folder = folder("heating");
    let job = job(&folder);
    let board = board(&folder);
    let host = Host::start(&["stream", &job, "--port", &board.port, "--hot-end", "200"]);
    wait_until(&board, "heating", |status| status["state"] == "heating");
    let before = status(&board)["counts"].clone();
    host.signal("-TERM");
    let (well, _, said) = host.end();
    assert!(!well && said.contains("start it again"), "{said}");
    assert!(!said.contains("--resume"), "{said}");
    assert_ordered_off(&board, "the signal");
    let after = status(&board);
    assert_eq!(after["state"], "idle", "{after:?}");
    assert_eq!(after["counts"], before, "{after:?}");
    let again = headway(&["stream", &job, "--port", &board.port, "--hot-end", "30"]);
    assert!(again.status.success(), "{}", stderr(&again));
    board.end();
}

#[test]
fn heating_and_tuning_by_hand_that_a_signal_ends_leave_nothing_hot() {
    let folder = folder("hand");
    for (command, name) in [("heat", "-INT"), ("tune", "-TERM")] {
        let board = board(&folder);
        let host = Host::start(&["board", command, "hot-end", "200", "--port", &board.port]);
        wait_until(&board, "heating", |status| targets(status)[0] >= 200.0);
        host.signal(name);
        let (well, _, said) = host.end();
        assert!(
            !well && said.contains("off again"),
            "{command} {name}: {said}"
        );
        assert_ordered_off(&board, &format!("{command} {name}"));
        board.end();
    }
    // What succeeds hands over.
    let board = board(&folder);
    let done = headway(&["board", "heat", "hot-end", "27", "--port", &board.port]);
    assert!(done.status.success(), "{}", stderr(&done));
    assert_eq!(targets(&status(&board))[0], 27.0);
    board.end();
}

/// How somebody ends what has begun.
fn break_off(host: &mut Host, how: &str) {
    match how {
        "page" => post(host, "stop"),
        "stdin" => host.type_line("stop"),
        _ => host.signal(how),
    }
}

#[test]
fn a_stop_is_heard_while_a_resumed_job_heats_and_goes_to_its_start() {
    let folder = folder("resume");
    let job = job(&folder);
    for (phase, temperature, how) in [
        ("heating before anything moves", "200", "page"),
        ("heating before anything moves", "200", "stdin"),
        ("heating before anything moves", "200", "-INT"),
        ("up, across, and down", "0", "page"),
        ("up, across, and down", "0", "-INT"),
    ] {
        let board = board(&folder);
        // Far from where the job begins.
        for (joint, at) in [("x", "20"), ("y", "20"), ("z", "40"), ("c", "0")] {
            let set = ["board", "set-joint", joint, at, "--port", &board.port];
            assert!(headway(&set).status.success());
        }
        let mut host = Host::start(&[
            "stream",
            &job,
            "--port",
            &board.port,
            "--resume-from",
            "pass:0",
            "--part-clear",
            "--hot-end",
            temperature,
            "--view",
            "--no-open",
        ]);
        host.wait_for(phase);
        let asked = Instant::now();
        break_off(&mut host, how);
        let (well, _, said) = host.end();
        let words = if how.starts_with('-') {
            "ended before"
        } else {
            "stopped"
        };
        assert!(!well && said.contains(words), "{phase}, {how}: {said}");
        // Not once heating and moves are over: a hot end takes a minute.
        assert!(asked.elapsed() < PATIENCE / 4, "{phase}, {how}");
        assert_ordered_off(&board, how);
        let status = status(&board);
        let state = if how.starts_with('-') {
            "idle"
        } else {
            "faulted"
        };
        assert_eq!(status["state"], state, "{phase}, {how}: {status:?}");
        board.end();
    }
}

#[test]
fn a_pause_that_keeps_heat_says_so_and_ends() {
    let folder = folder("pause");
    let job = job(&folder);
    let board = board(&folder);
    let mut host = Host::start(&[
        "stream",
        &job,
        "--port",
        &board.port,
        "--hot-end",
        "30",
        "--pause-heat-max-min",
        "0.01",
        "--json",
    ]);
    wait_until(&board, "running", |status| status["state"] == "running");
    host.type_line("pause");
    host.wait_for("the pause keeps hot-end (30 °C) hot");
    host.wait_for("the heaters are off, the pause stays");
    assert_ordered_off(&board, "the pause");
    assert_eq!(status(&board)["state"], "paused");
    host.type_line("resume");
    wait_until(&board, "heating again", |status| targets(status)[0] == 30.0);
    let (well, figures, said) = host.end();
    assert!(well && figures["done"] == true, "{said}");
    assert_ordered_off(&board, "the end");
    board.end();
}

/// Goal: a stream's end leaves nothing hot, whoever switched it on, unless it is asked to. Method: a bed that was
/// heated by hand before the print; the board's own rule is 15 s away.
#[test]
fn a_finished_stream_leaves_nothing_hot_unless_asked() {
    let folder = folder("end");
    let job = job(&folder);
    for leave_hot in [false, true] {
        let board = board(&folder);
        let by_hand = [
            "board",
            "heat",
            "bed",
            "40",
            "--no-wait",
            "--port",
            &board.port,
        ];
        assert!(headway(&by_hand).status.success());
        let stream = [
            "stream",
            &job,
            "--port",
            &board.port,
            "--hot-end",
            "30",
            "--json",
        ];
        let hot = leave_hot.then_some("--leave-hot");
        let streamed = headway(&stream.into_iter().chain(hot).collect::<Vec<_>>());
        assert_eq!(object(&streamed)["done"], true);
        let status = status(&board);
        let fault = status["fault"].as_str().unwrap_or_default();
        assert_eq!(fault, "", "{status:?}");
        if leave_hot {
            assert_eq!(targets(&status)[..2], [30.0, 40.0], "{status:?}");
        } else {
            assert_ordered_off(&board, "the end");
        }
        board.end();
    }
}
