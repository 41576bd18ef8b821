//! Goal: every number that the planner was given has its reason. Method: every numeric constant of the planner and of the
//! optimiser, outside of tests, has a comment, or follows one that has; a constant whose comment speaks of trials has a row
//! in the list of fitted ones, and every row its constant; fitted constants, and numbers without a name, only become fewer.

use super::planner::{OPTIMISER, PLAN};
use super::{Breaches, ROOT, assert_none, code, sources};
use std::collections::BTreeSet;
use std::path::Path;

const PAGE: &str = "docs/design/planner-constants.md";
/// Numbers with a point that have no name, but for those of [`is_plain`].
const UNNAMED_MAX: usize = 70;
/// Words of a numeric type; names of constants are lengths of arrays.
const NUMERIC: [&str; 16] = [
    "f64",
    "f32",
    "usize",
    "isize",
    "u8",
    "u16",
    "u32",
    "u64",
    "i8",
    "i16",
    "i32",
    "i64",
    "Vector2",
    "RangeInclusive",
    "std",
    "ops",
];

/// A constant of a file: where it is named, whether it has a comment, and whether that speaks of trials.
struct Constant {
    line: usize,
    name: String,
    has_comment: bool,
    is_from_trials: bool,
}

/// The name that the page gives a file of the planner or the optimiser.
fn short_name(source: &str) -> Option<String> {
    let of_optimiser = source.strip_prefix("host/");
    let of_optimiser = of_optimiser.filter(|_| source.starts_with(OPTIMISER));
    source
        .strip_prefix(PLAN)
        .or(of_optimiser)
        .map(str::to_string)
}

fn is_numeric(of_type: &str) -> bool {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let words = of_type.split(|c| !is_name(c));
    let mut words = words.filter(|word| word.starts_with(|c: char| c.is_ascii_alphabetic()));
    let is_constant = |word: &str| !word.contains(|c: char| c.is_ascii_lowercase());
    !of_type.contains('&') && words.all(|word| NUMERIC.contains(&word) || is_constant(word))
}

/// Where a constant begins on this line, from its name on.
fn declared(line: &str) -> Option<&str> {
    let (before, rest) = code(line).split_once("const ")?;
    let is_declared = before.is_empty() || before.starts_with("pub") && before.ends_with(' ');
    let has_name = rest.starts_with(|c: char| c.is_ascii_uppercase());
    (is_declared && has_name).then_some(rest)
}

/// The numeric constants of a file, and the text of all that is no constant and no comment.
fn read(lines: &[String]) -> (Vec<Constant>, Vec<(usize, &str)>) {
    let (mut found, mut rest) = (Vec::new(), Vec::new());
    let (mut has_comment, mut is_from_trials) = (false, false);
    let mut next = 0;
    while let Some(line) = lines.get(next) {
        let number = next;
        next += 1;
        if line.trim_start().starts_with("//") {
            has_comment = true;
            is_from_trials |= line.contains("trials") || line.contains("(fitted");
            continue;
        }
        let Some(begun) = declared(line) else {
            (has_comment, is_from_trials) = (false, false);
            rest.push((number, line.split("//").next().unwrap_or("")));
            continue;
        };
        let mut text = begun.to_string();
        while !text.ends_with(';') && next < lines.len() {
            text.push(' ');
            text.push_str(lines[next].trim());
            next += 1;
        }
        if let Some((name, typed)) = text.split_once(": ")
            && let Some((of_type, _)) = typed.trim_end_matches(';').split_once(" = ")
            && is_numeric(of_type)
        {
            found.push(Constant {
                line: number,
                name: name.to_string(),
                has_comment,
                is_from_trials,
            });
        }
        is_from_trials = false;
    }
    (found, rest)
}

/// File and name of each constant of the page, which is there once and says what it trades.
fn listed(page: &str, breaches: &mut Breaches) -> BTreeSet<(String, String)> {
    let mut rows = BTreeSet::new();
    for line in page.lines().filter(|line| line.starts_with("| `")) {
        let (file, constants) = line[3..].split_once("` | ").unwrap_or_default();
        for constant in constants.trim_end_matches(" |").split("; ") {
            let (name, trade) = constant.split_once("`: ").unwrap_or((constant, ""));
            let row = (file.to_string(), name.trim_matches('`').to_string());
            if trade.is_empty() || !rows.insert(row) {
                breaches.0.push(format!("{PAGE}: bad entry: {constant}"));
            }
        }
    }
    rows
}

/// Numbers of formulas: none, halves, small wholes, and what only keeps a division finite.
fn is_plain(number: f64) -> bool {
    const PLAIN: [f64; 10] = [0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0];
    PLAIN.contains(&number) || number <= 1e-6
}

/// The numbers with a point or an exponent of a line, outside of strings.
fn unnamed(line: &str) -> Vec<f64> {
    let outside: String = line.split('"').step_by(2).collect::<Vec<_>>().join(" ");
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '.' || c == '-';
    let words = outside.split(|c| !is_part(c)).map(|word| {
        let word = word.trim_start_matches('-');
        let word = word.split_once("f64").map_or(word, |(number, _)| number);
        word.trim_end_matches('.').replace('_', "")
    });
    let is_float =
        |word: &String| word.starts_with(|c: char| c.is_ascii_digit()) && word.contains(['.', 'e']);
    words
        .filter(is_float)
        .filter_map(|w| w.parse().ok())
        .collect()
}

#[test]
fn every_constant_of_the_planner_has_its_reason() {
    let page = std::fs::read_to_string(Path::new(ROOT).join(PAGE)).expect("the list");
    let mut breaches = Breaches(Vec::new());
    let mut rows = listed(&page, &mut breaches);
    let fitted = rows.len();
    let mut count = 0;
    let mut numbers = Vec::new();
    for source in sources() {
        let Some(file) = short_name(&source.name) else {
            continue;
        };
        let (constants, rest) = read(&source.lines);
        for constant in constants {
            count += 1;
            let name = &constant.name;
            let is_listed = rows.remove(&(file.clone(), name.clone()));
            if constant.is_from_trials && !is_listed {
                breaches.add(&source, constant.line, &format!("{name} is not in {PAGE}"));
            }
            if !constant.has_comment && !is_listed {
                breaches.add(&source, constant.line, &format!("{name} has no comment"));
            }
        }
        for (line, text) in rest {
            let found = unnamed(text)
                .into_iter()
                .filter(|number| !is_plain(*number));
            numbers.extend(found.map(|number| format!("{}:{}: {number}", source.name, line + 1)));
        }
    }
    for (file, name) in &rows {
        breaches
            .0
            .push(format!("{PAGE}: no constant {name} in {file}"));
    }
    assert_none(&breaches);
    assert!(count > 500, "only {count} constants found");
    let budgets = include_str!("../../../../tools/budgets.toml");
    let budget = format!("\nfitted_constants = {fitted}\n");
    assert!(budgets.contains(&budget), "{fitted} fitted constants");
    let unnamed = numbers.len();
    assert!(
        (1..=UNNAMED_MAX).contains(&unnamed),
        "{unnamed} numbers without a name, at most {UNNAMED_MAX}:\n{}",
        numbers.join("\n")
    );
}

#[test]
fn constants_and_numbers_are_found() {
    let text = "/// From trials on slices.\npub(super) const SHARES: [f64; 2] = [\n    0.5,\n    0.7,\n];\n\
                const NAME: &str = \"1.5\";\nfn half(x: f64) -> f64 {\n    1.5e-3 * x.max(-0.7) // 9.9\n}";
    let lines: Vec<String> = text.lines().map(str::to_string).collect();
    let (found, rest) = read(&lines);
    let [shares] = &found[..] else {
        panic!("{} constants", found.len());
    };
    assert!(shares.name == "SHARES" && shares.line == 1);
    assert!(shares.is_from_trials && shares.has_comment);
    let numbers: Vec<f64> = rest.iter().flat_map(|(_, text)| unnamed(text)).collect();
    assert_eq!(numbers, [1.5e-3, 0.7]);
    assert!(is_plain(0.5) && is_plain(1e-9) && !is_plain(0.7));
}
