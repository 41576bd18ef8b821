//! Texts from files on the terminal: printed without control sequences.

use crate::input::names::is_command;
use std::borrow::Cow;

/// Longest line for the eye, characters: more is a file's content, not a message.
const LINE_CHARS_MAX: usize = 4000;

/// Text with its control characters (but ends of lines and tabs) written out, `\u001b`: that is how
/// JSON writes them too, so that an object stays the same.
pub(crate) fn printable(text: &str) -> Cow<'_, str> {
    let is_raw = |c: char| is_command(c) && c != '\n' && c != '\t';
    if !text.contains(is_raw) {
        return Cow::Borrowed(text);
    }
    let mut written = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        match is_raw(c) {
            true => written += &format!("\\u{:04x}", u32::from(c)),
            false => written.push(c),
        }
    }
    Cow::Owned(written)
}

/// The same for a message, each of its lines cut where it is beyond reading.
pub(crate) fn message(text: &str) -> String {
    let lines = text
        .split('\n')
        .map(|line| match line.char_indices().nth(LINE_CHARS_MAX) {
            Some((end, _)) => format!("{}... ({} bytes)", printable(&line[..end]), line.len()),
            None => printable(line).into_owned(),
        });
    lines.collect::<Vec<String>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_would_obey_is_written_out() {
        let text = "a\u{1b}[31m\u{9b}2J\u{7}\r\u{202e}b\nc\td \u{b0}";
        assert_eq!(
            printable(text),
            "a\\u001b[31m\\u009b2J\\u0007\\u000d\\u202eb\nc\td \u{b0}"
        );
        let object = serde_json::json!({"name": text}).to_string();
        let printed = printable(&object);
        let back: serde_json::Value = serde_json::from_str(&printed).unwrap();
        assert_eq!(back["name"], text);
        let long = message(&format!("x\n{}", "y".repeat(5_000_000)));
        assert!(long.len() < 5000 && long.ends_with("(5000000 bytes)"));
    }
}
