//! The stream at its ticks: poses, and when primes and retracts begin.
//!
//! In: a [`SegmentStream`]. Out: channels in mm, rad, mm³, unwrapped; events in mm³ and ticks.

use crate::job::SegmentStream;
use headway_firmware::path::spline::{Span, Spans};
use headway_protocol::segment::FlowAction;
use headway_protocol::units::{CHANNEL_VOLUME, CHANNELS};

/// Ticks of the events, with volume, mm³, and duration, s at ticks of 1.
pub(crate) fn event_ticks(stream: &SegmentStream) -> Vec<(u64, FlowAction, f64, f64)> {
    let per_mm3 = stream.units.per_natural(CHANNEL_VOLUME);
    let starts: Vec<u64> = stream.spans().map(|span| span.start_tick).collect();
    let events = stream.events.iter();
    events
        .filter_map(|event| {
            let start = starts.get(event.span as usize)?;
            let tick = start + u64::from(event.offset_ticks);
            let volume_mm3 = f64::from(event.volume_units) / per_mm3;
            Some((
                tick,
                event.action,
                volume_mm3,
                f64::from(event.duration_ticks.0),
            ))
        })
        .collect()
}

/// Poses at ticks that do not fall by more than a span.
pub(crate) struct Poses<'a> {
    stream: &'a SegmentStream,
    spans: Spans<'a>,
    span: Option<Span>,
}

impl<'a> Poses<'a> {
    pub(crate) fn new(stream: &'a SegmentStream) -> Poses<'a> {
        let mut spans = stream.spans();
        let span = spans.next();
        Poses {
            stream,
            spans,
            span,
        }
    }

    pub(crate) fn at(&mut self, tick: u64) -> [f64; CHANNELS] {
        if self
            .span
            .as_ref()
            .is_some_and(|span| tick < span.start_tick)
        {
            *self = Poses::new(self.stream);
        }
        while let Some(span) = &self.span {
            let local = tick - span.start_tick;
            if local > u64::from(span.duration_ticks)
                && let Some(next) = self.spans.next()
            {
                self.span = Some(next);
                continue;
            }
            return span.position((local as f64).min(f64::from(span.duration_ticks)));
        }
        [0.0; CHANNELS]
    }
}
