//! Moves of the stream as lines of text.
//!
//! In: ticks from and to. Out: G1, G2 and G3 with their words and feed, each as long as its ticks. Feed is that of
//! the tip where the dialect has it so, along an arc its length; of turns alone degrees a minute.

use super::arc_moves::{Arc, MoveEnd, moves_with_arcs};
use super::dialect::ArcsWritten;
use super::limits::{AXES, EXTRUDER};
use super::lines::{EvenHeading, LineTolerances, move_ends};
use super::poses::Poses;
use super::{STILL_MM, WriteError, Writer, short};
use headway_protocol::units::{CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Z, CHANNELS};
use std::io::Write;
use std::ops::Range;

/// Shorter moves are not cut where the heading's rate changes, s.
const EVEN_FROM_S: f64 = 0.004;
/// Longer moves are cut by length, s.
const LONG_FROM_S: f64 = 0.025;
/// Time over which moves are counted, s.
const WINDOW_S: f64 = 0.5;

/// True if two poses are nearer to each other than what a straight move may be off.
fn is_within(one: &[f64; CHANNELS], other: &[f64; CHANNELS], tolerances: &LineTolerances) -> bool {
    let away = |channels: Range<usize>| {
        let squares = channels.map(|channel| (one[channel] - other[channel]).powi(2));
        squares.sum::<f64>().sqrt()
    };
    away(CHANNEL_X..CHANNEL_Z + 1) < tolerances.tip_mm
        && away(CHANNEL_Z + 1..CHANNEL_VOLUME) < tolerances.turn_rad
}

impl<W: Write> Writer<'_, W> {
    /// A move of the stream, or a part of it, from tick to tick.
    pub(super) fn route_move(
        &mut self,
        [from_tick, to_tick]: [u64; 2],
        poses: &mut Poses,
    ) -> Result<(), WriteError> {
        let all: Vec<[f64; CHANNELS]> = (from_tick..=to_tick).map(|tick| poses.at(tick)).collect();
        let tolerances = LineTolerances {
            tip_mm: self.options.tip_mm,
            turn_rad: self.options.dialect.tolerances()[1].to_radians(),
            wrapped: self.options.wrapped,
            volume_mm3: self.options.volume_mm3,
            even: self.even_heading(),
            long_ticks: (LONG_FROM_S * self.servo_hz).round() as usize,
        };
        if all.iter().all(|pose| *pose == all[0]) {
            return Ok(());
        }
        let straight = |tick| MoveEnd { tick, arc: None };
        let mut ends: Vec<MoveEnd> = match self.arcs {
            ArcsWritten::None => move_ends(&all, &tolerances)
                .into_iter()
                .map(straight)
                .collect(),
            ArcsWritten::Standing => moves_with_arcs(&all, &tolerances, false),
            ArcsWritten::Turning => moves_with_arcs(&all, &tolerances, true),
        };
        // A controller that drops moves of a few steps would add it to the push of filament behind it, at another speed.
        if let [.., before, last] = ends.as_slice()
            && before.arc.is_none()
            && last.arc.is_none()
            && is_within(&all[before.tick], &all[last.tick], &tolerances)
        {
            ends.remove(ends.len() - 2);
        }
        let mut from = 0;
        let area_mm2 = self.filament_mm2();
        for end in ends {
            let seconds = (end.tick - from) as f64 / self.servo_hz;
            let extruded_mm3 = all[end.tick][CHANNEL_VOLUME] - all[from][CHANNEL_VOLUME];
            self.written.volume_mm3 += extruded_mm3;
            let asked_mm3 = match extruded_mm3 > 0.0 && seconds > 0.0 {
                true => self.options.asked.at(extruded_mm3 / seconds)[0] * seconds,
                false => extruded_mm3,
            };
            let e_mm = self.e_mm + asked_mm3 / area_mm2;
            let time_s = (from_tick + end.tick as u64) as f64 / self.servo_hz;
            self.types_until(from_tick + from as u64)?;
            self.line(&all[end.tick], end.arc.as_ref(), e_mm, [seconds, time_s])?;
            from = end.tick;
        }
        Ok(())
    }

    fn types_until(&mut self, tick: u64) -> Result<(), WriteError> {
        while let Some((_, word)) = (self.options.types.get(self.typed)).filter(|of| of.0 <= tick) {
            writeln!(self.out, ";TYPE:{word}")?;
            self.typed += 1;
        }
        Ok(())
    }

    /// Where the heading follows, a move is told its mean rate, and the rate steps from move to move.
    fn even_heading(&self) -> EvenHeading {
        match self.follows {
            true => EvenHeading {
                change_rad: self.options.limits.heading_change().to_radians() / self.servo_hz,
                ticks_min: (EVEN_FROM_S * self.servo_hz).round() as usize,
            },
            false => EvenHeading::ANY,
        }
    }

    /// A line: to a pose, with filament up to `e_mm`, which takes seconds and ends at a time.
    fn line(
        &mut self,
        pose: &[f64; CHANNELS],
        arc: Option<&Arc>,
        e_mm: f64,
        [seconds, time_s]: [f64; 2],
    ) -> Result<(), WriteError> {
        let (before_deg, from_mm) = (self.turn_deg, self.at.tip_mm);
        let to = self.place(pose);
        let length = |way: &[f64]| way.iter().map(|part| part * part).sum::<f64>().sqrt();
        let way_mm: [f64; 3] = std::array::from_fn(|i| to.tip_mm[i] - from_mm[i]);
        let turned: [f64; 3] = std::array::from_fn(|i| self.turn_deg[i] - before_deg[i]);
        let (code, axes, way_mm) = match arc {
            None => ("G1", self.words(&to, 0), length(&way_mm)),
            Some(arc) => {
                let code = if arc.sweep_rad > 0.0 { "G3" } else { "G2" };
                let [i, j] = [0, 1].map(|k| short(arc.centre_mm[k] - from_mm[k], 4));
                let axes = format!("{} I{i} J{j}", self.words(&to, 2));
                (code, axes, length(&[arc.length_mm(), way_mm[2]]))
            }
        };
        let e_before = self.e_units;
        let words = axes + &self.extrusion(e_mm);
        if words.is_empty() {
            return Ok(());
        }
        let mut by = [0.0; AXES];
        for (axis, tip) in to.tip_mm.iter().enumerate() {
            by[axis] = tip - from_mm[axis];
        }
        by[3..EXTRUDER].copy_from_slice(&turned);
        by[EXTRUDER] = (self.e_units - e_before) as f64 * 1e-5;
        self.time.add(by, way_mm, seconds);
        let area_mm2 = self.filament_mm2();
        let demands = &mut self.written.demands;
        demands.add(&by, way_mm, area_mm2, to.turn_deg[2]);
        let feed = match (self.options.dialect.is_machine_tool(), way_mm > STILL_MM) {
            (true, _) => format!(" F{}", short(60.0 / seconds, 4)),
            (false, true) => format!(" F{}", short(60.0 * way_mm / seconds, 2)),
            (false, false) => {
                let turned_deg = length(&turned);
                format!(" F{}", short((60.0 * turned_deg / seconds).max(1.0), 2))
            }
        };
        // Inverse time belongs to its line; a speed goes on.
        let is_new = self.options.dialect.is_machine_tool() || feed != self.feed;
        let told = if is_new { feed.as_str() } else { "" };
        writeln!(self.out, "{code}{words}{told}")?;
        self.feed = feed;
        self.at = to;
        self.top_mm = self.top_mm.max(to.tip_mm[2]);
        self.written.arcs += usize::from(arc.is_some());
        self.count(time_s);
        self.progress(time_s)
    }

    /// How much is done and how many minutes are left, each time a whole per cent has passed; machine tools know no code
    /// for it.
    fn progress(&mut self, now_s: f64) -> Result<(), WriteError> {
        let all_s = self.written.duration_s;
        let pct = (100.0 * now_s / all_s.max(1e-9)) as u64;
        if !self.options.dialect.is_machine_tool() && self.told_pct != Some(pct) {
            self.told_pct = Some(pct);
            let left_min = short((all_s - now_s) / 60.0, 0);
            writeln!(self.out, "M73 P{pct} R{left_min}")?;
        }
        Ok(())
    }

    fn count(&mut self, time_s: f64) {
        self.written.moves += 1;
        self.recent.push_back(time_s);
        while self
            .recent
            .front()
            .is_some_and(|first| *first < time_s - WINDOW_S)
        {
            self.recent.pop_front();
        }
        let rate = self.recent.len() as f64 / WINDOW_S;
        self.written.moves_a_second = self.written.moves_a_second.max(rate);
    }
}
