//! Evaluation of the route's path curves: position and u-derivatives of the uniform cubic B-spline.
//!
//! In: [`PathCurve`] and a parameter u (one unit per span). Out: channels in mm, rad, mm³ and their
//! first to third derivatives by u. The spline has natural ends by phantom points P_{-1} = 2 P_0 -
//! P_1, so that it starts and ends on its first and last point.

use crate::plan::route::moves::PathCurve;
use headway_protocol::units::CHANNELS;

/// Value and derivatives of all channels at one point of a curve, by its parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    /// Channels: mm, rad, mm³.
    pub value: [f64; CHANNELS],
    /// First derivative by the parameter.
    pub first: [f64; CHANNELS],
    /// Second derivative by the parameter.
    pub second: [f64; CHANNELS],
    /// Third derivative by the parameter.
    pub third: [f64; CHANNELS],
}

impl PathCurve {
    /// Number of spans; 0 for a dwell.
    pub fn span_count(&self) -> usize {
        self.control.len().saturating_sub(1)
    }

    /// The four control points of a span, phantom points included.
    fn span_control(&self, span: usize) -> [[f64; CHANNELS]; 4] {
        let last = self.control.len() - 1;
        let beyond = |end: usize, inner: usize| {
            let mut point = [0.0; CHANNELS];
            for (channel, value) in point.iter_mut().enumerate() {
                *value = 2.0 * self.control[end][channel] - self.control[inner][channel];
            }
            point
        };
        [
            if span == 0 {
                beyond(0, 1)
            } else {
                self.control[span - 1]
            },
            self.control[span],
            self.control[span + 1],
            if span + 2 > last {
                beyond(last, last - 1)
            } else {
                self.control[span + 2]
            },
        ]
    }

    /// The span of path parameter `u`, clamped to 0..=span count, and the place in it. The curve must
    /// have at least two control points.
    fn place_of(&self, u: f64) -> (usize, f64) {
        let u = u.clamp(0.0, self.span_count() as f64);
        let span = (u as usize).min(self.span_count() - 1);
        (span, u - span as f64)
    }

    /// Point and derivatives at path parameter `u`, clamped to 0..=span count.
    /// The curve must have at least one control point.
    pub fn evaluate(&self, u: f64) -> CurvePoint {
        if self.control.len() < 2 {
            return CurvePoint {
                value: self.control[0],
                first: [0.0; CHANNELS],
                second: [0.0; CHANNELS],
                third: [0.0; CHANNELS],
            };
        }
        let (span, s) = self.place_of(u);
        self.evaluate_in_span(span, s)
    }

    /// The value alone.
    pub fn value(&self, u: f64) -> [f64; CHANNELS] {
        if self.control.len() < 2 {
            return self.control[0];
        }
        self.weighted(u, value_weights)
    }

    /// The first derivative alone.
    pub fn tangent(&self, u: f64) -> [f64; CHANNELS] {
        if self.control.len() < 2 {
            return [0.0; CHANNELS];
        }
        self.weighted(u, first_weights)
    }

    /// The sum of the control points about `u` with weights of the place in its span; no copies but
    /// at the ends, since most of planning's time by the tick is spent here.
    fn weighted(&self, u: f64, weights: impl Fn(f64) -> [f64; 4]) -> [f64; CHANNELS] {
        let (span, s) = self.place_of(u);
        let inner = span.checked_sub(1).and_then(|first| {
            let points = self.control.get(first..)?;
            points.first_chunk::<4>()
        });
        match inner {
            Some(points) => sum(points, &weights(s)),
            None => sum(&self.span_control(span), &weights(s)),
        }
    }

    /// Point and derivatives in a span at `s` in 0..=1.
    pub fn evaluate_in_span(&self, span: usize, s: f64) -> CurvePoint {
        let p = self.span_control(span);
        let [value, first, second] = basis_weights(s);
        let third = [-1.0, 3.0, -3.0, 1.0];
        CurvePoint {
            value: sum(&p, &value),
            first: sum(&p, &first),
            second: sum(&p, &second),
            third: sum(&p, &third),
        }
    }
}

/// Weights of the four control points of a uniform cubic span at `s`: value, first and second
/// derivative.
pub fn basis_weights(s: f64) -> [[f64; 4]; 3] {
    let second = [1.0 - s, 3.0 * s - 2.0, 1.0 - 3.0 * s, s];
    [value_weights(s), first_weights(s), second]
}

/// Weights of a span's control points at `s`.
fn value_weights(s: f64) -> [f64; 4] {
    let r = 1.0 - s;
    [
        r * r * r / 6.0,
        (4.0 + s * s * (3.0 * s - 6.0)) / 6.0,
        (1.0 + s * (3.0 + s * (3.0 - 3.0 * s))) / 6.0,
        s * s * s / 6.0,
    ]
}

/// Their derivatives.
fn first_weights(s: f64) -> [f64; 4] {
    let r = 1.0 - s;
    [
        -0.5 * r * r,
        s * (1.5 * s - 2.0),
        0.5 + s * (1.0 - 1.5 * s),
        0.5 * s * s,
    ]
}

#[inline]
fn sum(points: &[[f64; CHANNELS]; 4], weights: &[f64; 4]) -> [f64; CHANNELS] {
    let mut of = [0.0; CHANNELS];
    for (channel, value) in of.iter_mut().enumerate() {
        *value = (weights[0] * points[0][channel] + weights[3] * points[3][channel])
            + (weights[1] * points[1][channel] + weights[2] * points[2][channel]);
    }
    of
}

#[cfg(test)]
mod tests {
    //! Goal: ends on the end points, derivatives consistent with differences, C² across spans.
    use super::*;

    fn wave() -> PathCurve {
        PathCurve {
            control: (0..9)
                .map(|i| {
                    let t = f64::from(i);
                    [t, t.sin(), 0.1 * t, 0.0, 0.0, t.cos(), t * t]
                })
                .collect(),
        }
    }

    #[test]
    fn starts_and_ends_on_the_end_points() {
        let curve = wave();
        for channel in 0..CHANNELS {
            let first = curve.evaluate(0.0).value[channel];
            let last = curve.evaluate(8.0).value[channel];
            assert!((first - curve.control[0][channel]).abs() < 1e-14);
            assert!((last - curve.control[8][channel]).abs() < 1e-13);
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let curve = wave();
        let step = 1e-5;
        for i in 1..80 {
            let u = f64::from(i) * 0.1 + 0.013;
            if (u - u.round()).abs() < 2.0 * step || u > 7.9 {
                continue;
            }
            let (before, at, after) = (
                curve.evaluate(u - step),
                curve.evaluate(u),
                curve.evaluate(u + step),
            );
            for channel in 0..CHANNELS {
                let pairs = [
                    (before.value, after.value, at.first),
                    (before.first, after.first, at.second),
                    (before.second, after.second, at.third),
                ];
                for (low, high, slope) in pairs {
                    let difference = (high[channel] - low[channel]) / (2.0 * step);
                    assert!((difference - slope[channel]).abs() < 1e-6);
                }
            }
        }
    }

    #[test]
    fn second_derivative_is_continuous() {
        let curve = wave();
        for span in 1..8 {
            let left = curve.evaluate_in_span(span - 1, 1.0);
            let right = curve.evaluate_in_span(span, 0.0);
            for channel in 0..CHANNELS {
                assert!((left.second[channel] - right.second[channel]).abs() < 1e-12);
                assert!((left.value[channel] - right.value[channel]).abs() < 1e-12);
            }
        }
    }
}
