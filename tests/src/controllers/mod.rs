//! Models of the controllers that G-code is written for, each from its documentation and the behaviour of its
//! source: a text goes in, start and end blocks included, and out comes how the controller drives it.
//!
//! ```text
//! text --lines--> commands --state--> moves --look-ahead--> profiles --> [`Printed`]
//! ```
//! In: a text, and the controller's configuration in its own terms. Out: time, peaks of each axis, places, what is
//! left at the end. A controller keeps its state from print to print. They share the words of a line ([`words`])
//! and the arithmetic of straight moves with one acceleration ([`profiles`]), nothing with Headway's host. Leaves
//! out homing, heating, pressure advance and input shaping: they take their time and change no move.

pub mod grblhal;
pub mod guide;
pub mod klipper;
pub mod linuxcnc;
pub mod marlin;
pub mod mean_acceleration;
pub mod profiles;
pub mod reprapfirmware;
pub mod state;
pub mod words;

use mean_acceleration::{MEAN_S, SHORT_S, Track};
use profiles::Block;
use state::{State, Way};
use std::collections::BTreeMap;
use std::ops::Range;

/// X Y Z in mm, A B C in degrees, filament in mm.
pub const AXES: usize = 7;
/// The heading's axis.
pub const HEADING: usize = 5;
/// The extruder's.
pub const EXTRUDER: usize = 6;

/// An axis at its fastest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Peak {
    /// mm/s or degrees/s.
    pub speed: f64,
    /// Within moves, mm/s² or degrees/s².
    pub acceleration: f64,
    /// Step of the speed from a move to the next, mm/s or degrees/s.
    pub step: f64,
}

/// A print as a controller drives it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Printed {
    /// Of the job's moves and rests, s.
    pub seconds: f64,
    /// Where they end, the first place being where the job begins: mm and degrees of the machine.
    pub places: Vec<[f64; 6]>,
    /// Filament of the moves on which something else moves too, mm.
    pub filament_mm: f64,
    /// Of each axis, over the whole text.
    pub peaks: [Peak; AXES],
    /// Largest change of each axis' mean speed from one 20 ms to the next, over 20 ms: with the steps between moves.
    pub mean_accelerations: [f64; AXES],
    /// The same of 10 ms.
    pub short_accelerations: [f64; AXES],
    /// Moves, and how many of them begin slower than requested for which reason.
    pub moves: usize,
    /// See `moves`.
    pub slowed_by: BTreeMap<&'static str, usize>,
    /// Most moves that begin within half a second, a second.
    pub moves_a_second: f64,
    /// Longest line, characters.
    pub line_chars: usize,
    /// What is not as it was before the print.
    pub left: Vec<String>,
}

/// A move as the controller plans it, with what it is of the text.
#[derive(Clone, Debug)]
pub struct Planned {
    /// What is planned.
    pub block: Block,
    /// Places along it up to its end, X Y Z A B C of the machine.
    pub places: Vec<[f64; 6]>,
    /// See [`JobBounds`].
    pub of_job: bool,
    /// Time at rest after it, s; `None` goes on.
    pub rest_s: Option<f64>,
}

/// The moves of a text that a [`State`] reads; `block` makes them of its ways, and of the block before where there is no
/// rest between. M66, M68, M109, M190 and M400 wait for the moves before them.
///
/// # Errors
/// What the controller refuses, with the line.
pub fn moves_of(
    text: &str,
    state: &mut State,
    line_max: usize,
    mut block: impl FnMut(&State, &Way, Option<&Block>) -> Result<Option<Block>, String>,
) -> Result<Vec<Planned>, String> {
    const WAITS: [f64; 5] = [66.0, 68.0, 109.0, 190.0, 400.0];
    let mut moves: Vec<Planned> = Vec::new();
    let mut bounds = JobBounds::default();
    for (index, line) in text.lines().enumerate() {
        let of_job = bounds.is_job(line);
        let said = |error: String| format!("line {}: {error}: {line}", index + 1);
        if line.len() > line_max {
            return Err(said("the line is too long".to_string()));
        }
        let Some(words) = words::words(line).map_err(said)? else {
            continue;
        };
        let way = state.line(&words).map_err(said)?;
        if words.codes('M').any(|code| WAITS.contains(&code))
            && let Some(last) = moves.last_mut()
        {
            last.rest_s = Some(0.0);
        }
        let Some(way) = way else { continue };
        let before = moves.last().filter(|of| of.rest_s.is_none());
        let made = block(state, &way, before.map(|of| &of.block)).map_err(said)?;
        if let Some(block) = made {
            moves.push(Planned {
                block,
                places: way.places(),
                of_job,
                rest_s: None,
            });
        }
    }
    Ok(moves)
}

/// Which lines of a text are the job's: from behind its approach, the first G0, to its end block.
#[derive(Clone, Copy, Debug, Default)]
pub struct JobBounds {
    approached: bool,
    ended: bool,
}

impl JobBounds {
    /// True for the next line where it is the job's.
    pub fn is_job(&mut self, line: &str) -> bool {
        let ends = [";end of the job", "M400", "G94"];
        self.ended |= self.approached && ends.iter().any(|end| line.starts_with(end));
        let is_job = self.approached && !self.ended;
        self.approached |= line.starts_with("G0 ");
        is_job
    }
}

/// Least of the limits of the axes for a unit of length.
pub fn within(direction: &[f64; AXES], limits: &[f64; AXES]) -> f64 {
    let of_axes = direction
        .iter()
        .zip(limits)
        .filter(|(share, _)| **share != 0.0);
    of_axes
        .map(|(share, limit)| limit / share.abs())
        .fold(f64::INFINITY, f64::min)
}

/// What the printers' controllers and LinuxCNC count as a move's length: X Y Z where they move, else the rotary axes,
/// else the extruder.
pub fn linear_first(way: &Way) -> f64 {
    let turn = way.by[3..EXTRUDER]
        .iter()
        .map(|d| d * d)
        .sum::<f64>()
        .sqrt();
    match (way.length_mm > 0.0, turn > 0.0) {
        (true, _) => way.length_mm,
        (false, true) => turn,
        (false, false) => way.by[EXTRUDER].abs(),
    }
}

impl Printed {
    /// What is printed by moves that are planned from rest to rest, by their numbers.
    pub fn of_moves(
        moves: &[Planned],
        mut plan: impl FnMut(Range<usize>) -> Vec<profiles::Profile>,
    ) -> Printed {
        let mut printed = Printed {
            moves: moves.len(),
            ..Printed::default()
        };
        let (mut now_s, mut begins) = (0.0, Vec::new());
        let mut before: Option<(Block, profiles::Profile)> = None;
        let mut track = Track::default();
        let mut from = 0;
        for run in moves.split_inclusive(|of| of.rest_s.is_some()) {
            let range = from..from + run.len();
            from = range.end;
            for (planned, profile) in run.iter().zip(plan(range)) {
                printed.peak(&planned.block, &profile, before.as_ref());
                track.add(&planned.block, &profile, planned.rest_s.unwrap_or(0.0));
                if planned.of_job {
                    begins.push(now_s);
                    now_s += profile.seconds + planned.rest_s.unwrap_or(0.0);
                    printed.seconds = now_s;
                    let pushed_mm = planned.block.direction[EXTRUDER] * planned.block.length;
                    let goes = planned.block.direction[..EXTRUDER]
                        .iter()
                        .any(|d| *d != 0.0);
                    printed.filament_mm += if goes { pushed_mm } else { 0.0 };
                }
                match (planned.of_job, begins.is_empty()) {
                    (true, _) => printed.places.extend(&planned.places),
                    (false, true) => printed.places = planned.places.clone(),
                    (false, false) => {}
                }
                before = planned
                    .rest_s
                    .is_none()
                    .then(|| (planned.block.clone(), profile));
            }
            before = None;
        }
        printed.moves_a_second = profiles::most_a_second(&begins);
        printed.mean_accelerations = track.mean_accelerations(MEAN_S);
        printed.short_accelerations = track.mean_accelerations(SHORT_S);
        printed
    }

    /// The same of a planner that looks ahead over so many moves.
    pub fn looked_ahead(moves: &[Planned], buffer: usize) -> Printed {
        let blocks: Vec<Block> = moves.iter().map(|of| of.block.clone()).collect();
        Printed::of_moves(moves, |range| profiles::look_ahead(&blocks[range], buffer))
    }

    /// With what only the text and the controller behind it say: its longest line, and what it leaves set.
    pub fn of_text(self, text: &str, left: Vec<String>) -> Printed {
        Printed {
            line_chars: text.lines().map(str::len).max().unwrap_or(0),
            left,
            ..self
        }
    }

    fn peak(
        &mut self,
        block: &Block,
        profile: &profiles::Profile,
        before: Option<&(Block, profiles::Profile)>,
    ) {
        if profile.entry < 0.999 * block.speed_max {
            *self.slowed_by.entry(block.entry_by).or_default() += 1;
        }
        for (axis, peak) in self.peaks.iter_mut().enumerate() {
            let share = block.direction[axis];
            peak.speed = peak.speed.max(profile.peak * share.abs());
            if profile.peak > profile.entry.min(profile.exit) {
                peak.acceleration = peak.acceleration.max(block.acceleration * share.abs());
            }
            let came = before.map_or(0.0, |(block, profile)| profile.exit * block.direction[axis]);
            let goes = profile.entry * share;
            peak.step = peak.step.max((goes - came).abs());
        }
    }
}
