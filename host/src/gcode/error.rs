//! Why G-code is not taken: the line, what is wrong, what to do.

use super::{LINE_CHARS_MAX, MOVES_MAX};
use crate::short_number::{Short, told_apart};

/// Refusals, the first that is found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GcodeError {
    /// Not text.
    #[error("byte {at_byte} is not UTF-8 text: save the G-code as plain text")]
    NotText {
        /// The first byte that is not.
        at_byte: usize,
    },
    /// `.bgcode`.
    #[error("it is binary G-code: switch \"binary G-code\" off in the slicer and export again")]
    Binary,
    /// Longer than any line that means something.
    #[error(
        "line {line} is longer than {LINE_CHARS_MAX} characters: it is no G-code, or lost its line ends"
    )]
    LongLine {
        /// Line from 1.
        line: usize,
    },
    /// Not a word.
    #[error("line {line}: '{text}' is no word of a letter and a number")]
    NoWord {
        /// Line from 1.
        line: usize,
        /// What stands there, cut short.
        text: String,
    },
    /// Not a number.
    #[error(
        "line {line}: {letter} has no number that can be read ('{text}'); write it as {letter}12.345"
    )]
    Number {
        /// Line from 1.
        line: usize,
        /// The word's letter.
        letter: char,
        /// What stands there, cut short.
        text: String,
    },
    /// A parameter of an extended command.
    #[error("line {line}: {key}='{text}' is no number that can be taken; write it as {key}=12.5")]
    Parameter {
        /// Line from 1.
        line: usize,
        /// The parameter.
        key: String,
        /// What stands there, cut short.
        text: String,
    },
    /// The same letter twice.
    #[error("line {line}: {letter} is given twice: divide the line")]
    Twice {
        /// Line from 1.
        line: usize,
        /// The word's letter.
        letter: char,
    },
    /// A comment that does not end.
    #[error("line {line}: the comment that begins with '(' has no ')'")]
    OpenComment {
        /// Line from 1.
        line: usize,
    },
    /// Damaged on its way.
    #[error(
        "line {line}: its checksum is {given}, its text makes {found}: the file is damaged, export it again"
    )]
    Checksum {
        /// Line from 1.
        line: usize,
        /// What the line says.
        given: String,
        /// What it is.
        found: u8,
    },
    /// Computed G-code.
    #[error(
        "line {line}: variables, expressions and subprograms are not computed here: let the \
         post-processor write numbers"
    )]
    Computed {
        /// Line from 1.
        line: usize,
    },
    /// A code that moves, and that is not known how.
    #[error("line {line}: {code} is not read: {remedy}")]
    NotRead {
        /// Line from 1.
        line: usize,
        /// The code.
        code: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Codes that exclude each other.
    #[error("line {line}: two motions in one line ({first} and {second}): divide it")]
    TwoMotions {
        /// Line from 1.
        line: usize,
        /// One.
        first: String,
        /// The other.
        second: String,
    },
    /// Axes and no motion.
    #[error("line {line}: it names an axis, and no G0 to G3 was there before: write the code")]
    NoMotion {
        /// Line from 1.
        line: usize,
    },
    /// A number beyond what it may be.
    #[error("line {line}: {letter}{} is beyond {}: check units and modes (G20, G91, M83)", Short(*value), Short(*most))]
    Beyond {
        /// Line from 1.
        line: usize,
        /// The word's letter.
        letter: char,
        /// What was given.
        value: f64,
        /// The most that is taken.
        most: f64,
    },
    /// A temperature or a fan that cannot be.
    #[error("line {line}: a target of {}: write 0 to {} (°C for heaters, M106 of 255 for fans)", Short(*value), Short(*most))]
    Heat {
        /// Line from 1.
        line: usize,
        /// What was given.
        value: f64,
        /// The most that is taken.
        most: f64,
    },
    /// Not a speed.
    #[error("line {line}: F{} is no feed rate; it must be above 0", Short(*value))]
    Feed {
        /// Line from 1.
        line: usize,
        /// What was given.
        value: f64,
    },
    /// Slower than any machine file has it, for long.
    #[error(
        "line {line}: it prints at {} mm/s for {} s: check F, which is mm/min, and the modes (G93, G94)",
        Short(*speed_mm_s), Short(*seconds)
    )]
    Slow {
        /// Line from 1.
        line: usize,
        /// Tip speed.
        speed_mm_s: f64,
        /// How long.
        seconds: f64,
    },
    /// Inverse time without a time.
    #[error("line {line}: with G93 every G1, G2, G3 and G5 needs its own F")]
    NoInverseTime {
        /// Line from 1.
        line: usize,
    },
    /// An arc that is none.
    #[error("line {line}: the arc {problem}")]
    Arc {
        /// Line from 1.
        line: usize,
        /// What is wrong and what to do.
        problem: String,
    },
    /// A second nozzle.
    #[error(
        "line {line}: tool T{tool} after T{before} has printed: this machine has one nozzle; slice for \
         one extruder"
    )]
    SecondTool {
        /// Line from 1.
        line: usize,
        /// The new one.
        tool: u32,
        /// The old one.
        before: u32,
    },
    /// A diameter that is none.
    #[error("line {line}: a filament diameter of {} mm; write 0.1 to 20 mm", Short(*diameter_mm))]
    Filament {
        /// Line from 1.
        line: usize,
        /// What was given.
        diameter_mm: f64,
    },
    /// More than can be planned.
    #[error(
        "line {line}: more than {MOVES_MAX} moves: print it in parts, or slice it more coarsely"
    )]
    TooMany {
        /// Line from 1.
        line: usize,
    },
    /// Nothing to do.
    #[error(
        "nothing is printed: no move in the plane extrudes (E rises) in {lines} lines; is this the \
         sliced file, with its extrusion?"
    )]
    NothingPrinted {
        /// Lines of the file.
        lines: usize,
    },
    /// Headings on some moves of a pass, tilts beyond what a pose can say.
    #[error(
        "line {line}: the tool axis is tilted by {}°, more than {max_deg:.0}°: turn the part over",
        told_apart(*tilt_deg, &[*max_deg], 1)
    )]
    Tilt {
        /// Line from 1.
        line: usize,
        /// Angle from Z.
        tilt_deg: f64,
        /// The most that is taken.
        max_deg: f64,
    },
}
