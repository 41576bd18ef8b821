//! Least-squares fit of a rest-to-rest B-spline to a path given at servo ticks.
//!
//! In: the path by ticks, span durations. Out: control points on the grid
//! of the wire, and the worst error of every span against the tolerances. The ends are exact (three
//! equal control points); the inner ones minimise the squared error of position and acceleration
//! over all ticks (normal equations of half bandwidth 3, LDLᵀ). With the position alone the
//! acceleration of the fit overshoots by up to 10 % where the time law has corners.

use super::spline::{RestSpline, SpanBasis, durations_around, quantised, span_basis};
use super::tick_path::TickPath;
use crate::geometry::banded::Band;
use crate::settings::Settings;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_VOLUME, CHANNELS,
};
use rayon::prelude::*;

/// Share of the tolerances that the fit uses: from 0.3 to 0.6 costs 0.1 to 0.4 % of time (peaks of
/// the acceleration overshoot and are slowed) and saves 10 to 20 % of the segments.
const TOLERANCE_SHARE: f64 = 0.5;
/// Width of the bead by which the volume's tolerance goes, of the aperture's unit: the widest of the built-in nozzle.
const BEAD_WIDTH: f64 = 1.2;
/// An error along the path only shifts the motion in time; this many tolerances of it are let pass.
const ALONG_FACTOR: f64 = 4.0;

/// Largest error of each channel, natural units, for a ratio of 1. The volume's is the volume of a bead over
/// the tip's tolerance.
pub fn channel_tolerances(settings: &Settings) -> [f64; CHANNELS] {
    let tolerances = &settings.tolerances;
    let bead_mm2 = BEAD_WIDTH * settings.aperture.unit_mm() * settings.layer_height_mm;
    let mut of = [tolerances.tip_mm * TOLERANCE_SHARE; CHANNELS];
    of[CHANNEL_TILT_X] = tolerances.axis_rad * TOLERANCE_SHARE;
    of[CHANNEL_TILT_Y] = of[CHANNEL_TILT_X];
    of[CHANNEL_HEADING] = tolerances.heading_rad * TOLERANCE_SHARE;
    of[CHANNEL_VOLUME] = tolerances.tip_mm * TOLERANCE_SHARE * bead_mm2;
    of
}

/// Square of the error against the tolerance once the shift along the path is taken out of it; at
/// least `least`.
#[inline]
fn error_ratio2(
    error: &[f64; CHANNELS],
    tangent: impl Fn() -> [f64; CHANNELS],
    per_tolerance: &[f64; CHANNELS],
    least: f64,
) -> f64 {
    let mut scaled = *error;
    for (value, per_tolerance) in scaled.iter_mut().zip(per_tolerance) {
        *value *= per_tolerance;
    }
    // Taking the shift out makes no error larger than all of it is.
    let all2 = scaled.iter().map(|v| v * v).sum::<f64>();
    if all2 < SURE_SHARE * least {
        return least;
    }
    let mut along = tangent();
    for (value, per_tolerance) in along.iter_mut().zip(per_tolerance) {
        *value *= per_tolerance;
    }
    let norm2 = along.iter().map(|v| v * v).sum::<f64>();
    let mut rest = scaled;
    if norm2 > 1e-12 {
        let dot: f64 = scaled.iter().zip(&along).map(|(e, t)| e * t).sum();
        let bound = ALONG_FACTOR / norm2.sqrt();
        let shift = (dot / norm2).clamp(-bound, bound);
        for (value, tangent) in rest.iter_mut().zip(&along) {
            *value -= shift * tangent;
        }
    }
    let tip = rest[0] * rest[0] + rest[1] * rest[1] + rest[2] * rest[2];
    let tilt = rest[CHANNEL_TILT_X].powi(2) + rest[CHANNEL_TILT_Y].powi(2);
    tip.max(tilt)
        .max(rest[CHANNEL_HEADING].powi(2))
        .max(rest[CHANNEL_VOLUME].powi(2))
        .max(least)
}

/// Far below 1 by rounding.
const SURE_SHARE: f64 = 1.0 - 1e-9;

/// Weight of the squared acceleration error by the span's duration to the fourth: an error that
/// swings once a span has (2 pi)^4 = 1560 times its square in it, so this lets both count.
const ACCELERATION_WEIGHT: f64 = 1.0 / 500.0;

/// The normal equations: their band, one right side a channel.
struct NormalEquations {
    band: Band,
    right: Vec<[f64; CHANNELS]>,
}

impl NormalEquations {
    /// The sum of the spans' shares. The first three control points are the start, 0 here; the last
    /// three are the end, `travel`.
    fn of(shares: &[SpanShare], travel: &[f64; CHANNELS]) -> Self {
        let (mut rows, mut right) = (Vec::new(), Vec::new());
        let unknowns = (0..shares.len() - 3).into_par_iter();
        unknowns
            .with_min_len(SPANS_MIN)
            .map(|row| Self::row(shares, row, travel))
            .unzip_into_vecs(&mut rows, &mut right);
        Self {
            band: Band { rows },
            right,
        }
    }

    /// One row: the four spans that control point `row` + 3 bears on.
    fn row(
        shares: &[SpanShare],
        row: usize,
        travel: &[f64; CHANNELS],
    ) -> ([f64; 4], [f64; CHANNELS]) {
        let unknowns = shares.len() - 3;
        let (mut band, mut of_channels) = ([0.0; 4], [0.0; CHANNELS]);
        for (k, span) in (row..row + 4).enumerate().map(|(n, span)| (3 - n, span)) {
            let share = &shares[span];
            let mut known = 0.0;
            for l in 0..4 {
                if span + l >= unknowns + 3 {
                    known += share.weights[k][l];
                } else if l >= k {
                    band[l - k] += share.weights[k][l];
                }
            }
            for (channel, right) in of_channels.iter_mut().enumerate() {
                *right += share.right[k][channel] - known * travel[channel];
            }
        }
        (band, of_channels)
    }
}

/// Fits control points to the path; `shares` are of the spans with these durations, at least three.
pub fn fit(path: &TickPath, durations_ticks: &[u16], shares: &[SpanShare]) -> RestSpline {
    let start = quantised(&path.value(0), path.units());
    let end = quantised(&path.value(path.ticks()), path.units());
    let travel: [f64; CHANNELS] = std::array::from_fn(|c| end[c] - start[c]);
    let NormalEquations { band, right } = NormalEquations::of(shares, &travel);
    let mut solved = right;
    band.factored().solve(&mut solved);
    let inner = (0..shares.len() - 3)
        .into_par_iter()
        .with_min_len(SPANS_MIN);
    let inner: Vec<[f64; CHANNELS]> = inner
        .map(|i| {
            quantised(
                &std::array::from_fn(|c| solved[i][c] + start[c]),
                path.units(),
            )
        })
        .collect();
    let control = [vec![start; 3], inner, vec![end; 3]].concat();
    RestSpline {
        durations_ticks: durations_ticks.to_vec(),
        control,
    }
}

/// Spans that are worth a thread.
const SPANS_MIN: usize = 64;

/// The tick at which each span begins.
pub fn first_ticks(durations_ticks: &[u16]) -> Vec<usize> {
    let mut tick = 0;
    let next = durations_ticks.iter().map(|&ticks| {
        tick += usize::from(ticks);
        tick - usize::from(ticks)
    });
    next.collect()
}

/// Contribution of the ticks of a span to the fit, independent of the adjacent spans; s = t /
/// duration.
#[derive(Clone, Debug)]
pub struct TickSums {
    /// Sums of powers of s, over all ticks and over those with an acceleration.
    powers: [f64; 7],
    bend_powers: [f64; 3],
    /// For each power of s the sums of the channels above the start times it, and of their second
    /// differences times it.
    moments: [[f64; CHANNELS]; 4],
    bends: [[f64; CHANNELS]; 2],
}

/// Memory of a thread for the ticks of a span.
#[derive(Default)]
struct Scratch {
    /// Powers 1 to 3 of s.
    shares: Vec<[f64; 3]>,
    values: Vec<[f64; CHANNELS]>,
}

/// The sums of every span; `known` has the known ones of a span.
pub fn tick_sums<'a>(
    path: &TickPath,
    durations_ticks: &[u16],
    known: impl Fn(usize) -> Option<&'a TickSums> + Sync,
) -> Vec<TickSums> {
    let start = quantised(&path.value(0), path.units());
    let first_ticks = first_ticks(durations_ticks);
    (0..durations_ticks.len())
        .into_par_iter()
        .with_min_len(SPANS_MIN)
        .map_init(Scratch::default, |scratch, span| match known(span) {
            Some(known) => known.clone(),
            None => TickSums::of(
                path,
                first_ticks[span],
                durations_ticks[span],
                &start,
                scratch,
            ),
        })
        .collect()
}

impl TickSums {
    fn of(
        path: &TickPath,
        first_tick: usize,
        ticks: u16,
        start: &[f64; CHANNELS],
        Scratch { shares, values }: &mut Scratch,
    ) -> Self {
        let duration = f64::from(ticks);
        shares.clear();
        shares.extend((1..=ticks).map(|t| {
            let s = f64::from(t) / duration;
            [s, s * s, s * s * s]
        }));
        // There is no acceleration at the path's last tick.
        let is_last = first_tick + usize::from(ticks) == path.ticks();
        let bend_shares = &shares[..shares.len() - usize::from(is_last)];
        // The last tick's second difference reaches into the next span.
        path.values(first_tick..=first_tick + usize::from(ticks) + 1, values);
        let (moments, bends) = moments(values, start, shares);
        Self {
            powers: powers(shares),
            bend_powers: powers(bend_shares),
            moments,
            bends,
        }
    }
}

/// The shares of every span in the normal equations; `known` has the known one of a span.
pub fn span_shares<'a>(
    durations_ticks: &[u16],
    sums: &[TickSums],
    known: impl Fn(usize) -> Option<&'a SpanShare> + Sync,
) -> Vec<SpanShare> {
    let spans = (0..sums.len()).into_par_iter().with_min_len(SPANS_MIN);
    spans
        .map(|span| match known(span) {
            Some(known) => known.clone(),
            None => SpanShare::of(durations_ticks, span, &sums[span]),
        })
        .collect()
}

/// The same at once, without known shares and without storing them.
pub fn shares_of_path(path: &TickPath, durations_ticks: &[u16]) -> Vec<SpanShare> {
    let start = quantised(&path.value(0), path.units());
    let first_ticks = first_ticks(durations_ticks);
    let spans = (0..durations_ticks.len())
        .into_par_iter()
        .with_min_len(SPANS_MIN);
    spans
        .map_init(Scratch::default, |scratch, span| {
            let (first_tick, ticks) = (first_ticks[span], durations_ticks[span]);
            let sums = TickSums::of(path, first_tick, ticks, &start, scratch);
            SpanShare::of(durations_ticks, span, &sums)
        })
        .collect()
}

/// One span's share of the normal equations for its four control points, relative to the start.
#[derive(Clone, Debug)]
pub struct SpanShare {
    /// Sums of products of weights.
    weights: [[f64; 4]; 4],
    /// Sums of weights times the wanted values.
    right: [[f64; CHANNELS]; 4],
}

impl SpanShare {
    /// The weights are cubics in s, so their sums are those of powers of s and of the moments.
    fn of(durations_ticks: &[u16], span: usize, sums: &TickSums) -> Self {
        let basis = span_basis(durations_around(durations_ticks, span));
        let duration = f64::from(durations_ticks[span]);
        let squared = duration * duration;
        let scales = [1.0, duration, squared, duration * squared];
        let value: SpanBasis =
            std::array::from_fn(|k| std::array::from_fn(|power| basis[k][power] * scales[power]));
        // The second derivative by s, with the weight that it counts.
        let root = ACCELERATION_WEIGHT.sqrt();
        let second = value.map(|[_, _, c2, c3]| [2.0 * c2 * root, 6.0 * c3 * root]);
        let root_squared = root * squared;
        let mut products = [[0.0; 4]; 4];
        // All of a row together, which the compiler puts side by side.
        let (values, seconds) = (transposed(&value), transposed(&second));
        for (k, products) in products.iter_mut().enumerate() {
            add_products(products, &value[k], &values, &sums.powers);
            add_products(products, &second[k], &seconds, &sums.bend_powers);
        }
        // Rounding must not make the two halves differ.
        let weights =
            std::array::from_fn(|k| std::array::from_fn(|l| products[k.min(l)][k.max(l)]));
        let right = std::array::from_fn(|k| {
            let position = weighted(&value[k], &sums.moments);
            let bend = weighted(&second[k], &sums.bends);
            std::array::from_fn(|c| position[c] + bend[c] * root_squared)
        });
        Self { weights, right }
    }
}

fn transposed<const COUNT: usize>(rows: &[[f64; COUNT]; 4]) -> [[f64; 4]; COUNT] {
    std::array::from_fn(|column| rows.map(|row| row[column]))
}

/// Adds the sums of the products of one polynomial with four others (by power) over places of which
/// the sums of powers are known.
#[inline]
fn add_products<const COUNT: usize>(
    sums: &mut [f64; 4],
    one: &[f64; COUNT],
    others: &[[f64; 4]; COUNT],
    powers: &[f64],
) {
    for (p, a) in one.iter().enumerate() {
        for (q, others) in others.iter().enumerate() {
            for (sum, b) in sums.iter_mut().zip(others) {
                *sum += a * b * powers[p + q];
            }
        }
    }
}

/// The sum of the rows by these weights.
#[inline]
fn weighted<const COUNT: usize>(
    weights: &[f64; COUNT],
    rows: &[[f64; CHANNELS]; COUNT],
) -> [f64; CHANNELS] {
    let mut sums = rows[0].map(|value| weights[0] * value);
    for (weight, row) in weights.iter().zip(rows).skip(1) {
        for (sum, value) in sums.iter_mut().zip(row) {
            *sum += weight * value;
        }
    }
    sums
}

/// Sums of the powers of s from 0 on.
fn powers<const COUNT: usize>(shares: &[[f64; 3]]) -> [f64; COUNT] {
    let mut sums = [0.0; COUNT];
    for [s, ..] in shares {
        let mut power = 1.0;
        for sum in &mut sums {
            *sum += power;
            power *= s;
        }
    }
    sums
}

/// Moments of the channels over the ticks of a span, given from its first tick on: sums of the value
/// above `start` times powers 0 to 3 of s, and of its second difference times powers 0 and 1. All
/// channels of a tick together, which the compiler puts side by side.
fn moments(
    values: &[[f64; CHANNELS]],
    start: &[f64; CHANNELS],
    shares: &[[f64; 3]],
) -> ([[f64; CHANNELS]; 4], [[f64; CHANNELS]; 2]) {
    let (mut moments, mut bends) = ([[0.0; CHANNELS]; 4], [[0.0; CHANNELS]; 2]);
    for (&[s, s2, s3], values) in shares.iter().zip(values.windows(2)) {
        for c in 0..CHANNELS {
            let wanted = values[1][c] - start[c];
            moments[0][c] += wanted;
            moments[1][c] += s * wanted;
            moments[2][c] += s2 * wanted;
            moments[3][c] += s3 * wanted;
        }
    }
    // None at the path's last tick.
    for (&[s, ..], values) in shares.iter().zip(values.windows(3)) {
        for c in 0..CHANNELS {
            let bend = (values[2][c] - values[1][c]) - (values[1][c] - values[0][c]);
            bends[0][c] += bend;
            bends[1][c] += s * bend;
        }
    }
    (moments, bends)
}

/// Worst error ratio of every span over its ticks; between them the path is defined by the spline.
/// `known` has the known one of a span.
pub fn span_errors(
    path: &TickPath,
    spline: &RestSpline,
    tolerances: &[f64; CHANNELS],
    known: impl Fn(usize) -> Option<f64> + Sync,
) -> Vec<f64> {
    let per_tolerance = tolerances.map(f64::recip);
    let first_ticks = first_ticks(&spline.durations_ticks);
    (0..spline.durations_ticks.len())
        .into_par_iter()
        .with_min_len(SPANS_MIN)
        .map(|span| {
            if let Some(known) = known(span) {
                return known;
            }
            let cubics = spline.span_polynomials(span);
            // By power, so that the channels are adjacent.
            let [c0, c1, c2, c3] = std::array::from_fn(|power| cubics.map(|cubic| cubic[power]));
            let mut worst = 0.0f64;
            for t in 1..=spline.durations_ticks[span] {
                let k = first_ticks[span] + usize::from(t);
                let (at, value) = (f64::from(t), path.value(k));
                let mut error = [0.0; CHANNELS];
                for c in 0..CHANNELS {
                    error[c] = c0[c] + at * (c1[c] + at * (c2[c] + at * c3[c])) - value[c];
                }
                worst = error_ratio2(&error, || path.tangent(k), &per_tolerance, worst);
            }
            worst.sqrt()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    //! Goal: a fit that reproduces what a spline can carry, exact
    //! ends, errors measured across the path.
    use super::*;
    use crate::plan::route::moves::PathCurve;

    /// A line in x with a swing of the heading, run from rest to rest in 400 ticks.
    fn path() -> (PathCurve, Vec<f64>) {
        const POINTS: u32 = 1000;
        let at = |i: u32| {
            let x = f64::from(i) / f64::from(POINTS);
            let swing = (2.0 * std::f64::consts::PI * x).sin();
            [1000.0 + 5.0 * x, 0.0, 0.0, 0.0, 0.0, swing, x]
        };
        let u = |k: u32| {
            let x = f64::from(k) / 400.0;
            f64::from(POINTS) * x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
        };
        let curve = PathCurve {
            control: (0..=POINTS).map(at).collect(),
        };
        (curve, (0..=400).map(u).collect())
    }

    #[test]
    fn ends_are_exact_and_the_error_falls_with_the_fourth_power() {
        let (curve, u) = path();
        let path = TickPath::new(&curve, &u);
        let tolerances = [1e-4; CHANNELS];
        let worst = |spans: usize| {
            let durations_ticks = vec![(400 / spans) as u16; spans];
            let sums = tick_sums(&path, &durations_ticks, |_| None);
            let shares = span_shares(&durations_ticks, &sums, |_| None);
            let spline = fit(&path, &durations_ticks, &shares);
            let control = &spline.control;
            let last = control.len() - 1;
            assert!(
                control[..3]
                    .iter()
                    .all(|p| *p == quantised(&path.value(0), path.units()))
            );
            assert!(
                control[last - 2..]
                    .iter()
                    .all(|p| *p == quantised(&path.value(400), path.units()))
            );
            span_errors(&path, &spline, &tolerances, |_| None)
                .into_iter()
                .fold(0.0, f64::max)
        };
        let (coarse, fine) = (worst(10), worst(20));
        // Theory says 16; the rests at the ends take some of it.
        assert!(coarse > 8.0 * fine && fine > 0.0, "{coarse} {fine}");
    }

    #[test]
    fn a_shift_along_the_path_is_no_error_but_one_across_is() {
        let mut tangent = [0.0; CHANNELS];
        tangent[0] = 30.0;
        let per_tolerance = [1e4; CHANNELS];
        let mut error = [0.0; CHANNELS];
        error[0] = 3e-4;
        let ratio =
            |error: &[f64; CHANNELS]| error_ratio2(error, || tangent, &per_tolerance, 0.0).sqrt();
        assert!(ratio(&error) < 1e-9);
        // What exceeds ALONG_FACTOR tolerances counts.
        error[0] = 6e-4;
        assert!((ratio(&error) - 2.0).abs() < 1e-9);
        error[1] = 2.5e-4;
        assert!((ratio(&error) - 10.25f64.sqrt()).abs() < 1e-9);
    }
}
