//! Divides a curve into shorter spans, so that its control points are near it.
//!
//! In: a stream. Out: the same B-spline over more knots: control points are values of its blossom (Oslo
//! algorithm: Cohen, Lyche and Riesenfeld, 1980), rounded once, to half a unit. Each event moves to the part of
//! the span that contains it. The first two spans, whose durations are not sent, are not divided.

use crate::job::{LEAD_IN_SPANS, SegmentStream};
use headway_protocol::segment::{FlowEvent, Knot, REST_TICKS};
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNELS, ChannelPoint};

/// Shortest part of a span, servo ticks: as short as planned ones.
const PART_TICKS_MIN: u32 = 8;

/// A stream's spline: `control[i]` is P_{i-3}, unwrapped, `starts[i]` is T_{i-2}, the start of span i - 2.
struct Curve {
    /// Units per mm.
    per_mm: f64,
    control: Vec<[f64; CHANNELS]>,
    starts: Vec<f64>,
}

/// Spans of at most `span_mm` in x and y.
pub(super) fn refined(stream: &SegmentStream, span_mm: f64) -> SegmentStream {
    let count = stream.knots.len();
    let curve = Curve::of(stream);
    let parts: Vec<Vec<u32>> = (0..count).map(|span| curve.parts(span, span_mm)).collect();
    // Starts of the parts, and which span each is of; then two spans that nothing moves in any more.
    let mut starts = vec![-2.0 * f64::from(REST_TICKS), -f64::from(REST_TICKS)];
    let mut spans = Vec::with_capacity(count);
    for (span, parts) in parts.iter().enumerate() {
        let mut at = curve.start(span);
        for part in parts {
            starts.push(at);
            spans.push(span);
            at += f64::from(*part);
        }
    }
    starts.extend((count..count + 3).map(|span| curve.start(span)));
    let mut refined = SegmentStream {
        start: stream.start,
        marks: stream.marks.clone(),
        solution: stream.solution,
        units: stream.units,
        events: events(&stream.events, &parts),
        knots: Vec::with_capacity(spans.len()),
    };
    for (number, span) in spans.iter().enumerate() {
        // T' of span m is `starts[m + 2]`.
        let at = |ahead: usize| starts[(number + 2 + ahead).min(starts.len() - 1)];
        refined.knots.push(Knot {
            control: curve.blossom(*span, [at(3), at(2), at(1)]),
            duration_ticks: (at(3) - at(2)) as u16,
        });
    }
    refined
}

/// Events in the parts of their spans.
fn events(events: &[FlowEvent], parts: &[Vec<u32>]) -> Vec<FlowEvent> {
    let mut firsts = Vec::with_capacity(parts.len());
    let mut first = 0u32;
    for parts in parts {
        firsts.push(first);
        first += parts.len() as u32;
    }
    let moved = |event: &FlowEvent| {
        let span = event.span as usize;
        let (Some(parts), Some(first)) = (parts.get(span), firsts.get(span)) else {
            return *event;
        };
        let (mut number, mut offset) = (0, u32::from(event.offset_ticks));
        while number + 1 < parts.len() && offset >= parts[number] {
            offset -= parts[number];
            number += 1;
        }
        FlowEvent {
            span: first + number as u32,
            offset_ticks: offset as u16,
            ..*event
        }
    };
    events.iter().map(moved).collect()
}

impl Curve {
    fn of(stream: &SegmentStream) -> Curve {
        let mut last = stream.start;
        let mut here = stream.start.map(f64::from);
        let mut control = vec![here; 3];
        for knot in &stream.knots {
            for channel in 0..CHANNELS {
                here[channel] += f64::from(knot.control[channel].wrapping_sub(last[channel]));
            }
            last = knot.control;
            control.push(here);
        }
        let first = f64::from(REST_TICKS);
        let mut starts = vec![-2.0 * first, -first, 0.0, first, 2.0 * first];
        let mut at = 2.0 * first;
        for knot in &stream.knots {
            at += f64::from(knot.duration_ticks);
            starts.push(at);
        }
        Curve {
            per_mm: stream.units.per_natural(CHANNEL_X),
            control,
            starts,
        }
    }

    /// T of a span, counted from 0.
    fn start(&self, span: usize) -> f64 {
        self.starts[(span + 2).min(self.starts.len() - 1)]
    }

    /// Durations of the parts of a span.
    fn parts(&self, span: usize, span_mm: f64) -> Vec<u32> {
        let ticks = (self.start(span + 1) - self.start(span)) as u32;
        if span < LEAD_IN_SPANS {
            return vec![ticks];
        }
        // P_{n-3} to P_n are at n to n + 3; the speed is between those of their differences.
        let mut per_tick = 0.0f64;
        for i in 0..3 {
            let [from, to] = [self.control[span + i], self.control[span + i + 1]];
            let way = [CHANNEL_X, CHANNEL_Y].map(|c| (to[c] - from[c]) / self.per_mm);
            // Of P_{n-2+i} the knots T_{n-2+i} to T_{n+1+i}.
            let ticks = self.starts[span + i + 3] - self.starts[span + i];
            per_tick = per_tick.max(3.0 * way[0].hypot(way[1]) / ticks);
        }
        let wanted = (per_tick * f64::from(ticks) / span_mm).ceil() as u32;
        let count = wanted.clamp(1, (ticks / PART_TICKS_MIN).max(1));
        (0..count)
            .map(|part| ticks * (part + 1) / count - ticks * part / count)
            .collect()
    }

    /// The blossom of a span at three knots, channel units: the control point that they belong to. The last
    /// knot first: if no knot was inserted every share is 1, and the point equals the old one bit for bit.
    fn blossom(&self, span: usize, knots: [f64; 3]) -> ChannelPoint {
        let mut points = [0, 1, 2, 3].map(|i| self.control[span + i]);
        for (round, knot) in knots.into_iter().enumerate() {
            // From the last one down, so that those before it are still the last round's.
            for i in (round + 1..4).rev() {
                // T_{n-3+i} and T_{n+i-round}: the support of P_{n-3+i}, shorter by a knot in every round.
                let low = self.starts[span + i - 1];
                let high = self.starts[span + i + 2 - round];
                let share = (knot - low) / (high - low);
                let before = points[i - 1];
                for (value, before) in points[i].iter_mut().zip(before) {
                    *value = before + share * (*value - before);
                }
            }
        }
        // Wraps as it came.
        points[3].map(|value| value.round() as i64 as i32)
    }
}
