//! The rest of a job after a given point: its stream from the start of a pass on.
//!
//! ```text
//! SegmentStream, HeatEvents, pass --rest_of--> Rest: stream from that pass's prime on, its own time base
//!                        place --pass_at--> the pass that was not whole there
//! ```
//! A pass begins at rest, so that nothing is recomputed: control points and durations are the job's. Added
//! before it are two short rests (the wire format fixes their durations), a prime where the pass has none of
//! its own, and the heaters' latest targets. A point within a pass cannot be a start: the head would have to
//! accelerate on a curve that was planned at speed. Not covered: the moves to the start (`approach`).

use crate::job::heat::{HeatEvent, HeatOrder};
use crate::job::{LEAD_IN_SPANS, Mark, MotionState, SegmentStream, dwell_spans};
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::path::spline::Span;
use headway_protocol::segment::{FlowAction, FlowEvent, Knot, REST_TICKS};
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_X, CHANNEL_Z, CHANNELS, ChannelPoint, Units,
};
use std::collections::HashMap;
use std::f64::consts::TAU;

/// Cells in which a pass is searched for places where it overlaps itself, mm: less than a bead's width.
const CELL_MM: f64 = 0.25;
/// Longest part of the path in that search, mm.
const LOOK_MM: f64 = 0.5 * CELL_MM;
/// Most pieces of one span: 60 m/s at the longest span of a move.
const LOOKS_MAX: usize = 4096;

/// The rest of a job.
#[derive(Clone, Debug, PartialEq)]
pub struct Rest {
    /// The stream. Layers and passes are numbered as in the job.
    pub stream: SegmentStream,
    /// Orders of heaters and fan on its ticks: the latest ones before the place at its start, waited for.
    pub heat: Vec<HeatEvent>,
    /// The pass that it begins with.
    pub pass: u32,
    /// Its layer from 0.
    pub layer: u32,
    /// Servo tick of the job at which it is cut.
    pub cut_tick: u64,
    /// Ticks of the rest before that place.
    pub lead_ticks: u64,
    /// A prime was added before the pass, which has none of its own.
    pub primed: bool,
}

/// Lengths and times of printing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Printed {
    /// Path length of the tip on passes, mm.
    pub length_mm: f64,
    /// Time on passes at the planned rate, s.
    pub time_s: f64,
}

/// The incomplete pass of a stream that is done up to a tick; between two passes the next one.
///
/// # Errors
/// A `Refusal`.
pub fn pass_at(stream: &SegmentStream, done_tick: u64) -> Result<u32, Refusal> {
    let left = passes(stream).filter(|(_, mark)| mark.end_tick > done_tick);
    // The first in time.
    let first = left.map(|(pass, _)| pass).next();
    first.ok_or_else(nothing_left)
}

fn nothing_left() -> Refusal {
    refusal!("the job was printed to its last pass: nothing is left")
}

/// The first pass of a layer, counted from 1.
///
/// # Errors
/// A `Refusal`.
pub fn pass_of_layer(stream: &SegmentStream, layer: u32) -> Result<u32, Refusal> {
    let of_layer = |(_, mark): &(u32, &Mark)| Some(mark.layer) == layer.checked_sub(1);
    let first = passes(stream).find(of_layer);
    let layers = stream.layers();
    let none = || refusal!("the job prints nothing in layer {layer}: it has layers 1 to {layers}");
    first.map(|(pass, _)| pass).ok_or_else(none)
}

/// Moves that print, with their passes.
fn passes(stream: &SegmentStream) -> impl Iterator<Item = (u32, &Mark)> {
    let prints = |mark: &&Mark| mark.state == MotionState::Print;
    let marks = stream.marks.iter().filter(prints);
    marks.filter_map(|mark| Some((mark.pass?, mark)))
}

/// The stream from a pass's start on.
///
/// # Errors
/// A `Refusal`.
pub fn rest_of(stream: &SegmentStream, heat: &[HeatEvent], pass: u32) -> Result<Rest, Refusal> {
    let last = passes(stream).map(|(pass, _)| pass).max();
    let last = last.ok_or_else(nothing_left)?;
    let is_first = |mark: &Mark| mark.state == MotionState::Print && mark.pass == Some(pass);
    let printed = stream.marks.iter().position(is_first);
    let printed = printed
        .ok_or_else(|| refusal!("the job has no pass {pass}: they are counted from 0 to {last}"))?;
    // Primes and rests at the pass's start are its own.
    let stands = |mark: &Mark| matches!(mark.state, MotionState::Prime | MotionState::Hold);
    let before = stream.marks[..printed].iter().rev();
    let first = printed - before.take_while(|mark| stands(mark)).count();
    let (cut_tick, layer) = (stream.marks[first].start_tick, stream.marks[printed].layer);

    let durations = durations_ticks(&stream.knots);
    let no_rest =
        || refusal!("pass {pass} does not begin at rest between two spans: plan the job again");
    let span = span_at(&durations, cut_tick).ok_or_else(no_rest)?;
    let start = rest_before(stream, span).ok_or_else(no_rest)?;
    let print_span = span_at(&durations, stream.marks[printed].start_tick);
    let print_span = print_span.ok_or_else(no_rest)? as u32;
    let own = own_prime(stream, span as u32, print_span);
    let primed = own.is_some();
    let dwell = own.map_or(Vec::new(), |event| {
        dwell_spans(u64::from(event.duration_ticks.0))
    });
    let lead = LEAD_IN_SPANS + dwell.len();

    let mut new_durations = vec![REST_TICKS; LEAD_IN_SPANS];
    new_durations.extend(dwell);
    let lead_ticks = new_durations.iter().map(|&ticks| u64::from(ticks)).sum();
    new_durations.extend(&durations[span..]);
    let controls = std::iter::repeat_n(start, lead);
    let controls = controls.chain(stream.knots[span..].iter().map(|knot| knot.control));
    let knots = controls.enumerate().map(|(n, control)| Knot {
        control,
        duration_ticks: new_durations.get(n + 2).copied().unwrap_or(REST_TICKS),
    });
    let shifted = stream.events.iter().filter_map(|event| {
        let behind = (event.span as usize).checked_sub(span)?;
        let span = (behind + lead) as u32;
        Some(FlowEvent { span, ..*event })
    });
    let own = own.map(|event| FlowEvent {
        span: LEAD_IN_SPANS as u32,
        offset_ticks: 0,
        ..event
    });
    let rest = SegmentStream {
        start,
        knots: knots.collect(),
        events: own.into_iter().chain(shifted).collect(),
        marks: marks_from(&stream.marks[first..], cut_tick, lead_ticks, primed),
        solution: stream.solution,
        units: stream.units,
    };
    let stands = stream.unwrapped().nth(span).unwrap_or_default();
    Ok(Rest {
        stream: rest.shifted_to(placed(start, &stands, &stream.units)),
        heat: heat_from(heat, cut_tick, lead_ticks),
        pass,
        layer,
        cut_tick,
        lead_ticks,
        primed,
    })
}

/// Where a board is sent: its pose has 32 bits of base units, and a heading that wound beyond them stands as it does
/// whole turns earlier.
fn placed(start: ChannelPoint, unwrapped: &[i64; CHANNELS], units: &Units) -> ChannelPoint {
    let channel = CHANNEL_HEADING;
    let base_units = unwrapped[channel] << units.exponent(channel);
    let mut placed = start;
    if i32::try_from(base_units).is_err() {
        let per_rad = units.per_natural(channel);
        let within_rad = (unwrapped[channel] as f64 / per_rad).rem_euclid(TAU);
        placed[channel] = (within_rad * per_rad).round() as i32;
    }
    placed
}

/// Durations of the spans that knots make.
fn durations_ticks(knots: &[Knot]) -> Vec<u16> {
    let told = knots.iter().map(|knot| knot.duration_ticks);
    let fixed = std::iter::repeat_n(REST_TICKS, LEAD_IN_SPANS);
    fixed.chain(told).take(knots.len()).collect()
}

/// The span that begins at a tick.
fn span_at(durations: &[u16], tick: u64) -> Option<usize> {
    let mut at = 0;
    for (span, &ticks) in durations.iter().enumerate() {
        if at >= tick {
            return (at == tick).then_some(span);
        }
        at += u64::from(ticks);
    }
    None
}

/// Where the head rests before a span; `None` if it moves.
fn rest_before(stream: &SegmentStream, span: usize) -> Option<ChannelPoint> {
    let control = |behind: usize| match span.checked_sub(behind) {
        Some(knot) => stream.knots[knot].control,
        None => stream.start,
    };
    let here = control(1);
    (control(2) == here && control(3) == here).then_some(here)
}

/// The prime to add before a pass that has none between its start and its first move: the last one before it,
/// else the job's first.
fn own_prime(stream: &SegmentStream, span: u32, print_span: u32) -> Option<FlowEvent> {
    let primes = || {
        let events = stream.events.iter();
        events.filter(|event| event.action == FlowAction::Prime)
    };
    if primes().any(|event| (span..=print_span).contains(&event.span)) {
        return None;
    }
    let before = primes().take_while(|event| event.span < span).last();
    before.or(primes().next()).copied()
}

fn marks_from(marks: &[Mark], cut_tick: u64, lead_ticks: u64, primed: bool) -> Vec<Mark> {
    let layer = marks.first().map_or(0, |mark| mark.layer);
    let lead_in = REST_TICKS as u64 * LEAD_IN_SPANS as u64;
    let rest = |start_tick, end_tick, state| Mark {
        start_tick,
        end_tick,
        state,
        layer,
        pass: None,
    };
    let mut made = vec![rest(0, lead_in, MotionState::Hold)];
    if primed {
        made.push(rest(lead_in, lead_ticks, MotionState::Prime));
    }
    made.extend(marks.iter().map(|mark| Mark {
        start_tick: mark.start_tick - cut_tick + lead_ticks,
        end_tick: mark.end_tick - cut_tick + lead_ticks,
        ..*mark
    }));
    made
}

/// The latest orders up to a tick at the start, heaters waited for, the fan with the first move; then those after it.
fn heat_from(events: &[HeatEvent], cut_tick: u64, lead_ticks: u64) -> Vec<HeatEvent> {
    let mut latest: Vec<HeatOrder> = Vec::new();
    for event in events.iter().take_while(|event| event.tick <= cut_tick) {
        match latest
            .iter_mut()
            .find(|order| order.is_of_same(&event.order))
        {
            Some(order) => *order = event.order,
            None => latest.push(event.order),
        }
    }
    let (heaters, fans): (Vec<_>, Vec<_>) = latest
        .into_iter()
        .filter(HeatOrder::is_on)
        .partition(|order| matches!(order, HeatOrder::Heater { .. }));
    let waited = heaters.into_iter().map(|order| match order {
        HeatOrder::Heater {
            heater, celsius, ..
        } => HeatOrder::wait_for(heater, celsius),
        fan => fan,
    });
    let at = |tick| move |order| HeatEvent { tick, order };
    let behind = events.iter().filter(|event| event.tick > cut_tick);
    let behind = behind.map(|event| HeatEvent {
        tick: event.tick - cut_tick + lead_ticks,
        ..*event
    });
    // A fan would cool what is being heated.
    waited
        .map(at(0))
        .chain(fans.into_iter().map(at(1)))
        .chain(behind)
        .collect()
}

/// The print from one tick to another.
pub fn printed_between(stream: &SegmentStream, ticks: [u64; 2], servo_hz: f64) -> Printed {
    let mut printed = Printed::default();
    for_printing_spans(stream, ticks, |span, _| {
        printed.time_s += f64::from(span.duration_ticks) / servo_hz;
        let places = looks(span);
        let ways = places.windows(2).map(|pair| distance_mm(pair[0], pair[1]));
        printed.length_mm += ways.sum::<f64>();
    });
    printed
}

/// Highest tip position of the print before a tick, mm; `None` if there is none.
pub fn printed_top_mm(stream: &SegmentStream, before_tick: u64) -> Option<f64> {
    let mut top_mm = None;
    for_printing_spans(stream, [0, before_tick], |span, _| {
        for place in looks(span) {
            top_mm = Some(place[2].max(top_mm.unwrap_or(f64::NEG_INFINITY)));
        }
    });
    top_mm
}

/// Refuses a pass that is on top of itself: its start is below its own print.
///
/// # Errors
/// A `Refusal` if it returns to a place higher by more than half a layer and a cell's slope.
pub fn check_flat(stream: &SegmentStream, pass: u32, layer_height_mm: f64) -> Result<(), Refusal> {
    let rise_max_mm = CELL_MM + 0.5 * layer_height_mm;
    let mut lowest: HashMap<[i64; 2], f64> = HashMap::new();
    let mut found = Ok(());
    for_printing_spans(stream, [0, u64::MAX], |span, mark| {
        if mark.pass != Some(pass) || found.is_err() {
            return;
        }
        for [x_mm, y_mm, z_mm] in looks(span) {
            let cell = [x_mm, y_mm].map(|at| (at / CELL_MM).floor() as i64);
            let low_mm = lowest.entry(cell).or_insert(z_mm);
            let rise_mm = z_mm - *low_mm;
            *low_mm = low_mm.min(z_mm);
            if rise_mm > rise_max_mm {
                found = Err(refusal!(
                    "pass {pass} lies on itself (at {x_mm:.1}, {y_mm:.1} mm on the machine it comes back {rise_mm:.2} mm \
                     higher): begun again at its start the nozzle would run into what is printed; print what is left as a \
                     job of its own, or begin at another pass"
                ));
                return;
            }
        }
    });
    found
}

/// Calls for every span of the passes that begins within ticks.
fn for_printing_spans(
    stream: &SegmentStream,
    [from_tick, to_tick]: [u64; 2],
    mut each: impl FnMut(&Span, &Mark),
) {
    let mut marks = stream.marks.iter().peekable();
    for span in stream.spans() {
        if span.start_tick >= to_tick {
            return;
        }
        while marks
            .next_if(|mark| mark.end_tick <= span.start_tick)
            .is_some()
        {}
        if let Some(mark) = marks.peek()
            && mark.state == MotionState::Print
            && span.start_tick >= from_tick
        {
            each(&span, mark);
        }
    }
}

/// Places of the tip along a span, its ends among them, mm.
fn looks(span: &Span) -> Vec<[f64; 3]> {
    let ticks = f64::from(span.duration_ticks);
    let bounds = &span.polynomial.rate_bound[CHANNEL_X..=CHANNEL_Z];
    let longest_mm = bounds.iter().map(|bound| bound * bound).sum::<f64>().sqrt() * ticks
        / span.units.per_natural(CHANNEL_X);
    let count = ((longest_mm / LOOK_MM).ceil() as usize).clamp(1, LOOKS_MAX);
    let place = |number: usize| {
        let at = span.position(ticks * number as f64 / count as f64);
        [at[CHANNEL_X], at[CHANNEL_X + 1], at[CHANNEL_Z]]
    };
    (0..=count).map(place).collect()
}

fn distance_mm(a: [f64; 3], b: [f64; 3]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}
