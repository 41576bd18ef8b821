//! Time law, fit and check of one move, until every limit is kept.
//!
//! In: the move and its limits. Out: a [`FinishedMove`]. A first time law, which includes the jerk only
//! through a smoothing window, gives a first fit; that motion is retimed for the least time along it
//! (`super::retiming`), three times, since each new fit differs a little. Then limits are exceeded by a
//! few per cent in some places, and the finished motion is stretched in time around them
//! ([`super::warp`]), which cannot cause a new peak elsewhere. If the result takes longer than the
//! first time law, the first fit is stretched unchanged, and the shorter one is used.

use super::check::{self, EventRun, JERK_RATIO_MAX, Piece, Ratios};
use super::layout::{self, Layout};
use super::retiming::retimed;
use super::spline::RestSpline;
use super::tick_path::TickPath;
use super::{FinishedMove, dwell_ticks, warp};
use crate::plan::motion::joint_limits::{MotionLimits, tip_mm};
use crate::plan::motion::motion_error::MotionError;
use crate::plan::motion::path_samples::{PathSample, sample_path, tip_way_mm};
use crate::plan::motion::time_law::{
    Shares, TimeLaw, check_duration, coarseness, time_law, without_jerk_s,
};
use crate::plan::route::moves::{MoveEvent, RouteMove};
use headway_protocol::segment::SPAN_TICKS_MAX;
use headway_protocol::units::CHANNELS;

/// Share of the speed limits that the time law aims at: what quantisation and fit add.
const TIME_LAW_SPEED_AIM: f64 = 0.9985;
/// Share of the acceleration limits that the time law aims at: the fit overshoots at corners of
/// the acceleration.
const TIME_LAW_ACCELERATION_AIM: f64 = 0.97;
/// Rounds of retiming: the third brings 1 %, more trade one place for another.
const RETIMING_ROUNDS: usize = 3;
/// Rounds of local stretching of the time.
const WARP_ROUNDS: usize = 20;
/// Rounds in which a jerk beyond its limit counts; after them it is let pass.
const JERK_ROUNDS: usize = 14;
/// Doublings of all durations after that: each halves speeds and quarters accelerations.
const DOUBLING_ROUNDS: usize = 6;
/// A move that becomes a spline.
pub struct Shaping<'a> {
    /// The move.
    pub route_move: &'a RouteMove,
    /// The one before it, whose prime may still run.
    pub before: Option<&'a RouteMove>,
    /// What binds it.
    pub limits: &'a MotionLimits,
    /// Error of each channel that the fit may use.
    pub tolerances: &'a [f64; CHANNELS],
    /// Servo ticks of one tick of the limits' clock.
    pub coarse: u16,
}

/// A move's timing data from samples of its path, which would be too large to keep for a long move.
pub struct FirstTiming {
    /// The motion with which fitting begins.
    law: TimeLaw,
    /// Path length of the tip, mm.
    way_mm: f64,
    /// How long the move takes without limits of the jerk, s.
    least_s: f64,
}

/// A layout and the ratios of its spans.
struct Checked {
    layout: Layout,
    ratios: Vec<Vec<Ratios>>,
}

fn finished(layout: Layout, pieces: &[Piece]) -> FinishedMove {
    FinishedMove {
        ratios: pieces
            .iter()
            .fold(Ratios::default(), |worst, piece| worst.max(piece.ratios)),
        fit_error_ratio: layout.worst_error(),
        spline: layout.spline,
        doubled: false,
        time_bound_s: 0.0,
    }
}

/// The one of two motions that keeps the jerk, or the shorter one where both do; else the one that is less
/// beyond it. A motion slowed as a whole is the last resort.
fn better(motion: FinishedMove, other: FinishedMove) -> FinishedMove {
    let rank = |motion: &FinishedMove| {
        let jerk = motion.ratios.jerk;
        let beyond = if jerk <= JERK_RATIO_MAX { 0.0 } else { jerk };
        (motion.doubled, beyond, motion.spline.ticks())
    };
    if rank(&other) < rank(&motion) {
        other
    } else {
        motion
    }
}

impl Shaping<'_> {
    /// Times, fits and checks until nothing exceeds its limit; very slow moves use a coarse clock.
    pub fn finish(&self) -> Result<FinishedMove, MotionError> {
        let samples = sample_path(&self.route_move.curve, self.limits)?;
        let coarse = coarseness(&samples, self.limits);
        if coarse == 1 {
            return self.timed(samples);
        }
        let on_coarse_ticks = Shaping {
            limits: &self.limits.on_coarse_ticks(coarse),
            coarse,
            ..*self
        };
        let mut finished = on_coarse_ticks.timed(samples)?;
        finished.spline = finished.spline.slower(coarse);
        Ok(finished)
    }

    fn timed(&self, samples: Vec<PathSample>) -> Result<FinishedMove, MotionError> {
        let first = self.first_timing(samples)?;
        Ok(FinishedMove {
            time_bound_s: first.least_s,
            ..self.shortest(first)?
        })
    }

    fn shortest(&self, first: FirstTiming) -> Result<FinishedMove, MotionError> {
        let FirstTiming { law, way_mm, .. } = first;
        let first_ticks = law.ticks() as u64;
        let mut best = self.settled(law.clone(), way_mm, RETIMING_ROUNDS)?;
        let keeps_jerk = |motion: &FinishedMove| motion.ratios.jerk <= JERK_RATIO_MAX;
        if !keeps_jerk(&best) {
            // A motion a little different may settle where this one does not.
            for rounds in (1..RETIMING_ROUNDS).rev() {
                best = better(best, self.settled(law.clone(), way_mm, rounds)?);
                if keeps_jerk(&best) {
                    break;
                }
            }
        }
        if best.spline.ticks() <= first_ticks && !best.doubled && keeps_jerk(&best) {
            return Ok(best);
        }
        Ok(better(best, self.settled(law, way_mm, 0)?))
    }

    /// Fits a time law, retimes it in the first rounds and stretches it until nothing exceeds its
    /// limit.
    fn settled(
        &self,
        mut law: TimeLaw,
        way_mm: f64,
        retiming_rounds: usize,
    ) -> Result<FinishedMove, MotionError> {
        let long_ticks = layout::span_ticks_long(self.limits, self.coarse);
        let mut layout = layout::lay_out(&self.path(&law), self.tolerances, long_ticks);
        let mut before: Option<Checked> = None;
        for round in 0..=retiming_rounds + WARP_ROUNDS {
            let (next, ratios) = if round < retiming_rounds {
                let least_ticks = self.least_ticks();
                let is_rough = round + 1 < retiming_rounds;
                let u_at_tick =
                    retimed(&layout, &law.u_at_tick, least_ticks, self.limits, is_rough)?;
                (TimeLaw { u_at_tick }, None)
            } else {
                let with_jerk = round < retiming_rounds + JERK_ROUNDS;
                let ratios = self.motion_ratios(&layout, &law, before.as_ref())?;
                let mut pieces = self.pieces(&layout, &ratios);
                if pieces.iter().all(|piece| piece.is_kept(with_jerk)) {
                    let refused = self.refused_spans(&layout.spline)?;
                    if refused.is_empty() {
                        return Ok(finished(layout, &pieces));
                    }
                    pieces.extend(refused);
                }
                pieces.retain(|piece| !piece.is_kept(with_jerk));
                let next = self.stretched(&law, way_mm, &pieces, round - retiming_rounds)?;
                (next, Some(ratios))
            };
            let path = self.path(&next);
            let again = layout::lay_out_again(&path, self.tolerances, &layout, &law.u_at_tick);
            let layout = std::mem::replace(&mut layout, again);
            before = ratios.map(|ratios| Checked { layout, ratios });
            law = next;
        }
        self.doubled(layout, &law)
    }

    /// The time around the pieces beyond a limit stretched.
    fn stretched(
        &self,
        law: &TimeLaw,
        way_mm: f64,
        pieces: &[Piece],
        round: usize,
    ) -> Result<TimeLaw, MotionError> {
        let slowness = warp::slowness(law.ticks(), pieces, round);
        let duration_s = slowness.iter().sum::<f64>() / self.limits.servo_hz;
        check_duration(duration_s, way_mm, self.limits, self.begin_mm())?;
        Ok(TimeLaw {
            u_at_tick: warp::stretched(&law.u_at_tick, &slowness),
        })
    }

    /// The spline of a move that this one repeats, moved here, if it still keeps the limits:
    /// rounding at its end may use up the margin.
    pub fn taken_over(
        &self,
        spline: RestSpline,
        known: &FinishedMove,
    ) -> Result<Option<FinishedMove>, MotionError> {
        let ratios = check::motion_ratios(&spline, self.limits, &[], |_| None)?;
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
        Ok(Some(FinishedMove {
            ratios: ratios.fold(Ratios::default(), Ratios::max),
            fit_error_ratio: known.fit_error_ratio,
            spline,
            doubled: known.doubled,
            time_bound_s: known.time_bound_s,
        }))
    }

    /// Ratios of the motion's spans; those that `before` had as well are taken from it.
    fn motion_ratios(
        &self,
        layout: &Layout,
        law: &TimeLaw,
        before: Option<&Checked>,
    ) -> Result<Vec<Vec<Ratios>>, MotionError> {
        let asked = self.limits.asked_at_ticks(&law.u_at_tick);
        check::motion_ratios(&layout.spline, self.limits, &asked, |span| {
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

    /// What the controller would refuse, on its own clock.
    fn refused_spans(&self, spline: &RestSpline) -> Result<Vec<Piece>, MotionError> {
        if self.coarse == 1 {
            return check::refused_spans(spline, self.limits);
        }
        let refused = check::refused_spans(&spline.clone().slower(self.coarse), self.limits)?;
        let coarse = f64::from(self.coarse);
        let on_own_clock = refused.into_iter().map(|piece| Piece {
            start_tick: piece.start_tick / coarse,
            end_tick: piece.end_tick / coarse,
            ..piece
        });
        Ok(on_own_clock.collect())
    }

    fn first_timing(&self, samples: Vec<PathSample>) -> Result<FirstTiming, MotionError> {
        let aims = Shares {
            speed: TIME_LAW_SPEED_AIM,
            acceleration: TIME_LAW_ACCELERATION_AIM,
        };
        let least_s = self.route_move.dwell_s;
        let mut law = time_law(&samples, self.limits, aims, least_s, self.begin_mm())?;
        law.pad_to(layout::MOVING_TICKS_MIN);
        Ok(FirstTiming {
            law,
            way_mm: tip_way_mm(&samples),
            least_s: without_jerk_s(&samples, self.limits).max(least_s),
        })
    }

    /// Ticks that the move lasts at least.
    fn least_ticks(&self) -> usize {
        let of_dwell = (self.route_move.dwell_s * self.limits.servo_hz)
            .ceil()
            .max(0.0);
        layout::MOVING_TICKS_MIN.max(of_dwell as usize)
    }

    fn begin_mm(&self) -> [f64; 3] {
        tip_mm(&self.route_move.curve.control[0])
    }

    fn path<'a>(&'a self, law: &'a TimeLaw) -> TickPath<'a> {
        TickPath::new(&self.route_move.curve, &law.u_at_tick)
            .on_coarse_ticks(self.coarse)
            .in_units(self.limits.units)
    }

    /// Ratios of the motion, and of the fit where even the cut spans miss their tolerance: a slower
    /// motion is then needed to follow the path.
    fn pieces(&self, layout: &Layout, ratios: &[Vec<Ratios>]) -> Vec<Piece> {
        let spline = &layout.spline;
        let mut pieces = self.limit_pieces(spline, ratios);
        let mut start_tick = 0.0;
        for (&ticks, &error) in spline.durations_ticks.iter().zip(&layout.errors) {
            let end_tick = start_tick + f64::from(ticks);
            if error > layout::ERROR_MAX {
                let ratios = Ratios {
                    speed: (error / layout::ERROR_MAX).min(2.0),
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

    /// Events that run during the move or while its advance dies out.
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
            && let Some(MoveEvent::PrimeAtStart {
                volume_mm3,
                duration_s,
            }) = before.event
        {
            let start_tick = -(dwell_ticks(before, hz) as f64);
            events.push(run(start_tick, duration_s, volume_mm3));
        }
        match self.route_move.event {
            Some(MoveEvent::RetractBeforeEnd {
                volume_mm3,
                duration_s,
                lead_s,
            }) => {
                let start_tick = (ticks - (lead_s * hz).round()).max(0.0);
                events.push(run(start_tick, duration_s, -volume_mm3));
            }
            Some(MoveEvent::PrimeAtStart {
                volume_mm3,
                duration_s,
            }) => events.push(run(0.0, duration_s, volume_mm3)),
            None => {}
        }
        events
    }

    /// The last resort: every duration doubled, which halves speeds and quarters accelerations
    /// exactly and leaves the shape as it is.
    fn doubled(&self, mut layout: Layout, law: &TimeLaw) -> Result<FinishedMove, MotionError> {
        let mut pieces = Vec::new();
        for _ in 0..DOUBLING_ROUNDS {
            for ticks in &mut layout.spline.durations_ticks {
                *ticks = ticks.saturating_mul(2).min(SPAN_TICKS_MAX / self.coarse);
            }
            let ratios = self.motion_ratios(&layout, law, None)?;
            pieces = self.pieces(&layout, &ratios);
            let refused = self.refused_spans(&layout.spline)?;
            if pieces.iter().all(|piece| piece.is_kept(false)) && refused.is_empty() {
                break;
            }
        }
        Ok(FinishedMove {
            doubled: true,
            ..finished(layout, &pieces)
        })
    }
}
