//! Goal: the house rules hold without anybody watching: modules import one way, files and functions
//! stay short, nothing can panic where a hot nozzle moves. Method: read every source line; a breach
//! names file, line and rule.
//!
//! It reads text, not syntax: it leans on rustfmt's layout (checked on its own) and on `use` lines
//! and paths that begin with `crate::` or a package's name.

mod constants;
mod doc_paths;
mod lengths;
mod planner;
mod rooms;
mod words;

use planner::check_stages;
use rooms::check_order;
use std::fmt::Write;
use std::path::{Path, PathBuf};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
/// Longest file, without its tests: 500, and what rustfmt adds to a file that kept to it.
const FILE_LINES_MAX: usize = 510;
/// Longest function, first to last line.
const FUNCTION_LINES_MAX: usize = 75;
/// Longest line: rustfmt's 100, comments that it leaves alone somewhat longer; a message alone on
/// its line may be as long as it is.
const LINE_CHARS_MAX: usize = 130;

/// One source file, its tests cut off (the lines stay, empty, so that numbers are true).
struct Source {
    name: String,
    lines: Vec<String>,
    code_lines: usize,
}

struct Breaches(Vec<String>);

impl Breaches {
    fn add(&mut self, source: &Source, line: usize, rule: &str) {
        self.0.push(format!("{}:{}: {rule}", source.name, line + 1));
    }
}

/// (module, what its files may not name, why). A module is a path prefix; the longest match wins
/// nothing: all rules whose prefix matches apply.
const MODULES: [(&str, &[&str], &str); 15] = [
    (
        "protocol/src/",
        &["headway_firmware", "headway::", "headway_tests", "std::"],
        "protocol is no_std and imports nothing of ours",
    ),
    (
        "firmware/src/",
        &["headway::", "headway_tests", "std::"],
        "firmware is no_std and imports protocol only",
    ),
    ("host/", &["headway_tests"], "host never imports tests"),
    (
        "host/geometry/src/",
        &["headway::", "headway_", "std::fs"],
        "geometry knows no planning and nothing of ours",
    ),
    (
        "host/optimiser/src/",
        &[
            "headway::",
            "headway_firmware",
            "headway_protocol",
            "std::fs",
        ],
        "the optimiser knows geometry only",
    ),
    (
        "host/reach/src/",
        &["headway::", "headway_", "std::fs"],
        "reach knows neither machines nor planning and nothing of ours",
    ),
    (
        "host/src/settings",
        &[
            "crate::plan",
            "crate::drive",
            "crate::cli",
            "crate::report",
            "crate::input",
        ],
        "settings know geometry and the machine only",
    ),
    (
        "host/src/input/",
        &[
            "crate::plan",
            "crate::drive",
            "crate::cli",
            "crate::report",
            "std::fs",
        ],
        "input turns bytes into regions: no planning, no files",
    ),
    (
        "host/src/mesh/",
        &[
            "crate::plan",
            "crate::drive",
            "crate::cli",
            "crate::report",
            "crate::input",
            "std::fs",
        ],
        "mesh turns bytes into regions by layer: no planning, no files",
    ),
    (
        "host/src/gcode/",
        &[
            "crate::plan",
            "crate::drive",
            "crate::cli",
            "crate::report",
            "crate::input",
            "std::fs",
        ],
        "gcode turns bytes into passes and streams into bytes: no planning, no files",
    ),
    (
        "host/src/plan/",
        &[
            "crate::drive",
            "crate::cli",
            "crate::report",
            "std::fs",
            "std::net",
            "std::thread",
            "std::time",
        ],
        "a stage of plan knows geometry, settings and the stage before it: no clock, file or thread",
    ),
    (
        "host/src/drive/",
        &["crate::plan", "crate::cli", "crate::input", "crate::report"],
        "drive moves segments and never imports plan",
    ),
    (
        "host/src/report/",
        &[
            "crate::plan",
            "crate::drive",
            "crate::cli",
            "crate::input",
            "std::fs",
        ],
        "report draws plain structs: no stages, no files",
    ),
    (
        "host/src/job/",
        &["crate::plan", "crate::drive", "crate::cli"],
        "job is a contract",
    ),
    (
        "host/src/pipeline/",
        &["crate::cli", "std::fs", "std::net", "std::thread"],
        "the pipeline knows no command line, file or thread",
    ),
];

/// Absolute paths of somebody's machine; /tmp and devices may be spoken of.
const FOREIGN: [&str; 3] = ["/home/", "/Users/", "/root/"];

/// What may not happen on the controller: a panic.
const PANICS: [&str; 8] = [
    ".unwrap()",
    ".expect(",
    "panic!(",
    "unreachable!(",
    "todo!(",
    "unimplemented!(",
    "assert!(",
    "assert_eq!(",
];
/// What is not left behind on the host.
const LEFTOVERS: [&str; 4] = ["todo!(", "unimplemented!(", "dbg!(", ".unwrap()"];

fn rust_files(folder: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    let mut paths: Vec<PathBuf> = entries.map(|e| e.expect("folder entry").path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            if path.file_name().is_none_or(|name| name != "target") {
                rust_files(&path, found);
            }
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            found.push(path);
        }
    }
}

fn sources() -> Vec<Source> {
    let mut files = Vec::new();
    for package in ["protocol", "firmware", "host", "tests"] {
        rust_files(&PathBuf::from(ROOT).join(package), &mut files);
    }
    let sources: Vec<Source> = files.iter().map(|path| source(path)).collect();
    // The rules are about something only if the files were found.
    assert!(sources.len() > 30, "only {} files found", sources.len());
    sources
}

fn source(path: &Path) -> Source {
    let text = std::fs::read_to_string(path).expect("source file");
    let name = path
        .strip_prefix(ROOT)
        .expect("below the root")
        .to_string_lossy()
        .into_owned();
    let file = path
        .file_name()
        .map(|f| f.to_string_lossy().into_owned())
        .unwrap_or_default();
    let is_test = name.starts_with("tests/")
        || name.contains("/tests/")
        || file.ends_with("tests.rs")
        || file.starts_with("test_");
    let all: Vec<&str> = text.lines().collect();
    let mut lines = Vec::with_capacity(all.len());
    let mut in_tests = is_test;
    let mut skip = 0;
    for (number, line) in all.iter().enumerate() {
        if *line == "#[cfg(test)]" {
            // `mod tests;` is an item of one line, `mod tests {` is the rest of the file.
            let item = all[number..]
                .iter()
                .find(|l| !l.starts_with("#["))
                .unwrap_or(&"");
            if item.ends_with(';') {
                skip = 1 + all[number..].iter().position(|l| l == item).unwrap_or(0);
            } else if item.starts_with("mod ") || item.starts_with("pub mod ") {
                in_tests = true;
            }
        }
        if in_tests || skip > 0 {
            skip = skip.max(1) - 1;
            lines.push(String::new());
        } else {
            lines.push((*line).to_string());
        }
    }
    let code_lines = lines
        .iter()
        .rposition(|line| !line.is_empty())
        .map_or(0, |k| k + 1);
    Source {
        name,
        lines,
        code_lines,
    }
}

fn code(line: &str) -> &str {
    let trimmed = line.trim_start();
    if trimmed.starts_with("//") {
        ""
    } else {
        trimmed
    }
}

fn check_rooms(source: &Source, breaches: &mut Breaches) {
    for (module, forbidden, why) in MODULES {
        if !source.name.starts_with(module) {
            continue;
        }
        for (number, line) in source.lines.iter().enumerate() {
            let code = code(line);
            for name in forbidden {
                if code.contains(name) {
                    breaches.add(source, number, &format!("names {name}: {why}"));
                }
            }
        }
    }
}

fn check_panics(source: &Source, breaches: &mut Breaches) {
    let on_controller = ["protocol/src/", "firmware/src/"]
        .iter()
        .any(|module| source.name.starts_with(module));
    let words: &[&str] = if on_controller { &PANICS } else { &LEFTOVERS };
    for (number, line) in source.lines.iter().enumerate() {
        let code = code(line);
        for word in words {
            // Compile-time and debug assertions cost nothing on the controller: those of a board's table are in
            // constants, as the images show that link only if no panic can be reached.
            let harmless = code.contains("debug_assert")
                || code.contains("const _: () = assert!(")
                || source.name == "firmware/src/board/table.rs";
            if code.contains(word) && !harmless {
                breaches.add(source, number, &format!("{word} outside tests"));
            }
        }
    }
}

fn check_lengths(source: &Source, breaches: &mut Breaches) {
    if source.code_lines > FILE_LINES_MAX {
        let rule = format!(
            "file of {} lines, at most {FILE_LINES_MAX}",
            source.code_lines
        );
        breaches.add(source, source.code_lines - 1, &rule);
    }
    let mut start: Option<(usize, usize)> = None;
    for (number, line) in source.lines.iter().enumerate() {
        let indent = line.len() - line.trim_start().len();
        let code = code(line);
        let head = [
            "fn ",
            "pub fn ",
            "pub(crate) fn ",
            "pub(super) fn ",
            "const fn ",
            "pub const fn ",
        ];
        if head.iter().any(|h| code.starts_with(h)) && !code.ends_with(';') {
            start = Some((number, indent));
        }
        if let Some((first, its_indent)) = start
            && indent == its_indent
            && code == "}"
        {
            let length = number + 1 - first;
            if length > FUNCTION_LINES_MAX {
                let rule = format!("function of {length} lines, at most {FUNCTION_LINES_MAX}");
                breaches.add(source, first, &rule);
            }
            start = None;
        }
    }
}

fn check_text(path: &Path, name: &str, breaches: &mut Breaches) {
    let text = std::fs::read_to_string(path).expect("source file");
    let source = Source {
        name: name.to_string(),
        lines: Vec::new(),
        code_lines: 0,
    };
    if !text.starts_with("//!") {
        breaches.add(&source, 0, "a file begins with what it is for (//!)");
    }
    if !text.ends_with('\n') || text.ends_with("\n\n") {
        breaches.add(
            &source,
            text.lines().count() - 1,
            "a file ends with one line break",
        );
    }
    for (number, line) in text.lines().enumerate() {
        if line.contains('\t') {
            breaches.add(&source, number, "a tab");
        }
        if line.ends_with(' ') {
            breaches.add(&source, number, "white space at the end");
        }
        let message = line.trim_start().starts_with('"');
        if !message && line.chars().count() > LINE_CHARS_MAX {
            breaches.add(&source, number, "a line of more than 130 characters");
        }
        // This file has to spell what it looks for.
        if name != "tests/tests/end_to_end/tidy/mod.rs"
            && FOREIGN.iter().any(|word| line.contains(word))
        {
            breaches.add(&source, number, "names a place of somebody's machine");
        }
    }
}

fn assert_none(breaches: &Breaches) {
    let mut text = String::new();
    for breach in &breaches.0 {
        writeln!(text, "{breach}").expect("to memory");
    }
    assert!(
        breaches.0.is_empty(),
        "{} breaches:\n{text}",
        breaches.0.len()
    );
}

#[test]
fn modules_import_one_way() {
    let mut breaches = Breaches(Vec::new());
    for source in sources() {
        check_rooms(&source, &mut breaches);
    }
    assert_none(&breaches);
}

#[test]
fn nothing_panics_on_the_controller() {
    let mut breaches = Breaches(Vec::new());
    for source in sources() {
        check_panics(&source, &mut breaches);
    }
    assert_none(&breaches);
}

#[test]
fn files_and_functions_are_short() {
    let mut breaches = Breaches(Vec::new());
    for source in sources() {
        check_lengths(&source, &mut breaches);
    }
    assert_none(&breaches);
}

#[test]
fn text_is_clean() {
    let mut breaches = Breaches(Vec::new());
    let mut files = Vec::new();
    for package in ["protocol", "firmware", "host", "tests"] {
        rust_files(&PathBuf::from(ROOT).join(package), &mut files);
    }
    for path in files {
        let name = path
            .strip_prefix(ROOT)
            .expect("below the root")
            .to_string_lossy()
            .into_owned();
        check_text(&path, &name, &mut breaches);
    }
    assert_none(&breaches);
}

#[test]
fn the_rules_can_fail() {
    let bad = Source {
        name: "host/src/drive/bad.rs".to_string(),
        lines: vec![
            "use crate::plan::route::moves::Route;".to_string(),
            "    x.unwrap()".to_string(),
        ],
        code_lines: 511,
    };
    let circle = Source {
        name: "host/src/plan/axis/bad.rs".to_string(),
        lines: vec!["use crate::plan::beads::passes;".to_string()],
        code_lines: 1,
    };
    let upwards = Source {
        name: "host/src/job/bad.rs".to_string(),
        lines: vec!["use crate::pipeline::Plan;".to_string()],
        code_lines: 1,
    };
    let of_firmware = Source {
        name: "firmware/src/steps/bad.rs".to_string(),
        lines: vec!["use crate::motion::Motion;".to_string()],
        code_lines: 1,
    };
    let mut breaches = Breaches(Vec::new());
    check_rooms(&bad, &mut breaches);
    check_order(&upwards, &mut breaches);
    check_panics(&bad, &mut breaches);
    check_lengths(&bad, &mut breaches);
    check_stages(&circle, &mut breaches);
    check_order(&of_firmware, &mut breaches);
    let expected = [
        "host/src/drive/bad.rs:1: names crate::plan: drive moves segments and never imports plan",
        "host/src/job/bad.rs:1: job imports from a later room (pipeline)",
        "host/src/drive/bad.rs:2: .unwrap() outside tests",
        "host/src/drive/bad.rs:511: file of 511 lines, at most 510",
        "host/src/plan/axis/bad.rs:1: stage axis imports from a later one",
        "firmware/src/steps/bad.rs:1: steps imports from a later room (motion)",
    ];
    assert_eq!(breaches.0, expected);
}
