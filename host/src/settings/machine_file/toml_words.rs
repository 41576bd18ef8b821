//! What the TOML parser says of a machine file -> the same for people who do not program.
//!
//! In: the file's text, the parser's error. Out: the line, and what to write there. Not covered: what a value may be, which
//! [`super::Settings`] checks.

use crate::text::near_name::near_name;

/// Longest line of a machine file that is shown with its fault: a file that is none may have one line of megabytes.
const LINE_SHOWN_CHARS_MAX: usize = 200;

/// What is wrong, with the line; without it where that is no line to read.
pub(in crate::settings) fn toml_problem(text: &str, error: &toml::de::Error) -> String {
    let begins = error.span().map_or(0, |span| span.start);
    let before = text.get(..begins).unwrap_or_default();
    let number = before.matches('\n').count() + 1;
    let line = text.lines().nth(number - 1).unwrap_or_default();
    let problem = in_words(error.message(), text.get(begins..).unwrap_or_default());
    if line.chars().count() > LINE_SHOWN_CHARS_MAX {
        return format!(
            "line {number} is no line of a machine file: {problem}; `headway machine new` writes one"
        );
    }
    format!("line {number}: {}\n  {problem}", line.trim())
}

/// The names in backquotes.
fn names(message: &str) -> Vec<&str> {
    message.split('`').skip(1).step_by(2).collect()
}

fn in_words(message: &str, at: &str) -> String {
    let names = names(message);
    let is_number = at.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c));
    match (message, names.as_slice()) {
        (_, [key, known @ ..]) if message.starts_with("unknown field") => {
            match near_name(key, known) {
                Some(near) => format!("unknown key `{key}`: is `{near}` meant?"),
                None => format!("unknown key `{key}`; this group has {}", known.join(", ")),
            }
        }
        (_, [given, known @ ..]) if message.starts_with("unknown variant") => {
            format!(
                "`{given}` is not known: write \"{}\"",
                known.join("\" or \"")
            )
        }
        (_, [key, ..]) if message.starts_with("missing field") => {
            format!("the key `{key}` is missing")
        }
        _ if message.starts_with("invalid type: string") && is_of_number(message) => {
            "this is a text: write a number without quotes".to_string()
        }
        _ if message.starts_with("invalid type: floating point") && is_of_number(message) => {
            "write a whole number".to_string()
        }
        _ if message.starts_with("invalid value: integer") && is_of_number(message) => {
            "write a whole number of 0 or more".to_string()
        }
        _ if message.starts_with("string values must be quoted") && is_number => {
            "write the number alone: its unit is in the key's name".to_string()
        }
        _ if message.starts_with("string values must be quoted")
            || message.starts_with("invalid boolean") =>
        {
            "write a text in quotes, as in \"planar\"".to_string()
        }
        _ if message.starts_with("unexpected key or value") && at.starts_with(',') => {
            "write decimals with a point, as in 0.2".to_string()
        }
        _ => message.to_string(),
    }
}

/// True where the parser expected a number.
fn is_of_number(message: &str) -> bool {
    [
        "expected f64",
        "expected u32",
        "expected u16",
        "expected u8",
    ]
    .iter()
    .any(|of| message.ends_with(of))
}
