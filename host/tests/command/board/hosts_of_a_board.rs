//! Goal: no host of a simulated board keeps another one out, and none takes what another one needs. Method: the command
//! and hosts of this process at one board behind a real socket.
#![cfg(unix)]

use crate::rig::board::{Board, Host, job};
use crate::rig::{folder, headway, object, stderr};
use headway::drive::pump::{Pump, host_session};
use headway::drive::sender::Sender;
use headway::drive::sender_state::{SenderEvent, SenderState};
use headway::drive::transport::{BAUD_DEFAULT, Port};
use headway::settings::Settings;
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_protocol::message::Control;
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// More than a board has places for.
const IDLE: usize = 40;
/// A host waits two milliseconds for its answer; the rest is the start of a program on a busy machine.
const ANSWER: Duration = Duration::from_secs(5);

/// Goal: connections that say nothing keep nobody out. It was ten seconds with five of them.
#[test]
fn idle_connections_keep_nobody_out() {
    let board = Board::tcp(1.0);
    let address = board.port.strip_prefix("tcp:").unwrap();
    let idle: Vec<TcpStream> = (0..IDLE)
        .map(|_| TcpStream::connect(address).unwrap())
        .collect();
    let begun = Instant::now();
    let status = object(&headway(&[
        "board",
        "status",
        "--port",
        &board.port,
        "--json",
    ]));
    assert_eq!(status["state"], "idle");
    let jogged = headway(&["board", "jog", "x", "1", "--port", &board.port]);
    assert!(jogged.status.success(), "{}", stderr(&jogged));
    assert!(begun.elapsed() < ANSWER, "{:?}", begun.elapsed());
    drop(idle);
    assert!(board.end().steps > 0);
}

/// A host that asks for the status again and again over one connection.
struct Watcher {
    ends: Arc<AtomicBool>,
    answers: Arc<AtomicU32>,
    thread: JoinHandle<()>,
}

impl Watcher {
    fn begin(port: &str) -> Watcher {
        let port: Port = port.parse().unwrap();
        let ends = Arc::new(AtomicBool::new(false));
        let answers = Arc::new(AtomicU32::new(0));
        let (stop, heard) = (ends.clone(), answers.clone());
        let thread = std::thread::spawn(move || {
            let mut pump = Pump::open(&port, BAUD_DEFAULT, None).unwrap();
            let mut sender = Sender::talking(host_session());
            while !stop.load(Ordering::Relaxed) {
                pump.turn(&mut sender);
                while let Some(event) = sender.poll_event() {
                    if matches!(event, SenderEvent::Status(_)) {
                        heard.fetch_add(1, Ordering::Relaxed);
                    }
                }
                assert!(!matches!(sender.state(), SenderState::Failed(_)));
                if !sender.has_command() {
                    sender.command(Control::StatusRequest);
                }
            }
        });
        Watcher {
            ends,
            answers,
            thread,
        }
    }

    fn answers(&self) -> u32 {
        self.answers.load(Ordering::Relaxed)
    }

    fn wait_for_answers(&self) {
        let (before, begun) = (self.answers(), Instant::now());
        while self.answers() < before + 3 {
            assert!(begun.elapsed() < ANSWER);
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Goal: who only asks never stands where the next print needs the line. Method: a host asks all the time, from before
/// the first of two prints until behind the second.
#[test]
fn a_watcher_does_not_take_the_line_after_a_print() {
    let folder = folder("watcher");
    let (job, _) = job(&folder, 1);
    let board = Board::unix(&folder, 20.0);
    let watcher = Watcher::begin(&board.port);
    watcher.wait_for_answers();
    let port = ["--port", &board.port];
    for _ in 0..2 {
        let streamed = object(&headway(&[&["stream", &job, "--json"], &port[..]].concat()));
        assert_eq!(streamed["done"], true);
        watcher.wait_for_answers();
        let gone = headway(&[&["board", "go", &job], &port[..]].concat());
        assert!(gone.status.success(), "{}", stderr(&gone));
    }
    watcher.wait_for_answers();
    watcher.ends.store(true, Ordering::Relaxed);
    watcher.thread.join().unwrap();
    board.end();
}

/// Goal: while a job runs nobody else sets its fan.
#[test]
fn a_second_host_sets_no_fan_while_a_job_runs() {
    let folder = folder("fan");
    let (job, _) = job(&folder, 8);
    let (place, machine) = (
        Port::Unix(folder.join("board")),
        Settings::default().machine,
    );
    let board = Board::of_machine(&place, 1.0, machine, HeatConfiguration::standard());
    let host = Host::start(&["stream", &job, "--port", &board.port, "--no-heat", "--json"]);
    let state = || {
        let asked = headway(&["board", "status", "--port", &board.port, "--json"]);
        object(&asked)["state"].clone()
    };
    let begun = Instant::now();
    while state() != "running" {
        assert!(begun.elapsed() < 2 * ANSWER, "{}", state());
    }
    let refused = headway(&["board", "fan", "40", "--port", &board.port]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("refuses"), "{}", stderr(&refused));
    assert_eq!(state(), "running", "too late to show anything");
    let aborted = headway(&["board", "abort", "--port", &board.port]);
    assert!(aborted.status.success(), "{}", stderr(&aborted));
    let (well, _, said) = host.end();
    assert!(!well, "{said}");
    board.end();
}
