//! What the tests of the command share: the command itself, and ([`board`]) boards to talk to.

#[cfg(unix)]
pub mod board;

use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

pub fn example(name: &str) -> String {
    format!("{EXAMPLES}/{name}")
}

/// An empty folder of its own for one test: its name begins with that of the test's file.
#[track_caller]
pub fn folder(test: &str) -> PathBuf {
    let caller = Path::new(std::panic::Location::caller().file());
    let file = caller.file_stem().unwrap_or_default().to_string_lossy();
    let name = format!("{file}-{test}");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("temporary folder");
    folder
}

/// The command with its pipes, not yet begun.
pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
    command
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

pub fn headway_with(threads: &str, arguments: &[&str]) -> Output {
    command(arguments)
        .env("RAYON_NUM_THREADS", threads)
        .output()
        .expect("the command starts")
}

pub fn headway(arguments: &[&str]) -> Output {
    headway_with("2", arguments)
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("text")
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("text")
}

pub fn succeeded(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{}", stderr(output));
    stdout(output)
}

pub fn object(output: &Output) -> Map<String, Value> {
    serde_json::from_str(&succeeded(output)).expect("one object")
}

pub fn path(path: &Path) -> &str {
    path.to_str().expect("UTF-8 path")
}
