//! Goal: a path of a source file that a page names leads to that file. Method: every `path/file.rs` between
//! backticks of every page is the end of a source file's path.

use super::{ROOT, rust_files};
use std::fmt::Write;
use std::path::{Path, PathBuf};

pub fn pages(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("folder entry").path();
        let name = path.file_name().expect("a name").to_string_lossy();
        if path.is_dir() {
            if name != "target" && !name.starts_with('.') && name != "node_modules" {
                pages(&path, found);
            }
        } else if name.ends_with(".md") {
            found.push(path);
        }
    }
}

/// What is between backticks and ends on `.rs`, with its line.
fn named(text: &str) -> Vec<(usize, &str)> {
    let lines = text.lines().enumerate();
    let words = lines.flat_map(|(number, line)| {
        let quoted = line.split('`').skip(1).step_by(2);
        quoted.map(move |word| (number + 1, word))
    });
    let is_path = |word: &str| word.ends_with(".rs") && !word.contains(['*', '<', '{', ' ']);
    words.filter(|(_, word)| is_path(word)).collect()
}

#[test]
fn every_source_file_that_a_page_names_is_there() {
    let (mut files, mut found) = (Vec::new(), Vec::new());
    for package in ["protocol", "firmware", "host", "tests", "fuzz", "python"] {
        rust_files(&Path::new(ROOT).join(package), &mut files);
    }
    let files: Vec<String> = files
        .iter()
        .map(|file| format!("/{}", file.display()))
        .collect();
    pages(Path::new(ROOT), &mut found);
    let (mut missing, mut count) = (String::new(), 0);
    for page in found {
        let text = std::fs::read_to_string(&page).expect("a page");
        for (line, path) in named(&text) {
            count += 1;
            let end = format!("/{path}");
            if !files.iter().any(|file| file.ends_with(&end)) {
                let _ = writeln!(missing, "{}:{line}: no file {path}", page.display());
            }
        }
    }
    assert!(missing.is_empty(), "{missing}");
    // The rule is about something only if paths were found.
    assert!(count > 40, "only {count} paths found");
}
