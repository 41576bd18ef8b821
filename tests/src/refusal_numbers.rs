//! Numbers in the text of a refusal: places, lengths, counts, as its reader sees them.

/// The numbers behind these words, in order; none where the text has no such words.
pub fn numbers_behind(text: &str, words: &str) -> Vec<f64> {
    let rest = text.split_once(words).map_or("", |(_, rest)| rest);
    let is_of_number = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
    rest.split(|c| !is_of_number(c))
        .filter_map(|word| word.parse().ok())
        .collect()
}
