//! Goal: a job gets to a board whatever happens on the way. Method: the command itself, streaming
//! to the firmware library behind real sockets, in accelerated time; connections are cut, hosts
//! killed, Ctrl-C pressed; in the end the motors must stand where the simulation has them.
#![cfg(unix)]

use crate::rig::board::{Board, Host, counts, job, sleep_into_the_job};
use crate::rig::{folder, headway, object, path, stderr, stdout};
use headway::drive::link_log::{Entry, Way, read_log};
use headway::drive::transport::Port;
use headway::job::file;
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_protocol::frame::FrameDecoder;
use headway_protocol::message::{DeviceMessage, DeviceState, Status};
use serde_json::Value;
use serialport::{SerialPort, TTYPort};
use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Streams a job, with a log that replaces that of another stream.
fn logged<'a>(job: &'a str, port: &'a str, log: &'a str) -> [&'a str; 7] {
    ["stream", job, "--port", port, "--log", log, "--force"]
}

#[test]
fn a_job_streams_over_unix_socket_and_tcp_to_the_simulations_end() {
    let folder = folder("both");
    let (job, expected) = job(&folder, 3);
    for board in [Board::unix(&folder, 10.0), Board::tcp(10.0)] {
        let log = folder.join("print.log").display().to_string();
        let streamed = headway(&[&logged(&job, &board.port, &log)[..], &["--json"]].concat());
        let figures = object(&streamed);
        assert_eq!(figures["done"], true);
        assert_eq!(figures["reconnects"], 0);
        let board = board.end();
        assert_eq!(counts(&board), expected);
        // The log is the print once more, the same each time.
        let replays = [0, 1].map(|_| object(&headway(&["board", "replay", &log, "--json"])));
        assert_eq!(replays[0], replays[1]);
        assert_eq!(replays[0]["final_counts"], expected);
        assert_eq!(replays[0]["state"], "finished");
        assert_eq!(replays[0]["damaged_frames"], 0);
    }
}

/// A serial port that leads to a board, through a pseudo-terminal.
struct SerialLine {
    /// What a host opens. Held open, so that the line stays when a host hangs up.
    terminal: TTYPort,
    cut: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl SerialLine {
    fn to(board: &Board) -> SerialLine {
        let (mut line, terminal) = TTYPort::pair().unwrap();
        line.set_timeout(Duration::from_millis(1)).unwrap();
        let mut socket = board.port.parse::<Port>().unwrap().open(0).unwrap();
        let cut = Arc::new(AtomicBool::new(false));
        let is_cut = cut.clone();
        let thread = std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while !is_cut.load(Ordering::Relaxed) {
                match line.read(&mut bytes) {
                    Ok(count) => socket.send(&bytes[..count]).unwrap(),
                    Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::TimedOut),
                }
                let count = socket.receive(&mut bytes).unwrap();
                let mut rest = &bytes[..count];
                while !rest.is_empty() {
                    match line.write(rest) {
                        Ok(count) => rest = &rest[count..],
                        // Nobody reads: a host that has hung up.
                        Err(_) => break,
                    }
                }
            }
        });
        SerialLine {
            terminal,
            cut,
            thread: Some(thread),
        }
    }

    fn end(mut self) {
        self.cut.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

#[test]
fn a_job_streams_over_a_serial_port_with_the_simulations_very_steps() {
    let folder = folder("serial");
    let (job, _) = job(&folder, 3);
    let simulated = object(&headway(&["simulate", &job, "--json"]));
    let mut digests = Vec::new();
    // On a machine that is too busy the queue may run dry, which moves steps in time.
    for _ in 0..3 {
        let board = Board::unix(&folder, 2.0);
        let line = SerialLine::to(&board);
        let port = line.terminal.name().unwrap();
        let status = object(&headway(&["board", "status", "--port", &port, "--json"]));
        assert_eq!(status["state"], "idle", "{status:?}");
        let streamed = object(&headway(&["stream", &job, "--port", &port, "--json"]));
        assert_eq!(streamed["done"], true);
        assert_eq!(streamed["reconnects"], 0);
        line.end();
        let board = board.end();
        assert_eq!(counts(&board), simulated["final_counts"]);
        assert_eq!(Value::from(board.steps), simulated["steps"]);
        if board.underruns == 0 {
            digests.push(board.step_digest);
            break;
        }
    }
    assert_eq!(digests.len(), 1, "the queue ran dry each time");
    assert_eq!(simulated["step_digest"], digests[0].as_str());
}

#[test]
fn a_homed_machine_goes_to_the_job_before_it_prints_it() {
    let folder = folder("go");
    let (job, expected) = job(&folder, 1);
    let board = Board::unix(&folder, 20.0);
    let port = ["--port", &board.port];
    let ask = |arguments: &[&str]| headway(&[arguments, &port].concat());
    let homed = ask(&["board", "home"]);
    assert!(homed.status.success(), "{}", stderr(&homed));
    assert!(stdout(&homed).contains("known joints [0, 1, 2]"));
    // It stands at its switches: the job begins elsewhere.
    let refused = ask(&["stream", &job]);
    assert!(!refused.status.success());
    let told = stderr(&refused);
    assert!(told.contains("not where the job begins"), "{told}");
    assert!(!told.contains("refused"), "told once: {told}");
    let gone = ask(&["board", "go", &job]);
    assert!(gone.status.success(), "{}", stderr(&gone));
    assert_eq!(object(&ask(&["stream", &job, "--json"]))["done"], true);
    assert_eq!(counts(&board.end()), expected);
}

#[test]
fn a_pulled_cable_is_waited_for() {
    let folder = folder("pull");
    let (job, expected) = job(&folder, 5);
    let board = Board::tcp(2.0);
    let host = Host::start(&["stream", &job, "--port", &board.port, "--json"]);
    for _ in 0..3 {
        sleep_into_the_job();
        board.pull.store(true, Ordering::Relaxed);
    }
    host.wait_for("the line is back");
    let (well, figures, said) = host.end();
    assert!(well, "{said}");
    assert!(figures["reconnects"].as_u64().unwrap() >= 1, "{figures}");
    let board = board.end();
    assert_eq!(counts(&board), expected);
    assert!(board.hosts >= 2);
}

#[test]
fn a_killed_host_is_followed_by_one_that_resumes() {
    let folder = folder("resume");
    let (job, expected) = job(&folder, 5);
    let board = Board::unix(&folder, 2.0);
    let mut host = Host::start(&["stream", &job, "--port", &board.port]);
    sleep_into_the_job();
    host.child.kill().unwrap();
    host.child.wait().unwrap();
    // Without --resume it would be a second print on top of the first: refused.
    let again = headway(&["stream", &job, "--port", &board.port]);
    assert_eq!(again.status.code(), Some(1), "{}", stderr(&again));
    assert!(stderr(&again).contains("--resume"), "{}", stderr(&again));
    let resumed = headway(&["stream", &job, "--port", &board.port, "--resume", "--json"]);
    assert_eq!(object(&resumed)["done"], true);
    assert_eq!(counts(&board.end()), expected);
    // A board that knows nothing of it has nothing to resume.
    let fresh = Board::unix(&folder, 2.0);
    let refused = headway(&["stream", &job, "--port", &fresh.port, "--resume"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        stderr(&refused).contains("without --resume"),
        "{}",
        stderr(&refused)
    );
}

#[test]
fn ctrl_c_pauses_on_the_path_and_a_second_one_aborts() {
    let folder = folder("pause");
    let (job, expected) = job(&folder, 5);
    let board = Board::unix(&folder, 2.0);
    let mut host = Host::start(&["stream", &job, "--port", &board.port, "--json"]);
    sleep_into_the_job();
    host.interrupt();
    host.wait_for("pausing;");
    std::thread::sleep(Duration::from_millis(500));
    host.type_line("override 150");
    host.type_line("resume");
    let (well, _, said) = host.end();
    assert!(well, "{said}");
    assert_eq!(counts(&board.end()), expected);

    let board = Board::unix(&folder, 2.0);
    let host = Host::start(&["stream", &job, "--port", &board.port, "--json"]);
    sleep_into_the_job();
    host.interrupt();
    host.wait_for("pausing;");
    host.interrupt();
    let (well, figures, said) = host.end();
    assert!(!well && said.contains("aborted"), "{said}");
    assert_eq!(figures["done"], false);
    let status = object(&headway(&[
        "board",
        "status",
        "--port",
        &board.port,
        "--json",
    ]));
    assert_eq!(status["state"], "idle");
    assert_eq!(status["fault"], Value::Null);
    assert_ne!(counts(&board.end()), expected);
}

/// What the board said of itself in a log.
fn statuses(log: &str) -> Vec<Status> {
    let text = std::fs::read_to_string(log).unwrap();
    let log = read_log(&mut text.as_bytes()).unwrap();
    let mut decoder = FrameDecoder::new();
    let heard = log.entries.iter().filter_map(|entry| match entry {
        Entry::Bytes {
            way: Way::Up,
            bytes,
            ..
        } => Some(bytes),
        _ => None,
    });
    let mut statuses = Vec::new();
    for &byte in heard.flatten() {
        if let Some(Ok(frame)) = decoder.push(byte)
            && let DeviceMessage::Status(status) = DeviceMessage::decode(frame.payload).unwrap()
        {
            statuses.push(status);
        }
    }
    statuses
}

/// Goal: the board tells its status as often as it was asked to. Method: the same job twice; statuses
/// in the logs, a hundred and then twenty milliseconds of the board's time apart.
#[test]
fn a_status_comes_as_often_as_asked_for() {
    let folder = folder("period");
    let (job, _) = job(&folder, 1);
    let count = |period: &[&str]| {
        let board = Board::unix(&folder, 4.0);
        let log = folder.join("print.log").display().to_string();
        let streamed = headway(&[&logged(&job, &board.port, &log)[..], period].concat());
        assert!(streamed.status.success(), "{}", stderr(&streamed));
        board.end();
        statuses(&log).len()
    };
    let (seldom, often) = (count(&[]), count(&["--status-period-ms", "20"]));
    assert!(seldom > 5 && often > 3 * seldom, "{seldom} {often}");
    let refused = headway(&["stream", &job, "--port", "x", "--status-period-ms", "19"]);
    assert_eq!(refused.status.code(), Some(2));
}

/// Spans of the board within which an order may come late: those of a status period and of the way to the board and
/// back, at five times the speed on a busy machine.
const SPANS_LATE: u32 = 60;

/// Spans before each layer's first tick.
fn spans_before_layers(job: &str) -> Vec<u32> {
    let file = std::fs::read(job).unwrap();
    let stream = file::read(&mut std::io::Cursor::new(file))
        .unwrap()
        .stream()
        .unwrap();
    let ends: Vec<u64> = stream
        .spans()
        .map(|span| span.start_tick + u64::from(span.duration_ticks))
        .collect();
    let before = |layer| {
        let [begin, _] = stream.ticks_of_layer(layer);
        ends.iter().filter(|&&end| end < begin).count() as u32
    };
    (0..stream.layers()).map(before).collect()
}

/// Heaters of a job that is printed at 35 to 40 °C: a test does not wait for more.
fn cool_heaters() -> HeatConfiguration {
    let mut heat = HeatConfiguration::standard();
    heat.heaters[0].extrude_min_c = 30.0;
    heat
}

/// A job of some layers with heat that is soon there and a fan, and its machine.
fn heated_job(folder: &Path, layers: u32) -> (String, MachineConfiguration) {
    let machine = folder.join("machine.toml");
    let text = stdout(&headway(&["machine", "new", "--kind", "planar"]));
    let material = "\n[material]\nhot_end_c = 35\nfirst_layer_hot_end_c = 40\nfan_pct = 50\n\
        fan_from_layer = 2\n";
    let text = text + material;
    std::fs::write(&machine, &text).unwrap();
    let part = folder.join("square.json");
    let square = r#"{"units":"mm","exterior":[[0,0],[8,0],[8,8],[0,8]]}"#;
    std::fs::write(&part, square).unwrap();
    let [machine, part, job] =
        [machine, part, folder.join("square.hwj")].map(|place| place.display().to_string());
    let layers = layers.to_string();
    let planned = headway(&[
        "plan", &part, "-m", &machine, "--layers", &layers, "-o", &job,
    ]);
    assert!(planned.status.success(), "{}", stderr(&planned));
    let settings = headway::settings::machine_file::from_toml(&text);
    (job, settings.unwrap().machine)
}

/// Goal: temperatures and fan change where the job says, on a board that holds heaters: it waits for the first
/// layer's at rest, the fan comes with the second layer, all is off in the end. Method: a job of three layers with
/// a material, streamed to heaters of a model; the board's own statuses in the log against the spans at which its
/// layers begin.
#[test]
fn heaters_and_fan_follow_the_path() {
    let folder = folder("heat");
    let (job, machine) = heated_job(&folder, 3);
    let board = Board::of_machine(
        &Port::Unix(folder.join("board")),
        5.0,
        machine,
        cool_heaters(),
    );
    let log = folder.join("print.log").display().to_string();
    let ran = headway(&[
        "stream",
        &job,
        "--port",
        &board.port,
        "--log",
        &log,
        "--json",
    ]);
    let figures = object(&ran);
    assert_eq!(figures["done"], true, "{}", stderr(&ran));
    // The board's heat loop takes an order over once in 0.1 s.
    let off = |status: &serde_json::Map<String, Value>| {
        let targets = [0, 1].map(|heater| status["heaters"][heater]["target_celsius"].clone());
        targets == [Value::from(0.0), Value::from(0.0)] && status["fan"] == 0.0
    };
    let ask = || {
        object(&headway(&[
            "board",
            "status",
            "--port",
            &board.port,
            "--json",
        ]))
    };
    assert!((0..50).any(|_| off(&ask())), "{:?}", ask());
    board.end();
    let spans = spans_before_layers(&job);
    let told = statuses(&log);
    assert!(
        told.iter()
            .any(|status| status.state == DeviceState::Heating)
    );
    // Nothing moves before both are there.
    let begins = told.iter().find(|status| status.spans_done > 0).unwrap();
    let hot = begins.heaters[0].decidegrees;
    assert!((380..=420).contains(&hot), "{hot}");
    let moving = told
        .iter()
        .filter(|status| status.state == DeviceState::Running);
    let (mut before, mut after, mut late) = (0, 0, 0);
    for status in moving {
        let (done, target) = (status.spans_done, status.heaters[0].target_decidegrees);
        if done < spans[1] {
            assert_eq!((target, status.fan_permille), (400, 0), "{done} spans");
            before += 1;
        } else if (target, status.fan_permille) != (350, 500) {
            late = late.max(done - spans[1]);
        } else {
            after += 1;
        }
        if done > spans[1] + SPANS_LATE {
            assert_eq!((target, status.fan_permille), (350, 500), "{done} spans");
        }
    }
    println!("{before} statuses before, {after} after, {late} spans late of {spans:?}");
    assert!(before > 3 && after > 10, "{before} {after}");
}

/// Goal: a print outlives its host's sleep. Method: the host's process stands for 13 s, longer than any answer is
/// waited for, on a board in another process.
#[test]
fn a_print_outlives_its_host_that_stood_for_13_seconds() {
    let folder = folder("sleep");
    let (job, _) = job(&folder, 3);
    let port = format!("unix:{}", path(&folder.join("board")));
    let board = Host::start(&["board", "simulate", "--listen", &port]);
    board.wait_for("listens on");
    let host = Host::start(&["stream", &job, "--port", &port, "--json"]);
    sleep_into_the_job();
    host.stand(Duration::from_secs(13));
    let (well, figures, said) = host.end();
    assert!(well && figures["done"] == true, "{said}");
    assert!(figures["took_s"].as_f64().unwrap() > 13.0, "{figures}");
    board.interrupt();
    board.end();
}

/// Goal: who lets others move and heat a board knows it. Method: where a simulated board says it listens.
#[test]
fn a_board_that_listens_beyond_this_computer_says_so() {
    for (place, is_open) in [("0.0.0.0", true), ("127.0.0.1", false)] {
        let listen = format!("tcp:{place}:0");
        let board = Host::start(&["board", "simulate", "--listen", &listen]);
        board.wait_for("Ctrl-C ends it");
        board.interrupt();
        let (_, _, said) = board.end();
        assert_eq!(said.contains("anybody in the network"), is_open, "{said}");
    }
}

/// Goal: the same for a board that heats and gives its host up after 30 s: its heaters go off, the returning host
/// orders them again, and the print is the very same. Method: the host's process stands for 40 s.
#[test]
#[ignore = "a minute of real time; run by name"]
fn a_print_with_heat_outlives_its_host_that_stood_for_40_seconds() {
    let folder = folder("long-sleep");
    let (job, machine) = heated_job(&folder, 12);
    let counts = object(&headway(&["simulate", &job, "--json"]))["final_counts"].clone();
    let listen = Port::Unix(folder.join("board"));
    let board = Board::of_machine(&listen, 1.0, machine, cool_heaters());
    let log = folder.join("print.log").display().to_string();
    let host = Host::start(&[
        "stream",
        &job,
        "--port",
        &board.port,
        "--log",
        &log,
        "--json",
    ]);
    std::thread::sleep(Duration::from_secs(20));
    host.stand(Duration::from_secs(40));
    let (well, figures, said) = host.end();
    assert!(well && figures["done"] == true, "{said}");
    assert!(said.contains("heating again"), "{said}");
    assert!(statuses(&log).iter().all(|status| status.fault.is_none()));
    assert_eq!(Value::from(board.end().counts), counts);
}
