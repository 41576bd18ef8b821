//! Boards in this process, hosts that stream to them, and a job for both.

use super::{command, headway, object, stderr};
use headway::drive::transport::{Listener, Port};
use headway::drive::virtual_board::{BoardFigures, BoardSetup, VirtualBed, VirtualBoard};
use headway::settings::Settings;
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_firmware::configuration::homing::HomingConfiguration;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest that anything may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A job of some seconds: turns of a spiral, for the built-in machine. Its path, and the counts
/// at which the simulation ends.
pub fn job(folder: &Path, turns: u32) -> (String, Value) {
    let run = folder.join("spiral.wpt");
    let mut waypoints = String::new();
    for i in 0..=36 * turns {
        let t = f64::from(i) * 10f64.to_radians();
        let radius = 15.0 + 0.3 * t;
        waypoints += &format!("{} {} 0.2 0 0 1\n", radius * t.cos(), radius * t.sin());
    }
    std::fs::write(&run, waypoints).unwrap();
    let job = folder.join("spiral.hwj").display().to_string();
    let planned = headway(&["plan", &run.display().to_string(), "-o", &job]);
    assert!(planned.status.success(), "{}", stderr(&planned));
    let counts = object(&headway(&["simulate", &job, "--json"]))["final_counts"].clone();
    (job, counts)
}

/// A board in a thread of this process, and a cable that can be pulled.
pub struct Board {
    pub port: String,
    stop: Arc<AtomicBool>,
    pub pull: Arc<AtomicBool>,
    thread: Option<JoinHandle<BoardFigures>>,
}

impl Board {
    pub fn start(port: &Port, speed: f64) -> Board {
        let machine = Settings::default().machine;
        Board::of_machine(port, speed, machine, HeatConfiguration::none())
    }

    pub fn of_machine(
        port: &Port,
        speed: f64,
        machine: MachineConfiguration,
        heat: HeatConfiguration,
    ) -> Board {
        let setup = BoardSetup {
            switches: HomingConfiguration::standard(&machine),
            machine,
            session: 77,
            speed,
            heat,
            bed: VirtualBed::default(),
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

    pub fn unix(folder: &Path, speed: f64) -> Board {
        Board::start(&Port::Unix(folder.join("board")), speed)
    }

    pub fn tcp(speed: f64) -> Board {
        Board::start(&Port::Tcp("127.0.0.1:0".into()), speed)
    }

    pub fn end(mut self) -> BoardFigures {
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
pub struct Host {
    pub child: Child,
    pub said: Arc<std::sync::Mutex<String>>,
    listener: std::thread::JoinHandle<()>,
}

impl Host {
    pub fn start(arguments: &[&str]) -> Host {
        let mut command = command(arguments);
        command.stdin(Stdio::piped());
        Host::of(command)
    }

    /// Of a command whose output goes into pipes.
    pub fn of(mut command: Command) -> Host {
        let mut child = command.spawn().unwrap();
        let said = Arc::new(std::sync::Mutex::new(String::new()));
        let (stderr, heard) = (child.stderr.take().unwrap(), said.clone());
        let listener = std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                *heard.lock().unwrap() += &(line + "\n");
            }
        });
        Host {
            child,
            said,
            listener,
        }
    }

    pub fn wait_for(&self, words: &str) {
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

    pub fn interrupt(&self) {
        self.signal("-INT");
    }

    /// A signal by its name, as `-TERM`.
    pub fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        let sent = Command::new("kill").args([name, &pid]).status();
        assert!(sent.unwrap().success());
    }

    /// Its process stands for a time.
    pub fn stand(&self, time: Duration) {
        self.signal("-STOP");
        std::thread::sleep(time);
        self.signal("-CONT");
    }

    pub fn type_line(&mut self, line: &str) {
        let stdin = self.child.stdin.as_mut().unwrap();
        writeln!(stdin, "{line}").unwrap();
        stdin.flush().unwrap();
    }

    /// Its figures, and whether it ended well.
    pub fn end(mut self) -> (bool, Value, String) {
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
        // What it said last may not have been heard yet.
        self.listener.join().unwrap();
        let said = self.said.lock().unwrap().clone();
        (status.success(), figures, said)
    }
}

pub fn counts(figures: &BoardFigures) -> Value {
    serde_json::to_value(&figures.counts).unwrap()
}

/// Waits until the board that is asked runs the job, by its status.
pub fn sleep_into_the_job() {
    std::thread::sleep(Duration::from_millis(600));
}
