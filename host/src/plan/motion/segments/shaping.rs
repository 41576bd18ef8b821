//! One moving stretch: time law, fit and check, slowed locally until every limit is kept.
//!
//! In: the stretch, its samples and limits. Out: a [`FinishedStretch`]. The first rounds lower the
//! caps of the time law around a piece beyond its limit and plan again; the later ones, where only
//! a few per cent are missing, stretch the finished motion in time around the piece
//! ([`super::warp`]), which cannot raise a new peak elsewhere.

use super::check::{self, EventRun, JERK_RATIO_MAX, Piece, Ratios};
use super::layout::{self, Layout};
use super::spline::RestSpline;
use super::tick_path::TickPath;
use super::{FinishedStretch, dwell_ticks, warp};
use crate::plan::motion::joint_limits::{MotionError, MotionLimits, tip_mm};
use crate::plan::motion::path_samples::PathSample;
use crate::plan::motion::time_law::{Caps, TimeLaw, check_duration, smoothing_ticks, time_law};
use crate::plan::route::moves::{Stretch, StretchEvent};
use headway_protocol::segment::SPAN_TICKS_MAX;
use headway_protocol::units::CHANNELS;

/// Share of the speed limits that the time law aims at: what quantisation and fit add.
const SPEED_AIM: f64 = 0.9985;
/// Share of the acceleration limits that the time law aims at: the fit overshoots at corners of
/// the acceleration.
const ACCELERATION_AIM: f64 = 0.97;
/// Rounds by lower caps, then by local stretching of the time: more of the first kind only trade
/// one place for another.
const CAP_ROUNDS: usize = 2;
const WARP_ROUNDS: usize = 18;
/// Rounds in which a jerk beyond its limit counts; after them it is let pass.
const JERK_ROUNDS: usize = 14;
/// Doublings of all durations after that: each halves speeds and quarters accelerations.
const DOUBLING_ROUNDS: usize = 6;
/// Slowing goes a little beyond what the ratio asks, or it would creep up to the limit.
const SLOWING_EXTRA: f64 = 0.995;
/// Error of the fit, against its share of the tolerance, that slows the motion down: the whole
/// tolerance with room for what lies between ticks.
const FIT_ERROR_MAX: f64 = 1.8;

/// One moving stretch on its way to a spline.
pub struct Shaping<'a> {
    /// The stretch.
    pub stretch: &'a Stretch,
    /// The one before it, whose prime may still run.
    pub before: Option<&'a Stretch>,
    /// Samples of its path.
    pub samples: &'a [PathSample],
    /// What binds it.
    pub limits: &'a MotionLimits,
    /// Error of each channel that the fit may use.
    pub tolerances: &'a [f64; CHANNELS],
}

/// A layout and the ratios of its spans.
struct Checked {
    layout: Layout,
    ratios: Vec<Vec<Ratios>>,
}

fn finished(layout: Layout, pieces: &[Piece]) -> FinishedStretch {
    FinishedStretch {
        ratios: pieces
            .iter()
            .fold(Ratios::default(), |worst, piece| worst.max(piece.ratios)),
        fit_error_ratio: layout.worst_error(),
        spline: layout.spline,
        doubled: false,
    }
}

impl Shaping<'_> {
    /// Times, fits and checks until nothing exceeds its limit.
    pub fn finish(&self) -> Result<FinishedStretch, MotionError> {
        let mut caps = Caps::uniform(self.samples.len(), SPEED_AIM, ACCELERATION_AIM);
        let mut law = self.time_law(&caps)?;
        let long_ticks = layout::span_ticks_long(self.limits.tip_speed_mm_s, self.limits.servo_hz);
        let mut layout = layout::lay_out(
            &self.path(&law).with_tangents(),
            self.tolerances,
            long_ticks,
        );
        let mut before: Option<Checked> = None;
        for round in 0..=CAP_ROUNDS + WARP_ROUNDS {
            let ratios = self.motion_ratios(&layout, before.as_ref())?;
            let mut pieces = self.pieces(&layout, &ratios);
            if pieces
                .iter()
                .all(|piece| piece.is_kept(round < JERK_ROUNDS))
            {
                let refused = check::refused_spans(&layout.spline, self.limits)?;
                if refused.is_empty() {
                    return Ok(finished(layout, &pieces));
                }
                pieces.extend(refused);
            }
            pieces.retain(|piece| !piece.is_kept(round < JERK_ROUNDS));
            let next = if round < CAP_ROUNDS {
                self.lower_caps(&mut caps, &law.u_at_tick, &pieces);
                self.time_law(&caps)?
            } else {
                let slowness = warp::slowness(law.ticks(), &pieces, round - CAP_ROUNDS);
                let duration_s = slowness.iter().sum::<f64>() / self.limits.servo_hz;
                check_duration(duration_s, self.samples, self.limits, self.begin_mm())?;
                TimeLaw {
                    u_at_tick: warp::stretched(&law.u_at_tick, &slowness),
                }
            };
            let path = self.path(&next);
            let again = layout::lay_out_again(&path, self.tolerances, &layout, &law.u_at_tick);
            let layout = std::mem::replace(&mut layout, again);
            before = Some(Checked { layout, ratios });
            law = next;
        }
        self.doubled(layout)
    }

    /// The spline of a stretch that this one repeats, moved here, where it keeps the limits as that one
    /// did: rounding at its end may take what was spared.
    pub fn taken_over(
        &self,
        spline: RestSpline,
        known: &FinishedStretch,
    ) -> Result<Option<FinishedStretch>, MotionError> {
        let ratios = check::motion_ratios(&spline, self.limits, |_| None)?;
        let pieces = self.limit_pieces(&spline, &ratios);
        let jerk_max = known.ratios.jerk.max(JERK_RATIO_MAX) * (1.0 + 1e-6);
        let keeps_jerk = |piece: &Piece| piece.ratios.jerk <= jerk_max;
        let is_kept = pieces.iter().all(keeps_jerk)
            && pieces.iter().all(|piece| piece.is_kept(false))
            && check::refused_spans(&spline, self.limits)?.is_empty();
        if !is_kept {
            return Ok(None);
        }
        let ratios = pieces.iter().map(|piece| piece.ratios);
        Ok(Some(FinishedStretch {
            ratios: ratios.fold(Ratios::default(), Ratios::max),
            fit_error_ratio: known.fit_error_ratio,
            spline,
            doubled: known.doubled,
        }))
    }

    /// Ratios of the motion's spans; those that `before` had as well are taken from it.
    fn motion_ratios(
        &self,
        layout: &Layout,
        before: Option<&Checked>,
    ) -> Result<Vec<Vec<Ratios>>, MotionError> {
        check::motion_ratios(&layout.spline, self.limits, |span| {
            let before = before?;
            let same = layout.span_before(&before.layout, span)?;
            Some(&before.ratios[same])
        })
    }

    fn limit_pieces(&self, spline: &RestSpline, ratios: &[Vec<Ratios>]) -> Vec<Piece> {
        let mut pieces = check::motion_pieces(spline, ratios);
        let events = self.events(spline.ticks() as f64);
        pieces.extend(check::check_extruder(spline, self.limits, &events));
        pieces
    }

    fn time_law(&self, caps: &Caps) -> Result<TimeLaw, MotionError> {
        let least_s = self.stretch.dwell_s;
        let mut law = time_law(self.samples, self.limits, caps, least_s, self.begin_mm())?;
        law.pad_to(layout::MOVING_TICKS_MIN);
        Ok(law)
    }

    fn begin_mm(&self) -> [f64; 3] {
        tip_mm(&self.stretch.curve.control[0])
    }

    fn path<'a>(&'a self, law: &'a TimeLaw) -> TickPath<'a> {
        TickPath::new(&self.stretch.curve, &law.u_at_tick)
    }

    /// Ratios of the motion, and of the fit where even the cut spans miss their tolerance: slower
    /// is then the way to follow the path.
    fn pieces(&self, layout: &Layout, ratios: &[Vec<Ratios>]) -> Vec<Piece> {
        let spline = &layout.spline;
        let mut pieces = self.limit_pieces(spline, ratios);
        let mut start_tick = 0.0;
        for (&ticks, &error) in spline.durations_ticks.iter().zip(&layout.errors) {
            let end_tick = start_tick + f64::from(ticks);
            if error > FIT_ERROR_MAX {
                let ratios = Ratios {
                    speed: (error / FIT_ERROR_MAX).min(2.0),
                    ..Ratios::default()
                };
                pieces.push(Piece {
                    start_tick,
                    end_tick,
                    ratios,
                });
            }
            start_tick = end_tick;
        }
        pieces
    }

    /// Events that run while the stretch moves or its advance dies out.
    fn events(&self, ticks: f64) -> Vec<EventRun> {
        let hz = self.limits.servo_hz;
        let run = |start_tick: f64, duration_s: f64, volume_mm3: f64| EventRun {
            start_tick,
            duration_ticks: (duration_s * hz).round().max(1.0),
            volume_mm3,
        };
        let mut events = Vec::new();
        if let Some(before) = self.before
            && before.curve.control.len() == 1
            && let Some(StretchEvent::PrimeAtStart {
                volume_mm3,
                duration_s,
            }) = before.event
        {
            let start_tick = -(dwell_ticks(before, hz) as f64);
            events.push(run(start_tick, duration_s, volume_mm3));
        }
        match self.stretch.event {
            Some(StretchEvent::RetractBeforeEnd {
                volume_mm3,
                duration_s,
                lead_s,
            }) => {
                let start_tick = (ticks - (lead_s * hz).round()).max(0.0);
                events.push(run(start_tick, duration_s, -volume_mm3));
            }
            Some(StretchEvent::PrimeAtStart {
                volume_mm3,
                duration_s,
            }) => events.push(run(0.0, duration_s, volume_mm3)),
            None => {}
        }
        events
    }

    /// Lowers the caps around the pieces beyond a limit by what they exceed it.
    fn lower_caps(&self, caps: &mut Caps, u_at_tick: &[f64], pieces: &[Piece]) {
        let mut factors = Caps::uniform(self.samples.len(), 1.0, 1.0);
        // The smoothed motion at a tick is made of the profile half a window around it.
        let reach_ticks = smoothing_ticks(self.samples, self.limits) as f64 / 2.0 + 4.0;
        let last_tick = u_at_tick.len() - 1;
        let u_at = |tick: f64| u_at_tick[tick.clamp(0.0, last_tick as f64) as usize];
        for piece in pieces {
            let (speed, acceleration) = piece.slowing();
            let low = u_at((piece.start_tick - reach_ticks).floor());
            let high = u_at((piece.end_tick + reach_ticks).ceil());
            let from = self.samples.partition_point(|sample| sample.u < low);
            let to = self.samples.partition_point(|sample| sample.u <= high);
            for i in from.saturating_sub(1)..(to + 1).min(self.samples.len()) {
                if speed > 1.0 {
                    factors.speed[i] = factors.speed[i].min(SLOWING_EXTRA / speed);
                }
                if acceleration > 1.0 {
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
    fn doubled(&self, mut layout: Layout) -> Result<FinishedStretch, MotionError> {
        let mut pieces = Vec::new();
        for _ in 0..DOUBLING_ROUNDS {
            for ticks in &mut layout.spline.durations_ticks {
                *ticks = ticks.saturating_mul(2).min(SPAN_TICKS_MAX);
            }
            let ratios = self.motion_ratios(&layout, None)?;
            pieces = self.pieces(&layout, &ratios);
            let refused = check::refused_spans(&layout.spline, self.limits)?;
            if pieces.iter().all(|piece| piece.is_kept(false)) && refused.is_empty() {
                break;
            }
        }
        Ok(FinishedStretch {
            doubled: true,
            ..finished(layout, &pieces)
        })
    }
}
