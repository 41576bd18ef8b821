//! A curve over time: its channels at every servo tick.
//!
//! In: a path curve and its parameter at ticks 0..=n. Out: channels in natural units. They are evaluated span
//! by span on request: for a long path all of them would fill the memory, and when a motion changes a little
//! most spans are known already. At the curve's ends they equal its end points to the last bit: moves meet
//! there, and both have to quantise to the same value.

use crate::plan::route::moves::PathCurve;
use headway_protocol::segment::SPAN_TICKS_MAX;
use headway_protocol::units::{CHANNELS, Units};
use std::ops::RangeInclusive;

/// So near an end the path is at it, spans: rounding of the time law.
const END_SPANS: f64 = 1e-9;

/// The path by ticks.
pub struct TickPath<'a> {
    curve: &'a PathCurve,
    u_at_tick: &'a [f64],
    span_ticks_max: u16,
    units: Units,
}

impl<'a> TickPath<'a> {
    /// The curve at the given path parameters, at least one.
    pub fn new(curve: &'a PathCurve, u_at_tick: &'a [f64]) -> Self {
        Self {
            curve,
            u_at_tick,
            span_ticks_max: SPAN_TICKS_MAX,
            units: Units::BASE,
        }
    }

    /// The same for a stream of other units than base units.
    pub fn in_units(self, units: Units) -> Self {
        Self { units, ..self }
    }

    /// Units of the stream.
    pub fn units(&self) -> &Units {
        &self.units
    }

    /// The same, each tick this many servo ticks long.
    pub fn on_coarse_ticks(self, coarse: u16) -> Self {
        Self {
            span_ticks_max: (SPAN_TICKS_MAX / coarse).max(1),
            ..self
        }
    }

    /// Longest span of the wire, ticks.
    pub fn span_ticks_max(&self) -> usize {
        usize::from(self.span_ticks_max)
    }

    /// Duration in ticks.
    pub fn ticks(&self) -> usize {
        self.u_at_tick.len() - 1
    }

    /// Path parameter at ticks 0..=n.
    pub fn u_at_tick(&self) -> &'a [f64] {
        self.u_at_tick
    }

    /// Channels at a tick.
    pub fn value(&self, tick: usize) -> [f64; CHANNELS] {
        self.at(self.u_at_tick[tick])
    }

    /// A sum of weighted points is off by rounding, which the wire's grid can make a whole unit.
    fn at(&self, u: f64) -> [f64; CHANNELS] {
        let last = self.curve.span_count() as f64;
        match (self.curve.control.first(), self.curve.control.last()) {
            (Some(first), _) if u <= END_SPANS => *first,
            (_, Some(end)) if u >= last - END_SPANS => *end,
            _ => self.curve.value(u),
        }
    }

    /// Channels at these ticks, as far as the path has them, into `values`.
    pub fn values(&self, ticks: RangeInclusive<usize>, values: &mut Vec<[f64; CHANNELS]>) {
        values.clear();
        let end = (ticks.end() + 1).min(self.u_at_tick.len());
        let places = &self.u_at_tick[*ticks.start()..end];
        values.extend(places.iter().map(|&u| self.at(u)));
    }

    /// Derivative by the path parameter at a tick.
    pub fn tangent(&self, tick: usize) -> [f64; CHANNELS] {
        self.curve.tangent(self.u_at_tick[tick])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: where one move ends the next one begins, to the last bit. Method: curves whose ends lie half a
    /// unit of the wire beside its grid, where a rounding of 10⁻¹⁷ made a unit: the sent curve was then not the
    /// one that had been checked (1.004 of an acceleration limit at a start from rest).
    #[test]
    fn ends_are_the_end_points_to_the_last_bit() {
        let mut off = 0;
        for i in 0..500 {
            let end = 0.00005 + 0.0137 * f64::from(i);
            let point = |k: i32| [end + 0.3 * f64::from(k * k) + 0.1 * f64::from(k); CHANNELS];
            let curve = PathCurve {
                control: (0..6).map(point).collect(),
            };
            off += usize::from(curve.value(0.0) != curve.control[0]);
            let path = TickPath::new(&curve, &[0.0, 2.3, 5.0]);
            let mut values = Vec::new();
            path.values(0..=2, &mut values);
            assert_eq!([values[0], path.value(0)], [curve.control[0]; 2]);
            assert_eq!([values[2], path.value(2)], [curve.control[5]; 2]);
        }
        assert!(off > 50, "{off}");
    }
}
