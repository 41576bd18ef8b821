//! Moves of declared axes -> legs of the tip on the part, each with the time that the file gives it.
//!
//! In: the places of a file's axes along a move (mm, degrees), what it extrudes, F. Out: steps whose places are poses
//! on the part and whose speeds are the tip's there (mm/s). All axes go evenly over a move, and so does E. F is a
//! length a minute, and which length is the program's rule ([`FeedOf`]); by inverse time (G93) it is the move's time
//! itself. Leaves out accelerations: a file's times have none.

use super::klipper::{number_of, text_of};
use super::{Firmware, Interpreter};
use crate::gcode::axes::{At, FileAxes, SLOTS, TURNS_FROM};
use crate::gcode::error;
use crate::gcode::passes::{STILL_DEG, STILL_MM};
use crate::gcode::words::Line;
use crate::gcode::{ANGLE_MAX_DEG, PLACE_MAX_MM};
use crate::settings::axes_words::FeedOf;
use crate::text::refusal::Refusal;

/// Tool axes nearer to Z than this are upright, as a sine.
const UPRIGHT_MAX: f64 = 1e-6;
/// Slowest speed that a step has, mm/s.
const SLOWEST_MM_S: f64 = 1e-6;

/// Lengths of a way: linear axes, turns in degrees, and all of them together.
#[derive(Clone, Copy, Default)]
struct Lengths {
    xyz_mm: f64,
    turned_deg: f64,
    all: f64,
}

impl Lengths {
    fn of(from: &At, to: &At) -> Lengths {
        let squares = |axes: &[usize]| -> f64 {
            axes.iter()
                .map(|axis| (to[*axis] - from[*axis]).powi(2))
                .sum()
        };
        let linear = squares(&[0, 1, 2]);
        let turns: Vec<usize> = (TURNS_FROM..to.len()).collect();
        let turned = squares(&turns);
        Lengths {
            xyz_mm: linear.sqrt(),
            turned_deg: turned.sqrt(),
            all: (linear + turned).sqrt(),
        }
    }

    fn and(self, other: Lengths) -> Lengths {
        Lengths {
            xyz_mm: self.xyz_mm + other.xyz_mm,
            turned_deg: self.turned_deg + other.turned_deg,
            all: self.all + other.all,
        }
    }
}

impl Interpreter {
    /// An axis' word in mm or degrees.
    pub(super) fn place(
        &self,
        line: &Line,
        axis: usize,
        letter: u8,
        number: usize,
    ) -> Result<Option<f64>, Refusal> {
        let is_linear = axis < TURNS_FROM;
        let scale = if is_linear { self.unit_mm } else { 1.0 };
        let given = super::value(line, letter, number)?.map(|value| value * scale);
        let most = if is_linear {
            PLACE_MAX_MM
        } else {
            ANGLE_MAX_DEG
        };
        super::bounded(given, letter, number, most)
    }

    /// Letters of the axes; 0 where there is none.
    pub(super) fn axes(&self) -> [u8; SLOTS] {
        let extruder = self.extruder();
        let letters = match &self.axes {
            Some(axes) => axes.letters(),
            None => {
                let told = self.found.comments.turns.or(self.head_letters);
                let [a, b, c] = told.unwrap_or(*b"ABC");
                [b'X', b'Y', b'Z', a, b, c, 0, 0, 0, 0]
            }
        };
        // A letter that extrudes does not turn.
        letters.map(|letter| if letter == extruder { 0 } else { letter })
    }

    pub(super) fn extruder(&self) -> u8 {
        let declared = self.axes.as_ref().and_then(|axes| axes.extruder());
        let told = declared.or(self.found.comments.extruder);
        told.unwrap_or(b'E')
    }

    /// Where the first move of declared axes begins.
    pub(super) fn begin(&mut self) {
        let at = self.at;
        self.found.start = self.place_of(&at, true);
    }

    /// A slot that turns is named.
    pub(super) fn turns_by(&mut self, axis: usize) {
        match &self.axes {
            // Whether it tilts is seen where the tip goes.
            Some(axes) => self.found.turns[1] |= axes.heading() == Some(axis),
            None => self.found.turns[usize::from(axis == TURNS_FROM + 2)] = true,
        }
    }

    /// A step's place: of declared axes the nozzle's on the part.
    pub(super) fn place_of(&mut self, at: &At, rapid: bool) -> [f64; 6] {
        let Some(axes) = &self.axes else {
            let [x, y, z, a, b, c, ..] = *at;
            return [x, y, z, a, b, c];
        };
        let pose = axes.pose(at);
        let steps = &self.found.steps;
        let before = steps.last().map_or(self.found.start, |step| step.to);
        let place = pose.place(before[5]);
        let leans = pose.axis.x.hypot(pose.axis.y) > UPRIGHT_MAX || pose.axis.z < 0.0;
        self.found.turns[0] |= leans && !rapid;
        let ([x, y, z], [a, b, c]) = (place.tip_mm, place.turn_deg);
        [x, y, z, a, b, c]
    }

    /// Along the places of a move of declared axes.
    pub(super) fn along_axes(
        &mut self,
        axes: &FileAxes,
        way: &[At],
        extruded: f64,
        rapid: bool,
        number: usize,
    ) -> Result<(), Refusal> {
        let mut lengths = Lengths::default();
        let mut legs: Vec<(At, f64)> = Vec::new();
        for pair in way.windows(2) {
            let of_pair = Lengths::of(&pair[0], &pair[1]);
            lengths = lengths.and(of_pair);
            let places = match rapid {
                true => vec![pair[1]],
                false => axes.legs(&pair[0], &pair[1]),
            };
            let count = places.len() as f64;
            legs.extend(places.into_iter().map(|to| (to, of_pair.all / count)));
        }
        self.curve_moves_left = self
            .curve_moves_left
            .checked_sub(legs.len().saturating_sub(way.len() - 1))
            .ok_or_else(|| error::too_fine(number))?;
        let mut tip = axes.pose(&way[0]).tip_mm;
        let tips_mm: Vec<f64> = legs
            .iter()
            .map(|(to, _)| {
                let next = axes.pose(to).tip_mm;
                let length_mm = (next - tip).norm();
                tip = next;
                length_mm
            })
            .collect();
        let tip_mm: f64 = tips_mm.iter().sum();
        let duration_s = self.duration_s(axes, &lengths, tip_mm, extruded, rapid);
        let rapid = rapid || !self.may_cut();
        let count = legs.len();
        for ((to, length), leg_mm) in legs.into_iter().zip(tips_mm) {
            let share = match lengths.all > 0.0 {
                true => length / lengths.all,
                false => 1.0 / count as f64,
            };
            // On the spot it is the extruder's speed, or that of the turn.
            let moved = match (tip_mm > STILL_MM, lengths.turned_deg > STILL_DEG) {
                (true, _) => leg_mm,
                (_, true) => lengths.turned_deg * share,
                _ => extruded.abs() * share,
            };
            let speed_mm_s = (moved / (duration_s * share).max(1e-12)).max(SLOWEST_MM_S);
            let extruded = extruded * share;
            self.push(to, extruded, speed_mm_s, rapid, Firmware::None, number)?;
        }
        Ok(())
    }

    /// The time that the file gives a move, s.
    fn duration_s(
        &self,
        axes: &FileAxes,
        lengths: &Lengths,
        tip_mm: f64,
        extruded: f64,
        rapid: bool,
    ) -> f64 {
        let a_minute = self.feed_mm_min * self.speed_factor;
        if self.inverse_time && !rapid {
            return 60.0 / a_minute;
        }
        let length = match axes.feed() {
            FeedOf::Tip if tip_mm > STILL_MM => tip_mm,
            FeedOf::Xyz if lengths.xyz_mm > STILL_MM => lengths.xyz_mm,
            FeedOf::All => lengths.all,
            FeedOf::Tip | FeedOf::Xyz => lengths.turned_deg,
        };
        let length = match length > STILL_MM {
            true => length,
            false => extruded.abs(),
        };
        60.0 * length / a_minute
    }

    /// MANUAL_STEPPER of a declared axis: it turns while the others stand; false for all others.
    pub(super) fn manual_stepper(&mut self, command: &str, line: usize) -> Result<bool, Refusal> {
        let name = text_of(command, "STEPPER").unwrap_or_default();
        let Some(axes) = &self.axes else {
            return self.watch_stepper(name, command, line);
        };
        let Some(slot) = axes.stepper(name) else {
            return Ok(false);
        };
        if axes.heading() == Some(slot) {
            self.found.turns[1] = true;
        }
        if let Some(set) = number_of(command, "SET_POSITION", line)? {
            self.offset[slot] = self.at[slot] - set;
        }
        if let Some(to) = number_of(command, "MOVE", line)? {
            let to = super::bounded(Some(self.offset[slot] + to), b'S', line, ANGLE_MAX_DEG)?;
            let mut at = self.at;
            at[slot] = to.unwrap_or(at[slot]);
            let speed_mm_s = self.feed_mm_min / 60.0;
            self.push(at, 0.0, speed_mm_s, true, Firmware::None, line)?;
        }
        Ok(true)
    }
}
