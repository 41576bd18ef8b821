//! Smoother versions of a short run of poses.
//!
//! In: values over time. Out: those that minimise the sum of squared changes and of squared second
//! derivatives over time, the latter weighted so that waves shorter than a given one vanish (Whittaker
//! 1923; banded normal equations by LDLᵀ), brought back to what was there towards both ends, where
//! value and two derivatives stay.

use std::f64::consts::TAU;

/// Share of the run over which it goes over from what was there, at each end.
const BLEND_SHARE: f64 = 0.3;

/// The factors of one smoothing, for several channels.
pub struct Smoother {
    weight: Vec<f64>,
    diagonal: Vec<f64>,
    below: Vec<[f64; 2]>,
    blend: Vec<f64>,
}

impl Smoother {
    /// Smoothing of waves shorter than `wave_s` over poses `step_s` apart (at least three steps).
    pub fn new(step_s: &[f64], wave_s: f64) -> Smoother {
        let count = step_s.len() + 1;
        let stiffness = (wave_s / TAU).powi(2);
        let step = |i: usize| step_s[i.min(count - 2)];
        let weight: Vec<f64> = (0..count)
            .map(|i| 0.5 * (step(i) + step(i.saturating_sub(1))))
            .collect();
        let mut diagonal = weight.clone();
        let mut below = vec![[0.0; 2]; count];
        for i in 1..count - 1 {
            let (before, after) = (step(i - 1), step(i));
            let scale = stiffness / (0.5 * (before + after)).sqrt();
            let row = [
                scale / before,
                -scale / before - scale / after,
                scale / after,
            ];
            diagonal[i - 1] += row[0] * row[0];
            diagonal[i] += row[1] * row[1];
            diagonal[i + 1] += row[2] * row[2];
            below[i - 1][0] += row[0] * row[1];
            below[i][0] += row[1] * row[2];
            below[i - 1][1] += row[0] * row[2];
        }
        for i in 0..count {
            if i >= 1 {
                diagonal[i] -= below[i - 1][0].powi(2) * diagonal[i - 1];
            }
            if i >= 2 {
                diagonal[i] -= below[i - 2][1].powi(2) * diagonal[i - 2];
            }
            if i >= 1 {
                below[i][0] -= below[i - 1][0] * below[i - 1][1] * diagonal[i - 1];
            }
            below[i][0] /= diagonal[i];
            below[i][1] /= diagonal[i];
        }
        let blend = (0..count).map(|i| {
            let share = i as f64 / (count - 1) as f64;
            let t = (share.min(1.0 - share) / BLEND_SHARE).min(1.0);
            t * t * t * (10.0 - t * (15.0 - 6.0 * t))
        });
        Smoother {
            weight,
            diagonal,
            below,
            blend: blend.collect(),
        }
    }

    /// The smooth version of one channel.
    pub fn smoothed(&self, values: impl Iterator<Item = f64> + Clone) -> Vec<f64> {
        let count = self.weight.len();
        let mut smooth: Vec<f64> = values
            .clone()
            .zip(&self.weight)
            .map(|(v, w)| v * w)
            .collect();
        for i in 1..count {
            smooth[i] -= self.below[i - 1][0] * smooth[i - 1];
            if i >= 2 {
                smooth[i] -= self.below[i - 2][1] * smooth[i - 2];
            }
        }
        for i in (0..count).rev() {
            smooth[i] /= self.diagonal[i];
            if i + 1 < count {
                smooth[i] -= self.below[i][0] * smooth[i + 1];
            }
            if i + 2 < count {
                smooth[i] -= self.below[i][1] * smooth[i + 2];
            }
        }
        for ((smooth, value), blend) in smooth.iter_mut().zip(values).zip(&self.blend) {
            *smooth = value + blend * (*smooth - value);
        }
        smooth
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: straight runs stay as they are, ripples shorter than the wave vanish in the middle, ends
    /// stay. Method: a line with a ripple of a tenth of the wave, uneven steps.
    #[test]
    fn ripples_vanish_and_lines_stay() {
        let step_s: Vec<f64> = (0..200)
            .map(|i| 1e-3 * (1.0 + 0.3 * f64::from(i % 3)))
            .collect();
        let mut time = vec![0.0];
        for step in &step_s {
            time.push(time[time.len() - 1] + step);
        }
        let smoother = Smoother::new(&step_s, 0.1);
        let line = smoother.smoothed(time.iter().map(|t| 3.0 - 2.0 * t));
        for (t, found) in time.iter().zip(&line) {
            assert!((found - 3.0 + 2.0 * t).abs() < 1e-9);
        }
        let rippled: Vec<f64> = time
            .iter()
            .map(|t| t + 0.01 * (TAU * t / 0.01).sin())
            .collect();
        let found = smoother.smoothed(rippled.iter().copied());
        for i in 70..130 {
            assert!((found[i] - time[i]).abs() < 1e-4, "{i}");
        }
        assert_eq!([found[0], found[200]], [rippled[0], rippled[200]]);
    }
}
