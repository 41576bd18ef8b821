//! The unknowns of the optimiser: knots of a uniform cubic B-spline of the pose and of the speed.
//!
//! In: the passes, mm, rad and log s. Out: dimensionless knots, including phantom knots at the ends, and the
//! weights of the four knots of a span with their derivatives. Lengths are in a (half the aperture's length), times
//! in mean spans, so that one set of constants serves nozzles and machines of any size.

use super::OptimisedPass;
use headway_geometry::Point2;

/// Channels of a knot.
pub const CHANNELS: usize = 4;
/// x and y in a, heading in rad, log of the span's time in mean spans.
pub type Knot = [f64; CHANNELS];
/// The channel of the log of the span's time.
pub const PACE: usize = 3;
/// Passes with fewer control points stay as they are.
const CONTROL_MIN: usize = 6;

/// Weights of the four knots of a span at one point of it: of the value and of its derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Basis {
    /// Of the value.
    pub value: [f64; 4],
    /// Of the first derivative.
    pub first: [f64; 4],
    /// Of the second derivative.
    pub second: [f64; 4],
    /// Of the third derivative.
    pub third: [f64; 4],
}

impl Basis {
    /// At `t` in 0..=1.
    pub fn at(t: f64) -> Basis {
        let s = 1.0 - t;
        Basis {
            value: [
                s * s * s / 6.0,
                (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
                (-3.0 * t * t * t + 3.0 * t * t + 3.0 * t + 1.0) / 6.0,
                t * t * t / 6.0,
            ],
            first: [
                -s * s / 2.0,
                (9.0 * t * t - 12.0 * t) / 6.0,
                (-9.0 * t * t + 6.0 * t + 3.0) / 6.0,
                t * t / 2.0,
            ],
            second: [s, 3.0 * t - 2.0, -3.0 * t + 1.0, t],
            third: [-1.0, 3.0, -3.0, 1.0],
        }
    }
}

/// The sum of the first four knots with these weights.
#[inline]
pub fn blend(weights: &[f64; 4], knots: &[Knot]) -> Knot {
    let [p, q, r, s] = [&knots[0], &knots[1], &knots[2], &knots[3]];
    std::array::from_fn(|c| {
        weights[0] * p[c] + weights[1] * q[c] + weights[2] * r[c] + weights[3] * s[c]
    })
}

/// The knots of one pass among all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassKnots {
    /// Number of the pass among those given.
    pub pass: usize,
    /// First knot, the phantom.
    pub first: usize,
    /// Spans: two knots fewer than control points with phantoms.
    pub spans: usize,
    /// Whether it may move; its area counts either way.
    pub free: bool,
    /// Whether it begins and ends within a pass: its first and last knots are not phantoms then.
    pub cut: [bool; 2],
}

impl PassKnots {
    /// The knot after its last one.
    pub fn end(&self) -> usize {
        self.first + self.spans + 3
    }

    /// First knots of its spans.
    pub fn span_starts(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.spans
    }
}

/// Where an objective is evaluated.
#[derive(Clone, Copy, Debug)]
pub struct At<'a> {
    /// The knots.
    pub knots: &'a [Knot],
    /// The passes that they belong to.
    pub passes: &'a [PassKnots],
    /// For each knot whether it stays; if empty, all move.
    pub stays: &'a [bool],
}

/// Whether none of the four knots of the span from `knot` on moves; with no `stays` all do.
#[inline]
pub fn all_stay(stays: &[bool], knot: usize) -> bool {
    stays
        .get(knot..knot + 4)
        .is_some_and(|own| !own.contains(&false))
}

/// Units of the optimiser.
#[derive(Clone, Copy, Debug)]
pub struct Units {
    /// Unit of length: a, mm.
    pub length_mm: f64,
    /// Unit of time: the mean span, s.
    pub time_s: f64,
    /// The origin, in the region's frame.
    pub origin: Point2,
}

impl Units {
    /// Units of these passes about `origin`; `None` if none of them has a time.
    pub fn of(passes: &[OptimisedPass], length_mm: f64, origin: Point2) -> Option<Units> {
        let mut sum = 0.0;
        let mut count = 0;
        for pass in passes.iter().filter(|pass| is_sound(pass)) {
            sum += pass.log_pace.iter().sum::<f64>();
            count += pass.log_pace.len();
        }
        let time_s = (sum / count as f64).exp();
        let sound = time_s > 0.0 && time_s.is_finite() && length_mm > 0.0 && length_mm.is_finite();
        sound.then_some(Units {
            length_mm,
            time_s,
            origin,
        })
    }

    /// A point of the plane in these units.
    pub fn point(&self, p: Point2) -> [f64; 2] {
        [
            (p.x - self.origin.x) / self.length_mm,
            (p.y - self.origin.y) / self.length_mm,
        ]
    }

    /// A point of the plane from these units.
    pub fn point_of(&self, x: f64, y: f64) -> Point2 {
        Point2::new(
            self.origin.x + x * self.length_mm,
            self.origin.y + y * self.length_mm,
        )
    }
}

/// Whether a pass is a curve of numbers.
fn is_sound(pass: &OptimisedPass) -> bool {
    let numbers = pass.control.iter().flatten().chain(&pass.log_pace);
    pass.control.len() >= 2
        && pass.log_pace.len() == pass.control.len()
        && numbers.copied().all(f64::is_finite)
}

/// The knots of all valid passes, each with its phantoms, and the range of each.
pub fn knots_of(passes: &[OptimisedPass], units: &Units) -> (Vec<Knot>, Vec<PassKnots>) {
    let mut knots = Vec::new();
    let mut ranges = Vec::new();
    for (number, pass) in passes.iter().enumerate() {
        if !is_sound(pass) {
            continue;
        }
        let range = PassKnots {
            pass: number,
            first: knots.len(),
            spans: pass.control.len() - 1,
            free: pass.control.len() >= CONTROL_MIN,
            cut: [false; 2],
        };
        let log_time = units.time_s.ln();
        knots.push([0.0; CHANNELS]);
        for (&[x, y, heading_rad], log_pace) in pass.control.iter().zip(&pass.log_pace) {
            let [x, y] = units.point(Point2::new(x, y));
            knots.push([x, y, heading_rad, log_pace - log_time]);
        }
        knots.push([0.0; CHANNELS]);
        set_phantoms(&mut knots, &range);
        ranges.push(range);
    }
    (knots, ranges)
}

/// Natural ends: each phantom is twice the end knot less the inner one.
pub fn set_phantoms(knots: &mut [Knot], pass: &PassKnots) {
    let (first, last) = (pass.first, pass.end() - 1);
    let beyond =
        |end: Knot, inner: Knot| -> Knot { std::array::from_fn(|c| 2.0 * end[c] - inner[c]) };
    if !pass.cut[0] {
        knots[first] = beyond(knots[first + 1], knots[first + 2]);
    }
    if !pass.cut[1] {
        knots[last] = beyond(knots[last - 1], knots[last - 2]);
    }
}

/// Writes the knots of one pass, phantoms included, back to it.
pub fn write_back(knots: &[Knot], units: &Units, pass: &mut OptimisedPass) {
    let log_time = units.time_s.ln();
    for (i, knot) in knots[1..knots.len() - 1].iter().enumerate() {
        let p = units.point_of(knot[0], knot[1]);
        pass.control[i] = [p.x, p.y, knot[2]];
        pass.log_pace[i] = knot[PACE] + log_time;
    }
}
