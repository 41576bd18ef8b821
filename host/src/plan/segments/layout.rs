//! Where the knots go: span durations that just keep the tolerance.
//!
//! In: the path at servo ticks and the tolerances. Out: a fitted spline. The error of a cubic fit
//! goes with the fourth power of the span, so each round asks of every span the density that would
//! bring its error to the tolerance, spreads the knots anew by that density, and fits again; spans
//! that still exceed it are halved.

use super::fit::{TickPath, fit, span_errors};
use super::spline::RestSpline;
use headway_protocol::units::CHANNELS;

/// Shortest span: the least-squares fit needs a sample for each unknown, and acceleration changes
/// faster than in a millisecond are beyond any motor.
const SPAN_TICKS_MIN: usize = 2;
/// Longest span of a moving stretch: 128 ms, so that the check's samples stay close.
const SPAN_TICKS_LONG: f64 = 256.0;
/// Spans to begin with.
const SPAN_TICKS_FIRST: f64 = 12.0;
/// Rounds of spreading and of halving; a span of 256 ticks halves seven times.
const SPREAD_ROUNDS: usize = 7;
const HALVING_ROUNDS: usize = 8;
/// Error that the spreading aims at, against the tolerance.
const ERROR_AIM: f64 = 0.7;

/// Knots a tick, constant over each span of the last layout.
#[derive(Clone, Debug, PartialEq)]
pub struct Density {
    ticks: Vec<f64>,
    per_tick: Vec<f64>,
}

impl Density {
    /// The same density everywhere.
    pub fn first(ticks: usize) -> Self {
        Self {
            ticks: vec![ticks as f64],
            per_tick: vec![1.0 / SPAN_TICKS_FIRST],
        }
    }

    /// The same over another duration.
    pub fn scaled_to(&self, ticks: usize) -> Self {
        let factor = ticks as f64 / self.ticks.iter().sum::<f64>();
        Self {
            ticks: self.ticks.iter().map(|t| t * factor).collect(),
            per_tick: self.per_tick.clone(),
        }
    }

    /// What the errors of a layout ask for.
    fn wanted(durations_ticks: &[u16], errors: &[f64]) -> Self {
        let raw: Vec<f64> = durations_ticks
            .iter()
            .zip(errors)
            .map(|(&ticks, error)| {
                let factor = (error / ERROR_AIM).powf(0.25).clamp(0.4, 2.0);
                factor / f64::from(ticks)
            })
            .collect();
        // A span next to a dense one shares its trouble: the fit spreads errors over neighbours.
        let per_tick = (0..raw.len())
            .map(|i| {
                let near = raw[i.saturating_sub(1)].max(raw[(i + 1).min(raw.len() - 1)]);
                raw[i].max(0.5 * near).max(1.0 / SPAN_TICKS_LONG)
            })
            .collect();
        Self {
            ticks: durations_ticks.iter().map(|&t| f64::from(t)).collect(),
            per_tick,
        }
    }

    /// Spans by this density over `ticks`, at least three.
    fn durations(&self, ticks: usize) -> Vec<u16> {
        let mass: f64 = self
            .ticks
            .iter()
            .zip(&self.per_tick)
            .map(|(t, d)| t * d)
            .sum();
        let most = (ticks / SPAN_TICKS_MIN).max(3);
        let spans = (mass.ceil() as usize).clamp(3, most);
        let share = mass / spans as f64;
        let mut durations = Vec::with_capacity(spans);
        let (mut piece, mut before, mut done) = (0, 0.0, 0.0);
        let mut last_knot = 0;
        for knot in 1..=spans {
            let wanted = share * knot as f64;
            while piece + 1 < self.ticks.len()
                && before + self.ticks[piece] * self.per_tick[piece] < wanted
            {
                before += self.ticks[piece] * self.per_tick[piece];
                done += self.ticks[piece];
                piece += 1;
            }
            let at = done + (wanted - before) / self.per_tick[piece];
            // Room for the knots that are still to come.
            let least = last_knot + SPAN_TICKS_MIN;
            let latest = ticks - SPAN_TICKS_MIN * (spans - knot);
            let place = (at.round() as usize).clamp(least.min(latest), latest);
            let place = if knot == spans { ticks } else { place };
            durations.push((place - last_knot) as u16);
            last_knot = place;
        }
        durations
    }
}

/// Shortest stretch that moves.
pub const MOVING_TICKS_MIN: usize = 3 * SPAN_TICKS_MIN;

/// A layout and how good it is.
pub struct Layout {
    /// The fitted, quantised spline.
    pub spline: RestSpline,
    /// Its worst error against the tolerance of each span.
    pub errors: Vec<f64>,
    /// Density to begin with when the same stretch is laid out again.
    pub density: Density,
}

fn worst(errors: &[f64]) -> f64 {
    errors.iter().copied().fold(0.0, f64::max)
}

/// Lays knots and fits until every span keeps its tolerance or cannot be cut further.
/// The path must last at least [`MOVING_TICKS_MIN`].
pub fn lay_out(path: &TickPath, tolerances: &[f64; CHANNELS], first: &Density) -> Layout {
    let mut density = first.clone();
    let mut durations = density.durations(path.ticks());
    let mut spline = fit(path, &durations);
    let mut errors = span_errors(path, &spline, tolerances);
    for _ in 0..SPREAD_ROUNDS {
        density = Density::wanted(&durations, &errors);
        let next = density.durations(path.ticks());
        let settled = worst(&errors) <= 1.0 && next.len() * 50 >= durations.len() * 49;
        if settled || next == durations {
            break;
        }
        durations = next;
        spline = fit(path, &durations);
        errors = span_errors(path, &spline, tolerances);
    }
    for _ in 0..HALVING_ROUNDS {
        let Some(halved) = halve(&durations, &errors) else {
            break;
        };
        durations = halved;
        spline = fit(path, &durations);
        errors = span_errors(path, &spline, tolerances);
    }
    Layout {
        spline,
        errors,
        density,
    }
}

/// Cuts the spans beyond the tolerance in two; none where nothing is to be cut.
fn halve(durations_ticks: &[u16], errors: &[f64]) -> Option<Vec<u16>> {
    let mut halved = Vec::with_capacity(durations_ticks.len() + 8);
    for (&ticks, &error) in durations_ticks.iter().zip(errors) {
        if error > 1.0 && usize::from(ticks) >= 2 * SPAN_TICKS_MIN {
            halved.extend([ticks / 2, ticks - ticks / 2]);
        } else {
            halved.push(ticks);
        }
    }
    (halved.len() > durations_ticks.len()).then_some(halved)
}
