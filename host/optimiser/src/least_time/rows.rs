//! Rows over the squared rate of a motion, and the points where they apply.
//!
//! In: weights and bounds. Out: the excess of a row, and its slope.

use std::ops::Range;

/// Share of a violation that one round keeps: from a motion far beyond a limit the least time is
/// far away, where its fit is unreliable.
const VIOLATION_LEFT: f64 = 0.35;
/// Room that a row gets which sees coefficients that are held.
const HELD_ROOM: f64 = 1e-3;
/// One row: weights · (b, b', b'') <= bound, or <= bound / sqrt(b).
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Of b, b' and b''.
    pub weights: [f64; 3],
    /// Whether the bound falls with the root of b.
    pub is_jerk: bool,
    /// What the sum may be.
    pub bound: f64,
}

impl Row {
    /// By how much the bound is exceeded, and the slope of that.
    #[inline]
    pub fn excess(&self, at: &[f64; 3]) -> (f64, [f64; 3]) {
        let [w0, w1, w2] = self.weights;
        let sum = w0 * at[0] + w1 * at[1] + w2 * at[2];
        if !self.is_jerk {
            return (sum - self.bound, self.weights);
        }
        let b = at[0].max(f64::MIN_POSITIVE);
        let bound = self.bound / b.sqrt();
        (sum - bound, [w0 + 0.5 * bound / b, w1, w2])
    }

    /// Raises the bound to the violation that one round keeps.
    fn relaxed(&mut self, at: &[f64; 3], sees_held: bool) {
        let root = if self.is_jerk { at[0].sqrt() } else { 1.0 };
        let used = (self.excess(at).0 * root) + self.bound;
        self.bound = self.bound.max(VIOLATION_LEFT * used);
        if sees_held {
            self.bound = self.bound.max(used + HELD_ROOM);
        }
    }
}

/// A place of the motion and the rows there.
#[derive(Clone, Debug)]
pub struct Place {
    /// First of the four coefficients that b depends on here.
    pub first: usize,
    /// Their weights for b and its derivatives by knots.
    pub basis: [[f64; 4]; 3],
    /// Its rows.
    pub rows: Range<usize>,
}

impl Place {
    /// (b, b', b'') of these coefficients.
    pub fn of(&self, coefficients: &[f64]) -> [f64; 3] {
        let around = &coefficients[self.first..self.first + 4];
        self.weighted(&std::array::from_fn(|k| around[k]))
    }

    /// Weights of (b, b', b'') as weights of the four coefficients.
    #[inline]
    pub fn combined(&self, weights: &[f64; 3]) -> [f64; 4] {
        let [b, first, second] = &self.basis;
        std::array::from_fn(|k| weights[0] * b[k] + weights[1] * first[k] + weights[2] * second[k])
    }

    /// The same of the four that bear on it.
    #[inline]
    pub fn weighted(&self, around: &[f64; 4]) -> [f64; 3] {
        self.basis
            .map(|weights| weights.iter().zip(around).map(|(w, c)| w * c).sum())
    }
}

/// The rows of a window.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    /// Its points, in order of time.
    pub places: Vec<Place>,
    /// All rows.
    pub rows: Vec<Row>,
}

impl Rows {
    /// Gives rows that are beyond their bound, or see coefficients outside `free`, their room.
    pub fn relax(&mut self, coefficients: &[f64], free: &Range<usize>) {
        for place in &self.places {
            let at = place.of(coefficients);
            let sees_held = place.first < free.start || place.first + 4 > free.end;
            for row in &mut self.rows[place.rows.clone()] {
                row.relaxed(&at, sees_held);
            }
        }
    }
}
