//! Motion: a line's place by the motion in force, curves as chords.
//!
//! In: a line and the modes. Out: steps (mm, degrees, mm/s) of one frame.

use super::{EXTRUDER_MAX, Firmware, Interpreter, Motion, bounded};
use crate::gcode::axes::{At, TURNS_FROM};
use crate::gcode::curve_chords::{ArcWords, TURNS_MAX, arc_chords, bezier_chords};
use crate::gcode::error;
use crate::gcode::passes::{STILL_DEG, STILL_MM};
use crate::gcode::words::Line;
use crate::gcode::{ANGLE_MAX_DEG, PLACE_MAX_MM};
use crate::text::refusal::{Refusal, refusal};
use std::f64::consts::TAU;

impl Interpreter {
    /// A motion: to the line's place, by the motion in force.
    pub(super) fn go(
        &mut self,
        line: &Line,
        number: usize,
        in_machine: bool,
    ) -> Result<(), Refusal> {
        let motion = self.motion.ok_or_else(|| {
            refusal!(
                "line {number}: it names an axis, and no G0 to G3 was there before: write the code"
            )
        })?;
        let rapid = motion == Motion::Line { rapid: true };
        let has_feed = self.feed(line, number)?;
        if self.inverse_time && !rapid && !has_feed {
            return Err(refusal!(
                "line {number}: with G93 every G1, G2, G3 and G5 needs its own F"
            ));
        }
        self.watch(line, number)?;
        let mut to = self.at;
        for (axis, letter) in self.axes().into_iter().enumerate() {
            let Some(place) = self.place(line, axis, letter, number)? else {
                continue;
            };
            if axis >= TURNS_FROM {
                self.turns_by(axis);
            }
            to[axis] = match (self.relative, in_machine) {
                (_, true) => place,
                (true, _) => self.at[axis] + place,
                (false, _) => self.offset[axis] + place,
            };
            let most = if axis < TURNS_FROM {
                PLACE_MAX_MM
            } else {
                ANGLE_MAX_DEG
            };
            bounded(Some(to[axis]), letter, number, most)?;
        }
        let extruder = self.extruder();
        let mut extruded = 0.0;
        if let Some(e) = self.length(line, extruder, number)? {
            let is_relative = self.relative && self.flavour.has_relative_e();
            let is_relative = self.e_relative || is_relative;
            extruded = if is_relative { e } else { e - self.e };
            self.count(e, extruded, to, number);
            // Not a sum: what it is beside the file's own number would be a bead of its own.
            self.e = if is_relative { self.e + e } else { e };
            bounded(Some(self.e), extruder, number, EXTRUDER_MAX)?;
            self.found.extrudes = true;
        }
        extruded *= self.flow_factor;
        let places = match motion {
            Motion::Line { .. } => Vec::new(),
            Motion::Arc { clockwise } => self.arc(line, to, clockwise, extruded > 0.0, number)?,
            Motion::Bezier => self.bezier(line, to, number)?,
        };
        self.curve_moves_left = self
            .curve_moves_left
            .checked_sub(places.len())
            .ok_or_else(|| error::too_fine(number))?;
        self.along(&places, to, extruded, rapid, number)
    }

    /// Counts what tells how E is meant.
    fn count(&mut self, e: f64, extruded: f64, to: At, number: usize) {
        let counted = &mut self.found.counted;
        counted.sums[0] += extruded;
        if self.e_is_said || self.relative {
            counted.sums[1] += extruded;
            return;
        }
        counted.sums[1] += e;
        if counted.unsaid == 0 {
            counted.line = number;
        }
        counted.unsaid += 1;
        let way_mm = (to[0] - self.at[0]).hypot(to[1] - self.at[1]);
        if way_mm > STILL_MM && e > 0.0 {
            counted.bead(e, extruded, way_mm);
        }
    }

    /// Along the places of a curve in its plane, everything else evenly; straight without them.
    pub(super) fn along(
        &mut self,
        places: &[[f64; 2]],
        to: At,
        extruded: f64,
        rapid: bool,
        number: usize,
    ) -> Result<(), Refusal> {
        let from = self.at;
        let mut way = vec![from];
        let count = places.len();
        for (k, place) in places.iter().enumerate().take(count.saturating_sub(1)) {
            let share = (k + 1) as f64 / count as f64;
            let mut at: At =
                std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]));
            at[self.plane[0]] = place[0];
            at[self.plane[1]] = place[1];
            if place.iter().any(|mm| mm.abs() > PLACE_MAX_MM) {
                return Err(error::arc(
                    number,
                    &format!("leaves {PLACE_MAX_MM} mm: check I, J, K, P, Q and R"),
                ));
            }
            way.push(at);
        }
        way.push(to);
        if let Some(axes) = self.axes.clone() {
            return self.along_axes(&axes, &way, extruded, rapid, number);
        }
        self.wind(&to, extruded, rapid, number);
        let length = |range: std::ops::Range<usize>| -> f64 {
            way.windows(2)
                .map(|pair| {
                    range
                        .clone()
                        .map(|axis| (pair[1][axis] - pair[0][axis]).powi(2))
                        .sum::<f64>()
                        .sqrt()
                })
                .sum()
        };
        // The feed is the tip's; of the rotary axes where the tip stands.
        let (tip_mm, turned_deg) = (length(0..3), length(TURNS_FROM..TURNS_FROM + 3));
        // By inverse time what moves has the move's time: the extruder alone, too.
        let moved = match (tip_mm > STILL_MM, turned_deg > STILL_DEG) {
            (true, _) => tip_mm,
            (_, true) => turned_deg,
            _ => extruded.abs(),
        };
        let speed = match self.inverse_time && !rapid {
            true => moved * self.feed_mm_min / 60.0,
            false => self.feed_mm_min / 60.0,
        };
        let rapid = rapid || !self.may_cut();
        let speed_mm_s = (speed * self.speed_factor).max(1e-6);
        for pair in way.windows(2) {
            let leg: f64 = (0..3)
                .map(|axis| (pair[1][axis] - pair[0][axis]).powi(2))
                .sum::<f64>()
                .sqrt();
            let share = match tip_mm > 0.0 {
                true => leg / tip_mm,
                false => 1.0 / (way.len() - 1) as f64,
            };
            self.push(
                pair[1],
                extruded * share,
                speed_mm_s,
                rapid,
                Firmware::None,
                number,
            )?;
        }
        Ok(())
    }

    pub(super) fn arc(
        &mut self,
        line: &Line,
        to: At,
        clockwise: bool,
        prints: bool,
        number: usize,
    ) -> Result<Vec<[f64; 2]>, Refusal> {
        let [u, v, _] = self.plane;
        let mut centre = [0.0; 2];
        let mut is_given = false;
        for (slot, axis) in [u, v].into_iter().enumerate() {
            let letter = b"IJK"[axis];
            if let Some(given) = self.length(line, letter, number)? {
                is_given = true;
                centre[slot] = match self.centres_absolute {
                    true => self.offset[axis] + given - self.at[axis],
                    false => given,
                };
            } else if self.centres_absolute {
                centre[slot] = -self.at[axis] + self.offset[axis];
            }
        }
        let radius_mm = self.length(line, b'R', number)?;
        let turns = self.turns(line, prints, number)?;
        self.count_turns(
            turns,
            radius_mm.unwrap_or(centre[0].hypot(centre[1])),
            number,
        )?;
        let words = ArcWords {
            clockwise,
            centre_mm: is_given.then_some(centre),
            radius_mm,
            turns,
        };
        let (from, to) = ([self.at[u], self.at[v]], [to[u], to[v]]);
        arc_chords(from, to, &words, self.curve_moves_left, number)
    }

    /// Takes the way of an arc's further turns off what turns may claim.
    fn count_turns(
        &mut self,
        turns: Option<f64>,
        radius_mm: f64,
        line: usize,
    ) -> Result<(), Refusal> {
        let further = turns.map_or(0.0, |turns| (turns.floor() - 1.0).clamp(0.0, TURNS_MAX));
        self.turns_mm_left -= further * TAU * radius_mm.abs();
        match self.turns_mm_left >= 0.0 {
            true => Ok(()),
            false => Err(error::too_fine(line)),
        }
    }

    pub(super) fn bezier(
        &mut self,
        line: &Line,
        to: At,
        number: usize,
    ) -> Result<Vec<[f64; 2]>, Refusal> {
        let bad = |problem: &str| error::arc(number, problem);
        if self.plane != [0, 1, 2] {
            return Err(bad("(G5) lies in the XY plane: write G17 before it"));
        }
        let first = [
            self.length(line, b'I', number)?,
            self.length(line, b'J', number)?,
        ];
        let second = [
            self.length(line, b'P', number)?,
            self.length(line, b'Q', number)?,
        ];
        let ([Some(p), Some(q)], [i, j]) = (second, first) else {
            return Err(bad(
                "(G5) needs P and Q, its second control point from its end",
            ));
        };
        // Without I and J it goes on as the one before it ended.
        let [i, j] = match (i, j) {
            (Some(i), Some(j)) => [i, j],
            (None, None) => self.bezier_mm,
            _ => return Err(bad("(G5) needs both I and J, or neither")),
        };
        self.bezier_mm = [-p, -q];
        let from = [self.at[0], self.at[1]];
        let end = [to[0], to[1]];
        Ok(bezier_chords([
            from,
            [from[0] + i, from[1] + j],
            [end[0] + p, end[1] + q],
            end,
        ]))
    }
}
