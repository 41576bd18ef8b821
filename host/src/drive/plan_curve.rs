//! The planned motion in double precision: the reference for steps and limits.
//!
//! [`SegmentStream`] -> channels in natural units at any segment time, walked forward.

use crate::job::SegmentStream;
use headway_firmware::path::spline::{Span, Spans};
use headway_protocol::segment::Knot;
use headway_protocol::units::{CHANNELS, Units};

/// Walks along the planned motion; times must not decrease.
#[derive(Clone, Debug)]
pub struct PlanCursor<'a> {
    spans: Spans<'a>,
    span: Option<Span>,
    start: [f64; CHANNELS],
}

impl<'a> PlanCursor<'a> {
    /// At rest on the start, before segment time 0.
    pub fn new(stream: &'a SegmentStream) -> Self {
        let mut spans = stream.spans();
        let span = spans.next();
        PlanCursor {
            spans,
            span,
            start: stream.units.to_natural(&stream.start),
        }
    }

    /// Channels in mm, rad and mm³ at segment time `ticks`; at rest before the start and past the
    /// end.
    pub fn position(&mut self, ticks: f64) -> [f64; CHANNELS] {
        loop {
            let Some(span) = &self.span else {
                return self.start;
            };
            let local = ticks - span.start_tick as f64;
            let duration = f64::from(span.duration_ticks);
            if local > duration
                && let Some(next) = self.spans.next()
            {
                self.span = Some(next);
                continue;
            }
            return span.position(local.clamp(0.0, duration));
        }
    }
}

/// Segment time of a stream, in servo ticks. Knot n carries the duration of span n + 2.
pub fn stream_ticks(knots: &[Knot]) -> u64 {
    Spans::new(&[0; CHANNELS], knots, Units::BASE)
        .last()
        .map_or(0, |span| span.start_tick + u64::from(span.duration_ticks))
}
