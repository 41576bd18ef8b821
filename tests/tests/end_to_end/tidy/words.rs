//! Goal: words that a reader of the field stumbles over do not come back. Method: none of the phrases below stands in a
//! source file or on a page; the glossary (docs/glossary.md) says what we say instead.

use super::doc_paths::pages;
use super::{Breaches, ROOT, assert_none, rust_files};
use std::path::Path;

/// Phrases, and what stands in their place.
const BANNED: [(&str, &str); 8] = [
    ("behind a power cut", "after a power failure"),
    ("numbers that are none", "values that are not numbers"),
    ("no chords of its own", "does not split into chords"),
    ("Whose it is", "who owns it"),
    ("has_arcs_unasked", "writes_arcs_by_default"),
    ("Draught", "HeatLoad"),
    ("disobey", "stays on"),
    ("head touch is told", "collisions are reported"),
];

fn breaches_of(name: &str, text: &str) -> Vec<String> {
    let lines = text.lines().enumerate();
    let found = lines.flat_map(|(number, line)| {
        let banned = BANNED.iter().filter(|(phrase, _)| line.contains(phrase));
        banned.map(move |(phrase, instead)| {
            format!("{name}:{}: \"{phrase}\": say \"{instead}\"", number + 1)
        })
    });
    found.collect()
}

#[test]
fn words_that_are_not_used_do_not_come_back() {
    let root = Path::new(ROOT);
    let mut files = Vec::new();
    for package in ["protocol", "firmware", "host", "python", "fuzz"] {
        rust_files(&root.join(package), &mut files);
    }
    pages(&root.join("docs/guide"), &mut files);
    pages(&root.join("docs/design"), &mut files);
    files.extend(["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"].map(|page| root.join(page)));
    let mut breaches = Breaches(Vec::new());
    for file in &files {
        let text = std::fs::read_to_string(file).expect("a text");
        breaches
            .0
            .extend(breaches_of(&file.display().to_string(), &text));
    }
    assert_none(&breaches);
    assert!(files.len() > 500, "only {} files read", files.len());
    // The rule can fail.
    assert_eq!(breaches_of("a", "x\nbehind a power cut").len(), 1);
}
