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

/// A table's rows, with the column of a name.
pub struct Table {
    pub head: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

impl Table {
    pub fn of(csv: &str) -> Table {
        let cells = |line: &str| line.split(',').map(str::to_string).collect::<Vec<_>>();
        let mut lines = csv.lines();
        let head = cells(lines.next().expect("head"));
        let rows: Vec<_> = lines.map(cells).collect();
        assert!(rows.iter().all(|row| row.len() == head.len()));
        Table { head, rows }
    }

    pub fn texts(&self, name: &str) -> Vec<&str> {
        let at = self.head.iter().position(|head| head == name);
        let at = at.unwrap_or_else(|| panic!("no {name} in {:?}", self.head));
        self.rows.iter().map(|row| row[at].as_str()).collect()
    }

    pub fn column(&self, name: &str) -> Vec<f64> {
        let texts = self.texts(name).into_iter();
        texts.map(|text| text.parse().expect("number")).collect()
    }
}

/// An ASCII STL of triangles, mm.
pub fn stl(triangles: impl IntoIterator<Item = [[f64; 3]; 3]>) -> String {
    let mut text = String::from("solid part\n");
    for triangle in triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        for [x, y, z] in triangle {
            text += &format!("vertex {x} {y} {z}\n");
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid part\n"
}

/// The triangles of a box between its least and its greatest corner.
pub fn box_triangles(corners: [[f64; 3]; 2]) -> Vec<[[f64; 3]; 3]> {
    let faces = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let halves = faces
        .into_iter()
        .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
    let corner = |number: usize| [0, 1, 2].map(|axis| corners[number >> axis & 1][axis]);
    halves.map(|half| half.map(corner)).collect()
}
