//! Rests between moves, where the extruder has too little time to change from one to the next.
//!
//! In: the finished moves in their order (mm³, servo ticks) and the extruder's limits. Out: for each move the rest
//! before it, servo ticks; nearly always 0. A move is checked by itself, with its own prime or retract and the
//! prime before it. This stage handles the moves that share the extruder: a bead shorter than the lead of its
//! prime and retract, one bead's pressure advance in the next one, a retract that still runs when the next prime
//! begins. A rest delays the moves after it until the sum of both keeps the limits. Not covered: a move that
//! exceeds a limit by itself, which no rest can correct.

use super::FinishedMove;
use super::check::EventRun;
use super::spline::RestSpline;
use crate::plan::motion::joint_limits::MotionLimits;
use crate::plan::route::moves::{MoveEvent, Route, RouteMove};
use headway_protocol::units::CHANNEL_VOLUME;

/// Sum against the planned share of a limit that counts as kept: durations of events are whole ticks.
const KEPT: f64 = 1.001;
/// A rest grows in steps of this many ticks until the sum keeps the limits.
const STEP_TICKS: usize = 2;

/// Something that the extruder does, from a tick of the job on.
enum Source<'a> {
    Flow(Flow<'a>),
    Event(EventRun),
}

/// The deposited volume of a move.
struct Flow<'a> {
    start_tick: f64,
    spline: &'a RestSpline,
    /// Ticks from the move's start at which its spans end.
    ends: Vec<f64>,
}

impl Flow<'_> {
    /// V' and V'' at a tick, mm³ a tick and a tick².
    fn rates_at(&self, tick: f64) -> (f64, f64) {
        let local = tick - self.start_tick;
        let span = self.ends.partition_point(|&end| end < local);
        if local <= 0.0 || span >= self.ends.len() {
            return (0.0, 0.0);
        }
        let before = span.checked_sub(1).map_or(0.0, |span| self.ends[span]);
        let t = local - before;
        let [_, c1, c2, c3] = self.spline.span_polynomial(span, CHANNEL_VOLUME);
        (c1 + t * (2.0 * c2 + 3.0 * t * c3), 2.0 * c2 + 6.0 * t * c3)
    }
}

impl Source<'_> {
    /// Tick after which nothing of it is felt.
    fn end_tick(&self, limits: &MotionLimits) -> f64 {
        match self {
            Source::Flow(flow) => {
                let ticks = flow.ends.last().copied().unwrap_or(0.0);
                flow.start_tick + ticks + window_ticks(limits)
            }
            Source::Event(event) => {
                event.start_tick + event.duration_ticks + f64::from(limits.advance_delay_ticks)
            }
        }
    }

    /// Its contribution to the extruder's rate and acceleration at a tick, per tick.
    fn of_extruder(&self, tick: f64, limits: &MotionLimits) -> (f64, f64) {
        let middle = tick - f64::from(limits.advance_delay_ticks);
        match self {
            Source::Event(event) => event.rates_at(middle),
            Source::Flow(flow) => {
                let gain = limits.advance_ratio();
                let (now, before) = (
                    flow.rates_at(tick),
                    flow.rates_at(tick - window_ticks(limits)),
                );
                let (rate, slope) = flow.rates_at(middle);
                (
                    rate + gain * (now.0 - before.0),
                    slope + gain * (now.1 - before.1),
                )
            }
        }
    }

    /// The same this many ticks later.
    fn shifted(self, ticks: f64) -> Self {
        match self {
            Source::Flow(flow) => Source::Flow(Flow {
                start_tick: flow.start_tick + ticks,
                ..flow
            }),
            Source::Event(event) => Source::Event(EventRun {
                start_tick: event.start_tick + ticks,
                ..event
            }),
        }
    }
}

fn window_ticks(limits: &MotionLimits) -> f64 {
    (limits.pressure_advance_window_s * limits.servo_hz).round()
}

/// Ticks of rest before each move.
pub fn rests(route: &Route, finished: &[FinishedMove], limits: &MotionLimits) -> Vec<u64> {
    let mut now = 0.0;
    let mut live: Vec<Source> = Vec::new();
    let moves = route.moves.iter().zip(finished);
    moves
        .map(|(route_move, motion)| {
            live.retain(|source| source.end_tick(limits) > now);
            let own = sources(route_move, motion, limits.servo_hz, now);
            let rest = match live.is_empty() || own.is_empty() {
                true => 0,
                false => rest_before(&own, &live, now, limits),
            };
            let shifted = own.into_iter().map(|source| source.shifted(rest as f64));
            live.extend(shifted);
            now += rest as f64 + motion.spline.ticks() as f64;
            rest as u64
        })
        .collect()
}

/// What a move that begins at a tick does with the extruder.
fn sources<'a>(
    route_move: &RouteMove,
    motion: &'a FinishedMove,
    servo_hz: f64,
    start_tick: f64,
) -> Vec<Source<'a>> {
    let mut sources = Vec::new();
    let spline = &motion.spline;
    let volume = |point: &[f64; 7]| point[CHANNEL_VOLUME];
    let first = spline.control.first().map(volume);
    if spline
        .control
        .iter()
        .any(|point| Some(volume(point)) != first)
    {
        let durations = spline.durations_ticks.iter();
        let ends = durations.scan(0.0, |end, &ticks| {
            *end += f64::from(ticks);
            Some(*end)
        });
        sources.push(Source::Flow(Flow {
            start_tick,
            spline,
            ends: ends.collect(),
        }));
    }
    if let Some(event) = route_move.event {
        let ticks = spline.ticks() as f64;
        sources.push(Source::Event(event_run(event, start_tick, ticks, servo_hz)));
    }
    sources
}

/// An event of a move that begins at a tick and lasts this many, as `assemble` places it.
fn event_run(event: MoveEvent, start_tick: f64, ticks: f64, servo_hz: f64) -> EventRun {
    let in_ticks = |seconds: f64| (seconds * servo_hz).round();
    let (volume_mm3, duration_s, offset) = match event {
        MoveEvent::PrimeAtStart {
            volume_mm3,
            duration_s,
        } => (volume_mm3, duration_s, 0.0),
        MoveEvent::RetractBeforeEnd {
            volume_mm3,
            duration_s,
            lead_s,
        } => {
            let offset = (ticks - in_ticks(lead_s).max(1.0)).max(0.0);
            (-volume_mm3, duration_s, offset)
        }
    };
    EventRun {
        start_tick: start_tick + offset,
        duration_ticks: in_ticks(duration_s).max(1.0),
        volume_mm3,
    }
}

/// The shortest rest before a move with which its sources and those before it keep the limits together, as well as
/// either of them does alone.
fn rest_before(own: &[Source], live: &[Source], now: f64, limits: &MotionLimits) -> usize {
    let last = live.iter().map(|source| source.end_tick(limits));
    let over_ticks = (last.fold(now, f64::max) - now).ceil() as usize;
    let longest = over_ticks + limits.advance_delay_ticks as usize;
    let rests = (0..longest).step_by(STEP_TICKS);
    let is_kept = |rest: &usize| {
        (*rest..over_ticks).all(|tick| {
            let at = now + tick as f64;
            let alone =
                ratio(live, at, 0.0, &[], limits).max(ratio(&[], at, *rest as f64, own, limits));
            ratio(live, at, *rest as f64, own, limits) <= alone.max(KEPT)
        })
    };
    rests.into_iter().find(is_kept).unwrap_or(longest)
}

/// The extruder's rate or acceleration at a tick against the planned share of its limit; `own` begins so much later.
fn ratio(live: &[Source], tick: f64, rest: f64, own: &[Source], limits: &MotionLimits) -> f64 {
    let before = live.iter().map(|source| source.of_extruder(tick, limits));
    let after = own
        .iter()
        .map(|source| source.of_extruder(tick - rest, limits));
    let (rate, slope) = before.chain(after).fold((0.0, 0.0), |sum, of_source| {
        (sum.0 + of_source.0, sum.1 + of_source.1)
    });
    let hz = limits.servo_hz;
    let speed = rate * hz / limits.extruder_speed_max_mm3_s;
    let acceleration = slope * hz * hz / limits.extruder_acceleration_max_mm3_s2;
    speed.abs().max(acceleration.abs())
}
