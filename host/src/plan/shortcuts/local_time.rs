//! How long a stretch of a chain takes: a local time law.
//!
//! In: poses (x, y mm, heading rad) at equal steps of a path parameter u, the machine's limits, the
//! rates at both ends. Out: x = u̇² at every pose, by reachability over the window (Pham and Pham,
//! "A New Approach to Time-Optimal Path Parameterization based on Reachability Analysis", T-RO 2018):
//! backward the largest x from which the end can be reached, forward always the largest acceleration
//! that stays below it. Limits are those of the joints that carry x, y and heading, and of the tip; the
//! jerk that the path's shape makes bounds the rate.
//! Leaves out: flow, z, the jerk of changes of rate; [`crate::plan::time_law`] knows the whole of it.

use crate::plan::curve::plane_curve::PlaneControl;
use crate::plan::pose_limits::PoseLimits;

/// Directions in which the tip's acceleration is bounded, as unit vectors 45° apart: the octagon's
/// sides.
const TIP_DIRECTIONS: [[f64; 2]; 4] = [
    [1.0, 0.0],
    [
        std::f64::consts::FRAC_1_SQRT_2,
        std::f64::consts::FRAC_1_SQRT_2,
    ],
    [0.0, 1.0],
    [
        -std::f64::consts::FRAC_1_SQRT_2,
        std::f64::consts::FRAC_1_SQRT_2,
    ],
];
/// The octagon's inner radius against the circle of tip accelerations that it stands for: of equal
/// area to 0.1 %.
const OCTAGON: f64 = 0.974;
/// Constraints of a pose: heading, tip directions.
const ROWS: usize = 1 + TIP_DIRECTIONS.len();
/// Least rate, 1/s: keeps times finite where the head stands.
const RATE_MIN: f64 = 1e-3;
/// Newton steps to what is controllable: the room has few kinks.
const NEWTON_STEPS: usize = 12;

impl PoseLimits {
    /// Time of a way at the tip's speed, s.
    pub(super) fn at_speed_s(&self, way_mm: f64) -> f64 {
        way_mm / self.tip_speed_mm_s
    }

    /// The constraints of pose `i` of a chain, those beyond its ends mirrored.
    pub(super) fn knot(&self, poses: &[PlaneControl], i: usize) -> Knot {
        let last = poses.len() - 1;
        let mirrored = |end: PlaneControl, inner: PlaneControl| -> PlaneControl {
            std::array::from_fn(|c| 2.0 * end[c] - inner[c])
        };
        let at = |i: isize| match i {
            i if i < 0 => mirrored(poses[0], poses[1.min(last)]),
            i if i as usize > last => mirrored(poses[last], poses[last.saturating_sub(1)]),
            i => poses[i as usize],
        };
        let [before2, before, own, after, after2] =
            std::array::from_fn(|k| at(i as isize + k as isize - 2));
        let first: PlaneControl = std::array::from_fn(|c| 0.5 * (after[c] - before[c]));
        let second: PlaneControl = std::array::from_fn(|c| after[c] - 2.0 * own[c] + before[c]);
        // A cubic spline's third derivative jumps at its knots.
        let third = |c: usize| {
            let ahead = after2[c] - 3.0 * after[c] + 3.0 * own[c] - before[c];
            let behind = after[c] - 3.0 * own[c] + 3.0 * before[c] - before2[c];
            ahead.abs().max(behind.abs())
        };
        let mut inverse = first[0].hypot(first[1]) / self.tip_speed_mm_s;
        for (c, axis) in self.axes.iter().enumerate() {
            inverse = inverse.max(first[c].abs() / axis.speed);
            inverse = inverse.max((third(c) / axis.jerk).cbrt());
        }
        let mut rows = [Row::default(); ROWS];
        rows[0] = Row::new(first[2], second[2], self.axes[2].acceleration);
        for (row, [x, y]) in rows[1..].iter_mut().zip(TIP_DIRECTIONS) {
            let along = |d: &PlaneControl| x * d[0] + y * d[1];
            *row = Row::new(
                along(&first),
                along(&second),
                OCTAGON * self.tip_acceleration_mm_s2,
            );
        }
        Knot {
            rows,
            x_max: 1.0 / (inverse * inverse).max(1e-9),
        }
    }
}

/// One constraint |a ü + b x| <= c.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    a: f64,
    b: f64,
    c: f64,
}

impl Row {
    fn new(a: f64, b: f64, c: f64) -> Row {
        Row { a, b, c }
    }
}

/// What binds the motion at one pose.
#[derive(Clone, Copy, Debug)]
pub struct Knot {
    rows: [Row; ROWS],
    /// Largest u̇² that speeds and the shape's jerk allow.
    x_max: f64,
}

/// Bounds of ü from one knot to the next: slope x ± offset.
struct Cell {
    strips: [[f64; 2]; 2 * ROWS],
    x_max: f64,
}

impl Cell {
    fn new(here: &Knot, next: &Knot) -> Cell {
        let mut cell = Cell {
            strips: [[f64::INFINITY, 0.0]; 2 * ROWS],
            x_max: f64::INFINITY,
        };
        // x at the next knot is x + 2 ü.
        let ahead = next.rows.iter().map(|row| (row.a + 2.0 * row.b, row));
        let rows = here.rows.iter().map(|row| (row.a, row)).chain(ahead);
        for (strip, (a, row)) in cell.strips.iter_mut().zip(rows) {
            if a.abs() > 1e-12 {
                let inverse = 1.0 / a;
                *strip = [row.c * inverse.abs(), -row.b * inverse];
            } else if row.b.abs() > 1e-12 {
                cell.x_max = cell.x_max.min(row.c / row.b.abs());
            }
        }
        cell
    }

    /// Largest x here from which some x up to `next` can be reached: the room between the bounds is
    /// concave in x, and Newton's method from above does not pass its zero.
    fn controllable(&self, x_max: f64, next: f64) -> f64 {
        let mut x = x_max.min(self.x_max);
        for _ in 0..NEWTON_STEPS {
            let (mut low, mut high) = ([-0.5 * x, -0.5], [0.5 * (next - x), -0.5]);
            for &[offset, slope] in &self.strips {
                let middle = slope * x;
                if middle - offset > low[0] {
                    low = [middle - offset, slope];
                }
                if middle + offset < high[0] {
                    high = [middle + offset, slope];
                }
            }
            let (room, slope) = (high[0] - low[0], high[1] - low[1]);
            if room >= -1e-9 * (high[0].abs() + low[0].abs()) || slope >= 0.0 {
                break;
            }
            x = (x - room / slope).max(0.0);
        }
        x
    }

    /// Largest x at the next knot, at most `next`.
    fn advanced(&self, x: f64, next: f64) -> f64 {
        let high = 0.5 * (next - x);
        let high = self
            .strips
            .iter()
            .fold(high, |high, [offset, slope]| high.min(slope * x + offset));
        (x + 2.0 * high).clamp(0.0, next)
    }
}

/// Share of an end's x that may be missed: the rest of the chain is timed anew later.
const END_SHARE: f64 = 0.9;

/// Finds x at every knot with at most `ends` at both ends; false where the ends cannot be met.
pub fn find_rates(knots: &[Knot], ends: [f64; 2], x: &mut Vec<f64>) -> bool {
    let last = knots.len() - 1;
    x.clear();
    x.extend(knots.iter().map(|knot| knot.x_max));
    x[last] = x[last].min(ends[1]);
    let end = x[last];
    for i in (0..last).rev() {
        x[i] = Cell::new(&knots[i], &knots[i + 1]).controllable(x[i], x[i + 1]);
    }
    if x[0] < END_SHARE * ends[0] {
        return false;
    }
    x[0] = x[0].min(ends[0]);
    for i in 0..last {
        x[i + 1] = Cell::new(&knots[i], &knots[i + 1]).advanced(x[i], x[i + 1]);
    }
    x[last] >= END_SHARE * end
}

/// Time between two knots, s.
pub fn step_s(x: f64, next: f64) -> f64 {
    2.0 / (x.sqrt() + next.sqrt()).max(RATE_MIN)
}

/// Time from the first knot to the last, s.
pub fn duration_s(x: &[f64]) -> f64 {
    x.windows(2).map(|pair| step_s(pair[0], pair[1])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    fn print_s(poses: &[PlaneControl]) -> f64 {
        let limits = PoseLimits::of(&Settings::default());
        let knots: Vec<Knot> = (0..poses.len()).map(|i| limits.knot(poses, i)).collect();
        let mut rates = Vec::new();
        assert!(find_rates(&knots, [0.0; 2], &mut rates));
        duration_s(&rates)
    }

    /// Goal: straight lines and turns in place take what they must from rest to rest. Method: 20 mm along x at
    /// 95 % of 60 mm/s and 3000 mm/s², and 3 rad at 95 % of 20,000°/s² and 1080°/s, by hand.
    #[test]
    fn straight_lines_and_turns_take_their_time() {
        let line: Vec<PlaneControl> = (0..=200).map(|i| [0.1 * f64::from(i), 0.0, 0.0]).collect();
        let (speed, acceleration) = (0.95 * 60.0, OCTAGON * 0.95 * 3000.0);
        let expected = 20.0 / speed + speed / acceleration;
        let found = print_s(&line);
        assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        let turn: Vec<PlaneControl> = (0..=200)
            .map(|i| [0.0, 0.0, 0.015 * f64::from(i)])
            .collect();
        let (speed, acceleration) = (0.95 * 1080f64.to_radians(), 0.95 * 20_000f64.to_radians());
        let expected = 3.0 / speed + speed / acceleration;
        let found = print_s(&turn);
        assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    }
}
