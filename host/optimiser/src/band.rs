//! The normal equations of the optimiser: a gradient and a symmetric banded matrix.
//!
//! In: slopes and curvatures of single poses, added to the four knots of each. Out: the solution of the system
//! by Cholesky's method without roots (L D Lᵀ). Unknown `4 k + c` is channel c of knot k; a span couples four
//! knots, so the half bandwidth is 15.

use super::curve::CHANNELS;

/// Entries of a row of the upper part, the diagonal first.
pub const WIDTH: usize = 4 * CHANNELS;
/// Pivots below this mean a matrix that is not positive definite.
const PIVOT_MIN: f64 = 1e-12;

/// A symmetric band matrix, rows of its upper part; [`WIDTH`] empty rows below spare the bounds.
#[derive(Clone, Debug)]
pub struct Band {
    rows: Vec<[f64; WIDTH]>,
}

impl Band {
    /// All zero.
    pub fn new(unknowns: usize) -> Band {
        Band {
            rows: vec![[0.0; WIDTH]; unknowns + WIDTH],
        }
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.rows.len() - WIDTH
    }

    /// Back to zero.
    pub fn clear(&mut self) {
        self.rows.fill([0.0; WIDTH]);
    }

    /// Takes over the entries of another of the same size.
    pub fn copy_from(&mut self, other: &Band) {
        self.rows.copy_from_slice(&other.rows);
    }

    /// Row `i`: entries (i, i), (i, i + 1), ...
    pub fn row_mut(&mut self, i: usize) -> &mut [f64; WIDTH] {
        &mut self.rows[i]
    }

    /// Entry (i, j), in either order.
    pub fn at(&self, i: usize, j: usize) -> f64 {
        let (low, high) = (i.min(j), i.max(j));
        self.rows[low].get(high - low).copied().unwrap_or(0.0)
    }

    fn set(&mut self, i: usize, j: usize, value: f64) {
        if j >= i {
            self.rows[i][j - i] = value;
        }
    }

    /// Removes an unknown from the system: its row and column become those of the identity.
    pub fn pin(&mut self, i: usize) {
        for (off, row) in self.rows[i.saturating_sub(WIDTH - 1)..i]
            .iter_mut()
            .rev()
            .enumerate()
        {
            row[off + 1] = 0.0;
        }
        self.rows[i] = [0.0; WIDTH];
        self.rows[i][0] = 1.0;
    }

    /// Factors in place; false where the matrix is not positive definite (or not a number).
    pub fn factor(&mut self) -> bool {
        for i in 0..self.unknowns() {
            let pivot = self.rows[i];
            if !(pivot[0] > PIVOT_MIN && pivot[0].is_finite()) {
                return false;
            }
            let inverse = 1.0 / pivot[0];
            for (k, row) in self.rows[i + 1..i + WIDTH].iter_mut().enumerate() {
                let factor = pivot[k + 1] * inverse;
                for (entry, above) in row.iter_mut().zip(&pivot[k + 1..]) {
                    *entry -= factor * above;
                }
            }
        }
        true
    }

    /// Solves in place with the factors: `x` has [`WIDTH`] zeros below the unknowns.
    pub fn solve(&self, x: &mut [f64]) {
        let unknowns = self.unknowns();
        for i in 0..unknowns {
            let row = &self.rows[i];
            let own = x[i] / row[0];
            for (below, entry) in x[i + 1..i + WIDTH].iter_mut().zip(&row[1..]) {
                *below -= own * entry;
            }
            x[i] = own;
        }
        x[unknowns..].fill(0.0);
        for i in (0..unknowns).rev() {
            let row = &self.rows[i];
            // Four sums do not wait for each other; the entry on the diagonal is left out.
            let mut sums = [-row[0] * x[i], 0.0, 0.0, 0.0];
            let products = x[i..i + WIDTH].chunks_exact(4).zip(row.chunks_exact(4));
            for (x, entries) in products {
                for (sum, (x, entry)) in sums.iter_mut().zip(x.iter().zip(entries)) {
                    *sum += x * entry;
                }
            }
            let sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
            x[i] -= sum / row[0];
        }
    }
}

/// What a term of the objective adds at one pose: slope and curvature by x, y and heading.
#[derive(Clone, Copy, Debug, Default)]
pub struct PoseTerm {
    slope: [f64; 3],
    curvature: [[f64; 3]; 3],
}

impl PoseTerm {
    /// Adds a function of one quantity with this slope and curvature; `by_pose` is the quantity's own derivative.
    #[inline]
    pub fn add(&mut self, slope: f64, curvature: f64, by_pose: &[f64; 3]) {
        let rows = self.slope.iter_mut().zip(&mut self.curvature);
        for ((sum, row), own) in rows.zip(by_pose) {
            *sum += slope * own;
            for (entry, other) in row.iter_mut().zip(by_pose) {
                *entry += curvature * own * other;
            }
        }
    }
}

/// Gradient and curvature of an objective by the unknowns.
#[derive(Clone, Debug)]
pub struct System {
    /// Gradient, [`WIDTH`] spare entries at its end.
    pub gradient: Vec<f64>,
    /// Curvature, by Gauss and Newton.
    pub band: Band,
}

impl System {
    /// All zero.
    pub fn new(unknowns: usize) -> System {
        System {
            gradient: vec![0.0; unknowns + WIDTH],
            band: Band::new(unknowns),
        }
    }

    /// Back to zero.
    pub fn clear(&mut self) {
        self.gradient.fill(0.0);
        self.band.clear();
    }

    /// Adds a term at the pose that the four knots from `knot` on have with these weights.
    #[inline]
    pub fn add_pose(&mut self, knot: usize, weights: &[f64; 4], term: &PoseTerm) {
        for (j, &weight) in weights.iter().enumerate() {
            let base = CHANNELS * (knot + j);
            for (m, (slope, curvature)) in term.slope.iter().zip(&term.curvature).enumerate() {
                self.gradient[base + m] += weight * slope;
                let row = &mut self.band.rows[base + m];
                for (entry, bend) in row.iter_mut().zip(&curvature[m..]) {
                    *entry += weight * weight * bend;
                }
                for (ahead, other) in weights[j + 1..].iter().enumerate() {
                    let first = CHANNELS * (ahead + 1) - m;
                    for (entry, bend) in row[first..first + 3].iter_mut().zip(curvature) {
                        *entry += weight * other * bend;
                    }
                }
            }
        }
    }

    /// Takes an unknown out: it stays as it is.
    pub fn pin(&mut self, unknown: usize) {
        self.gradient[unknown] = 0.0;
        self.band.pin(unknown);
    }

    /// Removes a phantom knot from the unknowns: it is twice the `end` knot minus the `inner` one. All three
    /// are among the four knots from `window` on, beyond which the phantom has no coupling.
    pub fn fold(&mut self, window: usize, [phantom, end, inner]: [usize; 3]) {
        let base = CHANNELS * window;
        let mut dense = [[0.0; WIDTH]; WIDTH];
        for (i, row) in dense.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = self.band.at(base + i, base + j);
            }
        }
        for c in 0..CHANNELS {
            let [p, e, i] = [phantom, end, inner].map(|knot| CHANNELS * (knot - window) + c);
            let taken_out = dense[p];
            for (entry, own) in dense[e].iter_mut().zip(&taken_out) {
                *entry += 2.0 * own;
            }
            for (entry, own) in dense[i].iter_mut().zip(&taken_out) {
                *entry -= own;
            }
            for row in &mut dense {
                row[e] += 2.0 * row[p];
                row[i] -= row[p];
                row[p] = 0.0;
            }
            dense[p] = [0.0; WIDTH];
            dense[p][p] = 1.0;
            let slope = std::mem::take(&mut self.gradient[base + p]);
            self.gradient[base + e] += 2.0 * slope;
            self.gradient[base + i] -= slope;
        }
        for (i, row) in dense.iter().enumerate() {
            for (j, &entry) in row.iter().enumerate() {
                self.band.set(base + i, base + j, entry);
            }
        }
    }
}
