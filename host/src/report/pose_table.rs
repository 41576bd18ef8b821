//! The poses of a stream as CSV, and the samples for other tables and plots.
//!
//! Input: a [`SegmentStream`] in machine coordinates. Output: rows in the input's coordinates, at
//! even steps of segment time, evaluated in double precision from the spans that the controller
//! executes.

use crate::job::transform::PartTransform;
use crate::job::{Mark, MotionState, SegmentStream};
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::path::spline::{Span, Spans};
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS,
};
use std::io::Write;
use std::rc::Rc;

/// Header line of the pose tables.
pub const POSE_HEADER: &str =
    "t_s,layer,pass,x_mm,y_mm,z_mm,nx,ny,nz,heading_rad,speed_mm_s,flow_mm3_s,state";

/// Most rows of a table: eleven hours at the default of the command, some gigabytes.
pub const ROWS_MAX: f64 = 4e7;

/// The stream at one moment, machine coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamSample {
    /// Segment time.
    pub time_s: f64,
    /// Channels in mm, rad, mm³.
    pub position: [f64; CHANNELS],
    /// Their rates.
    pub velocity: [f64; CHANNELS],
    /// What the head is doing.
    pub mark: Mark,
}

impl StreamSample {
    /// Speed of the tip.
    pub fn speed_mm_s(&self) -> f64 {
        let v = &self.velocity;
        (v[CHANNEL_X].powi(2) + v[CHANNEL_Y].powi(2) + v[CHANNEL_Z].powi(2)).sqrt()
    }

    /// dV/dt of the deposited volume; 0 off the passes.
    pub fn flow_mm3_s(&self) -> f64 {
        match self.mark.pass {
            Some(_) if self.mark.state == MotionState::Print => self.velocity[CHANNEL_VOLUME],
            _ => 0.0,
        }
    }
}

/// Duration of a stream, servo ticks.
pub fn duration_ticks(stream: &SegmentStream) -> u64 {
    stream
        .spans()
        .last()
        .map_or(0, |span| span.start_tick + u64::from(span.duration_ticks))
}

/// Samples at every multiple of `every_ticks` (more than 0) up to the end.
pub fn samples(
    stream: &SegmentStream,
    servo_hz: f64,
    every_ticks: f64,
) -> impl Iterator<Item = StreamSample> + '_ {
    let whole = [0, duration_ticks(stream)];
    samples_within(stream, servo_hz, every_ticks, whole)
}

/// The same from one tick to another, both included.
pub fn samples_within(
    stream: &SegmentStream,
    servo_hz: f64,
    every_ticks: f64,
    ticks: [u64; 2],
) -> impl Iterator<Item = StreamSample> + '_ {
    moments_within(stream, servo_hz, every_ticks, ticks).map(|(sample, _, _)| sample)
}

/// The same, each with its span and the ticks since that began.
pub fn moments_within(
    stream: &SegmentStream,
    servo_hz: f64,
    every_ticks: f64,
    ticks: [u64; 2],
) -> impl Iterator<Item = (StreamSample, Rc<Span>, f64)> + '_ {
    let spans = stream.spans();
    moments_of(spans, &stream.marks, servo_hz, every_ticks, ticks)
}

/// Start of each span of a stream, so that a later layer is found without iterating over all earlier ones.
#[derive(Clone, Debug)]
pub struct StreamIndex<'a> {
    stream: &'a SegmentStream,
    /// First tick, and the spans from there on.
    places: Vec<(u64, Spans<'a>)>,
}

/// Spans between two places of an index.
const SPANS_A_PLACE: usize = 512;

impl<'a> StreamIndex<'a> {
    /// Of a stream.
    pub fn of(stream: &'a SegmentStream) -> StreamIndex<'a> {
        let mut places = Vec::new();
        let (mut spans, mut tick) = (stream.spans(), 0);
        for number in 0usize.. {
            if number.is_multiple_of(SPANS_A_PLACE) {
                places.push((tick, spans.clone()));
            }
            let Some(span) = spans.next() else {
                break;
            };
            tick = span.start_tick + u64::from(span.duration_ticks);
        }
        StreamIndex { stream, places }
    }

    /// The spans that end at a tick or later.
    pub fn spans_from(&self, tick: u64) -> impl Iterator<Item = Span> + use<'a> {
        let place = self.places.partition_point(|(first, _)| *first < tick);
        let place = self.places.get(place.saturating_sub(1));
        let spans = place.map_or(
            Spans::new(&self.stream.start, &[], self.stream.units),
            |(_, spans)| spans.clone(),
        );
        spans.skip_while(move |span| span.start_tick + u64::from(span.duration_ticks) < tick)
    }

    /// As [`moments_within`].
    pub fn moments_within(
        &self,
        servo_hz: f64,
        every_ticks: f64,
        ticks: [u64; 2],
    ) -> impl Iterator<Item = (StreamSample, Rc<Span>, f64)> + use<'a> {
        let spans = self.spans_from(ticks[0]);
        moments_of(spans, &self.stream.marks, servo_hz, every_ticks, ticks)
    }
}

fn moments_of<'a>(
    spans: impl Iterator<Item = Span> + 'a,
    marks: &'a [Mark],
    servo_hz: f64,
    every_ticks: f64,
    [from, end]: [u64; 2],
) -> impl Iterator<Item = (StreamSample, Rc<Span>, f64)> + 'a {
    let mut next = 0u64;
    let mut mark = marks.partition_point(|mark| mark.end_tick <= from);
    mark = mark.min(marks.len().saturating_sub(1));
    let spans =
        spans.skip_while(move |span| span.start_tick + u64::from(span.duration_ticks) < from);
    let spans = spans.take_while(move |span| span.start_tick <= end);
    spans.flat_map(move |span| {
        let span = Rc::new(span);
        let mut found = Vec::new();
        let span_end = span.start_tick + u64::from(span.duration_ticks);
        loop {
            let tick = from as f64 + next as f64 * every_ticks;
            // The last span owns its end as well.
            let is_past = tick > span_end as f64 || (tick == span_end as f64 && span_end < end);
            if is_past || tick > end as f64 {
                break found;
            }
            next += 1;
            let t = tick - span.start_tick as f64;
            while mark + 1 < marks.len() && marks[mark].end_tick as f64 <= tick {
                mark += 1;
            }
            let sample = StreamSample {
                time_s: tick / servo_hz,
                position: span.position(t),
                velocity: span.velocity(t, servo_hz),
                mark: marks.get(mark).copied().unwrap_or(NO_MARK),
            };
            found.push((sample, span.clone(), t));
        }
    })
}

/// For streams without marks.
const NO_MARK: Mark = Mark {
    start_tick: 0,
    end_tick: 0,
    state: MotionState::Hold,
    layer: 0,
    pass: None,
};

/// Writes one row of a pose table, in input coordinates.
pub fn write_row(
    out: &mut impl Write,
    sample: &StreamSample,
    transform: &PartTransform,
) -> std::io::Result<()> {
    let p = &sample.position;
    let [x, y, z] = transform.to_input([p[CHANNEL_X], p[CHANNEL_Y], p[CHANNEL_Z]]);
    let axis = Pose::from_channels(p).tool_axis();
    let pass = sample.mark.pass.map_or(-1, i64::from);
    writeln!(
        out,
        "{:.6},{},{pass},{x:.5},{y:.5},{z:.5},{:.7},{:.7},{:.7},{:.6},{:.4},{:.5},{}",
        sample.time_s,
        sample.mark.layer,
        axis.x,
        axis.y,
        axis.z,
        p[CHANNEL_HEADING],
        sample.speed_mm_s(),
        sample.flow_mm3_s(),
        sample.mark.state.name(),
    )
}

/// Writes the complete table, one row every `every_ms` of segment time.
pub fn write_csv(
    out: &mut impl Write,
    stream: &SegmentStream,
    servo_hz: f64,
    every_ms: f64,
    transform: &PartTransform,
) -> std::io::Result<()> {
    writeln!(out, "{POSE_HEADER}")?;
    for sample in samples(stream, servo_hz, every_ms * 1e-3 * servo_hz) {
        write_row(out, &sample, transform)?;
    }
    Ok(())
}
