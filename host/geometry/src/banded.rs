//! Symmetric positive definite systems of half bandwidth 3, by LDLᵀ.
//!
//! In: the upper band, right-hand sides with any number of columns. Out: the solutions. Why here: the headings of
//! beads, the fit and the retiming couple up to four neighbours. Source: Golub and Van Loan, "Matrix Computations"
//! (2013), 4.3.6. Not covered: pivoting: a pivot that rounding has reduced to 0 is replaced by the least positive
//! number.

/// The band: `rows[i][k]` couples unknowns i and i + k.
#[derive(Clone, Debug, Default)]
pub struct Band {
    /// One row for each unknown; entries beyond the last are not read.
    pub rows: Vec<[f64; 4]>,
}

/// A factored band, ready for right sides.
pub struct Factored {
    rows: Vec<[f64; 4]>,
}

impl Band {
    /// L and D in the place of the band: row i stays as it was when its unknown was eliminated.
    pub fn factored(mut self) -> Factored {
        for i in 0..self.rows.len() {
            let row = self.rows[i];
            for (k, below) in (1..4).zip(&mut self.rows[i + 1..]) {
                let factor = row[k] / pivot(&row);
                for (coupling, own) in below.iter_mut().zip(&row[k..]) {
                    *coupling -= factor * own;
                }
            }
        }
        Factored { rows: self.rows }
    }
}

fn pivot(row: &[f64; 4]) -> f64 {
    row[0].max(f64::MIN_POSITIVE)
}

impl Factored {
    /// Solves in place; one right side a column, as many rows as the band has.
    pub fn solve<const COLUMNS: usize>(&self, right: &mut [[f64; COLUMNS]]) {
        for (i, row) in self.rows.iter().enumerate() {
            let (own, below) = right[i..].split_at_mut(1);
            for (k, below) in (1..4).zip(below) {
                let factor = row[k] / pivot(row);
                for (right, own) in below.iter_mut().zip(&own[0]) {
                    *right -= factor * own;
                }
            }
        }
        for (i, row) in self.rows.iter().enumerate().rev() {
            let (own, below) = right[i..].split_at_mut(1);
            for (coupling, below) in row[1..].iter().zip(&*below) {
                for (own, below) in own[0].iter_mut().zip(below) {
                    *own -= coupling * below;
                }
            }
            own[0] = own[0].map(|own| own / pivot(row));
        }
    }
}

#[cfg(test)]
mod tests {
    //! Goal: the solver against a dense one.
    use super::*;

    #[test]
    fn banded_solver_agrees_with_a_dense_one() {
        let count = 9;
        let mut band = Band {
            rows: vec![[0.0; 4]; count],
        };
        let mut right = vec![[0.0; 7]; count];
        let mut dense = nalgebra::SMatrix::<f64, 9, 9>::zeros();
        let mut dense_right = nalgebra::SVector::<f64, 9>::zeros();
        for i in 0..count {
            for k in 0..4.min(count - i) {
                let value = if k == 0 {
                    6.0
                } else {
                    (i as f64 * 0.7 + k as f64).sin()
                };
                band.rows[i][k] = value;
                dense[(i, i + k)] = value;
                dense[(i + k, i)] = value;
            }
            dense_right[i] = (i as f64).cos();
            right[i] = std::array::from_fn(|c| (c + 1) as f64 * dense_right[i]);
        }
        let expected = dense.lu().solve(&dense_right).unwrap();
        band.factored().solve(&mut right);
        for (got, expected) in right.iter().zip(expected.iter()) {
            for (c, got) in got.iter().enumerate() {
                assert!((got - (c + 1) as f64 * expected).abs() < 1e-11);
            }
        }
    }
}
