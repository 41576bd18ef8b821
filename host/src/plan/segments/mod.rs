//! Route -> the finished stream of knots, events and marks.
//!
//! In: [`Route`] and settings. Out: [`SegmentStream`]. Every stretch is timed, fitted and checked
//! by itself (in parallel, the result does not depend on the number of threads):
//!
//! ```text
//! Stretch -> samples -> u(t) on servo ticks -> spline (quantised) -> ratios in joint space
//!                          ^                                             |
//!                          +------ local caps where a ratio is > 1 ------+
//! ```
//!
//! Left out: what one stretch's pressure advance still does in the next (they are joined at rest;
//! it dies out within the smoothing window).

pub mod assemble;
pub mod check;
pub mod fit;
pub mod layout;
pub mod spline;

use crate::job::SegmentStream;
use crate::plan::joint_limits::{MotionError, MotionLimits, PathSample, sample_path};
use crate::plan::route::{Route, Stretch, StretchEvent};
use crate::plan::time_law::{Caps, smoothing_ticks, time_law};
use crate::settings::Settings;
use check::{EventRun, Piece, Ratios};
use layout::Density;
use rayon::prelude::*;
use spline::{RestSpline, quantised};

/// What the finished segments reach of the planned share of the limits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionReport {
    /// Worst ratios over all stretches.
    pub ratios: Ratios,
    /// Worst error of the fit against the share of the tolerance that it may use.
    pub fit_error_ratio: f64,
    /// Stretches whose whole time had to be doubled, because local slowing did not settle.
    pub doubled_stretches: usize,
    /// Duration of the stream, s.
    pub duration_s: f64,
}

/// Duration of a stretch that moves nothing.
fn dwell_ticks(stretch: &Stretch, servo_hz: f64) -> u64 {
    (stretch.dwell_s.max(0.0) * servo_hz).ceil().max(1.0) as u64
}

/// Share of the speed limits that the time law aims at: what quantisation and fit add.
const SPEED_AIM: f64 = 0.9985;
/// Share of the acceleration limits that the time law aims at: the fit overshoots at corners of
/// the acceleration.
const ACCELERATION_AIM: f64 = 0.97;
/// Rounds of local slowing before the stretch is slowed as a whole, and rounds of that.
const LOCAL_ROUNDS: usize = 8;
const GLOBAL_ROUNDS: usize = 6;
/// Ratio that counts as kept: the extremum between samples is exact to less than this.
const RATIO_MAX: f64 = 1.0 - 1e-6;
/// Slowing goes a little beyond what the ratio asks, or it would creep up to the limit.
const SLOWING_EXTRA: f64 = 0.995;

/// A finished stretch.
pub struct FinishedStretch {
    /// Its motion; a dwell has equal control points.
    pub spline: RestSpline,
    ratios: Ratios,
    fit_error_ratio: f64,
    doubled: bool,
}

/// Turns a route into the stream of segments, within every limit times the plan's share.
pub fn lay_segments(
    route: &Route,
    settings: &Settings,
) -> Result<(SegmentStream, MotionReport), MotionError> {
    check_route(route)?;
    let finished: Vec<FinishedStretch> = (0..route.stretches.len())
        .into_par_iter()
        .map(|index| finish_stretch(route, index, settings))
        .collect::<Result<_, _>>()?;
    let mut report = MotionReport::default();
    for stretch in &finished {
        report.ratios = report.ratios.max(stretch.ratios);
        report.fit_error_ratio = report.fit_error_ratio.max(stretch.fit_error_ratio);
        report.doubled_stretches += usize::from(stretch.doubled);
    }
    let stream = assemble::assemble(route, &finished, settings);
    let ticks = stream.marks.last().map_or(0, |mark| mark.end_tick);
    report.duration_s = ticks as f64 / f64::from(settings.machine.servo_hz);
    Ok((stream, report))
}

/// Largest step between stretches that rounding explains, mm, rad or mm³.
const GAP_MAX: f64 = 1e-7;

fn check_route(route: &Route) -> Result<(), MotionError> {
    for (index, stretch) in route.stretches.iter().enumerate() {
        let control = &stretch.curve.control;
        let finite = control.iter().flatten().all(|value| value.is_finite());
        if control.is_empty() || !finite || !stretch.dwell_s.is_finite() {
            return Err(MotionError::NotFinite { stretch: index });
        }
        let before = index.checked_sub(1).map(|before| &route.stretches[before]);
        if let Some(end) = before.and_then(|before| before.curve.control.last()) {
            let gap = end
                .iter()
                .zip(&control[0])
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            if gap > GAP_MAX {
                return Err(MotionError::Gap {
                    stretch: index,
                    gap,
                });
            }
        }
    }
    Ok(())
}

fn finish_stretch(
    route: &Route,
    index: usize,
    settings: &Settings,
) -> Result<FinishedStretch, MotionError> {
    let stretch = &route.stretches[index];
    let limits = MotionLimits::of(settings, stretch.state)?;
    check_event(stretch, &limits)?;
    let first = quantised(&stretch.curve.control[0]);
    let moves = stretch
        .curve
        .control
        .iter()
        .any(|point| quantised(point) != first);
    if !moves {
        let ticks = dwell_ticks(stretch, limits.servo_hz);
        let durations_ticks = assemble::dwell_spans(ticks);
        return Ok(FinishedStretch {
            spline: RestSpline {
                control: vec![first; durations_ticks.len() + 3],
                durations_ticks,
            },
            ratios: Ratios::default(),
            fit_error_ratio: 0.0,
            doubled: false,
        });
    }
    let samples = sample_path(&stretch.curve, &limits)?;
    let before = index.checked_sub(1).map(|before| &route.stretches[before]);
    let tolerances = fit::channel_tolerances(&settings.tolerances);
    Shaping {
        stretch,
        before,
        samples: &samples,
        limits: &limits,
        tolerances: &tolerances,
    }
    .finish()
}

/// Fails where a prime or retract alone is more than the extruder may do. The quintic step peaks
/// at 1.875 volume / duration and 10/sqrt(3) volume / duration².
fn check_event(stretch: &Stretch, limits: &MotionLimits) -> Result<(), MotionError> {
    let (volume_mm3, duration_s) = match stretch.event {
        Some(StretchEvent::PrimeAtStart {
            volume_mm3,
            duration_s,
        })
        | Some(StretchEvent::RetractBeforeEnd {
            volume_mm3,
            duration_s,
            ..
        }) => (volume_mm3, duration_s),
        None => return Ok(()),
    };
    let speed = 1.875 * volume_mm3 / duration_s;
    let acceleration = 10.0 / 3f64.sqrt() * volume_mm3 / (duration_s * duration_s);
    let ratio = (speed / limits.extruder_speed_max_mm3_s)
        .max(acceleration / limits.extruder_acceleration_max_mm3_s2);
    if ratio <= 1.0 {
        Ok(())
    } else {
        Err(MotionError::EventBeyondExtruder {
            volume_mm3,
            duration_s,
            ratio,
        })
    }
}

/// One moving stretch on its way to a spline.
struct Shaping<'a> {
    stretch: &'a Stretch,
    before: Option<&'a Stretch>,
    samples: &'a [PathSample],
    limits: &'a MotionLimits,
    tolerances: &'a [f64; headway_protocol::units::CHANNELS],
}

impl Shaping<'_> {
    /// Times, fits and checks until nothing exceeds its limit.
    fn finish(&self) -> Result<FinishedStretch, MotionError> {
        let mut caps = Caps::uniform(self.samples.len(), SPEED_AIM, ACCELERATION_AIM);
        let mut density: Option<Density> = None;
        let mut round = 0;
        loop {
            let law = time_law(self.samples, self.limits, &caps, self.stretch.dwell_s)?;
            let path = fit::TickPath::new(&self.stretch.curve, &law.u_at_tick);
            let first = match &density {
                Some(density) => density.scaled_to(law.ticks()),
                None => Density::first(law.ticks()),
            };
            let layout = layout::lay_out(&path, self.tolerances, &first);
            let pieces = self.check(&layout.spline)?;
            let finished = Self::finished(layout.spline, &layout.errors, &pieces);
            if Self::is_kept(&finished) {
                return Ok(finished);
            }
            if round >= LOCAL_ROUNDS + GLOBAL_ROUNDS {
                return self.doubled(finished);
            }
            self.slow_down(&mut caps, &law.u_at_tick, &pieces, round >= LOCAL_ROUNDS);
            density = Some(layout.density);
            round += 1;
        }
    }

    fn check(&self, spline: &RestSpline) -> Result<Vec<Piece>, MotionError> {
        let mut pieces = check::check_motion(spline, self.limits)?;
        let events = self.events(spline.ticks() as f64);
        pieces.extend(check::check_extruder(spline, self.limits, &events));
        Ok(pieces)
    }

    fn finished(spline: RestSpline, errors: &[f64], pieces: &[Piece]) -> FinishedStretch {
        FinishedStretch {
            spline,
            ratios: pieces
                .iter()
                .fold(Ratios::default(), |worst, piece| worst.max(piece.ratios)),
            fit_error_ratio: errors.iter().copied().fold(0.0, f64::max),
            doubled: false,
        }
    }

    fn is_kept(finished: &FinishedStretch) -> bool {
        finished.ratios.speed <= RATIO_MAX && finished.ratios.acceleration <= RATIO_MAX
    }

    /// Events that run while the stretch moves or its advance dies out.
    fn events(&self, ticks: f64) -> Vec<EventRun> {
        let hz = self.limits.servo_hz;
        let mut events = Vec::new();
        if let Some(before) = self.before
            && before.curve.control.len() == 1
            && let Some(StretchEvent::PrimeAtStart {
                volume_mm3,
                duration_s,
            }) = before.event
        {
            events.push(EventRun {
                start_tick: -(dwell_ticks(before, hz) as f64),
                duration_ticks: (duration_s * hz).round().max(1.0),
                volume_mm3,
            });
        }
        match self.stretch.event {
            Some(StretchEvent::RetractBeforeEnd {
                volume_mm3,
                duration_s,
                lead_s,
            }) => events.push(EventRun {
                start_tick: (ticks - (lead_s * hz).round()).max(0.0),
                duration_ticks: (duration_s * hz).round().max(1.0),
                volume_mm3: -volume_mm3,
            }),
            Some(StretchEvent::PrimeAtStart {
                volume_mm3,
                duration_s,
            }) => events.push(EventRun {
                start_tick: 0.0,
                duration_ticks: (duration_s * hz).round().max(1.0),
                volume_mm3,
            }),
            None => {}
        }
        events
    }

    /// Lowers the caps around the pieces beyond a limit (or everywhere) by what they exceed it.
    fn slow_down(&self, caps: &mut Caps, u_at_tick: &[f64], pieces: &[Piece], everywhere: bool) {
        let mut factors = Caps::uniform(self.samples.len(), 1.0, 1.0);
        // The smoothed motion at a tick is made of the profile half a window around it.
        let reach_ticks = smoothing_ticks(self.samples, self.limits) as f64 / 2.0 + 4.0;
        let last_tick = u_at_tick.len() - 1;
        let u_at = |tick: f64| u_at_tick[tick.clamp(0.0, last_tick as f64) as usize];
        for piece in pieces {
            let Ratios {
                speed,
                acceleration,
                ..
            } = piece.ratios;
            if speed <= RATIO_MAX && acceleration <= RATIO_MAX {
                continue;
            }
            let (mut from, mut to) = (0, self.samples.len());
            if !everywhere {
                let low = u_at((piece.start_tick - reach_ticks).floor());
                let high = u_at((piece.end_tick + reach_ticks).ceil());
                from = self.samples.partition_point(|sample| sample.u < low);
                to = self.samples.partition_point(|sample| sample.u <= high);
            }
            for i in from.saturating_sub(1)..(to + 1).min(self.samples.len()) {
                if speed > RATIO_MAX {
                    factors.speed[i] = factors.speed[i].min(SLOWING_EXTRA / speed);
                }
                if acceleration > RATIO_MAX {
                    factors.acceleration[i] =
                        factors.acceleration[i].min(SLOWING_EXTRA / acceleration);
                }
            }
        }
        for i in 0..self.samples.len() {
            caps.speed[i] *= factors.speed[i];
            caps.acceleration[i] *= factors.acceleration[i];
        }
    }

    /// The last resort: every duration doubled, which halves speeds and quarters accelerations
    /// exactly and leaves the shape as it is.
    fn doubled(&self, finished: FinishedStretch) -> Result<FinishedStretch, MotionError> {
        let mut last = finished;
        for _ in 0..GLOBAL_ROUNDS {
            for ticks in &mut last.spline.durations_ticks {
                *ticks = ticks.saturating_mul(2);
            }
            let pieces = self.check(&last.spline)?;
            last = FinishedStretch {
                doubled: true,
                ..Self::finished(last.spline, &[last.fit_error_ratio], &pieces)
            };
            if Self::is_kept(&last) {
                break;
            }
        }
        Ok(last)
    }
}
