//! `[gcode]` of a machine file: the axes of another controller that knows the tip of a head that tilts.

use super::MachineFileError;
use serde::Deserialize;
use std::fmt::Write;

/// The group.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileGcode {
    letters: String,
}

impl FileGcode {
    pub(super) fn letters(&self) -> Result<[u8; 3], MachineFileError> {
        let letters = gcode_letters(&self.letters);
        letters.ok_or_else(|| MachineFileError::Letters(self.letters.chars().take(40).collect()))
    }
}

/// `A,B,C`: three different letters that axes of turns may have.
pub fn gcode_letters(text: &str) -> Option<[u8; 3]> {
    let bytes = text
        .split(',')
        .filter_map(|part| part.trim().bytes().next());
    let letters: Vec<u8> = bytes.map(|letter| letter.to_ascii_uppercase()).collect();
    let letters = <[u8; 3]>::try_from(letters).ok()?;
    let [a, b, c] = letters;
    let are_known = letters.iter().all(|letter| b"ABCUVWHJ".contains(letter));
    (are_known && a != b && b != c && a != c).then_some(letters)
}

/// Writes the group.
pub(super) fn write_letters(text: &mut String, letters: [u8; 3]) -> std::fmt::Result {
    let [a, b, c] = letters.map(char::from);
    writeln!(
        text,
        "\n# Tilts about X and Y and heading on a controller that knows the tip of the head.\n[gcode]"
    )?;
    writeln!(text, "letters = \"{a},{b},{c}\"")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_three_and_different() {
        assert_eq!(gcode_letters("a, B,c"), Some(*b"ABC"));
        for wrong in ["A,B", "A,B,B", "X,B,C", "A,B,C,U", ""] {
            assert_eq!(gcode_letters(wrong), None, "{wrong}");
        }
    }
}
