//! Why G-code is not taken: the line, what is wrong, what to do.

use super::{LINE_CHARS_MAX, MOVES_MAX};
use crate::text::short_number::{Short, told_apart};

/// Refusals, the first that is found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GcodeError {
    /// Bytes that are no text, outside comments.
    #[error("line {line}: a word has bytes that are no text: save the G-code as plain UTF-8 text")]
    NotText {
        /// Line from 1.
        line: usize,
    },
    /// `.bgcode`.
    #[error("it is binary G-code: switch \"binary G-code\" off in the slicer and export again")]
    Binary,
    /// A job's export, in planning.
    #[error(
        "its header says that Headway exported it from a job: stream or export that job (.hwj), or plan its part again"
    )]
    OwnExport,
    /// A file whose beads have no kinds, in planning anew.
    #[error(
        "line {line}: a bead, and no comment before it says of what kind, as those of PrusaSlicer, SuperSlicer, OrcaSlicer and Cura \
         do: slice with one of them, or plan the file along its lines (headway plan)"
    )]
    NoKinds {
        /// Line from 1.
        line: usize,
    },
    /// Nothing follows the last bead, in planning anew.
    #[error(
        "line {line}: the file ends with a bead, and no line of its slicer's end follows: it was cut short; slice it again"
    )]
    Cut {
        /// Line from 1.
        line: usize,
    },
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
    /// Slower than any bead is laid, for longer than a moment.
    #[error(
        "line {line}: it prints at {} mm/s for {} s, slower than 0.1 mm/s: check F, which is mm/min, and the \
         modes (G93, G94)",
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
    /// Curves that make more moves than their file can mean.
    #[error(
        "line {line}: the curves up to here make more moves than a file of this size may have: write fewer \
         turns (P) or smaller arcs, or straight moves"
    )]
    TooFine {
        /// Line from 1.
        line: usize,
    },
    /// A code that firmwares read differently.
    #[error(
        "line {line}: {code} {readings}, and nothing says for which firmware the file is: write a line such \
         as '; gcode_flavor = klipper' (marlin, marlin2, reprapfirmware, linuxcnc) into it"
    )]
    Disputed {
        /// Line from 1.
        line: usize,
        /// The code.
        code: &'static str,
        /// What it does for whom.
        readings: &'static str,
    },
    /// More states than any macro keeps.
    #[error("line {line}: more than 100 names of SAVE_GCODE_STATE: keep fewer states")]
    ManyStates {
        /// Line from 1.
        line: usize,
    },
    /// A state that was not kept.
    #[error("line {line}: no SAVE_GCODE_STATE before it has the name '{name}'")]
    NoState {
        /// Line from 1.
        line: usize,
        /// The name.
        name: String,
    },
    /// The extruder alone, slower than any means.
    #[error(
        "line {line}: the extruder alone is to move {} mm³ at {} mm³/s, which takes {} s; nozzles ooze faster \
         than 0.01 mm³/s: check F, which is mm/min, and the modes (G93, G94)",
        Short(*volume_mm3), Short(*rate_mm3_s), Short(volume_mm3 / rate_mm3_s)
    )]
    SlowPush {
        /// Line from 1.
        line: usize,
        /// How much.
        volume_mm3: f64,
        /// How fast.
        rate_mm3_s: f64,
    },
    /// More in one go than any machine has.
    #[error(
        "line {line}: {} mm³ are to be pushed or pulled on the spot, more than {}: check E (M82, M83, G92) and \
         the filament's diameter",
        Short(*volume_mm3), Short(*most_mm3)
    )]
    Push {
        /// Line from 1.
        line: usize,
        /// How much.
        volume_mm3: f64,
        /// The most that is taken.
        most_mm3: f64,
    },
    /// A bead that no nozzle lays.
    #[error(
        "line {line}: a bead of {} mm² in cross-section, more than {}: check E (M82, M83, G92) and the \
         filament's diameter",
        Short(*area_mm2), Short(*most_mm2)
    )]
    Bead {
        /// Line from 1.
        line: usize,
        /// Its cross-section.
        area_mm2: f64,
        /// The most that is taken.
        most_mm2: f64,
    },
    /// More time than any machine runs.
    #[error(
        "line {line}: up to here the job takes {} days, more than {}: check F, which is mm/min, E and the \
         flow that the machine allows (flow_max_mm3_s)",
        Short(*days), Short(*most_days)
    )]
    Long {
        /// Line from 1.
        line: usize,
        /// So far.
        days: f64,
        /// The most that is planned.
        most_days: f64,
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
    /// A letter of which nothing says what it turns.
    #[error("line {line}: {}", question.text(name))]
    Axes {
        /// Line from 1.
        line: usize,
        /// The letter, or the stepper's name.
        name: String,
        /// What has to be said.
        question: AxesQuestion,
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

/// What has to be said of a letter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxesQuestion {
    /// It may turn the head or the table.
    HeadOrTable,
    /// It may be the nozzle's heading or a table.
    HeadingOrTable,
    /// Others are declared, and it is not.
    NotDeclared,
}

impl AxesQuestion {
    fn text(self, name: &str) -> String {
        match self {
            AxesQuestion::HeadOrTable => format!(
                "{name} moves an axis: does it turn the head or the table, about x, y or z, and are X Y Z the tip's \
                 place on the part or the machine's linear axes? Say it with --axes, as in --axes \
                 \"{name}=table:x,coordinates=pivot\" or --axes \"{name}=head:x,coordinates=tip\" \
                 (extruder={name} where it feeds material; headway plan --help)"
            ),
            AxesQuestion::HeadingOrTable => format!(
                "{name} turns whole turns while X and Y do not go around anything: is it the table that turns under \
                 the nozzle, or the nozzle's heading? Say it with --axes, as in --axes \
                 \"{name}=table:z,coordinates=pivot\" (or table:-z) or --axes \"{name}=heading\""
            ),
            AxesQuestion::NotDeclared => format!(
                "{name} is no axis that --axes declares: say what it is as well, {name}=head:..., {name}=table:..., \
                 {name}=heading or extruder={name}"
            ),
        }
    }
}
