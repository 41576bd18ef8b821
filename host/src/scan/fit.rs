//! Linear least squares by rows, each with less weight the farther it is off.
//!
//! In: rows of a design with their observations. Out: values with standard errors. Tukey's biweight with the scale of the median
//! (Beaton and Tukey, 1974), begun from Huber's. A weak prior about 0 keeps values that no row knows: their error is the prior's.

use nalgebra::{SMatrix, SVector};

/// Rounds of weighting.
const ROUNDS: usize = 12;
/// Of the first rounds, which keep far rows.
const HUBER_ROUNDS: usize = 4;

/// A row: its columns, its observation.
pub type Row<const N: usize> = ([f64; N], f64);

/// What is found.
#[derive(Clone, Copy, Debug)]
pub struct Fit<const N: usize> {
    /// Values.
    pub value: [f64; N],
    /// Their standard errors.
    pub error: [f64; N],
    /// Standard deviation of a row about the fit, outliers left out.
    pub scale: f64,
}

/// The fit; `prior` is how far each value may be from 0, before any row.
pub fn robust<const N: usize>(rows: &[Row<N>], prior: [f64; N]) -> Fit<N> {
    let mut fit = Fit {
        value: [0.0; N],
        error: prior,
        scale: 0.0,
    };
    let mut weights = vec![1.0; rows.len()];
    for round in 0..ROUNDS {
        let (mut normal, mut right) = ([[0.0; N]; N], [0.0; N]);
        for ((columns, observed), weight) in rows.iter().zip(&weights) {
            for (row, column) in columns.iter().enumerate().filter(|_| *weight > 0.0) {
                right[row] += weight * observed * column;
                for (entry, other) in normal[row].iter_mut().zip(columns) {
                    *entry += weight * column * other;
                }
            }
        }
        let mut normal = SMatrix::<f64, N, N>::from(normal);
        // In units of the rows' variance, which the first round does not know.
        let variance = if round == 0 { 0.0 } else { fit.scale.powi(2) };
        for k in 0..N {
            normal[(k, k)] += (variance / prior[k].powi(2))
                .max(1e-12 * normal[(k, k)])
                .max(f64::MIN_POSITIVE);
        }
        let Some(factors) = normal.cholesky() else {
            return fit;
        };
        fit.value = factors.solve(&SVector::from(right)).into();
        let off = rows.iter().map(|(columns, observed)| {
            let fitted: f64 = columns.iter().zip(&fit.value).map(|(a, b)| a * b).sum();
            observed - fitted
        });
        let off: Vec<f64> = off.collect();
        fit.scale = 1.4826 * median(off.iter().map(|off| off.abs()).collect());
        let inverse = factors.inverse();
        fit.error = std::array::from_fn(|k| (inverse[(k, k)].sqrt() * fit.scale).min(prior[k]));
        let unit = fit.scale.max(f64::MIN_POSITIVE);
        for (weight, off) in weights.iter_mut().zip(&off) {
            let by = off.abs() / unit;
            *weight = match round < HUBER_ROUNDS {
                true => (1.5 / by.max(1e-9)).min(1.0),
                false => (1.0 - (by / 4.685).powi(2)).max(0.0).powi(2),
            };
        }
    }
    fit
}

/// The middle one; 0 of none.
pub fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    //! Goal: a line is found among wrong rows, and what no row knows stays unknown. Method: every fifth row is far off.
    use super::*;

    #[test]
    fn wrong_rows_do_not_count() {
        let row = |k: i32| {
            let x = f64::from(k) / 50.0;
            let off = if k % 5 == 0 {
                3.0
            } else {
                0.01 * f64::from(k % 3 - 1)
            };
            ([1.0, x, 0.0], 2.0 - x + off)
        };
        let rows: Vec<Row<3>> = (0..100).map(row).collect();
        let fit = robust(&rows, [10.0; 3]);
        assert!((fit.value[0] - 2.0).abs() < 0.01 && (fit.value[1] + 1.0).abs() < 0.01);
        assert!(
            fit.value[2].abs() < 1e-9 && (fit.error[2] - 10.0).abs() < 1e-3,
            "{fit:?}"
        );
    }
}
