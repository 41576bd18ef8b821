//! Checks a finished move against every limit, in joint space, on the quantised spline.
//!
//! In: a spline from rest to rest, limits (the plan's share), flow events that overlap it. Out: the
//! worst speed, acceleration and jerk ratio of every interval of a few ticks. On a linear machine
//! the acceleration is linear in a span, so its ends and the extremum of the speed between two
//! samples are exact; on others the samples are dense.

use super::spline::{RestSpline, evaluate};
use crate::plan::motion::joint_limits::{
    JointPoint, MotionLimits, joint_point, outside_range, tip_mm,
};
use crate::plan::motion::motion_error::{MotionError, no_pose};
use crate::plan::route::path_curve::CurvePoint;
use headway_firmware::configuration::Kinematics;
use headway_firmware::path::load::SpanFault;
use headway_firmware::path::spline::SpanWindow;
use headway_protocol::segment::{Knot, REST_TICKS};
use headway_protocol::units::{CHANNEL_VOLUME, CHANNELS};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Longest piece between two samples, and most pieces of a span, which is one cubic: longer spans crawl.
const PIECE_TICKS: f64 = 8.0;
const PIECES_MAX: f64 = 64.0;

/// Ratios of an interval of the motion to the planned share of the limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ratios {
    /// Joint speed, tip speed, flow, extruder rate.
    pub speed: f64,
    /// Joint and tip acceleration, flow's rate of change, extruder acceleration.
    pub acceleration: f64,
    /// Joint jerk.
    pub jerk: f64,
}

impl Ratios {
    /// The larger of each.
    pub fn max(self, other: Self) -> Self {
        Self {
            speed: self.speed.max(other.speed),
            acceleration: self.acceleration.max(other.acceleration),
            jerk: self.jerk.max(other.jerk),
        }
    }
}

/// Ratios between two ticks of the move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// First tick, from the move's start.
    pub start_tick: f64,
    /// Last tick.
    pub end_tick: f64,
    /// Worst in between.
    pub ratios: Ratios,
}

/// Ratio that counts as kept: the extremum between samples is exact to less than this.
const RATIO_MAX: f64 = 1.0 - 1e-6;
/// The same for the jerk, which in a cubic piece is a mean over it.
pub const JERK_RATIO_MAX: f64 = 1.01;
/// What an extremum between two samples may be beyond the estimate where joints turn with the whole pose: half of
/// this was the maximum, near the pole of a turning table.
const BETWEEN_SHARE: f64 = 1e-4;
/// By how much a span that the controller would refuse is slowed in one round.
const REFUSED_SLOWING: f64 = 1.05;
/// Largest jerk ratio that one round answers: jerk decreases faster than required.
const JERK_RATIO_ANSWERED: f64 = 3.0;

impl Piece {
    /// True where no limit is exceeded; the jerk may be omitted.
    pub fn is_kept(&self, with_jerk: bool) -> bool {
        self.ratios.speed <= RATIO_MAX
            && self.ratios.acceleration <= RATIO_MAX
            && !(with_jerk && self.ratios.jerk > JERK_RATIO_MAX)
    }

    /// Factors by which speed and acceleration have to decrease (above 1) to keep every ratio: a
    /// slowing by a factor f divides speed by f, acceleration by f², jerk by f³.
    pub fn slowing(&self) -> (f64, f64) {
        let needed = |ratio: f64, max: f64| {
            if ratio > max {
                ratio.max(1.0 + 1e-6)
            } else {
                0.0
            }
        };
        let jerk = needed(self.ratios.jerk.min(JERK_RATIO_ANSWERED), JERK_RATIO_MAX).cbrt();
        (
            needed(self.ratios.speed, RATIO_MAX).max(jerk),
            needed(self.ratios.acceleration, RATIO_MAX).max(jerk * jerk),
        )
    }
}

/// A prime or retract that runs during a move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EventRun {
    /// Start, ticks from the move's start; negative if it began before.
    pub start_tick: f64,
    /// Duration, ticks.
    pub duration_ticks: f64,
    /// Volume, mm³; negative for a retract.
    pub volume_mm3: f64,
}

impl EventRun {
    /// Rate (mm³ a tick) and its derivative (mm³ a tick²) of the quintic smooth step.
    pub(super) fn rates_at(&self, tick: f64) -> (f64, f64) {
        let x = (tick - self.start_tick) / self.duration_ticks;
        if !(0.0..=1.0).contains(&x) {
            return (0.0, 0.0);
        }
        let rate = 30.0 * x * x * (1.0 - x) * (1.0 - x);
        let slope = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x);
        (
            self.volume_mm3 * rate / self.duration_ticks,
            self.volume_mm3 * slope / (self.duration_ticks * self.duration_ticks),
        )
    }
}

/// A sample of the motion.
struct Sample {
    point: CurvePoint,
    joints: JointPoint,
}

fn tip_norm(values: &[f64; CHANNELS]) -> f64 {
    (values[0] * values[0] + values[1] * values[1] + values[2] * values[2]).sqrt()
}

/// Largest |speed| between two samples `length_s` apart, assuming a linear acceleration.
fn peak_speed(v0: f64, a0: f64, v1: f64, a1: f64, length_s: f64) -> f64 {
    let ends = v0.abs().max(v1.abs());
    if a0 * a1 >= 0.0 {
        return ends;
    }
    let at_s = length_s * a0 / (a0 - a1);
    ends.max((v0 + 0.5 * a0 * at_s).abs())
}

/// Largest tip speed between two samples `length_s` apart: by its slope, and by the velocity where
/// that is zero, which the path's turning back may make larger.
fn peak_tip_speed(low: &CurvePoint, high: &CurvePoint, length_s: f64) -> f64 {
    let slope = |point: &CurvePoint, speed: f64| {
        let (v, a) = (&point.first, &point.second);
        (v[0] * a[0] + v[1] * a[1] + v[2] * a[2]) / speed.max(1e-12)
    };
    let (v0, v1) = (tip_norm(&low.first), tip_norm(&high.first));
    let (a0, a1) = (slope(low, v0), slope(high, v1));
    let peak = peak_speed(v0, a0, v1, a1, length_s);
    if a0 * a1 >= 0.0 {
        return peak;
    }
    let share = a0 / (a0 - a1);
    let at_s = length_s * share;
    let there = std::array::from_fn(|c| {
        let (start, end) = (low.second[c], high.second[c]);
        low.first[c] + at_s * (start + 0.5 * share * (end - start))
    });
    peak.max(tip_norm(&there))
}

/// Ratios between two neighbouring samples.
fn piece_ratios(
    low: &Sample,
    high: &Sample,
    length_s: f64,
    limits: &MotionLimits,
    tip_mm_s: f64,
) -> Ratios {
    let mut worst = Ratios::default();
    let beyond = match limits.kinematics {
        Kinematics::Planar => 1.0,
        _ => 1.0 + BETWEEN_SHARE,
    };
    let (l, h) = (&low.joints, &high.joints);
    let of_joints = [&l.first, &h.first, &l.second, &h.second, &l.third, &h.third];
    for (limit, [v0, v1, a0, a1, j0, j1]) in limits.bounded(of_joints) {
        // Where joints turn with the whole pose the acceleration has an extremum of its own in between.
        let acceleration = peak_speed(a0, j0, a1, j1, length_s);
        worst = worst.max(Ratios {
            speed: beyond * peak_speed(v0, a0, v1, a1, length_s) / limit.speed_max,
            acceleration: beyond * acceleration / limit.acceleration_max,
            jerk: j0.abs().max(j1.abs()) / limit.jerk_max,
        });
    }
    let (f0, f1) = (
        low.point.first[CHANNEL_VOLUME],
        high.point.first[CHANNEL_VOLUME],
    );
    let (g0, g1) = (
        low.point.second[CHANNEL_VOLUME],
        high.point.second[CHANNEL_VOLUME],
    );
    let flow = peak_speed(f0, g0, f1, g1, length_s);
    let tip = peak_tip_speed(&low.point, &high.point, length_s);
    let tip_acceleration = tip_norm(&low.point.second).max(tip_norm(&high.point.second));
    worst.max(Ratios {
        speed: (tip / tip_mm_s).max(flow / limits.flow_max_mm3_s),
        acceleration: (tip_acceleration / limits.tip_acceleration_mm_s2)
            .max(g0.abs().max(g1.abs()) / limits.flow_rate_of_change_max_mm3_s2),
        jerk: 0.0,
    })
}

/// Spans that are worth a thread.
const SPANS_MIN: usize = 32;

/// Ratios of joints, tip and flow in the intervals of each span; `asked_at_tick` has the requested tip speeds at
/// the ticks (or none), `known` the known ratios of a span.
pub fn motion_ratios<'a>(
    spline: &RestSpline,
    limits: &MotionLimits,
    asked_at_tick: &[f64],
    known: impl Fn(usize) -> Option<&'a Vec<Ratios>> + Sync,
) -> Result<Vec<Vec<Ratios>>, MotionError> {
    let durations = spline.durations_ticks.iter();
    let first_ticks: Vec<f64> = durations
        .scan(0.0, |tick, &ticks| {
            let first = *tick;
            *tick += f64::from(ticks);
            Some(first)
        })
        .collect();
    let ticks = spline.ticks().max(1) as f64;
    let tip_mm_s = |tick: f64| limits.tip_speed_at_share_mm_s(asked_at_tick, tick / ticks);
    let spans = (0..spline.durations_ticks.len()).into_par_iter();
    spans
        .with_min_len(SPANS_MIN)
        .map(|span| match known(span) {
            Some(known) => Ok(known.clone()),
            None => span_ratios(spline, span, limits, |tick| {
                tip_mm_s(first_ticks[span] + tick)
            }),
        })
        .collect()
}

/// The intervals with these ratios, in order of time.
pub fn motion_pieces(spline: &RestSpline, ratios: &[Vec<Ratios>]) -> Vec<Piece> {
    let mut pieces = Vec::with_capacity(ratios.iter().map(Vec::len).sum());
    let mut start_tick = 0.0;
    for (&ticks, ratios) in spline.durations_ticks.iter().zip(ratios) {
        let (_, length) = piece_lengths(ticks);
        pieces.extend(ratios.iter().enumerate().map(|(piece, &ratios)| {
            let from = piece as f64 * length;
            Piece {
                start_tick: start_tick + from,
                end_tick: start_tick + from + length,
                ratios,
            }
        }));
        start_tick += f64::from(ticks);
    }
    pieces
}

/// Number and length of a span's pieces, ticks.
fn piece_lengths(ticks: u16) -> (usize, f64) {
    let duration = f64::from(ticks);
    let count = (duration / PIECE_TICKS).ceil().clamp(2.0, PIECES_MAX);
    (count as usize, duration / count)
}

fn span_ratios(
    spline: &RestSpline,
    span: usize,
    limits: &MotionLimits,
    tip_mm_s: impl Fn(f64) -> f64,
) -> Result<Vec<Ratios>, MotionError> {
    let cubics = spline.span_polynomials(span);
    let sample = |t: f64| {
        let point = evaluate(&cubics, t, limits.servo_hz);
        joint_point(&limits.kinematics, &point).map(|joints| Sample { point, joints })
    };
    let (count, length) = piece_lengths(spline.durations_ticks[span]);
    let mut low = sample(0.0)?;
    (0..count)
        .map(|piece| {
            let from = piece as f64 * length;
            let high = sample(from + length)?;
            let tip_mm_s = tip_mm_s(from).min(tip_mm_s(from + length));
            let ratios = piece_ratios(&low, &high, length / limits.servo_hz, limits, tip_mm_s);
            low = high;
            Ok(ratios)
        })
        .collect()
}

/// Spans that the controller would refuse, as intervals to be slowed: its own check, in its own
/// precision, on the data that it will receive. If the exact check above has passed there are none,
/// except for rounding.
///
/// # Errors
/// [`MotionError`] if slowing does not help: a joint's range, a pose without joints.
pub fn refused_spans(
    spline: &RestSpline,
    limits: &MotionLimits,
) -> Result<Vec<Piece>, MotionError> {
    let (durations, control) = (&spline.durations_ticks, &spline.control);
    let units = &limits.units;
    let mut window = SpanWindow::at_rest(&units.of_natural(&control[0]));
    let knot = |point: usize, span: usize| Knot {
        control: units.of_natural(&control[point]),
        duration_ticks: durations.get(span).copied().unwrap_or(REST_TICKS),
    };
    // A knot carries the duration of the span after the next.
    window.push(&knot(0, 0));
    window.push(&knot(0, 1));
    let mut pieces = Vec::new();
    let mut winding = limits.winding.single();
    let mut start_tick = 0.0;
    for (span, &ticks) in durations.iter().enumerate() {
        window.push(&knot(span + 3, span + 2));
        let end_tick = start_tick + f64::from(ticks);
        let at_mm = || tip_mm(&control[span + 1]);
        match limits.span_check.of_span(&window, &mut winding) {
            Ok(_) => {}
            Err(SpanFault::Limit(..)) => pieces.push(Piece {
                start_tick,
                end_tick,
                ratios: Ratios {
                    speed: REFUSED_SLOWING,
                    ..Ratios::default()
                },
            }),
            Err(SpanFault::SoftLimit(joint, units)) => {
                let joint = usize::from(joint);
                let rotary = limits.joints.get(joint).is_some_and(|limit| limit.rotary);
                let position = f64::from(units) * if rotary { 1e-6 } else { 1e-4 };
                return Err(outside_range(limits, joint, position, at_mm()));
            }
            Err(SpanFault::Kinematics(error)) => {
                let at_mm = at_mm();
                return Err(no_pose(error, at_mm));
            }
        }
        start_tick = end_tick;
    }
    Ok(pieces)
}

/// dV/dt and d²V/dt² at every tick of a move, per second.
fn flow_at_ticks(spline: &RestSpline, servo_hz: f64) -> Vec<(f64, f64)> {
    let mut flow = vec![(0.0, 0.0); spline.ticks() as usize + 1];
    let mut rest = &mut flow[1..];
    let mut of_spans = Vec::with_capacity(spline.durations_ticks.len());
    for &ticks in &spline.durations_ticks {
        let (own, behind) = rest.split_at_mut(usize::from(ticks));
        of_spans.push(own);
        rest = behind;
    }
    let of_spans = of_spans.into_par_iter().with_min_len(SPANS_MIN).enumerate();
    of_spans.for_each(|(span, flow)| {
        let [_, c1, c2, c3] = spline.span_polynomial(span, CHANNEL_VOLUME);
        for (t, flow) in (1u32..).zip(flow) {
            let t = f64::from(t);
            let rate = (c1 + t * (2.0 * c2 + 3.0 * t * c3)) * servo_hz;
            *flow = (rate, (2.0 * c2 + 6.0 * t * c3) * (servo_hz * servo_hz));
        }
    });
    flow
}

/// Ticks that one thread checks.
pub(super) const TICKS_AT_ONCE: usize = 4096;

/// Checks the extruder's own rate and acceleration, pressure advance and events included, tick by
/// tick until the advance has left its window: with the advance centred on the motion, e' at t is
/// V'(t - W/2) + events(t - W/2) + (K/W) (V'(t) - V'(t - W)). An interval beyond its limit is
/// listed where it happens and where its delayed part came from; one interval has the worst of all
/// others. Empty for a move that deposits nothing.
pub fn check_extruder(
    spline: &RestSpline,
    limits: &MotionLimits,
    events: &[EventRun],
) -> Vec<Piece> {
    let flow = flow_at_ticks(spline, limits.servo_hz);
    if flow
        .iter()
        .all(|&(rate, slope)| rate == 0.0 && slope == 0.0)
    {
        return Vec::new();
    }
    let window_ticks = (limits.pressure_advance_window_s * limits.servo_hz).round() as usize;
    let ticks = flow.len() + window_ticks;
    let parts: Vec<(Ratios, Vec<Piece>)> = (0..ticks.div_ceil(TICKS_AT_ONCE))
        .into_par_iter()
        .map(|part| {
            let from = part * TICKS_AT_ONCE;
            let mut worst = Ratios::default();
            let mut pieces = Vec::new();
            for tick in from..(from + TICKS_AT_ONCE).min(ticks) {
                let ratios = extruder_ratios(&flow, tick, window_ticks, limits, events);
                list_extruder(
                    ratios,
                    tick,
                    window_ticks,
                    flow.len(),
                    &mut worst,
                    &mut pieces,
                );
                if (flow.len()..window_ticks).contains(&tick) {
                    pieces.extend(short_piece(&flow, tick, window_ticks, limits, events));
                }
            }
            (worst, pieces)
        })
        .collect();
    let worst = parts.iter().map(|(worst, _)| *worst);
    let kept = Piece {
        start_tick: 0.0,
        end_tick: ticks as f64,
        ratios: worst.fold(Ratios::default(), Ratios::max),
    };
    let pieces = parts.into_iter().flat_map(|(_, pieces)| pieces);
    pieces.chain([kept]).collect()
}

/// A tick after a move that is shorter than the window of pressure advance, if the move by itself exceeds a
/// limit: half a window ago it was in its middle, or at its nearer end.
fn short_piece(
    flow: &[(f64, f64)],
    tick: usize,
    window_ticks: usize,
    limits: &MotionLimits,
    events: &[EventRun],
) -> Option<Piece> {
    let own = events.iter().filter(|event| event.start_tick >= 0.0);
    let own: Vec<EventRun> = own.copied().collect();
    let cause = tick.saturating_sub(limits.advance_delay_ticks as usize);
    let cause = cause.min(flow.len().saturating_sub(1)) as f64;
    let piece = Piece {
        start_tick: cause - 0.5,
        end_tick: cause + 0.5,
        ratios: extruder_ratios(flow, tick, window_ticks, limits, &own),
    };
    (!piece.is_kept(false)).then_some(piece)
}

/// Lists what a tick is beyond its limit by, or counts it among the others.
fn list_extruder(
    ratios: Ratios,
    tick: usize,
    window_ticks: usize,
    flow_ticks: usize,
    worst: &mut Ratios,
    pieces: &mut Vec<Piece>,
) {
    let piece_at = |cause: usize| Piece {
        start_tick: cause as f64 - 0.5,
        end_tick: cause as f64 + 0.5,
        ratios,
    };
    if tick < flow_ticks {
        let piece = piece_at(tick);
        if piece.is_kept(false) {
            *worst = worst.max(ratios);
        } else {
            pieces.push(piece);
        }
    }
    let cause = tick.checked_sub(window_ticks).filter(|&c| c < flow_ticks);
    if let Some(cause) = cause.filter(|_| ratios.speed.max(ratios.acceleration) > 1.0) {
        pieces.push(piece_at(cause));
    }
}

/// What the extruder does at a tick against its limits.
fn extruder_ratios(
    flow: &[(f64, f64)],
    tick: usize,
    window_ticks: usize,
    limits: &MotionLimits,
    events: &[EventRun],
) -> Ratios {
    let advance = limits.advance_ratio();
    let at = |tick: Option<usize>| {
        tick.and_then(|tick| flow.get(tick))
            .copied()
            .unwrap_or((0.0, 0.0))
    };
    let delay_ticks = limits.advance_delay_ticks as usize;
    let (rate, slope) = at(Some(tick));
    let (old_rate, old_slope) = at(tick.checked_sub(window_ticks));
    let (mid_rate, mid_slope) = at(tick.checked_sub(delay_ticks));
    let mut speed = mid_rate + advance * (rate - old_rate);
    let mut acceleration = mid_slope + advance * (slope - old_slope);
    let change = (rate - old_rate) / limits.pressure_advance_window_s;
    acceleration += limits.advance_bend_s2_mm3 * change * change * acceleration.signum();
    for event in events {
        let (rate, slope) = event.rates_at(tick as f64 - delay_ticks as f64);
        speed += rate * limits.servo_hz;
        acceleration += slope * limits.servo_hz * limits.servo_hz;
    }
    Ratios {
        speed: speed.abs() / limits.extruder_speed_max_mm3_s,
        acceleration: acceleration.abs() / limits.extruder_acceleration_max_mm3_s2,
        jerk: 0.0,
    }
}
