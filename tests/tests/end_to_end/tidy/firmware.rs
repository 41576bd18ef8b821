//! Rules of the firmware alone: the order of its rooms, and what the head of each says.

use super::{Breaches, Source, assert_none, code, sources};
use std::collections::BTreeSet;

/// Rooms of the library in the order of imports: a room imports only from those before it.
const ROOMS: [&str; 16] = [
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
];
const LIBRARY: &str = "firmware/src/";
/// Binaries of boards, which see the library from outside.
const BINARIES: &str = "bin/";

/// The room that a path of the library belongs to, as its place in [`ROOMS`].
fn room_of(path: &str) -> Option<usize> {
    let name = path.split([':', '/', '.', ';', ' ', ',', '}']).next()?;
    ROOMS.iter().position(|room| *room == name)
}

/// A path in the library, of files that are in a room.
fn below(source: &Source) -> Option<&str> {
    let below = source.name.strip_prefix(LIBRARY)?;
    (below != "lib.rs" && !below.starts_with(BINARIES)).then_some(below)
}

pub fn check_rooms_of_firmware(source: &Source, breaches: &mut Breaches) {
    let Some(below) = below(source) else {
        return;
    };
    let Some(own) = room_of(below) else {
        breaches.add(source, 0, "a file of the firmware belongs to a room");
        return;
    };
    for (number, line) in source.lines.iter().enumerate() {
        for named in code(line).split("crate::").skip(1) {
            match room_of(named) {
                Some(room) if room <= own => {}
                _ => breaches.add(
                    source,
                    number,
                    &format!("room {} imports from a later one", ROOMS[own]),
                ),
            }
        }
    }
}

#[test]
fn rooms_of_the_firmware_import_from_earlier_ones() {
    let mut breaches = Breaches(Vec::new());
    let mut met = BTreeSet::new();
    for source in sources() {
        check_rooms_of_firmware(&source, &mut breaches);
        met.extend(below(&source).and_then(room_of));
    }
    assert_none(&breaches);
    assert_eq!(met.len(), ROOMS.len(), "a room of the list is not there");
}

#[test]
fn a_room_says_what_comes_in_and_goes_out() {
    let mut breaches = Breaches(Vec::new());
    let mut count = 0;
    for source in sources() {
        let parts = below(&source).and_then(|below| below.split_once('/'));
        if parts.is_none_or(|(_, file)| file != "mod.rs") {
            continue;
        }
        count += 1;
        let head = source
            .lines
            .iter()
            .take_while(|line| line.starts_with("//!"));
        let head: String = head.map(|line| format!("{line} ")).collect();
        if !head.contains("In: ") || !head.contains("Out: ") {
            breaches.add(&source, 0, "the head says what comes in and goes out");
        }
    }
    assert_none(&breaches);
    assert!(count > 10, "only {count} rooms found");
}
