//! `[gcode]` of a machine file: the axes of another controller that knows the tip of a head that tilts, and those of the
//! machines that files are written for.

use super::write::quoted;
use crate::settings::Settings;
use crate::settings::axes_words::{AxesWords, MachineWord};
use crate::text::refusal::{Refusal, refusal};
use serde::Deserialize;
use std::fmt::Write;

/// The group.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct FileGcode {
    letters: Option<String>,
    axes: Option<String>,
}

impl FileGcode {
    pub(super) fn letters(&self) -> Result<Option<[u8; 3]>, Refusal> {
        let Some(text) = &self.letters else {
            return Ok(None);
        };
        let wrong = || {
            let text: String = text.chars().take(40).collect();
            refusal!(
                "gcode.letters: \"{text}\": write three different letters of A, B, C, U, V, W, H, J, as in \"A,B,C\""
            )
        };
        gcode_letters(text).ok_or_else(wrong).map(Some)
    }

    pub(super) fn axes(&self) -> Result<Option<String>, Refusal> {
        let Some(text) = &self.axes else {
            return Ok(None);
        };
        let words = AxesWords::parse(text).map_err(|refused| refusal!("gcode.axes: {refused}"))?;
        // Which folder it would lie in is not known when a job's settings are read again.
        if matches!(words.machine, Some(MachineWord::File(_))) {
            return Err(refusal!(
                "gcode.axes: machine:FILE goes with the option --axes; here write machine for this machine's own \
                 joints, or the axes themselves"
            ));
        }
        Ok(Some(text.clone()))
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

/// Writes the group, where it says something.
pub(super) fn write_gcode(text: &mut String, settings: &Settings) -> std::fmt::Result {
    if let Some([a, b, c]) = settings
        .gcode_letters
        .map(|letters| letters.map(char::from))
    {
        writeln!(
            text,
            "\n# Tilts about X and Y and heading on a controller that knows the tip of the head.\n[gcode]"
        )?;
        writeln!(text, "letters = \"{a},{b},{c}\"")?;
    }
    let Some(axes) = &settings.gcode_axes else {
        return Ok(());
    };
    if settings.gcode_letters.is_none() {
        writeln!(text, "\n[gcode]")?;
    }
    writeln!(
        text,
        "# Axes of the machine that files which are read were written for.\naxes = {}",
        quoted(axes)
    )
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
