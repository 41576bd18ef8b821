//! Goal: shells and `man` know every command. Method: ask for scripts and pages, and look in them for
//! the commands and options that the help names.

use crate::rig::{folder, headway, path, stderr, succeeded};

const COMMANDS: [&str; 13] = [
    "plan",
    "compare",
    "headings",
    "reach",
    "simulate",
    "view",
    "export",
    "inspect",
    "stream",
    "board",
    "calibrate",
    "machine",
    "measure",
];

#[test]
fn every_shell_completes_commands_and_options() {
    for shell in ["bash", "zsh", "fish", "powershell"] {
        let script = succeeded(&headway(&["completions", shell]));
        for name in COMMANDS {
            assert!(script.contains(name), "{shell} lacks {name}");
        }
        assert!(script.contains("quality"), "{shell} lacks --quality");
        assert!(script.contains("standard"), "{shell} lacks a value");
    }
    let unknown = headway(&["completions", "tcsh"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(stderr(&unknown).contains("powershell"), "names what it can");
}

#[test]
fn every_command_has_a_page_and_other_files_stay() {
    let folder = folder("man").join("man1");
    std::fs::create_dir_all(&folder).expect("folder");
    let other = folder.join("index.html");
    std::fs::write(&other, "mine").expect("file");
    succeeded(&headway(&["man", "-o", path(&folder)]));
    assert_eq!(std::fs::read_to_string(&other).expect("kept"), "mine");
    for name in COMMANDS {
        let page = std::fs::read_to_string(folder.join(format!("headway-{name}.1")))
            .unwrap_or_else(|problem| panic!("{name}: {problem}"));
        assert!(page.contains(".TH"), "{name}");
    }
    let below = std::fs::read_to_string(folder.join("headway-machine-new.1")).expect("page");
    assert!(below.contains("kind"));
    let first = succeeded(&headway(&["man"]));
    assert!(first.contains("headway\\-plan") && first.contains("Exit status"));
}
