//! Goal: imports between rooms run one way. Method: the rooms of a crate stand in a list; a file names only its own room and
//! those before it. `tools/rooms.py` counts rooms, arrows and circles.

use super::{Breaches, Source, assert_none, code, sources};
use std::collections::BTreeSet;

/// A crate's folder, how its files name it, and its rooms from the lowest on.
struct House {
    folder: &'static str,
    prefix: &'static str,
    rooms: &'static [&'static str],
}

const HOUSES: [House; 3] = [
    House {
        folder: "firmware/src/",
        prefix: "crate::",
        rooms: &[
            "log",
            "design",
            "numbers",
            "configuration",
            "kinematics",
            "steps",
            "checks",
            "flow",
            "path",
            "motion",
            "heat",
            "drivers",
            "settings",
            "line",
            "machine",
            "board",
        ],
    },
    House {
        folder: "host/src/",
        prefix: "crate::",
        rooms: &[
            "text",
            "settings",
            "mesh",
            "job",
            "report",
            "gcode",
            "bed_mesh",
            "input",
            "drive",
            "plan",
            "calibration",
            "joint_export",
            "programs",
            "scan",
            "pipeline",
            "api",
            "cli",
        ],
    },
    House {
        folder: "host/src/cli/",
        prefix: "crate::cli::",
        rooms: &[
            "error", "args", "terminal", "reading", "plan", "job", "replan", "compare", "live",
            "board", "stream", "machine", "shell",
        ],
    },
];
/// Crates that `headway` offers under names of its own.
const CRATES: [&str; 2] = ["geometry", "reach"];

fn word(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_');
    &text[..end.unwrap_or(text.len())]
}

pub fn check_order(source: &Source, breaches: &mut Breaches) {
    for house in &HOUSES {
        let Some(below) = source.name.strip_prefix(house.folder) else {
            continue;
        };
        let own = word(below);
        // The crate's or room's own map names all, and binaries see the library from outside.
        if ["lib", "main", "mod", "bin"].contains(&own) {
            continue;
        }
        let place = |room: &str| house.rooms.iter().position(|name| *name == room);
        let Some(floor) = place(own) else {
            breaches.add(source, 0, &format!("{own} is no room of {}", house.folder));
            continue;
        };
        for (number, line) in source.lines.iter().enumerate() {
            for named in code(line).split(house.prefix).skip(1) {
                let named = word(named);
                if CRATES.contains(&named) {
                    continue;
                }
                match place(named) {
                    Some(room) if room <= floor => {}
                    _ => {
                        let rule = format!("{own} imports from a later room ({named})");
                        breaches.add(source, number, &rule);
                    }
                }
            }
        }
    }
}

#[test]
fn rooms_import_from_earlier_ones() {
    let mut breaches = Breaches(Vec::new());
    let mut met = BTreeSet::new();
    for source in sources() {
        check_order(&source, &mut breaches);
        for (number, house) in HOUSES.iter().enumerate() {
            let below = source.name.strip_prefix(house.folder).map(word);
            met.extend(below.map(|room| (number, room.to_string())));
        }
    }
    assert_none(&breaches);
    for (number, house) in HOUSES.iter().enumerate() {
        for room in house.rooms {
            assert!(
                met.contains(&(number, (*room).to_string())),
                "{}{room} is not there",
                house.folder
            );
        }
    }
}

/// A room of the firmware says what comes in and goes out.
#[test]
fn heads_of_the_firmwares_rooms_say_what_comes_in_and_goes_out() {
    let mut breaches = Breaches(Vec::new());
    let mut count = 0;
    for source in sources() {
        let below = source.name.strip_prefix(HOUSES[0].folder);
        let parts = below.and_then(|below| below.split_once('/'));
        if parts.is_none_or(|(room, file)| room == "bin" || file != "mod.rs") {
            continue;
        }
        count += 1;
        let lines = source.lines.iter();
        let head = lines.take_while(|line| line.starts_with("//!"));
        let head: String = head.map(|line| format!("{line} ")).collect();
        if !head.contains("In: ") || !head.contains("Out: ") {
            breaches.add(&source, 0, "the head says what comes in and goes out");
        }
    }
    assert_none(&breaches);
    assert!(count > 10, "only {count} rooms found");
}

/// Goal: the machines of the examples are those that `headway machine new` writes. Method: the command's own files, which its
/// package has to contain, byte for byte beside the examples.
#[test]
fn example_machines_are_those_of_the_command() {
    let root = std::path::Path::new(super::ROOT);
    let mut seen = 0;
    for entry in std::fs::read_dir(root.join("host/machines")).expect("the command's machines") {
        let own = entry.expect("an entry").path();
        let name = own.file_name().expect("a name");
        let shown = std::fs::read(root.join("examples/machines").join(name)).expect("an example");
        assert!(
            std::fs::read(&own).expect("a file") == shown,
            "{name:?} is another machine in examples/machines"
        );
        seen += 1;
    }
    assert!(seen >= 6, "{seen} machines");
}
