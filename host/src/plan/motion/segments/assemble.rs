//! Finished moves -> one stream: knots with their durations, events by span, marks by tick.
//!
//! Knot n carries control point P_n and the duration of span n + 2 (see
//! `headway_protocol::segment`), so control points and durations are shifted by two spans.

use super::FinishedMove;
use crate::job::{LEAD_IN_SPANS, Mark, MotionState, SegmentStream, dwell_spans};
use crate::plan::route::moves::{MoveEvent, Route, RouteMove};
use crate::settings::Settings;
use headway_protocol::segment::{FlowAction, FlowEvent, Knot, REST_TICKS};
use headway_protocol::units::{CHANNEL_VOLUME, CHANNEL_Z, ChannelPoint, Ticks, Units};

/// Joins the moves, the head resting the given ticks before each.
pub fn assemble(
    route: &Route,
    finished: &[FinishedMove],
    rests: &[u64],
    settings: &Settings,
) -> SegmentStream {
    let servo_hz = f64::from(settings.machine.servo_hz);
    let Some(first) = finished.first() else {
        return SegmentStream::default();
    };
    let units = settings.units();
    let start = units.of_natural(&first.spline.control[0]);
    let mut control: Vec<ChannelPoint> = vec![start; LEAD_IN_SPANS];
    let mut durations: Vec<u16> = vec![REST_TICKS; LEAD_IN_SPANS];
    let mut tick = u64::from(REST_TICKS) * LEAD_IN_SPANS as u64;
    let mut marks = vec![Mark {
        start_tick: 0,
        end_tick: tick,
        state: MotionState::Hold,
        layer: route.moves.first().map_or(0, |route_move| route_move.layer),
        pass: None,
    }];
    let mut events = Vec::new();
    let moves = route.moves.iter().zip(finished).zip(rests);
    for ((route_move, motion), &rest_ticks) in moves {
        if rest_ticks > 0 {
            let spans = dwell_spans(rest_ticks);
            let here = control.last().copied().unwrap_or(start);
            control.extend(spans.iter().map(|_| here));
            durations.extend(spans);
        }
        let spans = &motion.spline.durations_ticks;
        if let Some(event) = flow_event(route_move, spans, durations.len(), (servo_hz, &units)) {
            events.push(event);
        }
        durations.extend(spans);
        let places = motion.spline.control[3..].iter();
        control.extend(places.map(|place| units.of_natural(place)));
        let end_tick = tick + rest_ticks + motion.spline.ticks();
        let whole = Mark {
            start_tick: tick,
            end_tick,
            state: route_move.state,
            layer: route_move.layer,
            pass: route_move.pass,
        };
        match route_move.parts.is_empty() {
            true => marks.push(whole),
            false => push_parts(&mut marks, whole, route_move, motion),
        }
        tick = end_tick;
    }
    events.sort_by_key(|event| (event.span, event.offset_ticks));
    let knots = control
        .iter()
        .enumerate()
        .map(|(n, &control)| Knot {
            control,
            duration_ticks: durations.get(n + 2).copied().unwrap_or(REST_TICKS),
        })
        .collect();
    SegmentStream {
        start,
        knots,
        events,
        marks,
        solution: settings.machine.kinematics.solution(),
        units,
    }
}

/// The marks of the layers of a move that prints several: each ends with the span in which the tip is as high.
fn push_parts(marks: &mut Vec<Mark>, whole: Mark, route_move: &RouteMove, motion: &FinishedMove) {
    let (control, spans) = (&motion.spline.control, &motion.spline.durations_ticks);
    let own_ticks = motion.spline.ticks();
    let (mut span, mut at_tick) = (0, whole.end_tick - own_ticks);
    let mut start_tick = whole.start_tick;
    for (number, part) in route_move.parts.iter().enumerate() {
        let is_last = number + 1 == route_move.parts.len();
        while span < spans.len() && (is_last || control[span + 2][CHANNEL_Z] < part.end_z_mm) {
            at_tick += u64::from(spans[span]);
            span += 1;
        }
        marks.push(Mark {
            start_tick,
            end_tick: at_tick,
            layer: part.layer,
            pass: part.pass,
            ..whole
        });
        start_tick = at_tick;
    }
}

/// The wire's event for a move whose first span is `first_span` of the stream.
fn flow_event(
    route_move: &RouteMove,
    spans: &[u16],
    first_span: usize,
    (servo_hz, units): (f64, &Units),
) -> Option<FlowEvent> {
    let stretch_ticks: u64 = spans.iter().map(|&ticks| u64::from(ticks)).sum();
    let in_ticks = |seconds: f64| (seconds * servo_hz).round().max(0.0) as u64;
    let (action, volume_mm3, duration_s, mut offset) = match route_move.event? {
        MoveEvent::PrimeAtStart {
            volume_mm3,
            duration_s,
        } => (FlowAction::Prime, volume_mm3, duration_s, 0),
        MoveEvent::RetractBeforeEnd {
            volume_mm3,
            duration_s,
            lead_s,
        } => (
            FlowAction::Retract,
            volume_mm3,
            duration_s,
            stretch_ticks.saturating_sub(in_ticks(lead_s).max(1)),
        ),
    };
    let mut span = first_span;
    for &ticks in spans {
        if offset < u64::from(ticks) {
            break;
        }
        offset -= u64::from(ticks);
        span += 1;
    }
    Some(FlowEvent {
        span: span as u32,
        offset_ticks: offset as u16,
        action,
        volume_units: (volume_mm3 * units.per_natural(CHANNEL_VOLUME)).round() as u32,
        duration_ticks: Ticks(in_ticks(duration_s).max(1) as u32),
    })
}
