//! A curve as it is to be run: its channels at every servo tick.
//!
//! In: a path curve and its parameter at ticks 0..=n. Out: channels in natural units. Tangents are
//! made when they are asked for, or kept where each is asked for several times.

use crate::plan::route::moves::PathCurve;
use headway_protocol::units::CHANNELS;
use rayon::prelude::*;

/// Ticks that are worth a thread.
const TICKS_MIN: usize = 1024;

/// The path by ticks.
pub struct TickPath<'a> {
    curve: &'a PathCurve,
    u_at_tick: &'a [f64],
    value: Vec<[f64; CHANNELS]>,
    /// The tangents, or none.
    kept: Vec<[f64; CHANNELS]>,
}

impl<'a> TickPath<'a> {
    /// The curve at the given path parameters, at least one.
    pub fn new(curve: &'a PathCurve, u_at_tick: &'a [f64]) -> Self {
        Self {
            value: at_ticks(u_at_tick, |u| curve.value(u)),
            kept: Vec::new(),
            curve,
            u_at_tick,
        }
    }

    /// The same with its tangents.
    pub fn with_tangents(self) -> Self {
        Self {
            kept: at_ticks(self.u_at_tick, |u| self.curve.tangent(u)),
            ..self
        }
    }

    /// Duration in ticks.
    pub fn ticks(&self) -> usize {
        self.value.len() - 1
    }

    /// Path parameter at ticks 0..=n.
    pub fn u_at_tick(&self) -> &'a [f64] {
        self.u_at_tick
    }

    /// Channels at ticks 0..=n.
    pub fn value(&self) -> &[[f64; CHANNELS]] {
        &self.value
    }

    /// Derivative by the path parameter at a tick.
    pub fn tangent(&self, tick: usize) -> [f64; CHANNELS] {
        let kept = self.kept.get(tick).copied();
        kept.unwrap_or_else(|| self.curve.tangent(self.u_at_tick[tick]))
    }
}

fn at_ticks(u_at_tick: &[f64], of: impl Fn(f64) -> [f64; CHANNELS] + Sync) -> Vec<[f64; CHANNELS]> {
    let ticks = u_at_tick.par_iter().with_min_len(TICKS_MIN);
    ticks.map(|&u| of(u)).collect()
}
