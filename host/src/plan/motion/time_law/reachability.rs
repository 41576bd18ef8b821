//! Time-optimal path parametrisation by reachability analysis over x = u̇².
//!
//! In: samples with constraints |a ü + b x| <= c. Out: the largest u̇ at each sample for a motion
//! from rest to rest. Backward: the largest x from which the end can be reached; forward: from
//! rest, always the largest acceleration that stays below it (Pham and Pham, "A New Approach to
//! Time-Optimal Path Parameterization based on Reachability Analysis", T-RO 2018). The acceleration
//! is constant in a cell and meets the constraints at both of its ends, which keeps the profile
//! smooth where a joint is at rest (their "interpolation" scheme).

use super::Shares;
use crate::plan::motion::joint_limits::MotionLimits;
use crate::plan::motion::path_samples::{PathSample, ROWS_MAX, Row};
use rayon::prelude::*;
use std::ops::Range;

/// Constraints of one sample.
struct Rows {
    rows: [Row; ROWS_MAX],
    count: usize,
}

impl Rows {
    fn new(sample: &PathSample, limits: &MotionLimits, scale: f64) -> Self {
        let mut rows = [Row::default(); ROWS_MAX];
        let count = sample.rows(limits, scale, &mut rows);
        Self { rows, count }
    }

    fn as_slice(&self) -> &[Row] {
        &self.rows[..self.count]
    }
}

/// Bound of the acceleration in a cell, linear in x: lo(x) <= ü <= hi(x) is
/// -offset + slope x <= ü <= offset + slope x.
#[derive(Clone, Copy, Default)]
struct Strip {
    offset: f64,
    slope: f64,
}

/// The constraints of a cell, from both of its ends, ready for evaluation.
struct Cell {
    strips: [Strip; 2 * ROWS_MAX],
    count: usize,
    /// Twice the cell's length in u.
    double_length: f64,
    /// Largest x of rows that do not see ü.
    x_max: f64,
}

/// Below this share of the largest factor a row does not see ü.
const FLAT: f64 = 1e-12;

impl Cell {
    fn new(here: &Rows, next: &Rows, length: f64) -> Self {
        let mut cell = Self {
            strips: [Strip::default(); 2 * ROWS_MAX],
            count: 0,
            double_length: 2.0 * length,
            x_max: f64::INFINITY,
        };
        for row in here.as_slice() {
            cell.push(row.a, row.b, row.c);
        }
        for row in next.as_slice() {
            // x at the cell's end is x + 2 length ü.
            cell.push(row.a + cell.double_length * row.b, row.b, row.c);
        }
        cell
    }

    fn push(&mut self, a: f64, b: f64, c: f64) {
        if a.abs() <= FLAT * (b.abs() * self.double_length + a.abs()) || a == 0.0 {
            if b != 0.0 {
                self.x_max = self.x_max.min(c / b.abs());
            }
            return;
        }
        self.strips[self.count] = Strip {
            offset: c / a.abs(),
            slope: -b / a,
        };
        self.count += 1;
    }

    /// (lowest, its slope, highest, its slope) of ü at `x`, with `next_max` the bound of the next x.
    fn bounds(&self, x: f64, next_max: f64) -> (f64, f64, f64, f64) {
        let back = -1.0 / self.double_length;
        let (mut low, mut low_slope) = (x * back, back);
        let (mut high, mut high_slope) = ((x - next_max) * back, back);
        for strip in &self.strips[..self.count] {
            let centre = strip.slope * x;
            if centre - strip.offset > low {
                (low, low_slope) = (centre - strip.offset, strip.slope);
            }
            if centre + strip.offset < high {
                (high, high_slope) = (centre + strip.offset, strip.slope);
            }
        }
        (low, low_slope, high, high_slope)
    }

    /// x here and the largest at the cell's end. If a row hardly depends on ü, its bound of ü falls
    /// from one end of the range to the other within a rounding of x, and the largest controllable
    /// x leads to a stop: a slightly smaller x here allows a far larger one at the cell's end.
    fn advanced(&self, x: f64, next_max: f64) -> (f64, f64) {
        let next_of = |x: f64| {
            let (_, _, high, _) = self.bounds(x, next_max);
            (x + self.double_length * high).clamp(0.0, next_max)
        };
        let mut best = (x, next_of(x));
        if best.1 >= FALL * x.min(next_max) {
            return best;
        }
        for exponent in GIVEN_UP_EXPONENTS {
            let less = x * (1.0 - 10f64.powi(exponent));
            let next = next_of(less);
            if next > 2.0 * best.1 {
                best = (less, next);
            }
        }
        best
    }

    /// Largest x <= `x_cap` with an admissible ü. The room high - low is concave in x and not
    /// negative at 0, so Newton's method from above descends to its zero without passing it.
    fn largest_controllable(&self, x_cap: f64, next_max: f64) -> f64 {
        let mut x = x_cap.min(self.x_max);
        for _ in 0..NEWTON_STEPS_MAX {
            let (low, low_slope, high, high_slope) = self.bounds(x, next_max);
            let room = high - low;
            let slope = high_slope - low_slope;
            if room >= -1e-12 * (high.abs() + low.abs()) || slope >= 0.0 {
                return x;
            }
            x = (x - room / slope).max(0.0);
        }
        x
    }
}

/// The room is piecewise linear with at most two pieces a row: more steps cannot be needed.
const NEWTON_STEPS_MAX: usize = 4 * ROWS_MAX + 4;

/// A fall of x over one cell to less than this share is examined.
const FALL: f64 = 0.5;
/// Shares of x that may be given up for more at the next sample, as powers of ten.
const GIVEN_UP_EXPONENTS: std::ops::RangeInclusive<i32> = -12..=-3;

/// Cells that are made side by side before they are gone through: what they take stays small.
const CELLS_AT_ONCE: usize = 4096;
/// Samples that are worth a thread.
const SAMPLES_MIN: usize = 128;

/// The cells from each of these samples to the next.
fn cells(
    samples: &[PathSample],
    limits: &MotionLimits,
    aims: Shares,
    range: Range<usize>,
) -> Vec<Cell> {
    let rows: Vec<Rows> = (range.start..range.end + 1)
        .into_par_iter()
        .with_min_len(SAMPLES_MIN)
        .map(|i| Rows::new(&samples[i], limits, aims.acceleration))
        .collect();
    let pairs = rows.par_windows(2).zip(range).with_min_len(SAMPLES_MIN);
    pairs
        .map(|(pair, i)| Cell::new(&pair[0], &pair[1], samples[i + 1].u - samples[i].u))
        .collect()
}

/// Largest u̇ at every sample (0 at both ends) within the limits times these shares.
pub fn fastest_rates(samples: &[PathSample], limits: &MotionLimits, aims: Shares) -> Vec<f64> {
    let last = samples.len() - 1;
    let mut x_max: Vec<f64> = (0..samples.len())
        .into_par_iter()
        .with_min_len(SAMPLES_MIN)
        .map(|i| samples[i].rate_max(limits, aims.speed).powi(2))
        .collect();
    x_max[last] = 0.0;
    let blocks = || (0..last).step_by(CELLS_AT_ONCE);
    let block = |from: usize| from..(from + CELLS_AT_ONCE).min(last);
    for from in blocks().rev() {
        let cells = cells(samples, limits, aims, block(from));
        for (i, cell) in block(from).zip(&cells).rev() {
            x_max[i] = cell.largest_controllable(x_max[i], x_max[i + 1]);
        }
    }
    x_max[0] = 0.0;
    let mut x = 0.0;
    for from in blocks() {
        let cells = cells(samples, limits, aims, block(from));
        for (i, cell) in block(from).zip(&cells) {
            (x_max[i], x) = cell.advanced(x, x_max[i + 1]);
            x_max[i + 1] = x;
        }
    }
    x_max.iter().map(|x| x.sqrt()).collect()
}

#[cfg(test)]
mod tests {
    //! Goal: the closed-form optimum on lines and circles, feasibility and maximality elsewhere.
    use super::*;
    use crate::job::MotionState;
    use crate::plan::motion::path_samples::sample_path;
    use crate::plan::motion::time_law::smoothing::duration_s;
    use crate::plan::route::moves::PathCurve;
    use crate::settings::Settings;

    fn rates(curve: &PathCurve) -> (Vec<f64>, Vec<f64>, Vec<PathSample>, MotionLimits) {
        let limits = MotionLimits::of(&Settings::default(), MotionState::Print).unwrap();
        let samples = sample_path(curve, &limits).unwrap();
        let aims = Shares {
            speed: 1.0,
            acceleration: 1.0,
        };
        let rate = fastest_rates(&samples, &limits, aims);
        let u = samples.iter().map(|sample| sample.u).collect();
        (u, rate, samples, limits)
    }

    /// Goal: a row that hardly sees ü does not stop the head in the middle of a path. Method: two
    /// rows as they come at the turn of a heading, x on the edge of what is controllable.
    #[test]
    fn no_stop_where_a_row_hardly_sees_the_acceleration() {
        let of = |rows: &[[f64; 3]]| {
            let mut all = [Row::default(); ROWS_MAX];
            for (row, [a, b, c]) in all.iter_mut().zip(rows) {
                (row.a, row.b, row.c) = (*a, *b, *c);
            }
            Rows {
                rows: all,
                count: rows.len(),
            }
        };
        let here = of(&[[1e-9, 0.05, 20.0], [0.1, 0.01, 2000.0]]);
        let next = of(&[[2e-3, 0.05, 21.0], [0.1, 0.01, 2000.0]]);
        let cell = Cell::new(&here, &next, 0.5);
        let next_max = 439.0;
        let most = cell.largest_controllable(1e6, next_max);
        let (x, at_end) = cell.advanced(most, next_max);
        assert!(
            at_end > 0.8 * most && x > 0.998 * most,
            "{most} {x} {at_end}"
        );
    }

    #[test]
    fn a_line_is_run_in_the_time_of_its_trapezoid() {
        let curve = PathCurve {
            control: vec![
                [50.0, 60.0, 0.2, 0.0, 0.0, 0.0, 0.0],
                [110.0, 60.0, 0.2, 0.0, 0.0, 0.0, 0.0],
            ],
        };
        let (u, rate, ..) = rates(&curve);
        let (v, a) = (0.95 * 60.0, 0.95 * 3000.0);
        let best_s = 60.0 / v + v / a;
        assert!((duration_s(&u, &rate) / best_s - 1.0).abs() < 1e-3);
    }

    #[test]
    fn a_circle_is_run_at_the_speed_of_its_centripetal_acceleration() {
        // Radius 0.5 mm: v = sqrt(a r) = 37.7 mm/s is below the tip's limit.
        let curve = PathCurve {
            control: (0..400)
                .map(|i| {
                    let (sin, cos) = (f64::from(i) * 0.1).sin_cos();
                    [
                        100.0 + 0.5 * cos,
                        100.0 + 0.5 * sin,
                        0.2,
                        0.0,
                        0.0,
                        0.0,
                        0.0,
                    ]
                })
                .collect(),
        };
        let (_, rate, samples, limits) = rates(&curve);
        let middle = samples.len() / 2;
        let speed = rate[middle] * 0.05;
        let best = (limits.tip_acceleration_mm_s2 * 0.5).sqrt();
        // The inscribed polygon of the tip's acceleration takes up to 2 %, of the speed 1 %.
        assert!(
            speed < 1.001 * best && speed > 0.985 * best,
            "{speed} {best}"
        );
    }

    #[test]
    fn a_wild_path_keeps_every_row_and_touches_one_nearly_everywhere() {
        let curve = PathCurve {
            control: (0..300)
                .map(|i| {
                    let t = f64::from(i) * 0.1;
                    let heading = 2.0 * (t * 0.9).sin() + 0.5 * (t * 2.3).cos();
                    [
                        100.0 + t,
                        100.0 + (t * 1.7).sin(),
                        0.2,
                        0.0,
                        0.0,
                        heading,
                        0.024 * t,
                    ]
                })
                .collect(),
        };
        let (u, rate, samples, limits) = rates(&curve);
        let mut binding = 0;
        for i in 0..u.len() - 1 {
            let acceleration =
                (rate[i + 1] * rate[i + 1] - rate[i] * rate[i]) / (2.0 * (u[i + 1] - u[i]));
            let mut tightest = rate[i] / samples[i].rate_max(&limits, 1.0);
            for (sample, rate) in [(&samples[i], rate[i]), (&samples[i + 1], rate[i + 1])] {
                for row in Rows::new(sample, &limits, 1.0).as_slice() {
                    let used = (row.a * acceleration + row.b * rate * rate).abs() / row.c;
                    assert!(used <= 1.0 + 1e-9, "sample {i}: {used}");
                    tightest = tightest.max(used);
                }
            }
            binding += usize::from(tightest > 1.0 - 1e-6);
        }
        // A time-optimal motion always has an active constraint.
        assert!(
            binding * 100 >= 97 * (u.len() - 1),
            "{binding} of {}",
            u.len()
        );
    }
}
