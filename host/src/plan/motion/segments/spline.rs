//! Non-uniform cubic B-spline from rest to rest, on servo ticks: basis, evaluation.
//!
//! With m spans of the given durations there are m + 3 control points; the first three are equal
//! and so are the last three (rest). Span i uses control points i..i+4. Source: de Boor, "A
//! Practical Guide to Splines" (1978). Evaluation is in natural units and seconds.
//!
//! In: durations in servo ticks, control points (mm, rad, mm³). Out: value and derivatives by
//! seconds at a tick. Not covered: the wire's integers ([`quantised`] rounds to them).

use crate::plan::route::path_curve::CurvePoint;
use headway_protocol::segment::SPAN_TICKS_MAX;
use headway_protocol::units::{CHANNELS, Units};

/// A spline from rest to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct RestSpline {
    /// Span durations, servo ticks, at least three of them unless it is a dwell.
    pub durations_ticks: Vec<u16>,
    /// Control points, natural units (mm, rad, mm³) on the grid of the wire, three more than spans.
    pub control: Vec<[f64; CHANNELS]>,
}

/// Weights of a span's four control points as cubics in ticks from its start.
pub type SpanBasis = [[f64; 4]; 4];

/// The basis of a span from the durations of spans i-2..=i+2.
pub fn span_basis(h: [f64; 5]) -> SpanBasis {
    let (inner, outer) = (h[1] + h[2], h[2] + h[3]);
    let rate = [
        3.0 / (h[0] + inner),
        3.0 / (inner + h[3]),
        3.0 / (outer + h[4]),
    ];
    let (bend_start, bend_end) = (1.0 / inner, 1.0 / outer);
    let jerk = 1.0 / (3.0 * h[2]);
    // How the curve depends on the three differences of control points.
    let a = [
        -h[2] * h[2] * rate[0] / (3.0 * inner),
        rate[0] * h[2] / inner,
        -rate[0] * bend_start,
        jerk * rate[0] * bend_start,
    ];
    let b = [
        h[1] * h[1] * rate[1] / (3.0 * inner),
        rate[1] * h[1] / inner,
        rate[1] * bend_start,
        -jerk * rate[1] * (bend_end + bend_start),
    ];
    let c = [0.0, 0.0, 0.0, jerk * rate[2] * bend_end];
    let mut basis = [[0.0; 4]; 4];
    for power in 0..4 {
        basis[0][power] = -a[power];
        basis[1][power] = a[power] - b[power];
        basis[2][power] = b[power] - c[power];
        basis[3][power] = c[power];
    }
    basis[1][0] += 1.0;
    basis
}

/// Durations of spans i-2..=i+2; beyond the ends, where everything rests, the end spans repeat.
pub fn durations_around(durations_ticks: &[u16], span: usize) -> [f64; 5] {
    let last = durations_ticks.len() - 1;
    std::array::from_fn(|k| {
        let index = (span + k).saturating_sub(2).min(last);
        f64::from(durations_ticks[index])
    })
}

impl RestSpline {
    /// Duration in servo ticks.
    pub fn ticks(&self) -> u64 {
        self.durations_ticks.iter().map(|&h| u64::from(h)).sum()
    }

    /// The same path in this multiple of the time.
    pub fn slower(mut self, factor: u16) -> RestSpline {
        for ticks in &mut self.durations_ticks {
            *ticks = ticks.saturating_mul(factor).min(SPAN_TICKS_MAX);
        }
        self
    }

    /// One span as cubics in ticks from its start.
    pub fn span_polynomials(&self, span: usize) -> [[f64; 4]; CHANNELS] {
        let basis = span_basis(durations_around(&self.durations_ticks, span));
        std::array::from_fn(|channel| self.cubic(&basis, span, channel))
    }

    /// One channel of a span.
    pub fn span_polynomial(&self, span: usize, channel: usize) -> [f64; 4] {
        let basis = span_basis(durations_around(&self.durations_ticks, span));
        self.cubic(&basis, span, channel)
    }

    #[inline]
    fn cubic(&self, basis: &SpanBasis, span: usize, channel: usize) -> [f64; 4] {
        let control = &self.control[span..span + 4];
        // Relative to the second point, so that large coordinates lose nothing.
        let origin = control[1][channel];
        let mut cubic = [0.0; 4];
        for (weights, point) in basis.iter().zip(control) {
            for (coefficient, weight) in cubic.iter_mut().zip(weights) {
                *coefficient += weight * (point[channel] - origin);
            }
        }
        cubic[0] += origin;
        cubic
    }
}

/// Value and derivatives by seconds of span polynomials at `t_ticks` from the span's start.
pub fn evaluate(cubics: &[[f64; 4]; CHANNELS], t_ticks: f64, servo_hz: f64) -> CurvePoint {
    let t = t_ticks;
    let (hz2, hz3) = (servo_hz * servo_hz, servo_hz * servo_hz * servo_hz);
    CurvePoint {
        value: cubics.map(|[c0, c1, c2, c3]| c0 + t * (c1 + t * (c2 + t * c3))),
        first: cubics.map(|[_, c1, c2, c3]| (c1 + t * (2.0 * c2 + 3.0 * t * c3)) * servo_hz),
        second: cubics.map(|[_, _, c2, c3]| (2.0 * c2 + 6.0 * t * c3) * hz2),
        third: cubics.map(|[_, _, _, c3]| 6.0 * c3 * hz3),
    }
}

/// The nearest point that a stream of these units can carry.
pub fn quantised(natural: &[f64; CHANNELS], units: &Units) -> [f64; CHANNELS] {
    std::array::from_fn(|channel| {
        let per_natural = units.per_natural(channel);
        (natural[channel] * per_natural).round() / per_natural
    })
}
