//! The flow curve of an extruder: slugs extruded at several rates, and the fit of what they weigh.
//!
//! In: settings; rows of rate and weight. Out: lines in the air above the bed, each with the same volume at a rate of its
//! own; the share of the flow that does not arrive, with its error and the rows that do not fit. The share is a
//! parabola of the rate that does not fall. Rows that are wrong are found by the least quantile of squared
//! residuals over all parabolas through three of them (Rousseeuw, 1984); the rest is fitted by least squares. Leaves out the
//! machine file.

use super::error::{machine, usage};
use super::line::{Line, length_mm, pitch_mm};
use super::{Asked, CalibrationError, Drawn, values};
use crate::settings::Settings;
use headway_firmware::configuration::flow_curves::CURVE_POINTS_MAX;
use nalgebra::{Matrix3, Vector3};

/// Volume of a slug, mm³, with a nozzle that makes beads of a millimetre: half a gram, which kitchen scales tell to 2 %.
const SLUG_MM3: f64 = 500.0;
/// How high above the bed it leaves the nozzle, mm: it coils freely.
const ABOVE_MM: f64 = 15.0;
/// Length of its path, mm.
const LENGTH_MM: f64 = 20.0;
/// Rates.
const RATES: u32 = 10;
/// The least rate, of the greatest.
const RATE_SHARE_MIN: f64 = 0.1;
/// Fewest rows that can be fitted and judged, and most.
const ROWS: std::ops::RangeInclusive<usize> = 5..=60;
/// Numbers of the parabola.
const TERMS: usize = 3;
/// One row of so many may be wrong.
const WRONG_EVERY: usize = 5;
/// A row is doubted this many standard deviations off, but not below the finest that scales tell.
const DOUBTED: f64 = 3.0;
/// Rounds of least squares, after each of which the rows are judged anew.
const ROUNDS: usize = 3;
const DEVIATION_MIN: f64 = 0.002;

/// What one slug weighed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weight {
    /// Line of the file, from 1.
    pub line: usize,
    /// The rate asked of the motor.
    pub mm3_s: f64,
    /// Its weight.
    pub g: f64,
}

/// A point of the curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    /// Asked of the motor.
    pub mm3_s: f64,
    /// What of it does not arrive.
    pub share: f64,
    /// Its standard error.
    pub error: f64,
}

/// The curve.
#[derive(Clone, Debug, PartialEq)]
pub struct FlowFit {
    /// Evenly over the rates that were weighed.
    pub points: Vec<CurvePoint>,
    /// Rows that do not fit, and by how much of the flow they are off.
    pub doubted: Vec<(Weight, f64)>,
    /// Standard deviation of the others, of the flow.
    pub deviation: f64,
}

/// Volume that the motor pushes for a slug at a rate, mm³: more than arrives by the curve that is set.
fn pushed_mm3(asked_mm3_s: f64, settings: &Settings) -> f64 {
    let arriving_mm3_s = settings.machine.curves.arriving().at(asked_mm3_s)[0];
    slug_mm3(settings) * asked_mm3_s / arriving_mm3_s
}

fn slug_mm3(settings: &Settings) -> f64 {
    SLUG_MM3 * settings.aperture.unit_mm().max(1.0).powi(3)
}

/// A rate of two digits, rounded down: rates that a person writes into a table.
fn even(mm3_s: f64) -> f64 {
    let unit = 0.2 * 10f64.powf(mm3_s.log10().floor());
    (mm3_s / unit + 1e-9).floor() * unit
}

/// Slugs in the air, from a tenth of the greatest flow on.
pub(super) fn slugs(asked: &Asked, settings: &Settings) -> Result<Drawn, CalibrationError> {
    let curve = settings.machine.curves.asked();
    let most_mm3_s = even(curve.at(settings.flow_max_mm3_s * settings.plan_share)[0]);
    let rates = values(
        asked,
        [RATE_SHARE_MIN * most_mm3_s, most_mm3_s],
        RATES,
        [1e-3, most_mm3_s],
    )?;
    let (pitch_mm, length_mm) = (
        pitch_mm(settings),
        length_mm(asked.length_mm, LENGTH_MM, settings),
    );
    let above_mm = ABOVE_MM * settings.aperture.unit_mm();
    let lines = rates.iter().enumerate().map(|(number, &rate_mm3_s)| {
        // Coils spread.
        let y_mm = 3.0 * pitch_mm * number as f64;
        let ends = [0.0, length_mm].map(|x_mm| [x_mm, y_mm, above_mm]);
        let mut line = Line::through("slug in the air", ends.into_iter(), 0.0);
        let arriving_mm3_s = settings.machine.curves.arriving().at(rate_mm3_s)[0];
        if let Some(first) = line.points.first_mut() {
            first.asked.has_sections = true;
        }
        for point in &mut line.points {
            point.section_mm2 = Some(slug_mm3(settings) / length_mm);
            point.speed_mm_s = Some(arriving_mm3_s * length_mm / slug_mm3(settings));
        }
        line.of_value(rate_mm3_s)
    });
    Ok(Drawn {
        unit: "mm³/s",
        lines: lines.collect(),
        machines: Vec::new(),
        reading: vec![
            "Each slug coils below the nozzle, the same volume at the rate in its row. Weigh them one by one and write \
             the rates and the weights into a file with the head `mm3_s,g`."
                .to_string(),
        ],
        change: "`headway calibrate flow --weights FILE.csv` fits `flow_loss` of `[extruder]`; `--write` puts it in".to_string(),
    })
}

/// Fits what the slugs weighed.
///
/// # Errors
/// Too few rows, numbers that cannot be, or a density that is not known.
pub fn fitted(weights: &[Weight], settings: &Settings) -> Result<FlowFit, CalibrationError> {
    let density = settings.material.and_then(|material| material.density_g_cm3).ok_or_else(|| {
        machine!("weights need the material's density: write density_g_cm3 under [material] of the machine file")
    })?;
    let [least, greatest] = checked_rates(weights)?;
    // Of the flow that is asked for, what arrives.
    let row = |weight: &Weight| Row {
        x: weight.mm3_s / greatest,
        y: weight.g / (density * 1e-3 * pushed_mm3(weight.mm3_s, settings)),
    };
    let rows: Vec<Row> = weights.iter().map(row).collect();
    let none = || usage!("the weights fit no curve: are rates and weights in the right columns?");
    let (curve, deviation, fits) = fit_kept(&rows).ok_or_else(none)?;
    let points = (0..CURVE_POINTS_MAX).map(|k| {
        let part = k as f64 / (CURVE_POINTS_MAX - 1) as f64;
        let mm3_s = least + (greatest - least) * part;
        let terms = powers(mm3_s / greatest);
        let variance = (curve.inverse * terms).dot(&terms);
        CurvePoint {
            mm3_s,
            share: 1.0 - curve.at(mm3_s / greatest),
            error: deviation * variance.max(0.0).sqrt(),
        }
    });
    let off = weights
        .iter()
        .zip(&rows)
        .zip(&fits)
        .filter(|(_, fits)| !**fits);
    let off = off.map(|((weight, row), _)| (*weight, row.y - curve.at(row.x)));
    Ok(FlowFit {
        points: points.collect(),
        doubted: off.collect(),
        deviation,
    })
}

/// The least and the greatest rate of rows that can be fitted, mm³/s.
fn checked_rates(weights: &[Weight]) -> Result<[f64; 2], CalibrationError> {
    if !ROWS.contains(&weights.len()) {
        let (least, most) = (ROWS.start(), ROWS.end());
        return Err(usage!(
            "{} weights: {least} to {most} can be fitted",
            weights.len()
        ));
    }
    for weight in weights {
        // Written so that a NaN is refused.
        if !(weight.mm3_s > 0.0
            && weight.g > 0.0
            && weight.mm3_s.is_finite()
            && weight.g.is_finite())
        {
            return Err(usage!(
                "line {}: rate and weight must be above 0",
                weight.line
            ));
        }
    }
    let greatest = weights
        .iter()
        .map(|weight| weight.mm3_s)
        .fold(0.0, f64::max);
    let least = weights
        .iter()
        .map(|weight| weight.mm3_s)
        .fold(greatest, f64::min);
    if least > 0.5 * greatest {
        return Err(usage!(
            "rates from {least} to {greatest} mm³/s are too near to each other: weigh slugs at half of it too"
        ));
    }
    Ok([least, greatest])
}

/// The curve by least squares, its deviation, and which rows it keeps.
fn fit_kept(rows: &[Row]) -> Option<(Parabola, f64, Vec<bool>)> {
    let (mut deviation, mut curve) = least_quantile(rows)?;
    let mut fits = vec![true; rows.len()];
    for _ in 0..ROUNDS {
        let limit = DOUBTED * deviation.max(DEVIATION_MIN);
        let off = |row: &Row| (row.y - curve.at(row.x)).abs();
        fits = rows.iter().map(|row| off(row) <= limit).collect();
        let kept = rows.iter().zip(&fits).filter(|(_, fits)| **fits);
        let kept: Vec<Row> = kept.map(|(row, _)| *row).collect();
        curve = Parabola::falling(&kept)?;
        let squares = kept.iter().map(|row| (row.y - curve.at(row.x)).powi(2));
        let spare = kept.len().saturating_sub(TERMS).max(1) as f64;
        deviation = (squares.sum::<f64>() / spare).sqrt();
    }
    Some((curve, deviation, fits))
}

/// Rate, of the greatest; what arrives, of the flow.
#[derive(Clone, Copy, Debug)]
struct Row {
    x: f64,
    y: f64,
}

fn powers(x: f64) -> Vector3<f64> {
    Vector3::new(1.0, x, x * x)
}

/// y = c0 + c1 x + c2 x².
#[derive(Clone, Copy, Debug)]
struct Parabola {
    terms: Vector3<f64>,
    /// Of the normal equations.
    inverse: Matrix3<f64>,
}

impl Parabola {
    fn at(&self, x: f64) -> f64 {
        self.terms.dot(&powers(x))
    }

    /// By least squares, with the terms that are asked for.
    fn through(rows: &[Row], terms: [bool; TERMS]) -> Option<Self> {
        let keep = Vector3::from(terms.map(f64::from));
        let (mut normal, mut right) = (
            Matrix3::from_diagonal(&keep.map(|kept| 1.0 - kept)),
            Vector3::zeros(),
        );
        for row in rows {
            let powers = powers(row.x).component_mul(&keep);
            normal += powers * powers.transpose();
            right += powers * row.y;
        }
        let inverse = normal.try_inverse()?;
        let kept = Matrix3::from_diagonal(&keep);
        Some(Self {
            terms: inverse * right,
            inverse: kept * inverse * kept,
        })
    }

    /// The best of those that do not rise from 0 to 1; where there are rows enough, by the criterion of Akaike (1974): a
    /// term that noise alone would ask for bends the ends away.
    fn falling(rows: &[Row]) -> Option<Self> {
        let all = [
            [true; 3],
            [true, false, true],
            [true, true, false],
            [true, false, false],
        ];
        let squares = |of: &Self| {
            rows.iter()
                .map(|row| (row.y - of.at(row.x)).powi(2))
                .sum::<f64>()
        };
        let count = rows.len() as f64;
        let price = |of: &Self| match rows.len() > TERMS + 1 {
            true => {
                let terms = of.terms.iter().filter(|term| **term != 0.0).count();
                count * (squares(of) / count).max(1e-12).ln() + 2.0 * terms as f64
            }
            false => squares(of),
        };
        let falls = |of: &Self| of.terms[1] <= 1e-9 && of.terms[1] + 2.0 * of.terms[2] <= 1e-9;
        let fits = all
            .into_iter()
            .filter_map(|terms| Self::through(rows, terms))
            .filter(falls);
        fits.min_by(|a, b| price(a).total_cmp(&price(b)))
    }
}

/// The parabola through three rows to which four fifths of all are nearest, and the standard deviation that goes with
/// it.
fn least_quantile(rows: &[Row]) -> Option<(f64, Parabola)> {
    let count = rows.len();
    let mut best: Option<(f64, Parabola)> = None;
    for i in 0..count {
        for j in i + 1..count {
            for k in j + 1..count {
                let Some(parabola) = Parabola::falling(&[rows[i], rows[j], rows[k]]) else {
                    continue;
                };
                let mut off: Vec<f64> = rows
                    .iter()
                    .map(|row| (row.y - parabola.at(row.x)).abs())
                    .collect();
                off.sort_by(f64::total_cmp);
                let bound = off[count - 1 - count / WRONG_EVERY];
                if best.is_none_or(|(least, _)| bound < least) {
                    best = Some((bound, parabola));
                }
            }
        }
    }
    // Four fifths of normal errors are within 1.28 deviations; for few rows (Rousseeuw and Leroy, 1987).
    let factor = (1.0 + 5.0 / count.saturating_sub(TERMS).max(1) as f64) / 1.28;
    best.map(|(bound, parabola)| (bound * factor, parabola))
}

#[cfg(test)]
mod tests {
    //! Goal: a known curve is found again from weights with noise, one of them wrong, and the wrong one is named; rows
    //! that tell nothing are refused. Method: extruders that lose by several laws, 1 % of noise, 200 seeds each.
    use super::*;
    use crate::settings::heat::Material;
    use rand::{RngExt, SeedableRng};

    fn settings() -> Settings {
        Settings {
            material: Some(Material {
                density_g_cm3: Some(1.24),
                ..Material::default()
            }),
            ..Settings::default()
        }
    }

    fn weights(share: impl Fn(f64) -> f64, wrong: usize, seed: u64) -> Vec<Weight> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let row = |number: usize| {
            let mm3_s = 2.0 * (number + 1) as f64;
            // Sum of twelve, near enough to normal.
            let noise: f64 = (0..12).map(|_| random.random_range(-0.5..0.5)).sum();
            let fault = if number == wrong { 0.8 } else { 1.0 };
            let g = SLUG_MM3
                * settings().aperture.unit_mm().powi(3)
                * 1.24e-3
                * (1.0 - share(mm3_s))
                * (1.0 + 0.01 * noise)
                * fault;
            Weight {
                line: number + 2,
                mm3_s,
                g,
            }
        };
        (0..10).map(row).collect()
    }

    #[test]
    fn curves_are_found_again_and_the_wrong_weight_named() {
        let laws: [fn(f64) -> f64; 4] = [
            |q| 0.04 + 0.21 * (q / 20.0).powi(2),
            |q| 0.04 + 0.21 * (q / 20.0),
            |q| 0.25 * (q / 20.0).powf(1.5),
            |_| 0.02,
        ];
        for (law, share) in laws.into_iter().enumerate() {
            let mut worst: Vec<f64> = Vec::new();
            let mut named = 0;
            for seed in 0..200 {
                let wrong = seed as usize % 10;
                let fit = fitted(&weights(share, wrong, seed), &settings()).expect("it fits");
                let off = |point: &CurvePoint| (point.share - share(point.mm3_s)).abs();
                worst.push(fit.points.iter().map(off).fold(0.0, f64::max));
                let is_named = fit
                    .doubted
                    .iter()
                    .any(|(weight, _)| weight.line == wrong + 2);
                named += usize::from(is_named && fit.doubted.len() <= 3);
            }
            worst.sort_by(f64::total_cmp);
            let within = worst.iter().filter(|off| **off <= 0.015).count();
            println!(
                "law {law}: median {:.4}, within 1.5 % {within}, worst {:.4}, named {named}",
                worst[100], worst[199]
            );
            assert!(
                worst[100] <= 0.01 && within >= 155 && named == 200,
                "law {law}"
            );
        }
    }
}
