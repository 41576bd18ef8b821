//! Retiming: makes a fitted motion faster where every limit has room, slower where one is exceeded.
//!
//! In: the motion's spline, the errors of its fit, u at servo ticks. Out: u at the ticks of the new motion. The
//! fitted spline is itself a curve with known derivatives by its own time t, so the motion of least time along it
//! only needs the rate p(t) = dt_old / dt_new: near 1, and smooth even where the motion begins from rest. b = p² is a
//! uniform cubic spline; the limits are rows over (b, b', b'') ([`limit_rows`]), jerk included; the least time is
//! found in windows of some 0.7 s with fixed ends, in two sweeps, the second over the ends of the first
//! ([`headway_optimiser::least_time`]). The windows of a sweep are independent, so the result does not depend on
//! threads. Not covered: the new fit of the motion, whose own check enforces every limit.

mod limit_rows;

use super::fit::first_ticks;
use super::layout::{ERROR_MAX, Layout};
use super::warp::catmull_rom;
use crate::plan::motion::joint_limits::MotionLimits;
use crate::plan::motion::motion_error::MotionError;
use crate::plan::route::path_curve::basis_weights;
use headway_optimiser::least_time::{Window, least_time};
use limit_rows::{Motion, SQUARED_PACE_FLOOR, WindowRows};
use rayon::prelude::*;
use std::ops::Range;

/// Distance of the pace's knots: 7 ms, less than the time in which the heading builds up its
/// acceleration. With 4 or 5 ms it follows what the fit makes of single spans.
const KNOT_TICKS: f64 = 14.0;
/// Sweeps over the windows, the second across the ends of the first.
const SWEEPS: usize = 2;
/// Coefficients of a window.
const WINDOW: usize = 96;
/// Coefficients between two windows that both hold: a cubic sees four.
const HELD: usize = 3;
/// Largest slowing for an error of the fit in one round.
const FIT_SLOWING_MAX: f64 = 2.0;

/// The knots of the squared pace.
pub struct PaceGrid {
    cells: usize,
    knot_ticks: f64,
    /// Knots a second.
    knot_hz: f64,
}

impl PaceGrid {
    fn new(ticks: f64, servo_hz: f64) -> Self {
        let cells = (ticks / KNOT_TICKS).ceil().max(1.0);
        let knot_ticks = ticks / cells;
        Self {
            cells: cells as usize,
            knot_ticks,
            knot_hz: servo_hz / knot_ticks,
        }
    }

    /// Coefficients: three more than cells.
    fn count(&self) -> usize {
        self.cells + 3
    }

    /// Cell of a tick and the place in it, 0 to 1.
    fn place(&self, tick: f64) -> (usize, f64) {
        let x = tick / self.knot_ticks;
        let cell = (x as usize).min(self.cells - 1);
        (cell, x - cell as f64)
    }

    /// Weights of a cell's four coefficients for b, b' and b'' by knots.
    fn basis(&self, s: f64) -> [[f64; 4]; 3] {
        basis_weights(s)
    }

    /// The free coefficients of each window of a sweep.
    fn windows(&self, sweep: usize) -> Vec<Range<usize>> {
        let mut windows = Vec::new();
        let mut start = 0;
        let mut end = if sweep.is_multiple_of(2) {
            WINDOW
        } else {
            WINDOW / 2
        };
        while start < self.count() {
            // No last window that is only a stub.
            let is_last = end + WINDOW / 2 >= self.count();
            let free_end = if is_last { self.count() } else { end - HELD };
            windows.push(start..free_end);
            start = if is_last { self.count() } else { end };
            end += WINDOW;
        }
        windows
    }
}

/// The retimed motion of a layout with u at its ticks, with a minimum number of ticks; `is_rough` where it is fitted and
/// retimed again.
pub fn retimed(
    layout: &Layout,
    u_at_tick: &[f64],
    least_ticks: usize,
    limits: &MotionLimits,
    is_rough: bool,
) -> Result<Vec<f64>, MotionError> {
    let spline = &layout.spline;
    let grid = PaceGrid::new(spline.ticks() as f64, limits.servo_hz);
    let fit_slowing = layout.errors.iter().map(|error| match error {
        error if *error > ERROR_MAX => (error / ERROR_MAX).min(FIT_SLOWING_MAX),
        _ => 0.0,
    });
    let motion = Motion {
        spline,
        fit_slowing: &fit_slowing.collect::<Vec<_>>(),
        first_ticks: &first_ticks(&spline.durations_ticks),
        asked_at_tick: &limits.asked_at_ticks(u_at_tick),
        limits,
    };
    let mut squared_pace = vec![1.0; grid.count()];
    for sweep in 0..SWEEPS {
        let windows = grid.windows(sweep);
        let is_rough = is_rough || sweep + 1 < SWEEPS;
        let solved: Vec<Option<Vec<f64>>> = windows
            .par_iter()
            .map(|free| solved_window(&motion, &grid, &squared_pace, free, is_rough))
            .collect::<Result<_, MotionError>>()?;
        for (free, solved) in windows.into_iter().zip(solved) {
            if let Some(solved) = solved {
                squared_pace[free].copy_from_slice(&solved);
            }
        }
    }
    let slowness: Vec<f64> = (0..u_at_tick.len())
        .map(|tick| {
            let (cell, s) = grid.place(tick as f64);
            let around = squared_pace[cell..cell + 4].iter();
            let [weights, ..] = grid.basis(s);
            let b: f64 = weights.iter().zip(around).map(|(w, c)| w * c).sum();
            slowness_of(b)
        })
        .collect();
    Ok(run_at(u_at_tick, &slowness, least_ticks))
}

/// How many times as long a motion takes at this squared pace, bounded.
fn slowness_of(squared_pace: f64) -> f64 {
    squared_pace.max(SQUARED_PACE_FLOOR).sqrt().recip()
}

fn solved_window(
    motion: &Motion,
    grid: &PaceGrid,
    squared_pace: &[f64],
    free: &Range<usize>,
    is_rough: bool,
) -> Result<Option<Vec<f64>>, MotionError> {
    let base = free.start.saturating_sub(HELD);
    let coefficients = squared_pace[base..(free.end + HELD).min(squared_pace.len())].to_vec();
    let mut rows = WindowRows::of_window(motion, grid, free, base)?;
    let free = free.start - base..free.end - base;
    if !rows.have_room {
        return Ok(None);
    }
    rows.held.relax(&coefficients, &free);
    let window = Window {
        rows: &rows.held,
        free,
        floor: SQUARED_PACE_FLOOR,
        is_rough,
    };
    Ok(least_time(&window, coefficients))
}

/// u at the ticks of a motion that takes `slowness` (at ticks) times as long; slowed so that it ends
/// on a tick and lasts at least this many.
fn run_at(u_at_tick: &[f64], slowness: &[f64], least_ticks: usize) -> Vec<f64> {
    let last = u_at_tick.len() - 1;
    let at = |tick: isize| u_at_tick[tick.clamp(0, last as isize) as usize];
    // Simpson's rule over a tick, the middle by the cubic through four.
    let length = |k: usize| {
        let beside = slowness[k.saturating_sub(1)] + slowness[(k + 2).min(last)];
        let inner = slowness[k] + slowness[k + 1];
        (inner + 0.25 * (9.0 * inner - beside)) / 6.0
    };
    let duration: f64 = (0..last).map(length).sum();
    let ticks = (duration.ceil() as usize).max(least_ticks);
    let scale = duration / ticks as f64;
    let (mut k, mut begin, mut end) = (0, 0.0, length(0));
    let mut run = Vec::with_capacity(ticks + 1);
    for tick in 0..ticks {
        let wanted = tick as f64 * scale;
        while k + 1 < last && end <= wanted {
            k += 1;
            (begin, end) = (end, end + length(k));
        }
        let s = ((wanted - begin) / (end - begin)).clamp(0.0, 1.0);
        // Old time by new: a cubic with the paces at its ends.
        let [rise, fall] = [k, k + 1].map(|k| (end - begin) / slowness[k]);
        let share = s * s * (3.0 - 2.0 * s) + s * (1.0 - s) * ((1.0 - s) * rise - s * fall);
        let k = k as isize;
        let around = [at(k - 1), at(k), at(k + 1), at(k + 2)];
        run.push(catmull_rom(around, share.clamp(0.0, 1.0)));
    }
    run.push(u_at_tick[last]);
    run
}

#[cfg(test)]
mod tests {
    //! Goal: the least time along a known motion within a jerk limit, no motion below its least
    //! duration, and the ticks of a motion at another pace.
    use super::super::fit::channel_tolerances;
    use super::super::layout::lay_out;
    use super::super::tick_path::TickPath;
    use super::*;
    use crate::job::MotionState;
    use crate::plan::route::moves::PathCurve;
    use crate::settings::Settings;
    use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X};

    /// A turn of the heading over a way of the tip that no limit of its own slows, both from rest to
    /// rest; u runs as a quintic over so many ticks.
    fn turn(turn_rad: f64, ticks: u32) -> (PathCurve, Vec<f64>) {
        let mut to = [0.0; 7];
        (to[CHANNEL_X], to[CHANNEL_HEADING]) = (0.1, turn_rad);
        let curve = PathCurve {
            control: vec![[0.0; 7], to],
        };
        let u = |k: u32| {
            let x = f64::from(k) / f64::from(ticks);
            x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
        };
        (curve, (0..=ticks).map(u).collect())
    }

    const TURN_RAD: f64 = 2.0;

    /// After so many rounds, the ticks.
    fn ticks_after(rounds: u32, least_ticks: usize) -> usize {
        let settings = Settings::default();
        let limits = MotionLimits::of(&settings, MotionState::Print).expect("limits");
        let tolerances = channel_tolerances(&settings);
        let (curve, mut u_at_tick) = turn(TURN_RAD, 1000);
        for round in 1..=rounds {
            let path = TickPath::new(&curve, &u_at_tick);
            let layout = lay_out(&path, &tolerances, 256.0);
            u_at_tick = retimed(&layout, &u_at_tick, least_ticks, &limits, round < rounds)
                .expect("retimed");
            assert_eq!((u_at_tick[0], u_at_tick[u_at_tick.len() - 1]), (0.0, 1.0));
            assert!(u_at_tick.windows(2).all(|pair| pair[1] >= pair[0]));
        }
        u_at_tick.len() - 1
    }

    /// Goal: near the seven phases of a motion within speed, acceleration and jerk, whose time is
    /// known: turn / v + v / a + a / j.
    #[test]
    fn a_turn_takes_the_time_of_its_seven_phases() {
        let settings = Settings::default();
        let limits = MotionLimits::of(&settings, MotionState::Print).expect("limits");
        let heading = limits.joints[limits.joints.len() - 1];
        let (v, a, j) = (
            heading.speed_max,
            heading.acceleration_max,
            heading.jerk_max,
        );
        assert!(
            TURN_RAD > v * v / a + v * a / j,
            "the turn reaches its speed"
        );
        let best_s = TURN_RAD / v + v / a + a / j;
        let found_s = ticks_after(4, 18) as f64 / limits.servo_hz;
        assert!(
            found_s > 0.99 * best_s && found_s < 1.04 * best_s,
            "{found_s} {best_s}"
        );
    }

    #[test]
    fn a_least_duration_is_kept() {
        assert_eq!(ticks_after(2, 700), 700);
    }

    #[test]
    fn a_motion_at_half_the_pace_takes_twice_the_ticks() {
        let (_, u_at_tick) = turn(1.0, 400);
        assert_eq!(run_at(&u_at_tick, &[1.0; 401], 18), u_at_tick);
        let slow = run_at(&u_at_tick, &[2.0; 401], 18);
        assert_eq!(slow.len(), 801);
        for (k, u) in u_at_tick.iter().enumerate() {
            assert!((slow[2 * k] - u).abs() < 1e-12, "{k}");
        }
    }

    /// Goal: a squared pace near zero, where steps did not settle, asks for no endless motion.
    #[test]
    fn no_pace_lets_a_motion_last_for_ever() {
        let slowest = limit_rows::SQUARED_PACE_FLOOR.sqrt().recip();
        for b in [0.0, -1.0, f64::NAN, 1e-300] {
            assert_eq!(slowness_of(b), slowest, "{b}");
        }
        assert_eq!(slowness_of(4.0), 0.5);
    }

    /// Goal: a pace that changes is followed to the order of the interpolation.
    #[test]
    fn a_pace_that_changes_is_followed() {
        let u_at_tick: Vec<f64> = (0..=1000).map(f64::from).collect();
        // dt_new / dt_old = 1 + t / 1000: the new time is t + t² / 2000, 1500 in all.
        let slowness: Vec<f64> = (0..=1000).map(|t| 1.0 + f64::from(t) / 1000.0).collect();
        let run = run_at(&u_at_tick, &slowness, 18);
        assert_eq!(run.len(), 1501);
        // The last ticks take the motion as ending at rest.
        for (tick, u) in run.iter().enumerate().take(1498) {
            let new_time = u + u * u / 2000.0;
            assert!((new_time - tick as f64).abs() < 1e-3, "{tick} {u}");
        }
    }

    #[test]
    fn windows_hold_three_coefficients_between_them() {
        for cells in [1.0, 40.0, 93.0, 200.0, 1000.0] {
            let grid = PaceGrid::new(cells * KNOT_TICKS, 2000.0);
            for sweep in 0..2 {
                let windows = grid.windows(sweep);
                assert_eq!(windows[0].start, 0);
                assert_eq!(windows[windows.len() - 1].end, grid.count());
                for pair in windows.windows(2) {
                    assert_eq!(pair[0].end + HELD, pair[1].start);
                }
            }
        }
    }
}
