//! Part names from files: made printable, and short.

/// Longest name that is kept, characters.
pub const NAME_CHARS_MAX: usize = 200;
/// Longest name inside a message, characters.
const SHORT_CHARS_MAX: usize = 60;

/// A part's name without control sequences of a terminal or a page, cut to [`NAME_CHARS_MAX`]; `None`
/// if nothing remains.
pub fn part_name(text: &str) -> Option<String> {
    let seen = text.chars().filter(|&c| !is_command(c));
    let name: String = seen.take(NAME_CHARS_MAX).collect();
    let name = name.trim();
    (!name.is_empty()).then(|| name.to_string())
}

/// A part's own name, else that of its file, else what it is.
pub(super) fn name_of(own: Option<&str>, file: &str, kind: &str) -> String {
    let mut names = own.into_iter().chain([file]);
    names
        .find_map(part_name)
        .unwrap_or_else(|| kind.to_string())
}

/// True for characters that are no text: controls (escape sequences begin with one), and marks that
/// turn the direction of writing.
pub fn is_command(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// The beginning of a text from a file, for a message.
pub(super) fn shortened(text: &str) -> String {
    match text.char_indices().nth(SHORT_CHARS_MAX) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_string(),
    }
}
