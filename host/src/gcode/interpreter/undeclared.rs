//! Letters that turn something of which nothing says what: the file is refused with what has to be said.
//!
//! In: the words of moves. Out: a refusal with the line. A and B tilt a head or a table, U, V and W may be
//! anything: they are asked for where they leave 0. C alone is the nozzle's heading, as [`super`] has always read it,
//! unless it turns like a table: whole turns with the tip as good as standing, or with X alone. What Headway wrote
//! says its letters itself.

use super::Interpreter;
use super::klipper::number_of;
use crate::gcode::comments::Slicer;
use crate::gcode::error;
use crate::gcode::error::AxesQuestion;
use crate::gcode::words::Line;
use crate::text::refusal::Refusal;

/// Letters that no reading has without a word on them.
const ASKED: [u8; 6] = *b"ABCUVW";
/// C turns on the spot where the tip goes less than this in a whole turn, mm: around less than any bead is wide.
const SPOT_MM_A_TURN: f64 = 1.0;
/// So far it may, degrees.
const SPOT_DEG: f64 = 360.0;
/// Names of manual steppers that turn something.
const STEPPERS: [&str; 10] = [
    "stepper_a",
    "stepper_b",
    "stepper_c",
    "stepper_u",
    "stepper_v",
    "a",
    "b",
    "c",
    "u",
    "v",
];

/// How C turns while beads are laid: of moves that extrude, and of all that are no G0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Winding {
    of: [Turns; 2],
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Turns {
    /// On the spot, and in all, degrees.
    spot_deg: f64,
    all_deg: f64,
    /// Line on which the first of them came to a whole turn.
    spot_line: usize,
    all_line: usize,
    /// X and Y moved.
    moved: [bool; 2],
}

impl Interpreter {
    fn is_own(&self) -> bool {
        self.found.comments.slicer == Slicer::Headway
    }

    fn ask(&self, line: usize, letter: u8, question: AxesQuestion) -> Refusal {
        error::axes(line, char::from(letter), question)
    }

    /// Letters of a move that nobody declared.
    pub(super) fn watch(&self, line: &Line, number: usize) -> Result<(), Refusal> {
        if self.is_own() {
            return Ok(());
        }
        let (axes, extruder) = (self.axes(), self.extruder());
        let is_known = |letter: u8| axes.contains(&letter) || letter == extruder;
        for word in &line.words {
            let letter = word.letter;
            let leaves = word.value.is_some_and(|value| value != 0.0);
            let question = match &self.axes {
                Some(_) if is_known(letter) => continue,
                Some(_) if ASKED.contains(&letter) || matches!(letter, b'X' | b'Y' | b'Z') => {
                    AxesQuestion::NotDeclared
                }
                // A head that tilts, whose letters the machine file says.
                None if self.head_letters.is_some() && is_known(letter) => continue,
                None if matches!(letter, b'A' | b'B' | b'U' | b'V' | b'W') => {
                    AxesQuestion::HeadOrTable
                }
                _ => continue,
            };
            if leaves && letter != extruder {
                return Err(self.ask(number, letter, question));
            }
        }
        Ok(())
    }

    /// Counts how C turns along a move that nothing declares.
    pub(super) fn wind(&mut self, to: &super::At, extruded: f64, rapid: bool, number: usize) {
        let [x, y, c] = [0, 1, 5].map(|axis| (to[axis] - self.at[axis]).abs());
        let prints = [extruded > 0.0, !rapid];
        for (turns, prints) in self.found.winding.of.iter_mut().zip(prints) {
            if !prints {
                continue;
            }
            turns.moved = [turns.moved[0] || x > 0.0, turns.moved[1] || y > 0.0];
            if c == 0.0 {
                continue;
            }
            turns.all_deg += c;
            if turns.all_line == 0 && turns.all_deg >= SPOT_DEG {
                turns.all_line = number;
            }
            if x.hypot(y) * 360.0 < SPOT_MM_A_TURN * c {
                turns.spot_deg += c;
                if turns.spot_line == 0 && turns.spot_deg >= SPOT_DEG {
                    turns.spot_line = number;
                }
            }
        }
    }

    /// Asks what C is, where it turned like a table.
    pub(super) fn ask_winding(&self) -> Result<(), Refusal> {
        if self.is_own() || self.head_letters.is_some() || self.axes.is_some() {
            return Ok(());
        }
        let turns = self.found.winding.of[usize::from(!self.found.extrudes)];
        let is_polar = turns.all_line > 0 && turns.moved != [true, true];
        let line = match (turns.spot_line, is_polar) {
            (0, false) => return Ok(()),
            (0, true) => turns.all_line,
            (line, _) => line,
        };
        Err(self.ask(line, b'C', AxesQuestion::HeadingOrTable))
    }

    /// A manual stepper that turns something, and nothing says what.
    pub(super) fn watch_stepper(
        &self,
        name: &str,
        command: &str,
        line: usize,
    ) -> Result<bool, Refusal> {
        let turns = STEPPERS
            .iter()
            .any(|stepper| name.eq_ignore_ascii_case(stepper));
        let moves = number_of(command, "MOVE", line)?.is_some_and(|to| to != 0.0);
        match turns && moves && !self.is_own() {
            true => Err(error::axes(line, name, AxesQuestion::HeadOrTable)),
            false => Ok(false),
        }
    }
}
