//! Goal: neither a full disk nor the end of the program in mid-write costs a good file, and a report is
//! whole or none. Method: the command with every output that it writes, over files that are there,
//! under the system's limit on a file's size: as an error of the write (the disk is full), and as the
//! signal that ends the program there.
#![cfg(unix)]

use crate::rig::{example, folder, headway, path, stderr, succeeded};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, Output};

/// The command where no file may be longer than `blocks` of 512 bytes.
fn headway_within(blocks: u32, is_killed: bool, arguments: &[&str]) -> Output {
    let trap = if is_killed { "" } else { "trap '' XFSZ; " };
    Command::new("sh")
        .args([
            "-c",
            &format!("{trap}ulimit -c 0; ulimit -f {blocks}; exec \"$0\" \"$@\""),
        ])
        .arg(env!("CARGO_BIN_EXE_headway"))
        .args(arguments)
        .output()
        .expect("the command starts")
}

/// Every file below, its name and what is in it.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("folder") {
        let path = entry.expect("entry").path();
        match path.is_dir() {
            true => found.extend(contents(&path)),
            false => found.push((
                path.display().to_string(),
                std::fs::read(&path).expect("file"),
            )),
        }
    }
    found.sort();
    found
}

/// Each command, the outputs that it writes.
fn writers(folder: &Path) -> Vec<Vec<String>> {
    let at = |name: &str| folder.join(name).display().to_string();
    let (input, job) = (example("taper.json"), at("taper.hwj"));
    let lines: [&[&str]; 6] = [
        &["plan", &input, "-o", &job],
        &["export", &job, "--to", "csv", "-o", &at("poses.csv")],
        &["export", &job, "--to", "svg", "-o", &at("picture.svg")],
        &["headings", &input, "-o", &at("headings.csv")],
        &["simulate", &job, "--trace", &at("trace.csv")],
        &["simulate", &job, "--report", &at("report")],
    ];
    let own = |line: &&[&str]| line.iter().map(|word| word.to_string()).collect();
    lines.iter().map(own).collect()
}

#[test]
fn no_good_file_is_lost_to_a_full_disk_or_a_kill() {
    let folder = folder("full");
    let lines = writers(&folder);
    let lines: Vec<Vec<&str>> = lines
        .iter()
        .map(|line| line.iter().map(String::as_str).collect())
        .collect();
    for line in &lines {
        succeeded(&headway(line));
    }
    let good = contents(&folder);
    assert_eq!(good.len(), 8);
    for line in &lines {
        // The report's figures still fit, its pictures do not.
        let output = headway_within(8, false, line);
        assert_eq!(
            output.status.code(),
            Some(1),
            "{line:?}: {}",
            stderr(&output)
        );
        assert!(stderr(&output).contains("too large"), "{}", stderr(&output));
        assert_eq!(contents(&folder), good, "{line:?}");
    }
    for line in &lines {
        let output = headway_within(8, true, line);
        // SIGXFSZ is 25 on all that this runs on.
        assert_eq!(
            output.status.signal(),
            Some(25),
            "{line:?}: {}",
            stderr(&output)
        );
        let mut left = contents(&folder);
        left.retain(|(name, _)| !name.contains(".part"));
        assert_eq!(left, good, "{line:?}");
    }
}

#[test]
fn a_report_that_fails_leaves_none() {
    let folder = folder("none");
    let report = folder.join("report");
    let input = example("taper.json");
    let arguments = ["simulate", &input, "--report", path(&report)];
    let output = headway_within(8, false, &arguments);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert_eq!(std::fs::read_dir(&folder).expect("folder").count(), 0);
    succeeded(&headway(&arguments));
    assert!(report.join("index.html").is_file());
    assert_eq!(std::fs::read_dir(&folder).expect("folder").count(), 1);
}

/// Somebody's folder that a report is to go to stays as it is, before and without any planning.
#[test]
fn a_report_does_not_replace_other_pages() {
    let site = folder("site");
    std::fs::write(site.join("index.html"), "<html>mine</html>").expect("file");
    let input = example("taper.json");
    for command in ["simulate", "view"] {
        let output = headway(&[command, &input, "--report", path(&site)]);
        assert_eq!(output.status.code(), Some(2));
        let told = stderr(&output);
        assert!(
            told.contains("index.html") && told.contains("another folder"),
            "{told}"
        );
        let kept = std::fs::read_to_string(site.join("index.html")).expect("kept");
        assert_eq!(kept, "<html>mine</html>");
        assert_eq!(std::fs::read_dir(&site).expect("folder").count(), 1);
    }
}

/// What is no file is written as it comes, and a link stays one.
#[test]
fn devices_and_links_are_written_through() {
    let folder = folder("devices");
    let input = example("taper.json");
    succeeded(&headway(&["headings", &input, "-o", "/dev/null"]));
    let full = headway(&["headings", &input, "-o", "/dev/full"]);
    assert_eq!(full.status.code(), Some(1), "{}", stderr(&full));
    assert!(stderr(&full).contains("/dev/full"));
    let [file, link] = ["file.csv", "link.csv"].map(|name| folder.join(name));
    std::fs::write(&file, "").expect("file");
    std::os::unix::fs::symlink(&file, &link).expect("link");
    succeeded(&headway(&["headings", &input, "-o", path(&link)]));
    assert!(link.is_symlink() && std::fs::metadata(&file).expect("file").len() > 1000);
}
