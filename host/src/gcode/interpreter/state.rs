//! States that a file keeps and comes back to, and codes that firmwares read differently.
//!
//! In: SAVE_GCODE_STATE and RESTORE_GCODE_STATE (Klipper), M120 and M121 (a stack in RepRapFirmware, endstops in
//! Marlin), a bare G92. Out: the interpreter's modes, offsets and feeds. Where the file does not say which
//! firmware it is for and it makes a difference, it is refused with the line.

use super::klipper::text_of;
use super::{Interpreter, motion_of, tenths, value};
use crate::gcode::axes::{At, SLOTS};
use crate::gcode::error;
use crate::gcode::flavour::Flavour;
use crate::gcode::words::{Line, shortened};
use crate::text::refusal::{Refusal, refusal};
use std::collections::BTreeMap;

/// Most states that are kept.
const STATES_MAX: usize = 100;

/// What is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
struct State {
    unit_mm: f64,
    relative: bool,
    e_relative: bool,
    inverse_time: bool,
    volumetric: bool,
    feed_mm_min: f64,
    // Klipper's alone.
    speed_factor: f64,
    flow_factor: f64,
    offset: At,
    at: At,
    e: f64,
}

/// States to come back to.
#[derive(Default)]
pub(super) struct Saved {
    named: BTreeMap<String, State>,
    stack: Vec<State>,
}

impl Interpreter {
    fn state(&self) -> State {
        State {
            unit_mm: self.unit_mm,
            relative: self.relative,
            e_relative: self.e_relative,
            inverse_time: self.inverse_time,
            volumetric: self.volumetric,
            feed_mm_min: self.feed_mm_min,
            speed_factor: self.speed_factor,
            flow_factor: self.flow_factor,
            offset: self.offset,
            at: self.at,
            e: self.e,
        }
    }

    /// What RepRapFirmware's stack has.
    fn set_modes(&mut self, state: &State) {
        self.unit_mm = state.unit_mm;
        self.relative = state.relative;
        self.e_relative = state.e_relative;
        self.inverse_time = state.inverse_time;
        self.volumetric = state.volumetric;
        self.feed_mm_min = state.feed_mm_min;
    }

    /// M120.
    pub(super) fn push_state(&mut self) {
        let keeps = matches!(self.flavour, Flavour::RepRapFirmware | Flavour::Unknown);
        if keeps && self.saved.stack.len() < STATES_MAX {
            let state = self.state();
            self.saved.stack.push(state);
        }
    }

    /// M121.
    pub(super) fn pop_state(&mut self, line: usize) -> Result<(), Refusal> {
        let Some(kept) = self.saved.stack.pop() else {
            return Ok(());
        };
        let now = self.state();
        let modes = |state: &State| State {
            at: now.at,
            e: now.e,
            offset: now.offset,
            speed_factor: now.speed_factor,
            flow_factor: now.flow_factor,
            ..*state
        };
        if self.flavour == Flavour::Unknown && modes(&kept) != now {
            return Err(error::disputed(
                line,
                "M121",
                "takes back the modes and the feed of M120 in RepRapFirmware and switches \
                           endstops in Marlin",
            ));
        }
        self.set_modes(&kept);
        Ok(())
    }

    /// SAVE_GCODE_STATE.
    pub(super) fn save_named(&mut self, command: &str, line: usize) -> Result<(), Refusal> {
        let name = text_of(command, "NAME").unwrap_or("default");
        let is_full = self.saved.named.len() >= STATES_MAX;
        if is_full && !self.saved.named.contains_key(name) {
            return Err(refusal!(
                "line {line}: more than 100 names of SAVE_GCODE_STATE: keep fewer states"
            ));
        }
        let state = self.state();
        self.saved.named.insert(name.to_string(), state);
        Ok(())
    }

    /// RESTORE_GCODE_STATE: with MOVE=1 the head goes back.
    pub(super) fn restore_named(&mut self, command: &str, line: usize) -> Result<(), Refusal> {
        let name = text_of(command, "NAME").unwrap_or("default");
        let Some(kept) = self.saved.named.get(name).copied() else {
            return Err(refusal!(
                "line {line}: no SAVE_GCODE_STATE before it has the name '{name}'",
                name = shortened(name)
            ));
        };
        self.set_modes(&kept);
        (self.speed_factor, self.flow_factor) = (kept.speed_factor, kept.flow_factor);
        (self.offset, self.e) = (kept.offset, kept.e);
        let moves = text_of(command, "MOVE").is_some_and(|value| value != "0");
        if !moves {
            return Ok(());
        }
        let own_mm_s = text_of(command, "MOVE_SPEED").and_then(|text| text.parse::<f64>().ok());
        let feed_mm_min = self.feed_mm_min;
        if let Some(mm_s) = own_mm_s.filter(|mm_s| mm_s.is_finite() && *mm_s > 0.0) {
            self.feed_mm_min = (60.0 * mm_s).min(super::FEED_MAX_MM_MIN);
        }
        let mut to = self.at;
        to[..3].copy_from_slice(&kept.at[..3]);
        self.along(&[], to, 0.0, false, line)?;
        self.feed_mm_min = feed_mm_min;
        Ok(())
    }

    /// G92 without axes.
    pub(super) fn bare_g92(&mut self, line: usize) -> Result<(), Refusal> {
        let is_zero = (0..SLOTS).all(|axis| self.at[axis] == self.offset[axis]);
        let e_is_zero = self.e == 0.0 || self.e_relative;
        match self.flavour {
            Flavour::Klipper => {
                (self.offset, self.e) = (self.at, 0.0);
                self.found.counted.before = None;
                Ok(())
            }
            Flavour::Marlin | Flavour::Prusa | Flavour::RepRapFirmware => Ok(()),
            _ if is_zero && e_is_zero => Ok(()),
            _ => Err(error::disputed(
                line,
                "G92",
                "without axes sets all of them to 0 in Klipper and nothing in Marlin and \
                           RepRapFirmware",
            )),
        }
    }

    /// Times that an arc passes its end, as RS274/NGC counts them; `prints` where it lays a bead.
    pub(super) fn turns(
        &self,
        line: &Line,
        prints: bool,
        number: usize,
    ) -> Result<Option<f64>, Refusal> {
        let Some(given) = value(line, b'P', number)? else {
            return Ok(None);
        };
        match self.flavour {
            // Full turns before the arc itself.
            Flavour::Marlin | Flavour::Prusa => Ok(Some(given + 1.0)),
            // Not read by either.
            Flavour::Klipper | Flavour::RepRapFirmware => Ok(None),
            Flavour::MachineTool => Ok(Some(given)),
            Flavour::Unknown if prints => Err(error::disputed(
                number,
                "P of an arc",
                "counts the turns that Marlin makes beside the arc, and in RS274/NGC those that \
                           the arc has",
            )),
            Flavour::Unknown => Ok(Some(given.max(1.0))),
        }
    }

    /// S of a spindle or a laser: in a line of M3, M4 or of moves.
    pub(super) fn set_power(&mut self, line: &Line, number: usize) -> Result<(), Refusal> {
        let is_other = line.words.iter().any(|word| match word.letter {
            b'M' => !(30..60).contains(&tenths(word)),
            b'G' => motion_of(tenths(word)).is_none(),
            _ => false,
        });
        if !is_other && line.words.iter().any(|word| word.letter == b'S') {
            self.power = value(line, b'S', number)?.or(self.power);
        }
        Ok(())
    }

    /// False where a spindle or a laser is known to be off.
    pub(super) fn may_cut(&self) -> bool {
        self.tool_on != Some(false) && self.power != Some(0.0)
    }
}
