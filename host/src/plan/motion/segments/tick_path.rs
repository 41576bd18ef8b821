//! A curve as it is to be run: its channels at every servo tick.
//!
//! In: a path curve and its parameter at ticks 0..=n. Out: channels in natural units. They are made span by
//! span when they are asked for: of a long path all of them would fill the memory, and most spans of a
//! motion that changed a little are known already.

use crate::plan::route::moves::PathCurve;
use headway_protocol::units::CHANNELS;
use std::ops::RangeInclusive;

/// The path by ticks.
pub struct TickPath<'a> {
    curve: &'a PathCurve,
    u_at_tick: &'a [f64],
}

impl<'a> TickPath<'a> {
    /// The curve at the given path parameters, at least one.
    pub fn new(curve: &'a PathCurve, u_at_tick: &'a [f64]) -> Self {
        Self { curve, u_at_tick }
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
        self.curve.value(self.u_at_tick[tick])
    }

    /// Channels at these ticks, as far as the path has them, into `values`.
    pub fn values(&self, ticks: RangeInclusive<usize>, values: &mut Vec<[f64; CHANNELS]>) {
        values.clear();
        let end = (ticks.end() + 1).min(self.u_at_tick.len());
        let places = &self.u_at_tick[*ticks.start()..end];
        values.extend(places.iter().map(|&u| self.curve.value(u)));
    }

    /// Derivative by the path parameter at a tick.
    pub fn tangent(&self, tick: usize) -> [f64; CHANNELS] {
        self.curve.tangent(self.u_at_tick[tick])
    }
}
