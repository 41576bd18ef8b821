//! Goal: a board does what it is told by hand, and the command can be one. Method: the command
//! itself, talking to the firmware library behind real sockets, in accelerated time.
#![cfg(unix)]

use crate::rig::board::{Board, Host, job};
use crate::rig::{folder, headway, object, stderr};
use headway::settings::Settings;

#[test]
fn a_board_is_asked_homed_and_jogged() {
    let folder = folder("board");
    let board = Board::unix(&folder, 50.0);
    let port = board.port.as_str();
    let info = object(&headway(&["board", "info", "--port", port, "--json"]));
    assert_eq!(info["servo_hz"], 2000);
    let homed = headway(&["board", "home", "--port", port]);
    assert!(homed.status.success(), "{}", stderr(&homed));
    let status = object(&headway(&["board", "status", "--port", port, "--json"]));
    assert_eq!(status["state"], "idle");
    let known: Vec<u64> = serde_json::from_value(status["referenced"].clone()).unwrap();
    assert!(
        [0, 1, 2].iter().all(|joint| known.contains(joint)),
        "{status:?}"
    );
    let jogged = headway(&["board", "jog", "x", "12.5", "--port", port]);
    assert!(jogged.status.success(), "{}", stderr(&jogged));
    let after = object(&headway(&["board", "status", "--port", port, "--json"]));
    let moved = after["counts"][0].as_i64().unwrap() - status["counts"][0].as_i64().unwrap();
    assert_eq!(moved, 1000, "12.5 mm at 80 steps a mm");
    // Melt by hand: 2 mm³ there, half of it back.
    let extruder = status["counts"].as_array().unwrap().len() - 1;
    for (volume, net_mm3) in [("2", 2.0), ("-1", 1.0)] {
        let pushed = headway(&["board", "extrude", volume, "--port", port]);
        assert!(pushed.status.success(), "{}", stderr(&pushed));
        let status = object(&headway(&["board", "status", "--port", port, "--json"]));
        let steps = Settings::default().machine.extruder.steps_per_mm3 * net_mm3;
        let difference = status["counts"][extruder].as_f64().unwrap() - steps;
        assert!(difference.abs() <= 1.0, "{status:?}");
    }
    // A homed machine is brought to a job's first pose, or the job is refused.
    let (job, _) = job(&folder, 1);
    let refused = headway(&["stream", &job, "--port", port]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        stderr(&refused).contains("board go"),
        "{}",
        stderr(&refused)
    );
    let gone = headway(&["board", "go", &job, "--port", port]);
    assert!(gone.status.success(), "{}", stderr(&gone));
    assert_eq!(
        object(&headway(&["stream", &job, "--port", port, "--json"]))["done"],
        true
    );
    for (arguments, code) in [
        (vec!["board", "override", "80"], 0),
        (vec!["board", "jog", "x", "-1000"], 1),
        (vec!["board", "stop"], 0),
        (vec!["board", "jog", "x", "1"], 1),
        (vec!["board", "reset"], 0),
        (vec!["board", "jog", "w", "1"], 2),
        (vec!["board", "extrude", "1", "--speed", "1000"], 2),
        (vec!["board", "extrude", "0"], 2),
        (vec!["board", "override", "500"], 2),
    ] {
        let said = headway(&[arguments.as_slice(), &["--port", port]].concat());
        assert_eq!(
            said.status.code(),
            Some(code),
            "{arguments:?}: {}",
            stderr(&said)
        );
    }
    // What a stop has lost is declared, where there is no switch to home to.
    for (joint, position) in [("x", "10"), ("y", "-2.5"), ("z", "1"), ("c", "90")] {
        let set = headway(&["board", "set-joint", joint, position, "--port", port]);
        assert!(set.status.success(), "{}", stderr(&set));
    }
    let status = object(&headway(&["board", "status", "--port", port, "--json"]));
    assert_eq!(status["counts"][0], 800);
    assert_eq!(status["counts"][1], -200);
    assert_eq!(status["counts"][3], 2400, "a quarter of 9600 steps");
    let known: Vec<u64> = serde_json::from_value(status["referenced"].clone()).unwrap();
    assert_eq!(known, [0, 1, 2, 3]);
    for (joint, position, code) in [("w", "1", 2), ("x", "1e9", 2), ("x", "1000", 1)] {
        let refused = headway(&["board", "set-joint", joint, position, "--port", port]);
        assert_eq!(refused.status.code(), Some(code), "{joint} {position}");
    }
    board.end();
    let gone = headway(&["board", "info", "--port", "unix:/nonexistent/board"]);
    assert_eq!(gone.status.code(), Some(1));
}

#[test]
fn the_command_can_be_a_board_itself() {
    let folder = folder("simulate");
    let (job, _) = job(&folder, 1);
    let board = Host::start(&[
        "board",
        "simulate",
        "--listen",
        "tcp:127.0.0.1:0",
        "--speed",
        "10",
    ]);
    board.wait_for("listens on ");
    let said = board.said.lock().unwrap().clone();
    let port = said
        .split("listens on ")
        .nth(1)
        .unwrap()
        .split(';')
        .next()
        .unwrap()
        .to_string();
    assert_eq!(
        object(&headway(&["stream", &job, "--port", &port, "--json"]))["done"],
        true
    );
    board.interrupt();
    let (well, _, said) = board.end();
    assert!(well && said.contains("1 hosts"), "{said}");
}

/// A board in a process of its own whose flash is this file, and its port.
fn board_with_flash(flash: &str) -> (Host, String) {
    let listen = ["board", "simulate", "--listen", "tcp:127.0.0.1:0"];
    let board = Host::start(&[&listen[..], &["--speed", "10", "--settings", flash]].concat());
    board.wait_for("listens on ");
    let said = board.said.lock().unwrap().clone();
    let port = said.split("listens on ").nth(1).unwrap();
    let port = port.split(';').next().unwrap().to_string();
    (board, port)
}

#[test]
fn a_board_keeps_the_machine_that_it_is_configured_for() {
    let folder = folder("configure");
    let (planar_job, _) = job(&folder, 1);
    let place = |name: &str| folder.join(name).display().to_string();
    let (gantry, gantry_job, flash) = (place("g.toml"), place("g.hwj"), place("flash"));
    let run = place("spiral.wpt");
    for arguments in [
        &["machine", "new", "--kind", "gantry", "-o", &gantry][..],
        &["plan", &run, "-m", &gantry, "-o", &gantry_job],
    ] {
        let done = headway(arguments);
        assert!(done.status.success(), "{}", stderr(&done));
    }
    let inspected = object(&headway(&["inspect", &gantry_job, "--json"]));
    let hash = |port: &str| {
        let info = object(&headway(&["board", "info", "--port", port, "--json"]));
        info["machine_hash"].clone()
    };
    let (board, port) = board_with_flash(&flash);
    let before = hash(&port);
    assert_ne!(before, inspected["machine_hash"]);
    let refused = headway(&["stream", &gantry_job, "--port", &port]);
    assert_eq!(refused.status.code(), Some(1));
    let done = headway(&["board", "configure", &gantry, "--port", &port]);
    assert!(done.status.success(), "{}", stderr(&done));
    assert_eq!(hash(&port), before, "in force from the next start");
    let refused = stderr(&headway(&["stream", &gantry_job, "--port", &port]));
    assert!(refused.contains("switch it off and on"), "{refused}");
    board.interrupt();
    board.end();

    let (board, port) = board_with_flash(&flash);
    assert_eq!(hash(&port), inspected["machine_hash"]);
    let refused = headway(&["stream", &planar_job, "--port", &port]);
    assert_eq!(refused.status.code(), Some(1));
    let printed = headway(&["stream", &gantry_job, "--port", &port, "--json"]);
    assert_eq!(object(&printed)["done"], true);
    board.interrupt();
    board.end();

    // A board without a store says so.
    let board = Board::unix(&folder, 50.0);
    let refused = headway(&["board", "configure", &gantry, "--port", &board.port]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("nowhere to keep settings"));
    // And a file that is no flash is left alone.
    let listen = ["board", "simulate", "--listen", "tcp:127.0.0.1:0"];
    let refused = headway(&[&listen[..], &["--settings", &gantry]].concat());
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        std::fs::read_to_string(&gantry)
            .unwrap()
            .contains("[extruder]")
    );
}

#[test]
fn a_stop_is_heard_while_another_host_streams_and_a_jog_is_refused_at_once() {
    let folder = folder("second");
    let (job, _) = job(&folder, 8);
    let board = Board::unix(&folder, 1.0);
    let port = board.port.clone();
    let streaming = Host::start(&["stream", &job, "--port", &port, "--json"]);
    let mut state = String::new();
    for _ in 0..400 {
        let status = object(&headway(&["board", "status", "--port", &port, "--json"]));
        state = status["state"].as_str().unwrap().to_string();
        if state == "running" {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    assert_eq!(state, "running");
    let begun = std::time::Instant::now();
    let jogged = headway(&["board", "jog", "x", "1", "--port", &port]);
    assert_eq!(jogged.status.code(), Some(1));
    assert!(stderr(&jogged).contains("refuses"), "{}", stderr(&jogged));
    let paused = headway(&["board", "pause", "--port", &port]);
    assert!(paused.status.success(), "{}", stderr(&paused));
    let stopped = headway(&["board", "stop", "--port", &port]);
    assert!(stopped.status.success(), "{}", stderr(&stopped));
    // Long before the job's end.
    assert!(begun.elapsed().as_secs() < 20);
    let (done, _, said) = streaming.end();
    assert!(!done);
    assert!(said.contains("emergency stop"), "{said}");
    // Nothing that was refused runs later.
    let before = object(&headway(&["board", "status", "--port", &port, "--json"]));
    std::thread::sleep(std::time::Duration::from_millis(300));
    let after = object(&headway(&["board", "status", "--port", &port, "--json"]));
    assert_eq!(before["counts"], after["counts"]);
    assert_eq!(after["state"], "faulted");
    board.end();
}

/// Goal: a stream that is begun while somebody asks for the status is no second host for good: it was
/// refused as one. Method: a line that is open when the stream comes, and goes without a word.
#[test]
fn a_stream_begun_while_another_host_only_asks_is_taken() {
    let folder = folder("asked");
    let (job, _) = job(&folder, 1);
    let board = Board::unix(&folder, 20.0);
    let path = board.port.strip_prefix("unix:").unwrap();
    let asking = std::os::unix::net::UnixStream::connect(path).unwrap();
    let streaming = Host::start(&["stream", &job, "--port", &board.port, "--json"]);
    std::thread::sleep(std::time::Duration::from_millis(150));
    drop(asking);
    let (done, _, said) = streaming.end();
    assert!(done, "{said}");
    assert_eq!(board.end().hosts, 2);
}

#[test]
fn a_client_made_of_the_wire_page_alone_talks_to_a_board() {
    let folder = folder("wire");
    let board = Board::unix(&folder, 2.0);
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let client = std::process::Command::new("python3")
        .arg(format!("{root}/tests/wire_client.py"))
        .arg(format!("{root}/protocol/WIRE.md"))
        .arg(board.port.strip_prefix("unix:").unwrap())
        .output();
    let Ok(output) = client else {
        assert!(std::env::var_os("CI").is_none(), "CI needs python3");
        println!("skipped: no python3");
        return;
    };
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", stderr(&output));
    for words in [
        "golden frames",
        "refused",
        "moved 5 mm",
        "second line stops",
    ] {
        assert!(said.contains(words), "{said}");
    }
    board.end();
}
