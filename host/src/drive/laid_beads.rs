//! Recorded steps, through a known extruder -> beads as they are laid.
//!
//! ```text
//! extruder's steps --motor_volume--> mm³ a servo tick --melt--> leaves the nozzle --by place on the path--> pieces of beads
//! ```
//! In: a job, the steps of its simulation, an [`ExtruderModel`]. Out: what arrives in each servo tick, and for each piece of
//! a pass, about as long as the narrowest bead is wide, its volume against the planned one. Leaves out input shapers' small
//! change of the path, and what material does once it is laid.

use crate::drive::melt::Melt;
use crate::drive::motor_volume::MotorVolume;
use crate::drive::plan_curve::PlanCursor;
use crate::drive::record::MotionRecord;
use crate::job::transform::PartTransform;
use crate::job::{Mark, MotionState, SegmentStream};
use crate::settings::Settings;
use crate::settings::extruder_model::ExtruderModel;
use headway_protocol::segment::FlowAction;
use headway_protocol::units::{CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS};

/// A piece of a pass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LaidPiece {
    /// First and last servo tick of segment time.
    pub ticks: [u64; 2],
    /// Layer from 0.
    pub layer: u32,
    /// Pass from 0.
    pub pass: u32,
    /// Its end, input coordinates.
    pub at_mm: [f64; 3],
    /// Along the path.
    pub length_mm: f64,
    /// As planned.
    pub asked_mm3: f64,
    /// As laid.
    pub laid_mm3: f64,
    /// Within the nozzle's length of the pass's start or end.
    pub is_end: bool,
}

impl LaidPiece {
    /// What is laid too much, as a share of what was asked for.
    pub fn error(&self) -> f64 {
        self.laid_mm3 / self.asked_mm3 - 1.0
    }
}

/// What arrives of a job.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LaidBeads {
    /// What leaves the nozzle in each servo tick of real time from the job's first segment on, mm³/s.
    pub flow_mm3_s: Vec<f32>,
    /// The pieces in order.
    pub pieces: Vec<LaidPiece>,
    /// What leaves the nozzle off the passes.
    pub off_passes_mm3: f64,
}

impl LaidBeads {
    /// What is laid, as a share of what was asked for, at a servo tick of segment time; 1 off the passes.
    pub fn share_at(&self, tick: u64) -> f32 {
        let at = self.pieces.partition_point(|piece| piece.ticks[1] <= tick);
        match self.pieces.get(at) {
            Some(at) if at.ticks[0] <= tick && at.asked_mm3 > 0.0 => (1.0 + at.error()) as f32,
            _ => 1.0,
        }
    }
}

/// Lays the beads of a simulated job.
pub fn laid_beads(
    stream: &SegmentStream,
    settings: &Settings,
    record: &MotionRecord,
    model: &ExtruderModel,
    transform: &PartTransform,
) -> LaidBeads {
    let machine = &settings.machine;
    let tick_s = 1.0 / f64::from(machine.servo_hz);
    let mut melt = Melt::new(model, tick_s, first_prime_mm3(stream));
    let mut motor = MotorVolume::new(machine, record);
    let mut cursor = PlanCursor::new(stream);
    let mut marks = stream.marks.as_slice();
    let mut pieces = Pieces {
        transform,
        length_mm: 2.0 * settings.aperture.minor_mm(),
        end_mm: 2.0 * settings.aperture.major_mm(),
        done: Vec::new(),
        first: 0,
        piece: None,
    };
    let mut beads = LaidBeads::default();
    let (mut segment_q16, mut before) = (0u64, cursor.position(0.0));
    for rate_q16 in &record.rates_q16 {
        let middle = (segment_q16 + u64::from(*rate_q16) / 2) >> 16;
        segment_q16 += u64::from(*rate_q16);
        while marks.len() > 1 && middle >= marks[0].end_tick {
            marks = &marks[1..];
        }
        let mark = marks.first();
        let layer = mark.map_or(0, |mark| mark.layer);
        let laid_mm3 = melt.leaving_mm3(motor.next_mm3_and_rate(), layer);
        beads.flow_mm3_s.push((laid_mm3 / tick_s) as f32);
        let here = cursor.position(segment_q16 as f64 / 65_536.0);
        match mark.filter(|mark| mark.state == MotionState::Print) {
            Some(mark) => pieces.add(mark, segment_q16 >> 16, [&before, &here], laid_mm3),
            None => {
                pieces.end_pass();
                beads.off_passes_mm3 += laid_mm3;
            }
        }
        before = here;
    }
    pieces.end_pass();
    beads.pieces = pieces.done;
    beads
}

/// A job begins as the one before it has ended: with the nozzle pulled back by what the first prime gives.
fn first_prime_mm3(stream: &SegmentStream) -> f64 {
    let first = stream.events.first();
    let prime = first.filter(|event| event.action == FlowAction::Prime);
    prime.map_or(0.0, |event| {
        f64::from(event.volume_units) / stream.units.per_natural(CHANNEL_VOLUME)
    })
}

/// Passes cut into pieces.
struct Pieces<'a> {
    transform: &'a PartTransform,
    /// Their length, and that of what counts as start and end of a pass.
    length_mm: f64,
    end_mm: f64,
    done: Vec<LaidPiece>,
    /// Of the pass that is being laid: its first piece, and the one in work.
    first: usize,
    piece: Option<LaidPiece>,
}

impl Pieces<'_> {
    /// A servo tick of a pass, from one place to the next.
    fn add(&mut self, mark: &Mark, tick: u64, way: [&[f64; CHANNELS]; 2], laid_mm3: f64) {
        let (pass, [before, here]) = (mark.pass.unwrap_or_default(), way);
        let last = self.piece.as_ref().or(self.done[self.first..].last());
        if last.is_some_and(|of| (of.pass, of.layer) != (pass, mark.layer)) {
            self.end_pass();
        }
        let last = self.done[self.first..].last();
        let begins = last.map_or(mark.start_tick, |last| last.ticks[1]);
        let piece = self.piece.get_or_insert(LaidPiece {
            ticks: [begins; 2],
            layer: mark.layer,
            pass,
            ..LaidPiece::default()
        });
        let ways = [CHANNEL_X, CHANNEL_Y, CHANNEL_Z].map(|c| here[c] - before[c]);
        piece.length_mm += ways.iter().map(|way| way * way).sum::<f64>().sqrt();
        piece.asked_mm3 += here[CHANNEL_VOLUME] - before[CHANNEL_VOLUME];
        piece.laid_mm3 += laid_mm3;
        piece.ticks[1] = tick;
        let at_mm = [CHANNEL_X, CHANNEL_Y, CHANNEL_Z].map(|c| here[c]);
        piece.at_mm = self.transform.to_input(at_mm);
        if piece.length_mm >= self.length_mm {
            self.done.extend(self.piece.take());
        }
    }

    /// The pass is complete: its rest goes to the piece before it.
    fn end_pass(&mut self) {
        if let Some(rest) = self.piece.take() {
            match self.done[self.first..].last_mut() {
                Some(last) => {
                    (last.ticks[1], last.at_mm) = (rest.ticks[1], rest.at_mm);
                    last.length_mm += rest.length_mm;
                    last.asked_mm3 += rest.asked_mm3;
                    last.laid_mm3 += rest.laid_mm3;
                }
                None => self.done.push(rest),
            }
        }
        let pass = &mut self.done[self.first..];
        let whole_mm: f64 = pass.iter().map(|piece| piece.length_mm).sum();
        let mut along_mm = 0.0;
        for piece in pass {
            let from_mm = along_mm;
            along_mm += piece.length_mm;
            piece.is_end = from_mm < self.end_mm || along_mm > whole_mm - self.end_mm;
        }
        self.first = self.done.len();
    }
}

#[cfg(test)]
#[path = "laid_beads_tests.rs"]
mod tests;
