//! Route -> the finished stream of knots, events and marks.
//!
//! In: [`Route`] and settings. Out: [`SegmentStream`]. Every move is timed, fitted and checked
//! by itself (in parallel, the result does not depend on the number of threads):
//!
//! ```text
//! Move -> samples -> u(t) on servo ticks -> spline (quantised) -> ratios in joint space
//!                          ^                                             |
//!                          +-- local slowing where a ratio is above 1 -----+
//! ```
//!
//! A print move that repeats one of an earlier layer reuses its spline, moved and checked.
//!
//! All moves share the extruder: if a prime, retract or pressure advance still acts in the next move and both
//! together exceed its limits, the head rests between them (`rests.rs`).

pub mod assemble;
pub mod check;
pub mod fit;
pub mod layout;
mod repeats;
mod rests;
mod retiming;
pub mod shaping;
pub mod spline;
pub mod tick_path;
pub mod warp;

use crate::job::{MotionState, SegmentStream, dwell_spans};
use crate::plan::motion::joint_limits::MotionLimits;
use crate::plan::motion::joint_turns::choose_solution;
use crate::plan::motion::motion_error::MotionError;
use crate::plan::progress::{Progress, Stage, Steps};
use crate::plan::route::moves::{MoveEvent, Route, RouteMove};
use crate::settings::Settings;
use crate::text::refusal::refusal;
use check::Ratios;
use headway_firmware::flow::extruder_limits::event_peaks;
use headway_firmware::kinematics::winding::Winding;
use headway_protocol::control::EVENT_VOLUME_UNITS_MAX;
use headway_protocol::units::CHANNEL_VOLUME;
use rayon::prelude::*;
use shaping::Shaping;
use spline::{RestSpline, quantised};

/// What the finished segments reach of the planned share of the limits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionReport {
    /// Worst ratios over all moves.
    pub ratios: Ratios,
    /// Worst error of the fit against the share of the tolerance that it may use.
    pub fit_error_ratio: f64,
    /// Moves whose complete time had to be doubled, because local slowing did not converge.
    pub doubled_moves: usize,
    /// Duration of the stream, s.
    pub duration_s: f64,
    /// The same if no joint had a limit of its jerk, s.
    pub time_bound_s: f64,
}

/// Duration of a dwell, in servo ticks; at least one.
pub fn dwell_ticks(route_move: &RouteMove, servo_hz: f64) -> u64 {
    (route_move.dwell_s.max(0.0) * servo_hz).ceil().max(1.0) as u64
}

/// A finished move.
pub struct FinishedMove {
    /// Its motion; a dwell has equal control points.
    pub spline: RestSpline,
    /// Worst ratios against the planned share of the limits.
    pub ratios: Ratios,
    /// Worst error of the fit against its share of the tolerance.
    pub fit_error_ratio: f64,
    /// True where local slowing did not settle.
    pub doubled: bool,
    /// Duration without limits of the jerk, s.
    pub time_bound_s: f64,
}

/// Turns a route into the stream of segments, within every limit times the plan's share.
pub fn lay_segments(
    route: &Route,
    settings: &Settings,
) -> Result<(SegmentStream, MotionReport), MotionError> {
    lay_segments_with_progress(route, settings, &())
}

/// The same, with progress.
pub fn lay_segments_with_progress(
    route: &Route,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(SegmentStream, MotionReport), MotionError> {
    check_route(route)?;
    let (settings, windings) = &choose_solution(route, settings)?;
    let steps = Steps::begin(progress, Stage::Segments, route.moves.len());
    let earlier = repeats::earlier_ones(route, &settings.units());
    let firsts: Vec<Option<FinishedMove>> = (0..route.moves.len())
        .into_par_iter()
        .map(|index| match earlier[index] {
            Some(_) => Ok(None),
            None => {
                let finish = || finish_move(route, index, None, settings, &windings[index]);
                Ok(Some(steps.step(finish)??))
            }
        })
        .collect::<Result<_, MotionError>>()?;
    let repeated: Vec<Option<FinishedMove>> = (0..route.moves.len())
        .into_par_iter()
        .map(|index| {
            let Some(first) = earlier[index] else {
                return Ok(None);
            };
            let known = firsts[first].as_ref().map(|known| (first, known));
            let finish = || finish_move(route, index, known, settings, &windings[index]);
            Ok(Some(steps.step(finish)??))
        })
        .collect::<Result<_, MotionError>>()?;
    let both = firsts.into_iter().zip(repeated);
    let finished: Vec<FinishedMove> = both.filter_map(|(a, b)| a.or(b)).collect();
    let mut report = MotionReport::default();
    for route_move in &finished {
        report.ratios = report.ratios.max(route_move.ratios);
        report.fit_error_ratio = report.fit_error_ratio.max(route_move.fit_error_ratio);
        report.doubled_moves += usize::from(route_move.doubled);
        report.time_bound_s += route_move.time_bound_s;
    }
    let limits = MotionLimits::of(settings, MotionState::Print)?;
    let rests = rests::rests(route, &finished, &limits);
    let stream = assemble::assemble(route, &finished, &rests, settings);
    let ticks = stream.marks.last().map_or(0, |mark| mark.end_tick);
    report.duration_s = ticks as f64 / f64::from(settings.machine.servo_hz);
    Ok((stream, report))
}

/// Longest move that is reused from an earlier layer, servo ticks.
const TAKEN_TICKS_MAX: u64 = 1 << 20;
/// Largest step between moves that rounding explains, mm, rad or mm³.
const GAP_MAX: f64 = 1e-7;

fn check_route(route: &Route) -> Result<(), MotionError> {
    for (index, route_move) in route.moves.iter().enumerate() {
        let control = &route_move.curve.control;
        let finite = control.iter().flatten().all(|value| value.is_finite());
        if control.is_empty() || !finite || !route_move.dwell_s.is_finite() {
            return Err(MotionError::Refused(refusal!(
                "move {index} of the route has no finite path; this is a fault of the planner"
            )));
        }
        let before = index.checked_sub(1).map(|before| &route.moves[before]);
        if let Some(end) = before.and_then(|before| before.curve.control.last()) {
            let gap = end
                .iter()
                .zip(&control[0])
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            if gap > GAP_MAX {
                return Err(MotionError::Refused(refusal!(
                    "move {index} of the route begins {gap:.6} away from the end of the one \
                     before it"
                )));
            }
        }
    }
    Ok(())
}

/// One move; `known` is an earlier one that it repeats.
fn finish_move(
    route: &Route,
    index: usize,
    known: Option<(usize, &FinishedMove)>,
    settings: &Settings,
    winding: &Winding<f64>,
) -> Result<FinishedMove, MotionError> {
    let route_move = &route.moves[index];
    let of_state = MotionLimits::of(settings, route_move.state)?;
    let own_mm_s = route_move.speed_mm_s.unwrap_or(f64::INFINITY);
    let own_mm_s2 = route_move.acceleration_mm_s2.unwrap_or(f64::INFINITY);
    let limits = MotionLimits {
        winding: *winding,
        tip_speed_mm_s: of_state.tip_speed_mm_s.min(own_mm_s),
        asked_mm_s: route_move.speeds_mm_s.clone(),
        tip_acceleration_mm_s2: of_state.tip_acceleration_mm_s2.min(own_mm_s2),
        ..of_state
    };
    check_event(route_move, &limits)?;
    let units = &limits.units;
    let first = quantised(&route_move.curve.control[0], units);
    let moves = route_move
        .curve
        .control
        .iter()
        .any(|point| quantised(point, units) != first);
    if !moves {
        let ticks = dwell_ticks(route_move, limits.servo_hz);
        let durations_ticks = dwell_spans(ticks);
        return Ok(FinishedMove {
            spline: RestSpline {
                control: vec![first; durations_ticks.len() + 3],
                durations_ticks,
            },
            ratios: Ratios::default(),
            fit_error_ratio: 0.0,
            doubled: false,
            time_bound_s: ticks as f64 / limits.servo_hz,
        });
    }
    let before = index.checked_sub(1).map(|before| &route.moves[before]);
    let tolerances = fit::channel_tolerances(settings);
    let shaping = Shaping {
        route_move,
        before,
        limits: &limits,
        tolerances: &tolerances,
        coarse: 1,
    };
    // What crawls is timed on a coarse clock, which is less work than to look at every tick again.
    let is_short = |known: &FinishedMove| known.spline.ticks() <= TAKEN_TICKS_MAX;
    if let Some((first, known)) = known.filter(|(_, known)| is_short(known)) {
        let spline = repeats::moved(&known.spline, &route.moves[first], route_move, units);
        if let Some(finished) = shaping.taken_over(spline, known)? {
            return Ok(finished);
        }
    }
    shaping.finish()
}

/// Fails where a prime or retract alone is more than the extruder may do; the controller has the same
/// requirement.
fn check_event(route_move: &RouteMove, limits: &MotionLimits) -> Result<(), MotionError> {
    let (volume_mm3, duration_s) = match route_move.event {
        Some(MoveEvent::PrimeAtStart {
            volume_mm3,
            duration_s,
        })
        | Some(MoveEvent::RetractBeforeEnd {
            volume_mm3,
            duration_s,
            ..
        }) => (volume_mm3, duration_s),
        None => return Ok(()),
    };
    let most_mm3 = f64::from(EVENT_VOLUME_UNITS_MAX) / limits.units.per_natural(CHANNEL_VOLUME);
    if volume_mm3 > most_mm3 {
        return Err(MotionError::Refused(refusal!(
            "a prime or retract of {volume_mm3} mm³ is more than the {most_mm3} mm³ that one \
             may have with this nozzle; ask for less at a time"
        )));
    }
    let [rate, acceleration] = event_peaks(volume_mm3, duration_s);
    let ratio = (rate / limits.extruder_speed_max_mm3_s)
        .max(acceleration / limits.extruder_acceleration_max_mm3_s2);
    if ratio <= 1.0 {
        Ok(())
    } else {
        Err(MotionError::Refused(refusal!(
            "a prime or retract of {volume_mm3} mm³ in {duration_s} s asks {ratio:.2} times of \
             what the extruder may do; lower its rate or raise the extruder's limits"
        )))
    }
}
