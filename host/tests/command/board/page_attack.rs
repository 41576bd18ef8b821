//! Goal: no client of the page takes the print down, keeps its line from being opened again or keeps a stop from
//! being heard. Method: the command streams to the firmware library behind a real socket with few file descriptors;
//! two hundred clients at once send what no browser sends, each again as soon as it was thrown out.
#![cfg(unix)]

use crate::rig::board::{Board, Host, counts, job};
use crate::rig::folder;
use serde_json::Value;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest that anything may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);
/// Hostile clients at once.
const CLIENTS: usize = 200;
/// Files that the command may have open: less than the clients would occupy.
const FILES_MAX: u32 = 80;
/// Longest wait of an honest request behind [`CLIENTS`] that occupy each place for 0.25 s: 200 / 48 places is about
/// one second; five for the test's own two hundred threads on two cores.
const ANSWER: Duration = Duration::from_secs(5);

/// Where the page is.
#[derive(Clone)]
struct Page {
    host: String,
    token: String,
}

impl Page {
    fn of(host: &Host) -> Page {
        host.wait_for("page: http://");
        let said = host.said.lock().unwrap().clone();
        let url = said.split("page: http://").nth(1).unwrap();
        let (host, rest) = url.split_once('/').unwrap();
        let (token, _) = rest.split_once('/').unwrap();
        Page {
            host: host.to_owned(),
            token: token.to_owned(),
        }
    }

    /// The head of a request without the line that ends it.
    fn head(&self, first: &str) -> String {
        let (token, host) = (&self.token, &self.host);
        let (method, what) = first.split_once(' ').unwrap();
        format!("{method} /{token}/{what} HTTP/1.1\r\nHost: {host}\r\n")
    }

    /// What is answered to these bytes until the server closes, or `None` where it gives no whole answer.
    fn send(&self, bytes: &[u8]) -> Option<(u16, String)> {
        let mut line = TcpStream::connect(&self.host).ok()?;
        line.set_read_timeout(Some(PATIENCE)).ok()?;
        line.write_all(bytes).ok()?;
        let mut answer = Vec::new();
        let _ = line.read_to_end(&mut answer);
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let (head, body) = answer.split_once("\r\n\r\n")?;
        let status = head.split(' ').nth(1)?.parse().ok()?;
        Some((status, body.to_owned()))
    }

    /// An honest request, again where its connection was closed for another one's sake; how long it took.
    fn ask(&self, first: &str, body: &str) -> (u16, String, Duration) {
        let length = body.len();
        let head = self.head(first);
        let request = format!("{head}Content-Length: {length}\r\n\r\n{body}");
        let begun = Instant::now();
        loop {
            if let Some((status, text)) = self.send(request.as_bytes()) {
                return (status, text, begun.elapsed());
            }
            assert!(begun.elapsed() < PATIENCE, "{first}: no answer");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn print(&self) -> (Value, Duration) {
        let (status, body, took) = self.ask("GET status", "");
        assert_eq!(status, 200);
        let answer = serde_json::from_str::<Value>(&body).unwrap();
        (answer["print"].clone(), took)
    }

    fn wait_until(&self, what: &str, holds: impl Fn(&Value) -> bool) {
        let begun = Instant::now();
        while !holds(&self.print().0) {
            assert!(begun.elapsed() < PATIENCE, "never {what}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

fn stream(job: &str, board: &Board) -> (Host, Page) {
    let program = env!("CARGO_BIN_EXE_headway");
    let mut command = Command::new("sh");
    command
        .arg("-c")
        .arg(format!("ulimit -n {FILES_MAX}; exec \"$@\""))
        .args(["sh", program, "stream", job, "--port", &board.port])
        .args(["--view", "--no-open", "--json"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let host = Host::of(command);
    let page = Page::of(&host);
    (host, page)
}

/// Two hundred of them, until they are dropped.
struct Attack {
    ends: Arc<AtomicBool>,
    connections: Arc<AtomicU32>,
    clients: Vec<JoinHandle<()>>,
}

impl Attack {
    fn begin(page: &Page) -> Attack {
        let ends = Arc::new(AtomicBool::new(false));
        let connections = Arc::new(AtomicU32::new(0));
        let client = |kind: usize| {
            let (page, ends, connections) = (page.clone(), ends.clone(), connections.clone());
            let run = move || {
                while !ends.load(Ordering::Relaxed) {
                    let Ok(line) = TcpStream::connect(&page.host) else {
                        std::thread::sleep(Duration::from_millis(20));
                        continue;
                    };
                    connections.fetch_add(1, Ordering::Relaxed);
                    // Being thrown out is what is expected.
                    let _ = annoy(line, &page, kind, &ends);
                }
            };
            let thread = std::thread::Builder::new().stack_size(128 << 10);
            thread.spawn(run).unwrap()
        };
        let clients = (0..CLIENTS).map(client).collect();
        Attack {
            ends,
            connections,
            clients,
        }
    }

    /// How many connections there were.
    fn end(self) -> u32 {
        self.ends.store(true, Ordering::Relaxed);
        for client in self.clients {
            client.join().unwrap();
        }
        self.connections.load(Ordering::Relaxed)
    }
}

/// One connection of a client of this kind.
fn annoy(mut line: TcpStream, page: &Page, kind: usize, ends: &AtomicBool) -> std::io::Result<()> {
    line.set_read_timeout(Some(Duration::from_millis(50)))?;
    let order = page.head("POST order");
    match kind % 10 {
        // A body of 2^40 bytes, with the key and without.
        0 => line.write_all(format!("{order}Content-Length: 1099511627776\r\n\r\nx").as_bytes())?,
        1 => line.write_all(b"POST /order HTTP/1.1\r\nContent-Length: 1099511627776\r\n\r\nx")?,
        // Bodies that never come, or never end.
        2 => line.write_all(format!("{order}Content-Length: 4\r\n\r\n").as_bytes())?,
        3 => {
            line.write_all(format!("{order}Transfer-Encoding: chunked\r\n\r\n").as_bytes())?;
            return drip(line, b"1\r\nx\r\n", ends);
        }
        // A head that comes byte by byte, one that never ends, headers without end.
        4 => return drip(line, b"G", ends),
        5 => line.write_all(&[b'a'; 200_000])?,
        6 => {
            line.write_all(order.as_bytes())?;
            line.write_all("X: y\r\n".repeat(20_000).as_bytes())?;
        }
        // Requests behind each other, then garbage.
        7 => {
            let status = page.head("GET status") + "\r\n";
            line.write_all(status.repeat(100).as_bytes())?;
            line.write_all(&[0xff; 20_000])?;
        }
        // The whole page, not read.
        8 => line.write_all((page.head("GET ") + "\r\n").as_bytes())?,
        // Nothing at all.
        _ => {}
    }
    if kind % 10 == 8 {
        std::thread::sleep(Duration::from_millis(500));
        return Ok(());
    }
    while !ends.load(Ordering::Relaxed) {
        match line.read(&mut [0; 512]) {
            Ok(0) => return Ok(()),
            Err(error) if error.kind() != std::io::ErrorKind::WouldBlock => return Err(error),
            _ => {}
        }
    }
    Ok(())
}

fn drip(mut line: TcpStream, bytes: &[u8], ends: &AtomicBool) -> std::io::Result<()> {
    while !ends.load(Ordering::Relaxed) {
        line.write_all(bytes)?;
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}

/// Goal: the print goes on under attack, also where its line must be opened again, and ends where the simulation
/// ends.
#[test]
fn two_hundred_hostile_clients_change_no_step() {
    let folder = folder("steps");
    let (job, expected) = job(&folder, 4);
    let board = Board::unix(&folder, 2.0);
    let (host, page) = stream(&job, &board);
    page.wait_until("running", |print| print["state"] == "running");
    let attack = Attack::begin(&page);
    std::thread::sleep(Duration::from_millis(700));
    board.pull.store(true, Ordering::Relaxed);
    host.wait_for("the line is back");
    let (_, took) = page.print();
    assert!(took < ANSWER, "{took:?}");
    let (well, figures, said) = host.end();
    let connections = attack.end();
    assert!(well, "{said}");
    assert_eq!(figures["reconnects"], 1);
    assert_eq!(counts(&board.end()), expected);
    assert!(connections > 2 * CLIENTS as u32, "{connections}");
    println!("{connections} connections, a status in {took:?}");
}

/// Goal: the stop of an honest page is heard at once, whoever else is there.
#[test]
fn a_stop_is_heard_among_two_hundred_hostile_clients() {
    let folder = folder("stop");
    let (job, _) = job(&folder, 8);
    let board = Board::unix(&folder, 1.0);
    let (host, page) = stream(&job, &board);
    page.wait_until("running", |print| print["state"] == "running");
    let attack = Attack::begin(&page);
    std::thread::sleep(Duration::from_millis(700));
    let (status, _, took) = page.ask("POST order", "stop");
    assert_eq!(status, 202);
    assert!(took < ANSWER, "{took:?}");
    host.wait_for("fault: ");
    let (well, figures, said) = host.end();
    let connections = attack.end();
    assert!(!well && figures["done"] == false, "{said}");
    board.end();
    println!("{connections} connections, a stop in {took:?}");
}

/// Goal: each limit answers for itself. Method: one client at a time.
#[test]
fn each_limit_is_answered() {
    let folder = folder("limits");
    let (job, _) = job(&folder, 4);
    let board = Board::unix(&folder, 1.0);
    let (mut host, page) = stream(&job, &board);
    page.wait_until("running", |print| print["state"] == "running");
    let order = page.head("POST order");
    let status = |request: String| page.send(request.as_bytes()).map(|(status, _)| status);
    let length = |bytes: u64| format!("{order}Content-Length: {bytes}\r\n\r\nx");
    assert_eq!(status(length(1 << 40)), Some(413));
    assert_eq!(status(length(65)), Some(413));
    // What says no length is counted.
    let chunk = format!("40\r\n{}\r\n", "x".repeat(64));
    let chunked = format!("{order}Transfer-Encoding: chunked\r\n\r\n{chunk}{chunk}");
    assert_eq!(status(chunked), Some(413));
    assert_eq!(status(length(4)), Some(408));
    let one = page.head("GET status");
    let long = format!("{one}X: {}\r\n\r\n", "y".repeat(10_000));
    let many = format!("{one}{}\r\n", "X: y\r\n".repeat(60));
    assert_eq!([status(long), status(many)], [Some(431), Some(431)]);
    // A second request on a connection is not looked at.
    let twice = format!("{one}\r\n{order}Content-Length: 5\r\n\r\nabort");
    assert_eq!(status(twice), Some(200));
    assert_ne!(page.print().0["state"], "aborting");
    host.child.kill().unwrap();
    host.child.wait().unwrap();
    board.end();
}

/// Goal: who builds on the library needs no server. Method: what the Python package and the fuzz targets depend on.
#[test]
fn the_server_of_the_page_comes_with_its_feature_alone() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let lock = |place: &str| std::fs::read_to_string(format!("{root}/{place}")).unwrap();
    let has_server = |text: &str| text.contains("name = \"hyper\"");
    assert!(has_server(&lock("Cargo.lock")));
    for place in ["python/Cargo.lock", "fuzz/Cargo.lock"] {
        assert!(!has_server(&lock(place)), "{place}");
    }
}
