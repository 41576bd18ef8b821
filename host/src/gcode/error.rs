//! Why G-code is not taken: the line, what is wrong, what to do.

use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::{Short, told_apart};
use headway_firmware::kinematics::pose::TILT_MAX_RAD;
use std::fmt::Display;

/// A job's export, in planning.
pub fn own_export() -> Refusal {
    refusal!(
        "its header says that Headway exported it from a job: stream or export that job (.hwj), \
         or plan its part again"
    )
}

/// Not a number.
pub fn number(line: usize, letter: char, text: &str) -> Refusal {
    refusal!(
        "line {line}: {letter} has no number that can be read ('{text}'); write it as \
         {letter}12.345"
    )
}

/// A parameter of an extended command.
pub fn parameter(line: usize, key: &str, text: &str) -> Refusal {
    refusal!("line {line}: {key}='{text}' is no number that can be taken; write it as {key}=12.5")
}

/// Computed G-code.
pub fn computed(line: usize) -> Refusal {
    refusal!(
        "line {line}: variables, expressions and subprograms are not computed here: let the \
         post-processor write numbers"
    )
}

/// A code that moves, and that is not known how.
pub fn not_read(line: usize, code: &str, remedy: &'static str) -> Refusal {
    refusal!("line {line}: {code} is not read: {remedy}")
}

/// A number beyond what it may be.
pub fn beyond(line: usize, letter: char, value: f64, most: f64) -> Refusal {
    refusal!(
        "line {line}: {letter}{} is beyond {}: check units and modes (G20, G91, M83)",
        Short(value),
        Short(most)
    )
}

/// An arc that is none.
pub fn arc(line: usize, problem: &str) -> Refusal {
    refusal!("line {line}: the arc {problem}")
}

/// A second nozzle.
pub fn second_tool(line: usize, tool: u32, before: u32) -> Refusal {
    refusal!(
        "line {line}: tool T{tool} after T{before} has printed: this machine has one nozzle; \
         slice for one extruder"
    )
}

/// A diameter that is none.
pub fn filament(line: usize, diameter_mm: f64) -> Refusal {
    refusal!(
        "line {line}: a filament diameter of {} mm; write 0.1 to 20 mm",
        Short(diameter_mm)
    )
}

/// A tilt beyond what a pose can say.
pub fn too_tilted(line: usize, tilt_rad: f64) -> Refusal {
    let (tilt_deg, max_deg) = (tilt_rad.to_degrees(), TILT_MAX_RAD.to_degrees());
    refusal!(
        "line {line}: the tool axis is tilted by {}°, more than {max_deg:.0}°: turn the part over",
        told_apart(tilt_deg, &[max_deg], 1)
    )
}

/// Curves that make more moves than their file can mean.
pub fn too_fine(line: usize) -> Refusal {
    refusal!(
        "line {line}: the curves up to here make more moves than a file of this size may have: \
         write fewer turns (P) or smaller arcs, or straight moves"
    )
}

/// A code that firmwares read differently.
pub fn disputed(line: usize, code: &'static str, readings: &'static str) -> Refusal {
    refusal!(
        "line {line}: {code} {readings}, and nothing says for which firmware the file is: write \
         a line such as '; gcode_flavor = klipper' (marlin, marlin2, reprapfirmware, linuxcnc) \
         into it"
    )
}

/// A letter of which nothing says what it turns.
pub fn axes(line: usize, name: impl Display, question: AxesQuestion) -> Refusal {
    refusal!("line {line}: {}", question.text(name))
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
    fn text(self, name: impl Display) -> String {
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
