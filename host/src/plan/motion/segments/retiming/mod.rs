//! Retiming: a fitted motion run anew, faster where every limit has room, slower where one is exceeded.
//!
//! In: the motion's spline, the errors of its fit, u at servo ticks. Out: u at the ticks of the new
//! motion. The fitted spline is itself a curve with known derivatives by its own time t, so the
//! motion of least time along it asks for the pace p(t) = dt_old / dt_new alone: near 1, and smooth
//! even where the motion begins from rest. b = p² is a uniform cubic spline; the limits are rows over
//! (b, b', b'') ([`limit_rows`]), jerk included; the least time is found in windows of some 0.5 s
//! with their ends held, two sweeps of them, the second over the ends of the first
//! ([`interior_point`]). The windows of a sweep do not see each other, so that threads change nothing.
//! Leaves out: that the new motion is fitted again. Its own check answers for every limit.

mod interior_point;
mod limit_rows;

use super::fit::first_ticks;
use super::layout::{ERROR_MAX, Layout};
use super::warp::catmull_rom;
use crate::plan::motion::joint_limits::{MotionError, MotionLimits};
use crate::plan::route::path_curve::basis_weights;
use interior_point::{Window, least_time};
use limit_rows::{Motion, Rows};
use rayon::prelude::*;
use std::ops::Range;

/// Distance of the pace's knots: 5 ms, half the time in which the heading builds up its
/// acceleration.
const KNOT_TICKS: f64 = 10.0;
/// Coefficients of a window.
const WINDOW: usize = 96;
/// Coefficients between two windows that both hold: a cubic sees four.
const HELD: usize = 3;
/// Largest slowing that an error of the fit asks for in one round.
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
        let mut end = if sweep % 2 == 0 { WINDOW } else { WINDOW / 2 };
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

/// The motion of a layout with u at its ticks, run anew, in at least so many ticks.
pub fn retimed(
    layout: &Layout,
    u_at_tick: &[f64],
    least_ticks: usize,
    limits: &MotionLimits,
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
        limits,
    };
    let mut squared_pace = vec![1.0; grid.count()];
    for sweep in 0..2 {
        let windows = grid.windows(sweep);
        let solved: Vec<Option<Vec<f64>>> = windows
            .par_iter()
            .map(|free| solved_window(&motion, &grid, &squared_pace, free))
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
            b.max(f64::MIN_POSITIVE).sqrt().recip()
        })
        .collect();
    Ok(run_at(u_at_tick, &slowness, least_ticks))
}

fn solved_window(
    motion: &Motion,
    grid: &PaceGrid,
    squared_pace: &[f64],
    free: &Range<usize>,
) -> Result<Option<Vec<f64>>, MotionError> {
    let base = free.start.saturating_sub(HELD);
    let coefficients = squared_pace[base..(free.end + HELD).min(squared_pace.len())].to_vec();
    let mut rows = Rows::of_window(motion, grid, free, base)?;
    let free = free.start - base..free.end - base;
    if !rows.have_room {
        return Ok(None);
    }
    rows.relax(&coefficients, &free);
    let window = Window { rows: &rows, free };
    Ok(least_time(&window, coefficients))
}

/// u at the ticks of a motion that takes `slowness` (at ticks) times as long; slowed so that it ends
/// on a tick and lasts at least so many.
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
