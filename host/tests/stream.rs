//! Goal: a job gets to a board whatever happens on the way. Method: the command itself, streaming
//! to the firmware library behind real sockets, in accelerated time; connections are cut, hosts
//! killed, Ctrl-C pressed; in the end the motors must stand where the simulation has them.
#![cfg(unix)]

use headway::drive::transport::{Listener, Port};
use headway::drive::virtual_board::{BoardFigures, BoardSetup, VirtualBoard};
use headway::settings::Settings;
use headway_firmware::homing::HomingConfiguration;
use serde_json::Value;
use serialport::{SerialPort, TTYPort};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest that anything may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

fn headway(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
    command
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

fn output(arguments: &[&str]) -> Output {
    headway(arguments).output().unwrap()
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A folder of its own for each test.
fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("stream-{name}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// A job of some seconds: turns of a spiral, for the built-in machine. Its path, and the counts
/// at which the simulation ends.
fn job(folder: &Path, turns: u32) -> (String, Value) {
    let run = folder.join("spiral.wpt");
    let mut waypoints = String::new();
    for i in 0..=36 * turns {
        let t = f64::from(i) * 10f64.to_radians();
        let radius = 15.0 + 0.3 * t;
        waypoints += &format!("{} {} 0.2 0 0 1\n", radius * t.cos(), radius * t.sin());
    }
    std::fs::write(&run, waypoints).unwrap();
    let job = folder.join("spiral.hwj").display().to_string();
    let planned = output(&["plan", &run.display().to_string(), "-o", &job]);
    assert!(planned.status.success(), "{}", text(&planned.stderr));
    let counts = json(&output(&["simulate", &job, "--json"]))["final_counts"].clone();
    (job, counts)
}

/// A board in a thread of this process, and a cable that can be pulled.
struct Board {
    port: String,
    stop: Arc<AtomicBool>,
    pull: Arc<AtomicBool>,
    thread: Option<JoinHandle<BoardFigures>>,
}

impl Board {
    fn start(port: &Port, speed: f64) -> Board {
        let machine = Settings::default().machine;
        let setup = BoardSetup {
            switches: HomingConfiguration::standard(&machine),
            machine,
            session: 77,
            speed,
        };
        let listener = Listener::bind(port).unwrap();
        let port = listener.port().unwrap().to_string();
        let (stop, pull) = (
            Arc::new(AtomicBool::new(false)),
            Arc::new(AtomicBool::new(false)),
        );
        let (stopped, pulled) = (stop.clone(), pull.clone());
        let thread = std::thread::spawn(move || {
            let mut board = VirtualBoard::new(setup, listener).unwrap();
            board
                .serve(&stopped, |board| {
                    if pulled.swap(false, Ordering::Relaxed) {
                        board.pull();
                    }
                })
                .unwrap()
        });
        Board {
            port,
            stop,
            pull,
            thread: Some(thread),
        }
    }

    fn unix(folder: &Path, speed: f64) -> Board {
        Board::start(&Port::Unix(folder.join("board")), speed)
    }

    fn tcp(speed: f64) -> Board {
        Board::start(&Port::Tcp("127.0.0.1:0".into()), speed)
    }

    fn end(mut self) -> BoardFigures {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap()
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// A host that streams, and what it says.
struct Host {
    child: Child,
    said: Arc<std::sync::Mutex<String>>,
}

impl Host {
    fn start(arguments: &[&str]) -> Host {
        let mut child = headway(arguments).stdin(Stdio::piped()).spawn().unwrap();
        let said = Arc::new(std::sync::Mutex::new(String::new()));
        let (stderr, heard) = (child.stderr.take().unwrap(), said.clone());
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                *heard.lock().unwrap() += &(line + "\n");
            }
        });
        Host { child, said }
    }

    fn wait_for(&self, words: &str) {
        let begun = Instant::now();
        while !self.said.lock().unwrap().contains(words) {
            assert!(
                begun.elapsed() < PATIENCE,
                "no `{words}` in:\n{}",
                self.said.lock().unwrap()
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn interrupt(&self) {
        let pid = self.child.id().to_string();
        assert!(
            Command::new("kill")
                .args(["-INT", &pid])
                .status()
                .unwrap()
                .success()
        );
    }

    fn type_line(&mut self, line: &str) {
        let stdin = self.child.stdin.as_mut().unwrap();
        writeln!(stdin, "{line}").unwrap();
        stdin.flush().unwrap();
    }

    /// Its figures, and whether it ended well.
    fn end(mut self) -> (bool, Value, String) {
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            if begun.elapsed() > PATIENCE {
                let _ = self.child.kill();
                panic!("not done:\n{}", self.said.lock().unwrap());
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        let mut stdout = String::new();
        self.child
            .stdout
            .take()
            .unwrap()
            .read_to_string(&mut stdout)
            .unwrap();
        let figures = serde_json::from_str(&stdout).unwrap_or(Value::Null);
        let said = self.said.lock().unwrap().clone();
        (status.success(), figures, said)
    }
}

fn counts(figures: &BoardFigures) -> Value {
    serde_json::to_value(&figures.counts).unwrap()
}

/// Waits until the board that is asked runs the job, by its status.
fn sleep_into_the_job() {
    std::thread::sleep(Duration::from_millis(600));
}

#[test]
fn a_job_streams_over_unix_socket_and_tcp_to_the_simulations_end() {
    let folder = folder("both");
    let (job, expected) = job(&folder, 3);
    for board in [Board::unix(&folder, 10.0), Board::tcp(10.0)] {
        let log = folder.join("print.log").display().to_string();
        let streamed = output(&[
            "stream",
            &job,
            "--port",
            &board.port,
            "--log",
            &log,
            "--json",
        ]);
        let figures = json(&streamed);
        assert_eq!(figures["done"], true);
        assert_eq!(figures["reconnects"], 0);
        let board = board.end();
        assert_eq!(counts(&board), expected);
        // The log is the print once more, the same each time.
        let replays: Vec<Value> = (0..2)
            .map(|_| json(&output(&["board", "replay", &log, "--json"])))
            .collect();
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
    let simulated = json(&output(&["simulate", &job, "--json"]));
    let mut digests = Vec::new();
    // On a machine that is too busy the queue may run dry, which moves steps in time.
    for _ in 0..3 {
        let board = Board::unix(&folder, 2.0);
        let line = SerialLine::to(&board);
        let port = line.terminal.name().unwrap();
        let status = json(&output(&["board", "status", "--port", &port, "--json"]));
        assert_eq!(status["state"], "idle", "{status}");
        let streamed = json(&output(&["stream", &job, "--port", &port, "--json"]));
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
    let ask = |arguments: &[&str]| output(&[arguments, &port].concat());
    let homed = ask(&["board", "home"]);
    assert!(homed.status.success(), "{}", text(&homed.stderr));
    assert!(text(&homed.stdout).contains("known joints [0, 1, 2]"));
    // It stands at its switches: the job begins elsewhere.
    let refused = ask(&["stream", &job]);
    assert!(!refused.status.success());
    let gone = ask(&["board", "go", &job]);
    assert!(gone.status.success(), "{}", text(&gone.stderr));
    assert_eq!(json(&ask(&["stream", &job, "--json"]))["done"], true);
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
    let again = output(&["stream", &job, "--port", &board.port]);
    assert_eq!(again.status.code(), Some(1), "{}", text(&again.stderr));
    assert!(
        text(&again.stderr).contains("--resume"),
        "{}",
        text(&again.stderr)
    );
    let resumed = output(&["stream", &job, "--port", &board.port, "--resume", "--json"]);
    assert_eq!(json(&resumed)["done"], true);
    assert_eq!(counts(&board.end()), expected);
    // A board that knows nothing of it has nothing to resume.
    let fresh = Board::unix(&folder, 2.0);
    let refused = output(&["stream", &job, "--port", &fresh.port, "--resume"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        text(&refused.stderr).contains("without --resume"),
        "{}",
        text(&refused.stderr)
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
    let status = json(&output(&[
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

#[test]
fn a_board_is_asked_homed_and_jogged() {
    let folder = folder("board");
    let board = Board::unix(&folder, 50.0);
    let port = board.port.as_str();
    let info = json(&output(&["board", "info", "--port", port, "--json"]));
    assert_eq!(info["servo_hz"], 2000);
    let homed = output(&["board", "home", "--port", port]);
    assert!(homed.status.success(), "{}", text(&homed.stderr));
    let status = json(&output(&["board", "status", "--port", port, "--json"]));
    assert_eq!(status["state"], "idle");
    let known: Vec<u64> = serde_json::from_value(status["referenced"].clone()).unwrap();
    assert!(
        [0, 1, 2].iter().all(|joint| known.contains(joint)),
        "{status}"
    );
    let jogged = output(&["board", "jog", "x", "12.5", "--port", port]);
    assert!(jogged.status.success(), "{}", text(&jogged.stderr));
    let after = json(&output(&["board", "status", "--port", port, "--json"]));
    let moved = after["counts"][0].as_i64().unwrap() - status["counts"][0].as_i64().unwrap();
    assert_eq!(moved, 1000, "12.5 mm at 80 steps a mm");
    // Melt by hand: 2 mm³ there, half of it back.
    let extruder = status["counts"].as_array().unwrap().len() - 1;
    for (volume, net_mm3) in [("2", 2.0), ("-1", 1.0)] {
        let pushed = output(&["board", "extrude", volume, "--port", port]);
        assert!(pushed.status.success(), "{}", text(&pushed.stderr));
        let status = json(&output(&["board", "status", "--port", port, "--json"]));
        let steps = Settings::default().machine.extruder.steps_per_mm3 * net_mm3;
        let difference = status["counts"][extruder].as_f64().unwrap() - steps;
        assert!(difference.abs() <= 1.0, "{status}");
    }
    // A homed machine is brought to a job's first pose, or the job is refused.
    let (job, _) = job(&folder, 1);
    let refused = output(&["stream", &job, "--port", port]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        text(&refused.stderr).contains("board go"),
        "{}",
        text(&refused.stderr)
    );
    let gone = output(&["board", "go", &job, "--port", port]);
    assert!(gone.status.success(), "{}", text(&gone.stderr));
    assert_eq!(
        json(&output(&["stream", &job, "--port", port, "--json"]))["done"],
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
        let said = output(&[arguments.as_slice(), &["--port", port]].concat());
        assert_eq!(
            said.status.code(),
            Some(code),
            "{arguments:?}: {}",
            text(&said.stderr)
        );
    }
    // What a stop has lost is declared, where there is no switch to home to.
    for (joint, position) in [("x", "10"), ("y", "-2.5"), ("z", "1"), ("c", "90")] {
        let set = output(&["board", "set-joint", joint, position, "--port", port]);
        assert!(set.status.success(), "{}", text(&set.stderr));
    }
    let status = json(&output(&["board", "status", "--port", port, "--json"]));
    assert_eq!(status["counts"][0], 800);
    assert_eq!(status["counts"][1], -200);
    assert_eq!(status["counts"][3], 2400, "a quarter of 9600 steps");
    let known: Vec<u64> = serde_json::from_value(status["referenced"].clone()).unwrap();
    assert_eq!(known, [0, 1, 2, 3]);
    for (joint, position, code) in [("w", "1", 2), ("x", "1e9", 2), ("x", "1000", 1)] {
        let refused = output(&["board", "set-joint", joint, position, "--port", port]);
        assert_eq!(refused.status.code(), Some(code), "{joint} {position}");
    }
    board.end();
    let gone = output(&["board", "info", "--port", "unix:/nonexistent/board"]);
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
        json(&output(&["stream", &job, "--port", &port, "--json"]))["done"],
        true
    );
    board.interrupt();
    let (well, _, said) = board.end();
    assert!(well && said.contains("1 hosts"), "{said}");
}
