//! Knots -> polynomial pieces of the motion, for both host (f64) and controller (f32).
//!
//! [`SpanWindow`] takes the knots of `headway_protocol::segment` one by one and keeps the four
//! control points and five durations that shape the newest span; [`SpanPolynomial`] is that span
//! as one cubic per channel, in channel units and servo ticks from the span's start. Positions
//! are an exact integer `base` (unwrapped, i64) plus a small offset in the number type, so that
//! resolution does not depend on the distance from the origin and nothing drifts.
//!
//! Source: de Boor, A Practical Guide to Splines (1978), derivative control points.

use crate::numbers::real::Real;
use headway_protocol::segment::{Knot, REST_TICKS};
use headway_protocol::units::{CHANNELS, ChannelPoint, Units};

/// Control points and durations that shape the newest span.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpanShape {
    /// P_{n-3}..P_n, channel units, wrapping.
    control: [ChannelPoint; 4],
    /// Durations of spans n-2..n+2, servo ticks.
    durations_ticks: [u16; 5],
}

impl SpanShape {
    /// At rest on `start`, before knot 0.
    pub fn at_rest(start: &ChannelPoint) -> Self {
        Self {
            control: [*start; 4],
            durations_ticks: [REST_TICKS; 5],
        }
    }

    /// Takes knot n; the shape is then that of span n.
    #[inline]
    pub fn push(&mut self, knot: &Knot) {
        self.control = [
            self.control[1],
            self.control[2],
            self.control[3],
            knot.control,
        ];
        let [_, h1, h2, h3, h4] = self.durations_ticks;
        self.durations_ticks = [h1, h2, h3, h4, knot.duration_ticks];
    }

    /// Duration of the newest span, servo ticks.
    pub fn duration_ticks(&self) -> u16 {
        self.durations_ticks[2]
    }

    /// Where the span's offsets count from, P_{n-2}, channel units, wrapping.
    pub fn base(&self) -> &ChannelPoint {
        &self.control[1]
    }

    /// Displacement of the base at the arrival of the newest knot, channel units.
    #[inline]
    pub fn base_step(&self, channel: usize) -> i32 {
        let [before, base, ..] = &self.control;
        of_channel(base, channel).wrapping_sub(of_channel(before, channel))
    }

    /// The weights of the span from its durations.
    pub fn weights<R: Real>(&self) -> SpanWeights<R> {
        SpanWeights::new(&self.durations_ticks)
    }

    /// One channel of the span, see [`SpanPolynomial::coefficients`].
    #[inline(always)]
    pub fn cubic<R: Real>(&self, channel: usize, weights: &SpanWeights<R>) -> [R; 4] {
        let [a, b, c] = self.differences(channel);
        weights.cubic(a, b, c)
    }

    /// Differences of a channel's control points.
    #[inline(always)]
    fn differences<R: Real>(&self, channel: usize) -> [R; 3] {
        let [p0, p1, p2, p3] = &self.control;
        let difference = |from: &ChannelPoint, to: &ChannelPoint| {
            R::of_integer(of_channel(to, channel).wrapping_sub(of_channel(from, channel)))
        };
        [difference(p0, p1), difference(p1, p2), difference(p2, p3)]
    }
}

/// One channel; 0 for one that does not exist.
#[inline(always)]
fn of_channel(point: &ChannelPoint, channel: usize) -> i32 {
    point.get(channel).copied().unwrap_or(0)
}

/// The newest span's shape and its place, unwrapped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpanWindow {
    shape: SpanShape,
    /// P_{n-2}, unwrapped from the start of the stream.
    base: [i64; CHANNELS],
}

impl SpanWindow {
    /// At rest on `start`, before knot 0.
    pub fn at_rest(start: &ChannelPoint) -> Self {
        Self {
            shape: SpanShape::at_rest(start),
            base: start.map(i64::from),
        }
    }

    /// Takes knot n; the window then shapes span n.
    pub fn push(&mut self, knot: &Knot) {
        self.shape.push(knot);
        for (channel, base) in self.base.iter_mut().enumerate() {
            *base = base.wrapping_add(i64::from(self.shape.base_step(channel)));
        }
    }

    /// Duration of the newest span, servo ticks.
    pub fn duration_ticks(&self) -> u16 {
        self.shape.duration_ticks()
    }

    /// Unwrapped integer position that the span's offsets count from, channel units.
    pub fn base(&self) -> &[i64; CHANNELS] {
        &self.base
    }

    /// Newest control point, channel units.
    pub fn newest(&self) -> &ChannelPoint {
        &self.shape.control[3]
    }

    /// True if nothing moves during the complete span.
    pub fn is_rest(&self) -> bool {
        self.starts_at_rest() && self.ends_at_rest()
    }

    /// True if velocity and acceleration are zero where the span starts.
    pub fn starts_at_rest(&self) -> bool {
        let [p0, p1, p2, _] = &self.shape.control;
        p0 == p1 && p1 == p2
    }

    /// True if velocity and acceleration are zero where the span ends.
    pub fn ends_at_rest(&self) -> bool {
        let [_, p1, p2, p3] = &self.shape.control;
        p1 == p2 && p2 == p3
    }

    /// The newest span as polynomials: about 250 floating-point instructions.
    pub fn polynomial<R: Real>(&self) -> SpanPolynomial<R> {
        let weights = self.shape.weights();
        let mut polynomial = SpanPolynomial::zero();
        for channel in 0..CHANNELS {
            let [a, b, c] = self.shape.differences(channel);
            polynomial.coefficients[channel] = weights.cubic(a, b, c);
            polynomial.rate_bound[channel] = weights.rate_bound(a, b, c);
        }
        polynomial
    }
}

/// Weights of a span that depend only on durations; shared by all channels.
#[derive(Clone, Copy, Debug)]
pub struct SpanWeights<R> {
    position: [R; 2],
    rate: [R; 3],
    start_blend: [R; 2],
    bend: [R; 2],
    jerk_sixth: R,
}

impl<R: Real> SpanWeights<R> {
    fn new(durations_ticks: &[u16; 5]) -> Self {
        let [h0, h1, h2, h3, h4] = durations_ticks.map(|ticks| R::of_integer(i32::from(ticks)));
        let three = R::of(3.0);
        let (inner, outer) = (h1 + h2, h2 + h3);
        let first = h0 + inner;
        let second = inner + h3;
        let third = outer + h4;
        Self {
            position: [h2 * h2 / (first * inner), h1 * h1 / (second * inner)],
            rate: [three / first, three / second, three / third],
            start_blend: [h2 / inner, h1 / inner],
            bend: [R::of(2.0) / inner, R::of(2.0) / outer],
            jerk_sixth: R::of(1.0 / 6.0) / h2,
        }
    }

    /// Cubic coefficients relative to P_{n-2} from the three control differences.
    #[inline(always)]
    fn cubic(&self, a: R, b: R, c: R) -> [R; 4] {
        let (da, db, dc) = (a * self.rate[0], b * self.rate[1], c * self.rate[2]);
        let bend_start = (db - da) * self.bend[0];
        let bend_end = (dc - db) * self.bend[1];
        [
            b * self.position[1] - a * self.position[0],
            da * self.start_blend[0] + db * self.start_blend[1],
            bend_start * R::of(0.5),
            (bend_end - bend_start) * self.jerk_sixth,
        ]
    }

    /// Largest |rate| of the hull of the derivative, units per tick.
    #[inline]
    fn rate_bound(&self, a: R, b: R, c: R) -> R {
        let (da, db, dc) = (a * self.rate[0], b * self.rate[1], c * self.rate[2]);
        da.magnitude().larger(db.magnitude()).larger(dc.magnitude())
    }
}

/// One span: offset(t) = c0 + c1 t + c2 t² + c3 t³ from the window's base, per channel, in channel
/// units, t in servo ticks from the span's start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpanPolynomial<R> {
    /// c0..c3 of each channel.
    pub coefficients: [[R; 4]; CHANNELS],
    /// Bound of |d offset / dt| over the span, units per tick.
    pub rate_bound: [R; CHANNELS],
}

impl<R: Real> SpanPolynomial<R> {
    /// No motion.
    pub fn zero() -> Self {
        let zero = R::of(0.0);
        Self {
            coefficients: [[zero; 4]; CHANNELS],
            rate_bound: [zero; CHANNELS],
        }
    }

    /// Offsets from the base, channel units.
    #[inline]
    pub fn offset(&self, t: R) -> [R; CHANNELS] {
        self.coefficients
            .map(|[c0, c1, c2, c3]| ((c3 * t + c2) * t + c1) * t + c0)
    }

    /// First derivative, channel units per tick.
    #[inline]
    pub fn rate(&self, t: R) -> [R; CHANNELS] {
        let (two, three) = (R::of(2.0), R::of(3.0));
        self.coefficients
            .map(|[_, c1, c2, c3]| (three * c3 * t + two * c2) * t + c1)
    }

    /// Second derivative, channel units per tick².
    #[inline]
    pub fn acceleration(&self, t: R) -> [R; CHANNELS] {
        let (two, six) = (R::of(2.0), R::of(6.0));
        self.coefficients
            .map(|[_, _, c2, c3]| six * c3 * t + two * c2)
    }

    /// Third derivative, constant over the span, channel units per tick³.
    pub fn jerk(&self) -> [R; CHANNELS] {
        let six = R::of(6.0);
        self.coefficients.map(|[_, _, _, c3]| six * c3)
    }
}

/// A span with its position in the stream, in double precision, for planner and checkers.
#[derive(Clone, Debug, PartialEq)]
pub struct Span {
    /// Index from 0.
    pub index: usize,
    /// Servo ticks of segment time before it.
    pub start_tick: u64,
    /// Servo ticks that it lasts.
    pub duration_ticks: u16,
    /// Where its offsets count from, channel units, unwrapped.
    pub base: [i64; CHANNELS],
    /// Its shape.
    pub polynomial: SpanPolynomial<f64>,
    /// What its units are.
    pub units: Units,
}

impl Span {
    /// Channels in mm, rad, mm³ at `t` ticks from the span's start.
    pub fn position(&self, t: f64) -> [f64; CHANNELS] {
        let mut natural = self.polynomial.offset(t);
        for (channel, value) in natural.iter_mut().enumerate() {
            let units = self.base[channel] as f64 + *value;
            *value = units / self.units.per_natural(channel);
        }
        natural
    }

    /// Rates in mm/s, rad/s, mm³/s.
    pub fn velocity(&self, t: f64, servo_hz: f64) -> [f64; CHANNELS] {
        self.scaled(self.polynomial.rate(t), servo_hz)
    }

    /// Second derivatives in mm/s², rad/s², mm³/s².
    pub fn acceleration(&self, t: f64, servo_hz: f64) -> [f64; CHANNELS] {
        self.scaled(self.polynomial.acceleration(t), servo_hz * servo_hz)
    }

    /// Third derivatives in mm/s³, rad/s³, mm³/s³.
    pub fn jerk(&self, servo_hz: f64) -> [f64; CHANNELS] {
        self.scaled(self.polynomial.jerk(), servo_hz * servo_hz * servo_hz)
    }

    /// Rate and second derivative of one channel alone, natural units and seconds.
    pub fn rate_and_acceleration_of(&self, channel: usize, t: f64, servo_hz: f64) -> [f64; 2] {
        let [_, c1, c2, c3] = self.polynomial.coefficients[channel];
        let per_tick = servo_hz / self.units.per_natural(channel);
        [
            (3.0 * c3 * t + 2.0 * c2) * t + c1,
            (6.0 * c3 * t + 2.0 * c2) * servo_hz,
        ]
        .map(|of| of * per_tick)
    }

    fn scaled(&self, mut units: [f64; CHANNELS], per_tick: f64) -> [f64; CHANNELS] {
        for (channel, value) in units.iter_mut().enumerate() {
            *value *= per_tick / self.units.per_natural(channel);
        }
        units
    }
}

/// The spans of a stream in order.
#[derive(Clone, Debug)]
pub struct Spans<'a> {
    window: SpanWindow,
    knots: core::slice::Iter<'a, Knot>,
    index: usize,
    start_tick: u64,
    units: Units,
}

impl<'a> Spans<'a> {
    /// Spans of `knots` after rest on `start`, in these units.
    pub fn new(start: &ChannelPoint, knots: &'a [Knot], units: Units) -> Self {
        Self {
            window: SpanWindow::at_rest(start),
            knots: knots.iter(),
            index: 0,
            start_tick: 0,
            units,
        }
    }
}

impl Iterator for Spans<'_> {
    type Item = Span;

    fn next(&mut self) -> Option<Span> {
        self.window.push(self.knots.next()?);
        let span = Span {
            index: self.index,
            start_tick: self.start_tick,
            duration_ticks: self.window.duration_ticks(),
            base: *self.window.base(),
            polynomial: self.window.polynomial(),
            units: self.units,
        };
        self.index += 1;
        self.start_tick += u64::from(span.duration_ticks);
        Some(span)
    }
}

#[cfg(test)]
mod tests {
    //! Goal: the polynomials are the B-spline of the contract. Method: de Boor's recursion on the
    //! knot vector, written out here; continuity at every joint; exactness at rest.
    use super::*;
    use std::vec::Vec;

    /// Pseudo-random knots; the last three control points are equal.
    fn stream(seed: u64, count: usize) -> (ChannelPoint, Vec<Knot>) {
        let mut state = seed;
        let mut next = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as i32
        };
        let start: ChannelPoint = core::array::from_fn(|_| next());
        let mut control = start;
        let mut knots: Vec<Knot> = (0..count)
            .map(|_| {
                for value in &mut control {
                    *value = value.wrapping_add(next() % 5000);
                }
                Knot {
                    control,
                    duration_ticks: 1 + (next() % 40) as u16,
                }
            })
            .collect();
        knots.extend(
            [Knot {
                control,
                duration_ticks: 9,
            }; 2],
        );
        (start, knots)
    }

    /// de Boor's triangle for the span with control points `p` and knots `t` (t[2]..t[3]).
    fn de_boor(p: [f64; 4], t: [f64; 6], x: f64) -> f64 {
        let mut d = p;
        for level in 1..=3 {
            for j in (level..=3).rev() {
                let (low, high) = (t[j - 1], t[j + 3 - level]);
                let share = (x - low) / (high - low);
                d[j] = (1.0 - share) * d[j - 1] + share * d[j];
            }
        }
        d[3]
    }

    #[test]
    fn spans_are_the_b_spline_of_the_contract() {
        let (start, knots) = stream(5, 200);
        let mut unwrapped: Vec<[i64; CHANNELS]> = std::vec![start.map(i64::from); 3];
        let mut durations = std::vec![f64::from(REST_TICKS); 4];
        for knot in &knots {
            let last = *unwrapped.last().unwrap();
            unwrapped.push(core::array::from_fn(|c| {
                last[c] + i64::from(knot.control[c].wrapping_sub(last[c] as i32))
            }));
            durations.push(f64::from(knot.duration_ticks));
        }
        for span in Spans::new(&start, &knots, Units::BASE) {
            let n = span.index;
            // durations[i] belongs to span i - 2.
            let mut t = [0.0; 6];
            for i in 1..6 {
                t[i] = t[i - 1] + durations[n + i - 1];
            }
            assert_eq!(t[3] - t[2], f64::from(span.duration_ticks));
            for channel in [0, 3, 6] {
                let origin = unwrapped[n][channel];
                let p = core::array::from_fn(|i| (unwrapped[n + i][channel] - origin) as f64);
                for part in [0.0, 0.3, 1.0] {
                    let local = part * f64::from(span.duration_ticks);
                    let exact = de_boor(p, t, t[2] + local);
                    let ours = span.polynomial.offset(local)[channel]
                        + (span.base[channel] - origin) as f64;
                    assert!((exact - ours).abs() < 1e-8, "span {n}: {exact} {ours}");
                }
            }
        }
    }

    #[test]
    fn position_rate_and_acceleration_are_continuous() {
        let (start, knots) = stream(17, 300);
        let mut last: Option<Span> = None;
        let mut checked = 0;
        for span in Spans::new(&start, &knots, Units::BASE) {
            if let Some(last) = last {
                let end = f64::from(last.duration_ticks);
                for channel in 0..CHANNELS {
                    let jump = (span.base[channel] - last.base[channel]) as f64
                        + span.polynomial.offset(0.0)[channel]
                        - last.polynomial.offset(end)[channel];
                    assert!(jump.abs() < 1e-8);
                    let rates = [last.polynomial.rate(end), span.polynomial.rate(0.0)];
                    assert!((rates[0][channel] - rates[1][channel]).abs() < 1e-8);
                    assert!(rates[0][channel].abs() <= last.polynomial.rate_bound[channel] + 1e-9);
                    let bends = [
                        last.polynomial.acceleration(end),
                        span.polynomial.acceleration(0.0),
                    ];
                    assert!((bends[0][channel] - bends[1][channel]).abs() < 1e-8);
                    checked += 1;
                }
            }
            last = Some(span);
        }
        assert!(checked > 2000);
    }

    #[test]
    fn the_last_span_ends_exactly_on_the_last_point_in_single_precision() {
        let (start, knots) = stream(99, 50);
        let mut window = SpanWindow::at_rest(&start);
        for knot in &knots {
            window.push(knot);
        }
        assert!(window.ends_at_rest() && !window.is_rest());
        window.push(knots.last().unwrap());
        assert!(window.is_rest());
        let polynomial = window.polynomial::<f32>();
        for t in [0.0, 3.0, 9.0] {
            assert_eq!(polynomial.offset(t), [0.0; CHANNELS]);
        }
        let last = knots.last().unwrap().control;
        assert_eq!(window.base().map(|v| v as i32), last);
    }
}
