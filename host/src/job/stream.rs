//! A planned job: the output of `plan`, which `drive`, `report` and the job file use.

use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::path::spline::Spans;
use headway_protocol::segment::{FlowEvent, Knot, SPAN_TICKS_MAX};
use headway_protocol::units::{CHANNELS, ChannelPoint, Units};
use serde::{Deserialize, Serialize};

/// Spans at rest before the first move: the wire fixes the durations of spans 0 and 1.
pub const LEAD_IN_SPANS: usize = 2;

/// Spans of a dwell, as even as integers allow.
pub fn dwell_spans(ticks: u64) -> Vec<u16> {
    let count = ticks.div_ceil(u64::from(SPAN_TICKS_MAX)).max(1);
    (0..count)
        .map(|i| ((ticks * (i + 1)) / count - (ticks * i) / count) as u16)
        .collect()
}

/// What the head does during a move of the job (the `state` column of the CSV files).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MotionState {
    /// Moving without flow.
    Travel,
    /// Standing while the material is brought to the aperture.
    Prime,
    /// Printing.
    Print,
    /// Standing (or finishing) while the material is pulled back.
    Retract,
    /// Standing for another reason.
    Hold,
}

impl MotionState {
    /// As the tables spell it.
    pub fn name(self) -> &'static str {
        match self {
            MotionState::Travel => "travel",
            MotionState::Prime => "prime",
            MotionState::Print => "print",
            MotionState::Retract => "retract",
            MotionState::Hold => "hold",
        }
    }
}

/// A move of the stream between two rests: its kind and time, in servo ticks of segment time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mark {
    /// First tick (0 = start of span 0 of the stream).
    pub start_tick: u64,
    /// Tick after the last.
    pub end_tick: u64,
    /// What happens.
    pub state: MotionState,
    /// Layer from 0.
    pub layer: u32,
    /// Pass from 0 over the complete job; `None` between passes.
    pub pass: Option<u32>,
}

/// The motion as it is streamed. All poses are in machine coordinates.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SegmentStream {
    /// Pose at rest before the first span, in its units.
    pub start: ChannelPoint,
    /// Knots in order; ends at rest (three equal control points).
    pub knots: Vec<Knot>,
    /// Flow events, ordered by (span, offset).
    pub events: Vec<FlowEvent>,
    /// The moves of the stream over time, ordered, without gaps.
    pub marks: Vec<Mark>,
    /// Which of the machine's joint solutions it is run in.
    pub solution: u8,
    /// Units of start, knots and events.
    pub units: Units,
}

/// A header's data about its stream.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamFacts {
    /// Pose at rest before the first span, in the stream's units.
    pub start: ChannelPoint,
    /// Identity of the stream (`WireFrames::job`).
    pub job: u32,
    /// Frames.
    pub frames: u32,
    /// Knots in them.
    pub knots: u32,
    /// Flow events in them.
    pub events: u32,
    /// What the stream is doing when.
    pub marks: Vec<Mark>,
    /// The joint solution that it is run in.
    pub solution: u8,
    /// Its units.
    pub units: Units,
}

impl SegmentStream {
    /// The machine, in the joint solution of this stream.
    pub fn machine(&self, machine: &MachineConfiguration) -> MachineConfiguration {
        MachineConfiguration {
            kinematics: machine.kinematics.with_solution(self.solution),
            ..machine.clone()
        }
    }

    /// Its spans in order.
    pub fn spans(&self) -> Spans<'_> {
        Spans::new(&self.start, &self.knots, self.units)
    }

    /// Its spans in order, each with its mark; `None` after the last one.
    pub fn marked_spans(
        &self,
    ) -> impl Iterator<Item = (<Spans<'_> as Iterator>::Item, Option<&Mark>)> {
        let (mut mark, mut tick) = (0, 0u64);
        self.spans().map(move |span| {
            while self.marks.get(mark).is_some_and(|own| own.end_tick <= tick) {
                mark += 1;
            }
            tick += u64::from(span.duration_ticks);
            (span, self.marks.get(mark))
        })
    }

    /// Appends a stream of the same units that begins at the end of this one; its passes are counted from
    /// `first_pass` on. Both end at rest and begin with a short rest, so that nothing is recomputed: the rest
    /// at the end of this one is the first rest of the other.
    pub fn append(&mut self, next: SegmentStream, first_pass: u32) {
        if self.knots.is_empty() {
            *self = next;
            return;
        }
        let spans = self.knots.len() as u32;
        let ticks = self.marks.last().map_or(0, |mark| mark.end_tick);
        self.knots.extend(next.knots);
        let events = next.events.into_iter();
        self.events.extend(events.map(|event| FlowEvent {
            span: event.span + spans,
            ..event
        }));
        let marks = next.marks.into_iter();
        self.marks.extend(marks.map(|mark| Mark {
            start_tick: mark.start_tick + ticks,
            end_tick: mark.end_tick + ticks,
            pass: mark.pass.map(|pass| pass + first_pass),
            ..mark
        }));
    }

    /// Where it ends, at rest, in its units.
    pub fn end(&self) -> ChannelPoint {
        self.knots.last().map_or(self.start, |knot| knot.control)
    }

    /// Control points from the start on, in its units: those of the wire wrap at 32 bits, these do not.
    pub fn unwrapped(&self) -> impl Iterator<Item = [i64; CHANNELS]> {
        let mut at = (self.start, self.start.map(i64::from));
        let knots = self.knots.iter().map(move |knot| {
            for (channel, value) in at.1.iter_mut().enumerate() {
                *value += i64::from(knot.control[channel].wrapping_sub(at.0[channel]));
            }
            at.0 = knot.control;
            at.1
        });
        std::iter::once(self.start.map(i64::from)).chain(knots)
    }

    /// From its start to its end, in its units.
    pub fn displacement(&self) -> [i64; CHANNELS] {
        let end = self.unwrapped().last().unwrap_or_default();
        std::array::from_fn(|channel| end[channel] - i64::from(self.start[channel]))
    }

    /// The same motion from another start, in its units.
    pub fn shifted_to(mut self, start: ChannelPoint) -> SegmentStream {
        let by: ChannelPoint = std::array::from_fn(|c| start[c].wrapping_sub(self.start[c]));
        let moved = |at: &ChannelPoint| std::array::from_fn(|c| at[c].wrapping_add(by[c]));
        self.start = start;
        for knot in &mut self.knots {
            knot.control = moved(&knot.control);
        }
        self
    }

    /// Layers of the job; 1 if there is no data on layers.
    pub fn layers(&self) -> u32 {
        self.marks.last().map_or(1, |mark| mark.layer + 1)
    }

    /// From the first tick of a layer to the tick after its last; empty if there is no such layer.
    pub fn ticks_of_layer(&self, layer: u32) -> [u64; 2] {
        let begins = self.marks.partition_point(|mark| mark.layer < layer);
        let ends = self.marks.partition_point(|mark| mark.layer <= layer);
        match self.marks[begins..ends] {
            [first, .., last] => [first.start_tick, last.end_tick],
            [only] => [only.start_tick, only.end_tick],
            [] => [0, 0],
        }
    }
}
