//! Placement of the knots: span durations that just keep the tolerance.
//!
//! In: the path at servo ticks and the tolerances. Out: a fitted spline. The error of a cubic fit
//! is proportional to the fourth power of the span, so each round finds for every span the density
//! that would bring its error to the tolerance, redistributes the knots by that density, and fits
//! again; spans that still exceed it are halved.

use super::fit::{SpanShare, TickSums, fit, shares_of_path, span_errors, span_shares, tick_sums};
use super::spline::{RestSpline, durations_around};
use super::tick_path::TickPath;
use crate::plan::motion::joint_limits::MotionLimits;
use crate::settings::units::span_volume_mm3;
use headway_protocol::segment::SPAN_TICKS_MAX;
use headway_protocol::units::{CHANNEL_X, CHANNELS};

/// Shortest span: 3 ms. In a shorter one the rounding to wire units is felt as acceleration (0.1 um
/// in 1 ms is 100 mm/s²), and the time law has nothing faster.
const SPAN_TICKS_MIN: usize = 6;
/// Longest span of a move: 128 ms, or the tip's time for a distance of 0.1 mm in base units. Over a
/// shorter distance the rounding to wire units shows as speed (0.1 um in 0.1 mm is 0.1 %). Half of
/// the wire's limit leaves room for slowing.
const SPAN_TICKS_LONG: f64 = 256.0;
const SPAN_WAY_MM: f64 = 0.1;
const SPAN_TICKS_LONGEST: f64 = 0.5 * SPAN_TICKS_MAX as f64;
/// Spans to begin with.
const SPAN_TICKS_FIRST: f64 = 12.0;
/// Largest delay of a knot that keeps the preceding span at its least length.
const LATE_TICKS_MAX: usize = 3;
/// Rounds of spreading and of halving; a span of 256 ticks halves seven times.
const SPREAD_ROUNDS: usize = 7;
const HALVING_ROUNDS: usize = 8;
/// Error that the spreading aims at, against the tolerance.
const ERROR_AIM: f64 = 0.65;
/// Least and largest factor by which spans may become denser in one round of spreading.
const DENSER: [f64; 2] = [0.4, 2.0];
/// Error that a span of an earlier layout may grow to, below the permitted one ([`ERROR_MAX`]):
/// cutting it would expose to the limits what the path does within a few milliseconds.
const ERROR_KEPT: f64 = 1.75;
/// Error of the fit, relative to its share of the tolerance, that slows the motion down: the full
/// tolerance with a margin for the error between ticks.
pub const ERROR_MAX: f64 = 1.8;

/// Longest span of a move within these limits, in ticks of `coarse` servo ticks each.
pub fn span_ticks_long(limits: &MotionLimits, coarse: u16) -> f64 {
    let coarse = f64::from(coarse);
    let servo_hz = limits.servo_hz * coarse;
    let way_mm = SPAN_WAY_MM * limits.units.base_units(CHANNEL_X);
    let way_ticks = way_mm / limits.tip_speed_mm_s * servo_hz;
    let volume_ticks = span_volume_mm3(&limits.units) / limits.flow_max_mm3_s * servo_hz;
    let ticks = way_ticks.clamp(SPAN_TICKS_LONG, SPAN_TICKS_LONGEST);
    ticks.min(volume_ticks.max(SPAN_TICKS_MIN as f64)) / coarse
}

/// Knots a tick, constant over each span of the last layout.
struct Density {
    ticks: Vec<f64>,
    per_tick: Vec<f64>,
}

impl Density {
    /// The same density everywhere.
    fn first(ticks: usize) -> Self {
        Self {
            ticks: vec![ticks as f64],
            per_tick: vec![1.0 / SPAN_TICKS_FIRST],
        }
    }

    /// The requirements of a layout's errors.
    fn wanted(durations_ticks: &[u16], errors: &[f64], span_ticks_long: f64) -> Self {
        let raw: Vec<f64> = durations_ticks
            .iter()
            .zip(errors)
            .map(|(&ticks, error)| {
                let factor = (error / ERROR_AIM).powf(0.25).clamp(DENSER[0], DENSER[1]);
                factor / f64::from(ticks)
            })
            .collect();
        // The worst error of a span is a noisy figure: its neighbours have a say. A span next to a
        // dense one shares its trouble, since the fit spreads errors.
        let per_tick = (0..raw.len())
            .map(|i| {
                let (left, right) = (raw[i.saturating_sub(1)], raw[(i + 1).min(raw.len() - 1)]);
                let mean = 0.25 * (left + right) + 0.5 * raw[i];
                let least = 0.5 * left.max(right);
                let dense = if errors[i] > 1.0 { raw[i] } else { mean };
                dense.max(least).max(1.0 / span_ticks_long)
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
            // Ticks reserved for the following knots.
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

/// Shortest move that is no dwell: three spans.
pub const MOVING_TICKS_MIN: usize = 3 * SPAN_TICKS_MIN;

/// A layout and how good it is.
pub struct Layout {
    /// The fitted, quantised spline.
    pub spline: RestSpline,
    /// Its worst error against the tolerance of each span.
    pub errors: Vec<f64>,
    /// For each span the one that it was in the layout before ([`lay_out_again`]), if any.
    was: Vec<Option<usize>>,
    /// What the ticks of each span gave to the fit, and what the span then did; nothing of a draft.
    sums: Vec<TickSums>,
    shares: Vec<SpanShare>,
}

/// An earlier layout, and for each span of the next one its span with the identical path, tick by
/// tick and at the following tick.
struct Before<'a> {
    layout: &'a Layout,
    spans: Vec<Option<usize>>,
}

impl Before<'_> {
    fn sums_of(&self, span: usize) -> Option<&TickSums> {
        self.layout.sums.get(self.spans[span]?)
    }

    /// The earlier span whose neighbours have the same lengths as those of this one.
    fn same_between(&self, span: usize, durations_ticks: &[u16]) -> Option<usize> {
        let before = &self.layout.spline.durations_ticks;
        let around = durations_around(durations_ticks, span);
        self.spans[span].filter(|&same| durations_around(before, same) == around)
    }

    /// The share of a span between spans of the same lengths.
    fn share_of(&self, span: usize, durations_ticks: &[u16]) -> Option<&SpanShare> {
        let same = self.same_between(span, durations_ticks)?;
        self.layout.shares.get(same)
    }

    /// The error of a span that has stayed the same curve under the same path.
    fn error_of(&self, span: usize, spline: &RestSpline) -> Option<f64> {
        let same = self.same_between(span, &spline.durations_ticks)?;
        let before = &self.layout.spline.control;
        let is_same = before[same..same + 4] == spline.control[span..span + 4];
        is_same.then(|| self.layout.errors[same])
    }
}

impl Layout {
    fn new(
        path: &TickPath,
        durations_ticks: &[u16],
        tolerances: &[f64; CHANNELS],
        before: Option<&Before>,
    ) -> Self {
        let sums = tick_sums(path, durations_ticks, |span| before?.sums_of(span));
        let shares = span_shares(durations_ticks, &sums, |span| {
            before?.share_of(span, durations_ticks)
        });
        let spline = fit(path, durations_ticks, &shares);
        let errors = span_errors(path, &spline, tolerances, |span| {
            before?.error_of(span, &spline)
        });
        Self {
            spline,
            errors,
            sums,
            shares,
            was: before.map_or_else(
                || vec![None; durations_ticks.len()],
                |before| before.spans.clone(),
            ),
        }
    }

    /// One of which hardly a span will stay as it is.
    fn draft(path: &TickPath, durations_ticks: &[u16], tolerances: &[f64; CHANNELS]) -> Self {
        let shares = shares_of_path(path, durations_ticks);
        let spline = fit(path, durations_ticks, &shares);
        let errors = span_errors(path, &spline, tolerances, |_| None);
        Self {
            spline,
            errors,
            sums: Vec::new(),
            shares: Vec::new(),
            was: vec![None; durations_ticks.len()],
        }
    }

    /// The span of the layout before that has stayed the same curve.
    pub fn span_before(&self, before: &Layout, span: usize) -> Option<usize> {
        let was = self.was[span]?;
        let [own, other] = [(self, span), (before, was)].map(|(layout, span)| {
            let RestSpline {
                control,
                durations_ticks,
            } = &layout.spline;
            (
                &control[span..span + 4],
                durations_around(durations_ticks, span),
            )
        });
        (own == other).then_some(was)
    }

    /// Worst error of any span.
    pub fn worst_error(&self) -> f64 {
        self.errors.iter().copied().fold(0.0, f64::max)
    }

    /// Cuts spans beyond `error_max` until all keep it or cannot be cut further.
    fn refined(mut self, path: &TickPath, tolerances: &[f64; CHANNELS], error_max: f64) -> Self {
        for _ in 0..HALVING_ROUNDS {
            let Some((halved, spans)) =
                halve(&self.spline.durations_ticks, &self.errors, error_max)
            else {
                break;
            };
            let before = Before {
                layout: &self,
                spans,
            };
            let mut next = Self::new(path, &halved, tolerances, Some(&before));
            for was in &mut next.was {
                *was = was.and_then(|span| self.was[span]);
            }
            self = next;
        }
        self
    }
}

/// Lays knots and fits until every span keeps its tolerance or cannot be cut further.
/// The path must last at least [`MOVING_TICKS_MIN`].
pub fn lay_out(path: &TickPath, tolerances: &[f64; CHANNELS], span_ticks_long: f64) -> Layout {
    let first = Density::first(path.ticks()).durations(path.ticks());
    let mut layout = Layout::draft(path, &first, tolerances);
    for _ in 0..SPREAD_ROUNDS {
        let durations = &layout.spline.durations_ticks;
        let wanted = Density::wanted(durations, &layout.errors, span_ticks_long);
        let next = wanted.durations(path.ticks());
        let settled = layout.worst_error() <= 1.0 && next.len() * 50 >= durations.len() * 49;
        if settled || next == *durations {
            break;
        }
        layout = Layout::draft(path, &next, tolerances);
    }
    layout.refined(path, tolerances, 1.0)
}

/// Fits again after the time law changed a little: every knot stays at its point of the path, so
/// that good spans stay good. `u_before` are the path parameters by tick before.
pub fn lay_out_again(
    path: &TickPath,
    tolerances: &[f64; CHANNELS],
    before: &Layout,
    u_before: &[f64],
) -> Layout {
    let u_at_tick = path.u_at_tick();
    let count = before.spline.durations_ticks.len();
    let ticks = path.ticks();
    let (mut tick_before, mut last_knot) = (0, 0);
    let (mut first_before, mut first_span) = (0, 0);
    let mut durations = Vec::with_capacity(count);
    let mut spans = Vec::with_capacity(count);
    for (span, &duration) in before.spline.durations_ticks.iter().enumerate() {
        tick_before += usize::from(duration);
        let u = u_before[tick_before];
        let wanted = u_at_tick.partition_point(|&other| other < u);
        let least = last_knot + SPAN_TICKS_MIN;
        let is_last = span + 1 == count;
        // A faster motion may have no room for a knot: its two spans become one.
        if !is_last && (least > wanted + LATE_TICKS_MAX || least + SPAN_TICKS_MIN > ticks) {
            continue;
        }
        let latest = ticks.saturating_sub(SPAN_TICKS_MIN).max(least);
        let place = if is_last {
            ticks
        } else {
            wanted.clamp(least, latest)
        };
        // Slowed manifold, a span may outgrow the longest that the wire has: it becomes several.
        let parts = (place - last_knot).div_ceil(path.span_ticks_max()).max(1);
        for part in 0..parts {
            let duration = (place - last_knot) / (parts - part);
            let first = last_knot;
            last_knot += duration;
            durations.push(duration as u16);
            let now = &u_at_tick[first..(last_knot + 2).min(u_at_tick.len())];
            let then = &u_before[first_before..(tick_before + 2).min(u_before.len())];
            spans.push((first_span == span && now == then).then_some(span));
        }
        (first_before, first_span) = (tick_before, span + 1);
    }
    if durations.len() < 3 {
        durations = Density::first(ticks).durations(ticks);
        spans = vec![None; durations.len()];
    }
    let before = Before {
        layout: before,
        spans,
    };
    Layout::new(path, &durations, tolerances, Some(&before)).refined(path, tolerances, ERROR_KEPT)
}

/// Cuts the spans beyond `error_max` in two; `None` if there are none. With the durations it gives
/// the numbers of the unchanged ones.
fn halve(
    durations_ticks: &[u16],
    errors: &[f64],
    error_max: f64,
) -> Option<(Vec<u16>, Vec<Option<usize>>)> {
    let mut halved = Vec::with_capacity(durations_ticks.len() + 8);
    let mut spans = Vec::with_capacity(durations_ticks.len() + 8);
    for (span, (&ticks, &error)) in durations_ticks.iter().zip(errors).enumerate() {
        if error > error_max && usize::from(ticks) >= 2 * SPAN_TICKS_MIN {
            halved.extend([ticks / 2, ticks - ticks / 2]);
            spans.extend([None; 2]);
        } else {
            halved.push(ticks);
            spans.push(Some(span));
        }
    }
    (halved.len() > durations_ticks.len()).then_some((halved, spans))
}

#[cfg(test)]
mod tests {
    //! Goal: durations add up, no span is shorter than the least, the tolerance is kept with fewer
    //! spans than even ones would need, and knots keep their places when the time changes.
    use super::*;
    use crate::plan::route::moves::PathCurve;

    /// Points of the curve: many for each span that is wanted.
    const POINTS: u32 = 20_000;

    /// A sharp bend in the middle, quiet elsewhere.
    fn curve() -> PathCurve {
        let at = |i: u32| {
            let x = f64::from(i) / f64::from(POINTS);
            let bend = (40.0 * (x - 0.5)).tanh();
            [40.0 * x, bend, 0.0, 0.0, 0.0, 0.0, 0.0]
        };
        PathCurve {
            control: (0..=POINTS).map(at).collect(),
        }
    }

    /// Its parameter from rest to rest.
    fn parameters(ticks: usize) -> Vec<f64> {
        let at = |k: usize| {
            let x = k as f64 / ticks as f64;
            f64::from(POINTS) * x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
        };
        (0..=ticks).map(at).collect()
    }

    const TOLERANCES: [f64; CHANNELS] = [3e-4; CHANNELS];

    #[test]
    fn the_tolerance_is_kept_with_knots_where_they_are_needed() {
        let (curve, u) = (curve(), parameters(2000));
        let path = TickPath::new(&curve, &u);
        let layout = lay_out(&path, &TOLERANCES, SPAN_TICKS_LONG);
        let durations = &layout.spline.durations_ticks;
        assert_eq!(layout.spline.ticks(), 2000);
        assert!(
            durations
                .iter()
                .all(|&ticks| usize::from(ticks) >= SPAN_TICKS_MIN)
        );
        assert!(layout.worst_error() <= 1.0, "{}", layout.worst_error());
        let even = Layout::new(
            &path,
            &vec![(2000 / durations.len()) as u16; 2000 / (2000 / durations.len())],
            &TOLERANCES,
            None,
        );
        assert!(even.worst_error() > 3.0, "{}", even.worst_error());
    }

    #[test]
    fn knots_keep_their_places_on_the_path() {
        let (curve, u_first, u_second) = (curve(), parameters(2000), parameters(2100));
        let first = TickPath::new(&curve, &u_first);
        let second = TickPath::new(&curve, &u_second);
        let layout = lay_out(&first, &TOLERANCES, SPAN_TICKS_LONG);
        let again = lay_out_again(&second, &TOLERANCES, &layout, &u_first);
        assert_eq!(again.spline.ticks(), 2100);
        assert_eq!(
            again.spline.durations_ticks.len(),
            layout.spline.durations_ticks.len()
        );
        let (mut tick, mut tick_again) = (0, 0);
        for (a, b) in layout
            .spline
            .durations_ticks
            .iter()
            .zip(&again.spline.durations_ticks)
        {
            tick += usize::from(*a);
            tick_again += usize::from(*b);
            // A tick of the faster motion is at most 0.001 of the path.
            let apart = (u_first[tick] - u_second[tick_again]).abs();
            assert!(apart < 1.1e-3 * f64::from(POINTS));
        }
    }

    #[test]
    fn spans_that_outgrow_the_wire_become_several() {
        let (curve, u_first, u_slow) = (curve(), parameters(2000), parameters(200_000));
        let first = TickPath::new(&curve, &u_first);
        let slow = TickPath::new(&curve, &u_slow);
        let layout = lay_out(&first, &TOLERANCES, SPAN_TICKS_LONG);
        let longest = *layout.spline.durations_ticks.iter().max().unwrap();
        assert!(100 * u32::from(longest) > u32::from(SPAN_TICKS_MAX));
        let again = lay_out_again(&slow, &TOLERANCES, &layout, &u_first);
        assert_eq!(again.spline.ticks(), 200_000);
        let durations = &again.spline.durations_ticks;
        assert!(durations.iter().all(|&ticks| ticks <= SPAN_TICKS_MAX));
        assert!(again.worst_error() <= 1.0, "{}", again.worst_error());
    }

    #[test]
    fn the_shortest_path_has_three_spans() {
        let (curve, u) = (curve(), parameters(MOVING_TICKS_MIN));
        let path = TickPath::new(&curve, &u);
        let layout = lay_out(&path, &TOLERANCES, SPAN_TICKS_LONG);
        assert_eq!(layout.spline.durations_ticks.len(), 3);
        assert_eq!(layout.spline.ticks(), MOVING_TICKS_MIN as u64);
    }
}
