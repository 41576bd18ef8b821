//! Places of a file's orders of heaters and fans -> ticks of the planned stream.
//!
//! In: orders by pass and point ([`PlacedOrder`]), the stream of some passes (mm, servo ticks). Out:
//! [`HeatEvent`]s. An order within a pass comes at the tick at which the path is nearest to the file's point,
//! looked for around the same length of the way; the path rounds corners, so that it is beside the point by
//! what it is beside the file's lines. What stands before the first bead comes at the very first tick.

use crate::gcode::{GcodePass, HeatPlace, PlacedOrder};
use crate::job::{MotionState, SegmentStream};
use crate::job_heat::HeatEvent;
use headway_firmware::spline::Spans;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Z};

/// How far along the way from where its length says a place is looked for, mm, and as a share of that
/// length: rounded corners shorten the way.
const AROUND_MM: f64 = 2.0;
const AROUND_SHARE: f64 = 0.01;

/// Some passes of a file and their stream.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LaidPasses<'a> {
    /// Number of the first of them in the file.
    pub first: usize,
    /// Them.
    pub passes: &'a [GcodePass],
    /// What number each has in the job; none where it is not printed.
    pub numbers: &'a [Option<u32>],
    /// Their stream; ticks from 0.
    pub stream: &'a SegmentStream,
    /// Machine coordinates of the file's origin, mm.
    pub offset_mm: [f64; 3],
}

/// The orders of these passes, ticks counted on from `before`.
pub(crate) fn events_of(orders: &[PlacedOrder], laid: &LaidPasses, before: u64) -> Vec<HeatEvent> {
    let place = |order: &PlacedOrder| {
        let (pass, point) = match order.place {
            HeatPlace::Leaving(pass) | HeatPlace::Start(pass) => (pass, None),
            HeatPlace::Point(pass, point) => (pass, Some(point)),
        };
        let own = pass.checked_sub(laid.first)?;
        (own < laid.passes.len()).then_some((own, point))
    };
    let event = |order: &PlacedOrder| {
        let (pass, point) = place(order)?;
        let number = laid.numbers.get(pass).copied().flatten();
        let tick = match (number, point) {
            (Some(number), Some(point)) => laid.tick_at(pass, number, point),
            // Nothing is printed there: with what is next.
            _ => {
                let next = laid.numbers.iter().skip(pass).flatten().next();
                laid.tick_before(next.copied(), matches!(order.place, HeatPlace::Start(_)))
            }
        };
        let (tick, order) = (before + tick, order.order);
        Some(HeatEvent { tick, order })
    };
    orders.iter().filter_map(event).collect()
}

/// The orders behind the last of `passes` passes, at the stream's end.
pub(crate) fn events_behind(
    orders: &[PlacedOrder],
    passes: usize,
    end_tick: u64,
) -> impl Iterator<Item = HeatEvent> {
    let is_behind = move |order: &&PlacedOrder| match order.place {
        HeatPlace::Leaving(pass) | HeatPlace::Start(pass) => pass >= passes,
        HeatPlace::Point(..) => false,
    };
    let event = move |order: &PlacedOrder| HeatEvent {
        tick: end_tick,
        order: order.order,
    };
    orders.iter().filter(is_behind).map(event)
}

impl LaidPasses<'_> {
    /// The way to a pass, or what stands before it begins; the stream's end without a pass.
    fn tick_before(&self, number: Option<u32>, at_start: bool) -> u64 {
        let marks = &self.stream.marks;
        let end_tick = marks.last().map_or(0, |mark| mark.end_tick);
        let begins = marks.iter().position(|mark| mark.pass == number);
        let Some(begins) = begins.filter(|_| number.is_some()) else {
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
        let led = marks[..begins].iter().rev();
        let led = led.take_while(|mark| leads(mark.state)).count();
        marks[begins - led].start_tick
    }

    /// Where the path is nearest to a point of a pass.
    fn tick_at(&self, pass: usize, number: u32, point: usize) -> u64 {
        let marks = self.stream.marks.iter();
        let mut own = marks.filter(|mark| mark.pass == Some(number));
        let Some(first) = own.next() else {
            return 0;
        };
        let ticks = [first.start_tick, own.next_back().unwrap_or(first).end_tick];
        let points = &self.passes[pass].points;
        let lengths_mm = points.windows(2).map(|pair| pair[1].distance_mm(&pair[0]));
        let all_mm: f64 = lengths_mm.clone().sum();
        let share = lengths_mm.take(point).sum::<f64>() / all_mm.max(1e-12);
        let Some(point) = points.get(point) else {
            return ticks[1];
        };
        let wanted_mm: [f64; 3] = std::array::from_fn(|i| point.tip_mm[i] + self.offset_mm[i]);
        let path = self.tips_mm(ticks);
        let mut along_mm = vec![0.0; path.len()];
        for k in 1..path.len() {
            along_mm[k] = along_mm[k - 1] + distance_mm(path[k], path[k - 1]);
        }
        let there_mm = share * along_mm.last().copied().unwrap_or(0.0);
        let around_mm = AROUND_MM + AROUND_SHARE * there_mm;
        let near = (0..path.len()).filter(|&k| (along_mm[k] - there_mm).abs() <= around_mm);
        let nearest = near.min_by(|&a, &b| {
            let of = |k: usize| distance_mm(path[k], wanted_mm);
            of(a).total_cmp(&of(b))
        });
        ticks[0] + nearest.unwrap_or(0) as u64
    }

    /// The tip at every tick from the first to the last.
    fn tips_mm(&self, [from, to]: [u64; 2]) -> Vec<[f64; 3]> {
        let mut tips = Vec::with_capacity((to - from + 1) as usize);
        for span in Spans::new(&self.stream.start, &self.stream.knots) {
            let end = span.start_tick + u64::from(span.duration_ticks);
            // The tick at which two spans meet is the second one's.
            let last = end.min(to + 1);
            for tick in span.start_tick.max(from)..last {
                let at = span.position((tick - span.start_tick) as f64);
                tips.push(std::array::from_fn(|i| at[CHANNEL_X + i]));
            }
            if end > to {
                break;
            }
        }
        tips
    }
}

fn distance_mm(a: [f64; 3], b: [f64; 3]) -> f64 {
    let squares = (0..=CHANNEL_Z - CHANNEL_X).map(|i| (a[i] - b[i]).powi(2));
    squares.sum::<f64>().sqrt()
}
