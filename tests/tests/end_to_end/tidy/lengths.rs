//! Goal: what is given in mm, mm² or mm³ is in one list, by the reason for it. Method: every constant whose name ends so, in
//! the host and its crates, outside of tests, has a row with its value, and every row its constant; the last table, of what
//! should be a share of the nozzle and is not, only becomes shorter.

use super::{Breaches, ROOT, assert_none, sources};
use std::collections::BTreeSet;
use std::path::Path;

const PAGE: &str = "docs/design/absolute-lengths.md";
/// Constants of the last table: two of them stood as literals in expressions before they had names.
const LEFT_MAX: usize = 40;

/// Name, file and value of each constant of a row.
fn row(line: &str) -> Vec<[String; 3]> {
    let row = line.strip_prefix("| `").unwrap_or_default();
    let (file, constants) = row.split_once("` | ").unwrap_or_default();
    let constants = constants.trim_end_matches(" |").split("; ");
    let pairs = constants.filter_map(|constant| constant.split_once("` "));
    pairs
        .map(|(name, value)| [name.trim_matches('`'), file, value].map(str::to_string))
        .collect()
}

/// Name and value of a constant in mm, mm² or mm³.
fn constant(line: &str) -> Option<[String; 2]> {
    let (_, rest) = line.split_once("const ")?;
    let (name, rest) = rest.split_once(": ")?;
    let is_length = ["_MM", "_MM2", "_MM3"]
        .iter()
        .any(|unit| name.ends_with(unit));
    let value = rest.split_once(" = ")?.1.trim_end_matches(';').to_string();
    is_length.then(|| [name.to_string(), value])
}

#[test]
fn lengths_that_do_not_go_with_the_nozzle_are_listed() {
    let page = std::fs::read_to_string(Path::new(ROOT).join(PAGE)).expect("the list");
    let listed: BTreeSet<[String; 3]> = page.lines().flat_map(row).collect();
    let mut found = BTreeSet::new();
    for source in sources() {
        let is_test = source.name.ends_with("tests.rs") || source.name.contains("/tests/");
        if !source.name.starts_with("host/") || !source.name.contains("/src/") || is_test {
            continue;
        }
        let code = source
            .lines
            .iter()
            .take_while(|line| line.trim() != "#[cfg(test)]");
        for [name, value] in code.filter_map(|line| constant(line)) {
            found.insert([name, source.name.clone(), value]);
        }
    }
    let mut breaches = Breaches(Vec::new());
    for [name, file, value] in found.difference(&listed) {
        breaches
            .0
            .push(format!("{file}: {name} = {value} is not in {PAGE}"));
    }
    for [name, file, value] in listed.difference(&found) {
        breaches
            .0
            .push(format!("{PAGE}: no constant {name} of {value} in {file}"));
    }
    assert_none(&breaches);
    let left = page.rsplit("\n## ").next().expect("a last table");
    let left = left.lines().flat_map(row).count();
    assert!(
        left <= LEFT_MAX,
        "{left} lengths should go with the nozzle and do not"
    );
    assert!(found.len() > left && left > 0);
}
