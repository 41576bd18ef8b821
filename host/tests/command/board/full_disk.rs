//! Goal: a log that can no longer be written is reported at once, at the terminal and on the page; the print goes on; and
//! what was written is not taken for a print that a power cut ended. Method: the command may write few bytes into a
//! file, which the system refuses as it refuses them on a full disk.
#![cfg(unix)]

use crate::rig::board::{Board, Host, counts, job};
use crate::rig::{folder, headway, stderr};
use headway::drive::log_place::UNWRITTEN;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};

/// Blocks of 512 bytes that a file may have: the first part of the log.
const BLOCKS_MAX: u32 = 24;

/// The command, with room for so much in each file.
fn with_little_room(arguments: &[&str]) -> Host {
    let mut command = Command::new("sh");
    command
        .arg("-c")
        // Without the trap the system ends whoever writes further.
        .arg(format!("trap '' XFSZ; ulimit -f {BLOCKS_MAX}; exec \"$@\""))
        .args(["sh", env!("CARGO_BIN_EXE_headway")])
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    Host::of(command)
}

/// What the page says of the print.
fn status(url: &str) -> String {
    let (host, path) = url.split_once('/').unwrap();
    let mut line = TcpStream::connect(host).unwrap();
    write!(line, "GET /{path}status HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
    let mut answer = String::new();
    line.read_to_string(&mut answer).unwrap();
    answer
}

#[test]
fn a_full_disk_is_reported_at_once_and_resume_names_the_last_place() {
    let folder = folder("full");
    let (job, expected) = job(&folder, 4);
    let log = folder.join("print.log").display().to_string();
    let board = Board::unix(&folder, 2.0);
    let stream = ["stream", &job, "--port", &board.port, "--log", &log];
    let host = with_little_room(&[&stream[..], &["--view", "--no-open", "--json"]].concat());
    host.wait_for("the log cannot be written any further");
    let said = host.said.lock().unwrap().clone();
    let url = said.split("page: http://").nth(1).unwrap();
    let on_page = status(url.lines().next().unwrap());
    assert!(on_page.contains("the log cannot be written"), "{on_page}");
    assert!(on_page.contains("\"ended\":null"), "{on_page}");
    let (_, _, said) = host.end();
    // The print was done all the same.
    assert_eq!(counts(&board.end()), expected, "{said}");

    let text = std::fs::read_to_string(&log).unwrap();
    assert_eq!(text.lines().last(), Some(UNWRITTEN));
    assert!(text.len() <= 512 * BLOCKS_MAX as usize * 2);
    let board = Board::unix(&folder, 20.0);
    let resumed = headway(&["stream", &job, "--port", &board.port, "--resume-from", &log]);
    assert_eq!(resumed.status.code(), Some(1));
    let said = stderr(&resumed);
    assert!(
        said.contains("the last place it knows is pass 0, layer 1 of 1"),
        "{said}"
    );
    assert!(said.contains("--resume-from pass:N"), "{said}");
    assert_eq!(board.end().steps, 0);
}
