//! Codes that are no motion: modes, offsets, filament, tools, firmware retraction.
//!
//! In: a code and its line. Out: the interpreter's state; what is not done is noted with its line.

use super::{Firmware, Interpreter, bounded_percent, code_name, tenths, value};
use crate::gcode::FILAMENT_MM;
use crate::gcode::error::GcodeError;
use crate::gcode::flavour::Flavour;
use crate::gcode::words::{Line, Word};

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
    ) -> Result<bool, GcodeError> {
        let not_read = |remedy: &'static str| GcodeError::NotRead {
            line: number,
            code: code_name(word),
            remedy,
        };
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
            921 | 922 => self.offset = [0.0; 6],
            280 => {
                self.home(line);
                return Ok(true);
            }
            100 | 110 if line.words.iter().any(|word| word.letter == b'L') => {
                return Err(not_read(
                    "coordinate systems are not kept: write places of one system (G54)",
                ));
            }
            100 if is_of_a_tool(line) => {
                self.tool_temperature(line, number)?;
                return Ok(true);
            }
            100 => self.firmware(Firmware::Retract(self.retract_mm[0]), number)?,
            110 => self.firmware(Firmware::Prime(self.retract_mm[1]), number)?,
            // Path control, cancelled offsets, the first coordinate system: as it is.
            400 | 490 | 540 | 610 | 611 | 640 | 690 | 800 | 970 | 980 | 990 => {}
            410 | 420 => {
                return Err(not_read(
                    "offset by the tool's radius: let the post-processor compute it",
                ));
            }
            550..=599 => {
                return Err(not_read(
                    "write all places in the first coordinate system (G54)",
                ));
            }
            730 | 760 | 810..=899 => {
                return Err(not_read("let the post-processor write its moves out"));
            }
            51..=53 | 331 | 950 | 960 => {
                return Err(not_read("write it as G1, G2, G3 or G5, with G94 or G93"));
            }
            _ => {
                self.undone(code_name(word), number);
                return Ok(true);
            }
        }
        Ok(false)
    }

    pub(super) fn m_code(
        &mut self,
        word: &Word,
        line: &Line,
        number: usize,
    ) -> Result<(), GcodeError> {
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
    pub(super) fn filament(&mut self, line: &Line, number: usize) -> Result<(), GcodeError> {
        let diameter_mm = value(line, b'D', number)?;
        let is_on = value(line, b'S', number)?.map(|on| on != 0.0);
        match diameter_mm {
            Some(diameter_mm) if diameter_mm != 0.0 => {
                if !(FILAMENT_MM[0]..=FILAMENT_MM[1]).contains(&diameter_mm) {
                    return Err(GcodeError::Filament {
                        line: number,
                        diameter_mm,
                    });
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
            self.tool = Some(tool as u32);
            self.changed = Some(number);
        }
    }

    /// Something is extruded, `on_the_way` or on the spot, by the tool in force: firmwares begin with the
    /// first one. What another one is primed by before the first bead is no matter.
    pub(super) fn prints(&mut self, on_the_way: bool) -> Result<(), GcodeError> {
        let tool = self.tool.unwrap_or(0);
        match (self.printing_tool, self.changed) {
            (Some(before), Some(line)) if before != tool => {
                return Err(GcodeError::SecondTool { line, tool, before });
            }
            (None, _) if on_the_way => self.printing_tool = Some(tool),
            _ => {}
        }
        Ok(())
    }

    /// G92.
    pub(super) fn set_position(&mut self, line: &Line, number: usize) -> Result<(), GcodeError> {
        if line.words.len() == 1 {
            return self.bare_g92(number);
        }
        let extruder = self.extruder();
        if let Some(e) = self.length(line, extruder, number)? {
            self.e = e;
            self.found.counted.before = None;
        }
        for (axis, letter) in self.axes().into_iter().enumerate() {
            if let Some(place) = self.place(line, letter, number)? {
                self.offset[axis] = self.at[axis] - place;
            }
        }
        Ok(())
    }

    /// G28: the head is at the machine's zero.
    pub(super) fn home(&mut self, line: &Line) {
        let named = |letter: u8| line.words.iter().any(|word| word.letter == letter);
        let axes = self.axes();
        let all = !axes.iter().any(|letter| named(*letter));
        for (axis, letter) in axes.into_iter().enumerate() {
            if all || named(letter) {
                self.at[axis] = 0.0;
                self.offset[axis] = 0.0;
            }
        }
    }
}
