//! Goal: a print can be watched and commanded from a page on this machine, by nobody else, and no page
//! disturbs it. Method: the command streams to the firmware library behind a real socket; a client of a
//! few lines, which shares no code with the server, asks what a page asks and what an attacker would.
#![cfg(unix)]

use crate::rig::board::{Board, Host, counts, job};
use crate::rig::{folder, headway, stderr};
use serde_json::Value;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// Longest that anything may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// Where a page is.
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

    /// Status and body of an answer; `headers` are lines.
    fn ask(&self, first: &str, headers: &str, body: &str) -> (u16, String) {
        let mut line = TcpStream::connect(&self.host).unwrap();
        line.set_read_timeout(Some(PATIENCE)).unwrap();
        let length = body.len();
        write!(
            line,
            "{first} HTTP/1.1\r\n{headers}Content-Length: {length}\r\nConnection: close\r\n\r\n{body}"
        )
        .unwrap();
        let mut answer = String::new();
        line.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        (status, body.to_owned())
    }

    fn get(&self, what: &str) -> (u16, String) {
        let first = format!("GET /{}/{what}", self.token);
        self.ask(&first, &format!("Host: {}\r\n", self.host), "")
    }

    fn order(&self, what: &str) -> u16 {
        let first = format!("POST /{}/order", self.token);
        self.ask(&first, &format!("Host: {}\r\n", self.host), what)
            .0
    }

    fn print(&self) -> Value {
        let (status, body) = self.get("status");
        assert_eq!(status, 200);
        // It may come chunked: the object is within.
        let object = &body[body.find('{').unwrap()..=body.rfind('}').unwrap()];
        serde_json::from_str::<Value>(object).unwrap()["print"].clone()
    }

    fn wait_until(&self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let print = self.print();
            if holds(&print) {
                return print;
            }
            assert!(begun.elapsed() < PATIENCE, "never {what}: {print}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

fn stream(job: &str, board: &Board) -> (Host, Page) {
    let host = Host::start(&[
        "stream",
        job,
        "--port",
        &board.port,
        "--view",
        "--no-open",
        "--json",
    ]);
    let page = Page::of(&host);
    (host, page)
}

#[test]
fn a_print_is_watched_and_commanded_from_its_page_alone() {
    let folder = folder("orders");
    let (job, expected) = job(&folder, 8);
    let board = Board::unix(&folder, 1.0);
    let (host, page) = stream(&job, &board);
    let running = page.wait_until("running", |print| print["state"] == "running");
    assert!(running["line_open"] == true && running["layers"] == 1);
    let (status, html) = page.get("");
    assert!(status == 200 && html.contains("id=\"live\"") && html.contains("connect-src 'self'"));

    // An attacker: without the key, with another one, by another name, from another page.
    let token = &page.token;
    let ours = format!("Host: {}\r\n", page.host);
    let port = page.host.split(':').nth(1).unwrap();
    let other = format!("Host: evil.example:{port}\r\n");
    let foreign = format!("{ours}Origin: http://evil.example\r\n");
    let wrong = token.replace(|c: char| c != '0', "0");
    for (first, headers) in [
        (format!("POST /{wrong}/order"), &ours),
        ("POST /order".to_owned(), &ours),
        (format!("POST /{token}/order"), &other),
        (format!("POST /{token}/order"), &foreign),
        (format!("GET /{token}/status"), &other),
        ("GET /".to_owned(), &ours),
    ] {
        assert_eq!(
            page.ask(&first, headers, "pause").0,
            403,
            "{first} {headers}"
        );
    }
    assert_eq!(page.get("order").0, 405);
    assert_eq!(page.get("passwd").0, 404);
    for order in [
        "heat hot-end 200",
        "fan 100",
        "override 500",
        "flow 5",
        "nonsense",
        "",
    ] {
        assert_eq!(page.order(order), 400, "{order}");
    }
    assert_ne!(page.print()["state"], "paused");

    assert_eq!(page.order("pause"), 202);
    let paused = page.wait_until("at rest", |print| {
        print["state"] == "paused" && print["left_s"] == Value::Null
    });
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(page.print()["done"], paused["done"]);
    assert_eq!(page.order("override 150"), 202);
    assert_eq!(page.order("flow 90"), 202);
    page.wait_until("at 150 and 90 per cent", |print| {
        print["override_percent"] == 150 && print["flow_percent"] == 90
    });
    assert_eq!(page.order("flow 100"), 202);
    page.wait_until("at 100 per cent", |print| print["flow_percent"] == 100);
    assert_eq!(page.order("resume"), 202);
    page.wait_until("further on", |print| {
        print["done"].as_f64() > paused["done"].as_f64()
    });
    let (well, _, said) = host.end();
    assert!(well, "{said}");
    // All but the extruder, which laid a little less at 90 per cent.
    let joints = expected.as_array().unwrap().len() - 1;
    let stood = counts(&board.end());
    let [stood, expected] = [&stood, &expected].map(|all| &all.as_array().unwrap()[..joints]);
    assert_eq!(stood, expected);
}

#[test]
fn a_page_ends_the_job_and_stops_it_at_once() {
    let folder = folder("ends");
    let (job, _) = job(&folder, 8);
    for (order, tells) in [("abort", "aborted"), ("stop", "fault")] {
        let board = Board::unix(&folder, 1.0);
        let (host, page) = stream(&job, &board);
        page.wait_until("running", |print| print["state"] == "running");
        assert_eq!(page.order(order), 202);
        let last = page.wait_until("over", |print| print["ended"] != Value::Null);
        let (well, _, said) = host.end();
        assert!(!well && said.contains(tells), "{order}: {said}");
        assert!(said.contains(last["ended"].as_str().unwrap()), "{last}");
        board.end();
    }
}

/// Pages that ask as fast as they can, one that connects and says nothing, one that never reads: the
/// motors end where the simulation has them all the same.
#[test]
fn pages_that_hammer_stall_and_hang_up_change_no_step() {
    let folder = folder("hammer");
    let (job, expected) = job(&folder, 4);
    let board = Board::unix(&folder, 2.0);
    let (host, page) = stream(&job, &board);
    page.wait_until("running", |print| print["state"] == "running");
    let mute = TcpStream::connect(&page.host).unwrap();
    let mut deaf = TcpStream::connect(&page.host).unwrap();
    write!(
        deaf,
        "GET /{}/ HTTP/1.1\r\nHost: {}\r\n\r\n",
        page.token, page.host
    )
    .unwrap();
    let (stop, asked) = (
        Arc::new(AtomicBool::new(false)),
        Arc::new(AtomicU32::new(0)),
    );
    let hammer = |_| {
        let (page, stop, asked) = (page.clone(), stop.clone(), asked.clone());
        std::thread::spawn(move || {
            while !stop.load(Ordering::Relaxed) {
                // Hangs up half of the time; the server ends with the print.
                let Ok(mut line) = TcpStream::connect(&page.host) else {
                    return;
                };
                let _ = write!(
                    line,
                    "GET /{}/status HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n",
                    page.token, page.host
                );
                if asked.fetch_add(1, Ordering::Relaxed) % 2 == 0 {
                    let _ = line.read_to_end(&mut Vec::new());
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        })
    };
    let hammers: Vec<_> = (0..3).map(hammer).collect();
    let (well, figures, said) = host.end();
    stop.store(true, Ordering::Relaxed);
    for hammer in hammers {
        hammer.join().unwrap();
    }
    drop((mute, deaf));
    assert!(well, "{said}");
    assert_eq!(figures["reconnects"], 0);
    assert_eq!(counts(&board.end()), expected);
    assert!(asked.load(Ordering::Relaxed) > 100, "{asked:?}");
}

#[test]
fn a_port_that_is_taken_is_told_before_anything_moves() {
    let folder = folder("taken");
    let (job, _) = job(&folder, 1);
    let board = Board::unix(&folder, 20.0);
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let view = ["--view", "--no-open", "--view-port", &port];
    let refused = headway(&[&["stream", &job, "--port", &board.port], &view[..]].concat());
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains(&port), "{}", stderr(&refused));
    assert_eq!(board.end().steps, 0);
}
