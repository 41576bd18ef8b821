//! Places of a file's orders of heaters and fans -> ticks of the planned stream.
//!
//! In: orders by pass and point ([`PlacedOrder`]), the stream of some passes (mm, servo ticks). Out:
//! them by tick. An order within a pass comes at the tick at which the path is nearest to the file's point,
//! looked for around the same length of the way; the path rounds corners, so that it is beside the point by
//! what it is beside the file's lines. What stands before the first bead comes at the very first tick.

use crate::gcode::{GcodePass, HeatPlace, PlacedOrder};
use crate::job::{Mark, MotionState, SegmentStream};
use headway_firmware::path::spline::Spans;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Z};
use std::collections::BTreeMap;
use std::iter::Peekable;

/// How far along the way from where its length says a place is looked for, mm, and as a share of that
/// length, up to a bound: rounded corners shorten the way.
const AROUND_MM: f64 = 2.0;
const AROUND_SHARE: f64 = 0.01;
const AROUND_MAX_MM: f64 = 100.0;
/// Most places of a span that are looked at: every tick of all but crawling beads.
const LOOKS_A_SPAN: u64 = 256;

/// Some passes of a file and their stream.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LaidPasses<'a> {
    /// Number of the first of them in the file.
    pub first: usize,
    /// Them.
    pub passes: &'a [GcodePass],
    /// What numbers each has in the job, first and last; none where it is not printed.
    pub numbers: &'a [Option<[u32; 2]>],
    /// Their stream; ticks from 0.
    pub stream: &'a SegmentStream,
    /// Machine coordinates of the file's origin, mm.
    pub offset_mm: [f64; 3],
}

fn pass_of<T>(order: &PlacedOrder<T>) -> usize {
    match order.place {
        HeatPlace::Leaving(pass) | HeatPlace::Start(pass) | HeatPlace::Point(pass, _) => pass,
    }
}

/// The orders of these passes, ticks counted on from `before`. Orders come in the order of their passes, as a
/// stream's marks do: each is gone through once.
pub(crate) fn events_of<T: Copy>(
    orders: &[PlacedOrder<T>],
    laid: &LaidPasses,
    before: u64,
) -> Vec<(u64, T)> {
    let [from, to] = [laid.first, laid.first + laid.passes.len()]
        .map(|pass| orders.partition_point(|order| pass_of(order) < pass));
    let marks = MarksOfPasses::of(&laid.stream.marks);
    let mut spans = laid.stream.spans().peekable();
    let mut known: Option<(usize, PassPath)> = None;
    // The next pass that is printed, of each.
    let mut next_printed = vec![None; laid.passes.len() + 1];
    for pass in (0..laid.passes.len()).rev() {
        let own = laid.numbers.get(pass).copied().flatten();
        next_printed[pass] = own.map(|[first, _]| first).or(next_printed[pass + 1]);
    }
    let mut events = Vec::with_capacity(to - from);
    for placed in &orders[from..to] {
        let pass = pass_of(placed) - laid.first;
        let numbers = laid.numbers.get(pass).copied().flatten();
        let tick = match (
            numbers.and_then(|numbers| marks.ticks_of(numbers)),
            placed.place,
        ) {
            (Some(ticks), HeatPlace::Point(_, point)) => {
                if known.as_ref().is_none_or(|(of, _)| *of != pass) {
                    known = Some((pass, PassPath::of(&laid.passes[pass], ticks, &mut spans)));
                }
                let path = known.as_ref().map(|(_, path)| path);
                path.map_or(ticks[0], |path| path.tick_at(point, laid, pass))
            }
            // Nothing is printed there: with what is next.
            _ => {
                let at_start = matches!(placed.place, HeatPlace::Start(_));
                marks.tick_before(next_printed[pass], at_start)
            }
        };
        events.push((before + tick, placed.order));
    }
    events
}

/// The orders behind the last of `passes` passes, at the stream's end.
pub(crate) fn events_behind<T: Copy>(
    orders: &[PlacedOrder<T>],
    passes: usize,
    end_tick: u64,
) -> impl Iterator<Item = (u64, T)> {
    let is_behind = move |order: &&PlacedOrder<T>| match order.place {
        HeatPlace::Leaving(pass) | HeatPlace::Start(pass) => pass >= passes,
        HeatPlace::Point(..) => false,
    };
    let event = move |order: &PlacedOrder<T>| (end_tick, order.order);
    orders.iter().filter(is_behind).map(event)
}

/// A stream's marks by pass.
struct MarksOfPasses<'a> {
    marks: &'a [Mark],
    /// First and last mark of each pass.
    of_pass: BTreeMap<u32, [usize; 2]>,
}

impl<'a> MarksOfPasses<'a> {
    fn of(marks: &'a [Mark]) -> MarksOfPasses<'a> {
        let mut of_pass: BTreeMap<u32, [usize; 2]> = BTreeMap::new();
        for (index, mark) in marks.iter().enumerate() {
            if let Some(pass) = mark.pass {
                of_pass.entry(pass).or_insert([index; 2])[1] = index;
            }
        }
        MarksOfPasses { marks, of_pass }
    }

    fn ticks_of(&self, numbers: [u32; 2]) -> Option<[u64; 2]> {
        let [Some([first, _]), Some([_, last])] = numbers.map(|number| self.of_pass.get(&number))
        else {
            return None;
        };
        let [first, last] = [*first, *last];
        Some([self.marks[first].start_tick, self.marks[last].end_tick])
    }

    /// The way to a pass, or what stands before it begins; the stream's end without a pass.
    fn tick_before(&self, number: Option<u32>, at_start: bool) -> u64 {
        let end_tick = self.marks.last().map_or(0, |mark| mark.end_tick);
        let begins = number.and_then(|number| self.of_pass.get(&number));
        let Some(&[begins, _]) = begins else {
            return end_tick;
        };
        if number == Some(0) {
            return 0;
        }
        let leads = |state: MotionState| match state {
            MotionState::Prime => true,
            MotionState::Travel | MotionState::Hold => !at_start,
            _ => false,
        };
        let led = self.marks[..begins].iter().rev();
        let led = led.take_while(|mark| leads(mark.state)).count();
        self.marks[begins - led].start_tick
    }
}

/// The path of a pass by ticks.
struct PassPath {
    end_tick: u64,
    /// Ticks, tips (mm, machine coordinates), lengths of the way to them.
    ticks: Vec<u64>,
    tips_mm: Vec<[f64; 3]>,
    along_mm: Vec<f64>,
    /// Share of the file's own way to each of its points.
    shares: Vec<f64>,
}

impl PassPath {
    /// From the stream's spans, of which those before are behind.
    fn of(pass: &GcodePass, [from, to]: [u64; 2], spans: &mut Peekable<Spans>) -> PassPath {
        let mut path = PassPath {
            end_tick: to,
            ticks: Vec::new(),
            tips_mm: Vec::new(),
            along_mm: Vec::new(),
            shares: vec![0.0],
        };
        for pair in pass.points.windows(2) {
            let way_mm = path.shares.last().copied().unwrap_or(0.0);
            path.shares.push(way_mm + pair[1].distance_mm(&pair[0]));
        }
        let all_mm = path.shares.last().copied().unwrap_or(0.0).max(1e-12);
        path.shares.iter_mut().for_each(|share| *share /= all_mm);
        while let Some(span) = spans.peek() {
            let end = span.start_tick + u64::from(span.duration_ticks);
            // The tick at which two spans meet is the second one's.
            let last = end.min(to + 1);
            let stride = u64::from(span.duration_ticks).div_ceil(LOOKS_A_SPAN).max(1);
            for tick in (span.start_tick.max(from)..last).step_by(stride as usize) {
                let at = span.position((tick - span.start_tick) as f64);
                path.push(tick, std::array::from_fn(|i| at[CHANNEL_X + i]));
            }
            if end > to {
                break;
            }
            spans.next();
        }
        path
    }

    fn push(&mut self, tick: u64, tip_mm: [f64; 3]) {
        let way_mm = match (self.tips_mm.last(), self.along_mm.last()) {
            (Some(before), Some(way_mm)) => way_mm + distance_mm(tip_mm, *before),
            _ => 0.0,
        };
        self.ticks.push(tick);
        self.tips_mm.push(tip_mm);
        self.along_mm.push(way_mm);
    }

    /// Where the path is nearest to a point of its pass.
    fn tick_at(&self, point: usize, laid: &LaidPasses, pass: usize) -> u64 {
        let place = laid.passes[pass].points.get(point);
        let (Some(place), Some(share)) = (place, self.shares.get(point)) else {
            return self.end_tick;
        };
        let wanted_mm: [f64; 3] = std::array::from_fn(|i| place.tip_mm[i] + laid.offset_mm[i]);
        let there_mm = share * self.along_mm.last().copied().unwrap_or(0.0);
        let around_mm = AROUND_MM + (AROUND_SHARE * there_mm).min(AROUND_MAX_MM);
        let from = self
            .along_mm
            .partition_point(|mm| *mm < there_mm - around_mm);
        let to = self
            .along_mm
            .partition_point(|mm| *mm <= there_mm + around_mm);
        let nearest = (from..to).min_by(|&a, &b| {
            let of = |k: usize| distance_mm(self.tips_mm[k], wanted_mm);
            of(a).total_cmp(&of(b))
        });
        nearest.map_or(self.end_tick, |k| self.ticks[k])
    }
}

fn distance_mm(a: [f64; 3], b: [f64; 3]) -> f64 {
    let squares = (0..=CHANNEL_Z - CHANNEL_X).map(|i| (a[i] - b[i]).powi(2));
    squares.sum::<f64>().sqrt()
}
