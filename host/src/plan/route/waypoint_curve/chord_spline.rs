//! Cubic splines through poses: over the chord length of the tip, and uniform ones.
//!
//! In: points in channel space (mm, rad, mm³). Out: a spline over the chord length with its derivatives, or the
//! control points of a uniform B-spline. Both solve one tridiagonal system (C. de Boor, A Practical Guide to Splines,
//! 1978, chapter 4). Not covered: corners and tolerances (`waypoint_curve`).

use headway_protocol::units::{CHANNEL_VOLUME, CHANNELS};
use nalgebra::Vector3;

type Point = [f64; CHANNELS];

/// Cubic spline over the chord length of its tip, all channels at once. Its first and last piece
/// are parabolas: natural ends would rotate the travel there by a quarter of a chord's turn.
pub struct Spline {
    /// Chord length at each point, mm.
    pub knots: Vec<f64>,
    /// The interpolated points.
    pub points: Vec<Point>,
    /// Second derivatives by chord length.
    bends: Vec<Point>,
}

impl Spline {
    /// Through two or more points whose tips differ from one to the next.
    pub fn through(points: &[Point]) -> Spline {
        let mut knots = vec![0.0];
        let mut length = 0.0;
        for pair in points.windows(2) {
            let chord = Vector3::from_fn(|i, _| pair[1][i] - pair[0][i]);
            length += chord.norm();
            knots.push(length);
        }
        Spline::over(knots, points)
    }

    /// The same over these increasing lengths.
    pub fn over(knots: Vec<f64>, points: &[Point]) -> Spline {
        let n = points.len();
        let mut rows = vec![Row::fixed([0.0; CHANNELS]); n];
        if n > 2 {
            rows[0].above = -1.0;
            rows[n - 1].below = -1.0;
        }
        for i in 1..n - 1 {
            let (left, right) = (knots[i] - knots[i - 1], knots[i + 1] - knots[i]);
            rows[i] = Row {
                below: left / 6.0,
                middle: (left + right) / 3.0,
                above: right / 6.0,
                value: std::array::from_fn(|c| {
                    (points[i + 1][c] - points[i][c]) / right
                        - (points[i][c] - points[i - 1][c]) / left
                }),
            };
        }
        Spline {
            bends: solve(rows),
            points: points.to_vec(),
            knots,
        }
    }

    /// Chord length of all of it, mm.
    pub fn length(&self) -> f64 {
        self.knots[self.knots.len() - 1]
    }

    /// Piece at `s`, its length, and how far into it.
    fn piece(&self, s: f64) -> (usize, f64, f64) {
        let after = self.knots.partition_point(|knot| *knot <= s);
        let piece = after.clamp(1, self.knots.len() - 1) - 1;
        let length = self.knots[piece + 1] - self.knots[piece];
        (
            piece,
            length,
            ((s - self.knots[piece]) / length).clamp(0.0, 1.0),
        )
    }

    /// Channels at a chord length.
    pub fn value(&self, s: f64) -> Point {
        let (i, h, b) = self.piece(s);
        let a = 1.0 - b;
        std::array::from_fn(|c| {
            let bend = (a * a * a - a) * self.bends[i][c] + (b * b * b - b) * self.bends[i + 1][c];
            a * self.points[i][c] + b * self.points[i + 1][c] + bend * h * h / 6.0
        })
    }

    /// Their derivatives by it.
    pub fn slope(&self, s: f64) -> Point {
        let (i, h, b) = self.piece(s);
        let a = 1.0 - b;
        std::array::from_fn(|c| {
            let bend =
                (3.0 * b * b - 1.0) * self.bends[i + 1][c] - (3.0 * a * a - 1.0) * self.bends[i][c];
            (self.points[i + 1][c] - self.points[i][c]) / h + bend * h / 6.0
        })
    }

    /// Their second derivatives.
    pub fn bend(&self, s: f64) -> Point {
        let (i, _, b) = self.piece(s);
        std::array::from_fn(|c| (1.0 - b) * self.bends[i][c] + b * self.bends[i + 1][c])
    }
}

/// One row of a tridiagonal system.
#[derive(Clone, Copy)]
struct Row {
    below: f64,
    middle: f64,
    above: f64,
    value: Point,
}

impl Row {
    fn fixed(value: Point) -> Row {
        Row {
            below: 0.0,
            middle: 1.0,
            above: 0.0,
            value,
        }
    }
}

/// Solves a diagonally dominant tridiagonal system (Thomas).
fn solve(mut rows: Vec<Row>) -> Vec<Point> {
    for i in 1..rows.len() {
        let (before, factor) = (rows[i - 1], rows[i].below / rows[i - 1].middle);
        rows[i].middle -= factor * before.above;
        for c in 0..CHANNELS {
            rows[i].value[c] -= factor * before.value[c];
        }
    }
    let mut solution = vec![[0.0; CHANNELS]; rows.len()];
    let mut next = [0.0; CHANNELS];
    for (row, slot) in rows.iter().zip(&mut solution).rev() {
        *slot = std::array::from_fn(|c| (row.value[c] - row.above * next[c]) / row.middle);
        next = *slot;
    }
    solution
}

/// Control points of the uniform cubic B-spline with natural ends through these samples.
pub fn through_samples(samples: &[Point]) -> Vec<Point> {
    let last = samples.len() - 1;
    let rows = samples.iter().enumerate().map(|(i, &value)| {
        if i == 0 || i == last {
            return Row::fixed(value);
        }
        Row {
            below: 1.0 / 6.0,
            middle: 4.0 / 6.0,
            above: 1.0 / 6.0,
            value,
        }
    });
    let mut control = solve(rows.collect());
    // Where all samples have none, rounding must not leave a trace of it.
    if samples.iter().all(|sample| sample[CHANNEL_VOLUME] == 0.0) {
        control
            .iter_mut()
            .for_each(|point| point[CHANNEL_VOLUME] = 0.0);
    }
    control
}
