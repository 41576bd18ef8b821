//! Codes that are no motion: modes, offsets, filament, tools, firmware retraction.
//!
//! In: a code and its line. Out: the interpreter's state; what is not done is noted with its line.

use super::{Firmware, Interpreter, code_name, tenths, value};
use crate::gcode::FILAMENT_MM;
use crate::gcode::axes::SLOTS;
use crate::gcode::error;
use crate::gcode::flavour::Flavour;
use crate::gcode::words::{Line, Word};
use crate::text::refusal::Refusal;

/// Tools that slicers count; numbers from here on are orders to a changer.
const TOOLS: f64 = 255.0;
/// S of a G10 that retracts is a switch of 0 or 1 (Marlin); more is a temperature (RepRapFirmware).
const SWITCH_MAX: f64 = 1.0;

/// G10 with a tool (P), or with a temperature.
fn is_of_a_tool(line: &Line) -> bool {
    let mut words = line.words.iter();
    words.any(|word| match word.letter {
        b'P' | b'R' => true,
        b'S' => word.value.is_some_and(|value| value > SWITCH_MAX),
        _ => false,
    })
}

impl Interpreter {
    /// Modes and codes that are no motion; true where they take the line's axis words.
    pub(super) fn g_code(
        &mut self,
        code: i64,
        word: &Word,
        line: &Line,
        number: usize,
    ) -> Result<bool, Refusal> {
        if let Some(remedy) = self.remedy(code, line) {
            let code = code_name(word);
            return Err(error::not_read(number, &code, remedy));
        }
        match code {
            170 => self.plane = [0, 1, 2],
            180 => self.plane = [2, 0, 1],
            190 => self.plane = [1, 2, 0],
            200 => self.unit_mm = 25.4,
            210 => self.unit_mm = 1.0,
            900 | 910 => {
                self.relative = code == 910;
                // Marlin 2 forgets M83 at either; the others have two switches of which one is enough.
                if self.flavour == Flavour::Marlin {
                    self.e_relative = self.relative;
                    self.e_is_said = true;
                }
            }
            901 => self.centres_absolute = true,
            911 => self.centres_absolute = false,
            930 => self.inverse_time = true,
            940 => self.inverse_time = false,
            920 => {
                self.set_position(line, number)?;
                return Ok(true);
            }
            921 => (self.offset, self.suspended) = ([0.0; SLOTS], None),
            922 => {
                self.suspended.get_or_insert(self.offset);
                self.offset = [0.0; SLOTS];
            }
            923 => self.offset = self.suspended.take().unwrap_or(self.offset),
            280 => {
                self.home(line, number)?;
                return Ok(true);
            }
            100 if is_of_a_tool(line) => {
                self.tool_temperature(line, number)?;
                return Ok(true);
            }
            100 | 110 => self.firmware_retraction(code == 100, number)?,
            // The tool's length: what stands beside it is a motion.
            430 | 434 => self.undone(code_name(word), number),
            // Path control, cancelled modes, the first coordinate system: as it is.
            80 | 150 | 400 | 490 | 500 | 520 | 540 | 610 | 611 | 640 | 690 | 800 | 970 | 980
            | 990 => return Ok(matches!(code, 500 | 520)),
            _ => {
                self.undone(code_name(word), number);
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// What is to be done in place of a code that changes where the others go; `None` for all that are read.
    fn remedy(&self, code: i64, line: &Line) -> Option<&'static str> {
        let has = |letter: u8| line.words.iter().any(|word| word.letter == letter);
        let moves = |word: &Word| word.letter != b'G' && word.value.is_some_and(|to| to != 0.0);
        let is_printer = matches!(
            self.flavour,
            Flavour::Marlin | Flavour::Prusa | Flavour::RepRapFirmware
        );
        match code {
            70 => Some("X is a diameter: write radii (G8)"),
            160 => Some("places are polar: write X and Y (G15)"),
            510 | 511 => Some("places are scaled: write them out (G50)"),
            520 if line.words.iter().any(moves) => {
                Some("places are moved: write those of one system (G54)")
            }
            680..=682 => Some("places are turned: write them out (G69)"),
            650 | 660 => {
                Some("subprograms are not computed: let the post-processor write them out")
            }
            610 if is_printer || has(b'S') => {
                Some("it goes back to a place of G60: write that place as G1")
            }
            100 | 110 if has(b'L') => {
                Some("coordinate systems are not kept: write places of one system (G54)")
            }
            410 | 420 => Some("offset by the tool's radius: let the post-processor compute it"),
            550..=599 => Some("write all places in the first coordinate system (G54)"),
            730 | 760 | 810..=899 => Some("let the post-processor write its moves out"),
            51..=53 | 331 | 950 | 960 => Some("write it as G1, G2, G3 or G5, with G94 or G93"),
            _ => None,
        }
    }

    /// G10 and G11: the second in a row does nothing.
    fn firmware_retraction(&mut self, retracts: bool, line: usize) -> Result<(), Refusal> {
        if self.retracted.replace(retracts) == Some(retracts) {
            return Ok(());
        }
        let [pulled_mm, pushed_mm] = self.retract_mm;
        let firmware = match retracts {
            true => Firmware::Retract(pulled_mm),
            false => Firmware::Prime(pushed_mm),
        };
        self.firmware(firmware, line)
    }

    pub(super) fn m_code(
        &mut self,
        word: &Word,
        line: &Line,
        number: usize,
    ) -> Result<(), Refusal> {
        match tenths(word) {
            code @ (820 | 830) => {
                self.e_relative = code == 830;
                self.e_is_said = true;
            }
            20 | 300 => self.ended = true,
            30 | 40 => self.tool_on = Some(true),
            50 => self.tool_on = self.tool_on.map(|_| false),
            // Coolant, and the tool that T names.
            60 | 70 | 80 | 90 => {}
            1200 => self.push_state(),
            1210 => self.pop_state(number)?,
            2000 => self.filament(line, number)?,
            2070 => {
                let pulled_mm = self.length(line, b'S', number)?.map(f64::abs);
                let more_mm = self.length(line, b'R', number)?;
                self.retract_by(pulled_mm, more_mm);
            }
            // RepRapFirmware's are limits of axes.
            2080 if line
                .words
                .iter()
                .any(|word| self.axes().contains(&word.letter)) =>
            {
                self.undone(code_name(word), number);
            }
            2080 => {
                let more_mm = self.length(line, b'S', number)?;
                self.retract_by(None, more_mm);
            }
            // S or R alone keep the factor and take it back.
            2200 | 2210 if line.words.iter().skip(1).any(|word| word.value.is_none()) => {
                self.undone(code_name(word), number);
            }
            2200 | 2210 => {
                let Some(percent) = bounded_percent(line, number)? else {
                    return Ok(());
                };
                match tenths(word) {
                    2200 => self.speed_factor = percent / 100.0,
                    _ => self.flow_factor = percent / 100.0,
                }
            }
            1010 => self.firmware(Firmware::Prime(self.retract_mm[1]), number)?,
            1030 => self.firmware(Firmware::Retract(self.retract_mm[0]), number)?,
            2270 if line.words.len() == 1 => self.firmware(Firmware::Prime(None), number)?,
            2280 if line.words.len() == 1 => self.firmware(Firmware::Retract(None), number)?,
            _ if self.heat_code(word, line, number)? => {}
            _ => self.undone(code_name(word), number),
        }
        Ok(())
    }

    /// What G10 pulls and G11 pushes more; what is not given stays.
    pub(super) fn retract_by(&mut self, pulled_mm: Option<f64>, more_mm: Option<f64>) {
        let [before_mm, pushed_mm] = self.retract_mm;
        let before_more_mm = pushed_mm
            .zip(before_mm)
            .map_or(0.0, |(pushed, pulled)| pushed - pulled);
        let pulled_mm = pulled_mm.or(before_mm);
        let more_mm = more_mm.unwrap_or(before_more_mm);
        self.retract_mm = [pulled_mm, pulled_mm.map(|mm| (mm + more_mm).max(0.0))];
    }

    /// M200: E in mm³ with a diameter, in mm with 0.
    pub(super) fn filament(&mut self, line: &Line, number: usize) -> Result<(), Refusal> {
        let diameter_mm = value(line, b'D', number)?;
        let is_on = value(line, b'S', number)?.map(|on| on != 0.0);
        match diameter_mm {
            Some(diameter_mm) if diameter_mm != 0.0 => {
                if !(FILAMENT_MM[0]..=FILAMENT_MM[1]).contains(&diameter_mm) {
                    return Err(error::filament(number, diameter_mm));
                }
                self.found.comments.filament_mm = Some(diameter_mm);
                self.volumetric = is_on.unwrap_or(true);
            }
            Some(_) => self.volumetric = false,
            None => self.volumetric = is_on.unwrap_or(self.volumetric),
        }
        Ok(())
    }

    pub(super) fn tool_change(&mut self, word: &Word, number: usize) {
        // "T-1", "T?", T255, T1000: no tool, which one, put it back, the nozzle as it is.
        let is_tool = |tool: &f64| (0.0..TOOLS).contains(tool);
        if let Some(tool) = word.value.filter(is_tool) {
            self.use_tool(tool as u32, number);
        }
    }

    pub(super) fn use_tool(&mut self, tool: u32, number: usize) {
        self.tool = Some(tool);
        self.changed = Some(number);
    }

    /// A feed without extrusion by the tool that M6 changed to: where the whole file extrudes nothing that is a
    /// bead, and a second tool's is none of this nozzle.
    pub(super) fn cuts(&mut self) {
        let tool = self.cutter.unwrap_or(0);
        let before = *self.cutting_tool.get_or_insert(tool);
        if let Some(line) = self.changed.filter(|_| before != tool) {
            let second = error::second_tool(line, tool, before);
            self.found.second_tool.get_or_insert(second);
        }
    }

    /// Something is extruded, `on_the_way` or on the spot, by the tool in force: firmwares begin with the
    /// first one. What another one is primed by before the first bead is no matter.
    pub(super) fn prints(&mut self, on_the_way: bool) -> Result<(), Refusal> {
        let tool = self.tool.unwrap_or(0);
        match (self.printing_tool, self.changed) {
            (Some(before), Some(line)) if before != tool => {
                return Err(error::second_tool(line, tool, before));
            }
            (None, _) if on_the_way => self.printing_tool = Some(tool),
            _ => {}
        }
        Ok(())
    }

    /// G92.
    pub(super) fn set_position(&mut self, line: &Line, number: usize) -> Result<(), Refusal> {
        if line.words.len() == 1 {
            return self.bare_g92(number);
        }
        let extruder = self.extruder();
        if let Some(e) = self.length(line, extruder, number)? {
            self.e = e;
            self.found.counted.before = None;
        }
        for (axis, letter) in self.axes().into_iter().enumerate() {
            if let Some(place) = self.place(line, axis, letter, number)? {
                self.offset[axis] = self.at[axis] - place;
            }
        }
        Ok(())
    }

    /// G28: the head goes to the machine's zero.
    pub(super) fn home(&mut self, line: &Line, number: usize) -> Result<(), Refusal> {
        let named = |letter: u8| line.words.iter().any(|word| word.letter == letter);
        let axes = self.axes();
        let all = !axes.iter().any(|letter| named(*letter));
        let mut to = self.at;
        for (axis, letter) in axes.into_iter().enumerate() {
            if all || named(letter) {
                to[axis] = 0.0;
                self.offset[axis] = 0.0;
            }
        }
        let has_moved = !self.found.steps.is_empty();
        if has_moved && to != self.at {
            let speed_mm_s = self.feed_mm_min / 60.0;
            self.push(to, 0.0, speed_mm_s, true, Firmware::None, number)?;
        }
        self.at = to;
        Ok(())
    }
}

/// Words of Sinumerik that make curves of the points behind them.
pub(super) fn is_curve(name: &str) -> bool {
    matches!(
        name,
        "BSPLINE" | "CSPLINE" | "ASPLINE" | "POLY" | "CIP" | "CT"
    )
}

/// The refusal of such a word.
pub(super) fn no_corners(code: String, line: usize) -> Refusal {
    error::not_read(
        line,
        &code,
        "the points behind it are no corners of a path; let the post-processor write straight moves (G1)",
    )
}

/// RepRapFirmware's conditions and loops, and subprograms by their number.
pub(super) fn is_computed(name: &str, command: &str) -> bool {
    const META: [&str; 7] = ["if", "elif", "else", "while", "break", "continue", "abort"];
    let is_number = |text: &str| text.trim_start().starts_with(|c: char| c.is_ascii_digit());
    let is_numbered = || {
        command
            .split_once(['P', 'p'])
            .is_some_and(|(_, p)| is_number(p))
    };
    META.contains(&name) || matches!(name, "M97" | "M98") && is_numbered()
}

/// S of M220 and M221.
fn bounded_percent(line: &Line, number: usize) -> Result<Option<f64>, Refusal> {
    let given = value(line, b'S', number)?;
    match given {
        Some(percent) if !(1.0..=1000.0).contains(&percent) => {
            Err(error::beyond(number, 'S', percent, 1000.0))
        }
        given => Ok(given),
    }
}
