//! Words of a line as printers and machine tools have them.
//!
//! In: a line. Out: its command (G1), letters with their numbers, or keys with their texts. Leaves out checksums,
//! line numbers and expressions: no text here has them.

use std::collections::BTreeMap;

/// A line without its comment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Words {
    /// Letters and numbers in order.
    pub letters: Vec<(char, f64)>,
    /// The first word as it stands, for commands that are names.
    pub name: String,
    /// `KEY=value` of such commands.
    pub keys: BTreeMap<String, String>,
}

impl Words {
    /// The number of a letter.
    pub fn number(&self, letter: char) -> Option<f64> {
        let mut found = self.letters.iter().filter(|(of, _)| *of == letter);
        found.next().map(|(_, number)| *number)
    }

    /// All numbers of a letter: codes of machine tools are many in a line.
    pub fn codes(&self, letter: char) -> impl Iterator<Item = f64> + '_ {
        let of_letter = self.letters.iter().filter(move |(of, _)| *of == letter);
        of_letter.map(|(_, number)| *number)
    }

    /// A key's number.
    pub fn key(&self, key: &str) -> Option<f64> {
        self.keys.get(key).and_then(|text| text.parse().ok())
    }
}

/// Reads a line; `None` where nothing but a comment is in it.
///
/// # Errors
/// Where a word has no number.
pub fn words(line: &str) -> Result<Option<Words>, String> {
    let code = line.split(';').next().unwrap_or("").trim();
    let name = code.split_whitespace().next().unwrap_or("");
    if name.is_empty() {
        return Ok(None);
    }
    let mut words = Words {
        name: name.to_string(),
        ..Words::default()
    };
    let is_name =
        name.len() > 1 && !name[1..].starts_with(|c: char| c.is_ascii_digit() || "-+.".contains(c));
    if is_name {
        for pair in code.split_whitespace().skip(1) {
            let (key, value) = pair
                .split_once('=')
                .ok_or(format!("{pair} is no KEY=value"))?;
            words.keys.insert(key.to_uppercase(), value.to_string());
        }
        return Ok(Some(words));
    }
    let text: String = code.chars().filter(|c| !c.is_whitespace()).collect();
    let mut rest = text.as_str();
    while let Some(letter) = rest.chars().next() {
        let end = rest[1..]
            .find(|c: char| c.is_ascii_alphabetic())
            .map_or(rest.len(), |at| at + 1);
        let number = rest[1..end]
            .parse()
            .map_err(|_| format!("{} has no number", &rest[..end]))?;
        words.letters.push((letter.to_ascii_uppercase(), number));
        rest = &rest[end..];
    }
    Ok(Some(words))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_letters_or_keys() {
        let line = words("G1 X0.13 C-15 U1.0045F2353 ; there")
            .expect("words")
            .expect("a line");
        assert_eq!(line.number('C'), Some(-15.0));
        assert_eq!(line.number('F'), Some(2353.0));
        let line = words("MANUAL_STEPPER STEPPER=heading GCODE_AXIS=")
            .expect("words")
            .expect("a line");
        assert_eq!(line.keys["GCODE_AXIS"], "");
        assert_eq!(words("; nothing"), Ok(None));
        assert!(words("G1 X").is_err());
    }
}
