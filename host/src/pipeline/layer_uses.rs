//! Time, volume and path length of a plan by layer and kind of bead.
//!
//! In: a plan (its marks, curves and route). Out: a row for each layer and kind: s, mm³, mm. Not
//! covered: primes and retracts, whose volumes cancel.

use super::Plan;
use crate::job::MotionState;
use crate::plan::layers::PlanePass;
use crate::plan::pass::PassKind;
use crate::plan::route::moves::way_mm;
use headway_protocol::units::{CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNELS};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What time is spent on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Use {
    /// Loops along the outline.
    Walls,
    /// Lines of solid infill.
    Solid,
    /// Lines of a sparse infill.
    Sparse,
    /// Lines over open space.
    Bridge,
    /// Skirt and brim.
    Skirt,
    /// Moves without flow.
    Travel,
    /// Primes, retracts and rests.
    Standing,
}

impl Use {
    /// As the figures have it.
    pub fn name(self) -> &'static str {
        match self {
            Use::Walls => "walls",
            Use::Solid => "solid",
            Use::Sparse => "sparse",
            Use::Bridge => "bridge",
            Use::Skirt => "skirt",
            Use::Travel => "travel",
            Use::Standing => "standing",
        }
    }

    fn of_pass(kind: PassKind) -> Use {
        match kind {
            PassKind::TwoPass | PassKind::OnePass => Use::Walls,
            PassKind::Infill => Use::Solid,
            PassKind::Sparse => Use::Sparse,
            PassKind::Bridge | PassKind::Roof => Use::Bridge,
            PassKind::Skirt => Use::Skirt,
        }
    }
}

/// What a pass is, and by servo ticks from its start on where it is something else.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PassUse {
    /// At its start.
    pub first: Use,
    /// Then, in order.
    pub then: Vec<(u64, Use)>,
}

impl PassUse {
    /// What it is so many ticks after its start.
    pub fn at(&self, ticks: u64) -> Use {
        let begun = self.then.iter().rev().find(|(from, _)| *from <= ticks);
        begun.map_or(self.first, |(_, what)| *what)
    }

    /// Its parts within so many ticks: how long each lasts.
    fn parts(&self, ticks: u64) -> impl Iterator<Item = (Use, u64)> + '_ {
        let froms = [(0, self.first)]
            .into_iter()
            .chain(self.then.iter().copied());
        let ends = self.then.iter().map(|(from, _)| *from).chain([ticks]);
        froms
            .zip(ends)
            .map(|((from, what), end)| (what, end.saturating_sub(from)))
    }
}

/// Time and material of a layer for one of them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LayerUse {
    /// Layer from 0.
    pub layer: u32,
    /// The kind of use.
    pub what: Use,
    /// How long.
    pub seconds: f64,
    /// The deposited volume.
    pub volume_mm3: f64,
    /// Path length of the tip.
    pub way_mm: f64,
}

impl LayerUse {
    /// The use of a travel by itself, whose layer its marks have.
    pub fn of_travel(plan: &Plan) -> Option<LayerUse> {
        Some(LayerUse {
            layer: plan.stream.marks.first()?.layer,
            what: Use::Travel,
            seconds: plan.motion.duration_s,
            volume_mm3: 0.0,
            way_mm: (plan.route.moves.iter())
                .map(|route_move| way_mm(&route_move.curve.control))
                .sum(),
        })
    }
}

/// What each pass is, by its number. Where its kind changes is the tick at which the tip is nearest to that place of its
/// curve.
pub fn pass_uses(plan: &Plan) -> Vec<PassUse> {
    let of_curve = |curve: &PlanePass| PassUse {
        first: Use::of_pass(curve.kind),
        then: Vec::new(),
    };
    let mut uses: Vec<PassUse> = plan.curves.iter().map(of_curve).collect();
    let changes = |pass: u32| {
        let curve = plan.curves.get(pass as usize)?;
        (!curve.then.is_empty()).then_some(curve)
    };
    let mut nearest: BTreeMap<(u32, usize), (f64, u64)> = BTreeMap::new();
    let mut places: BTreeMap<u32, Vec<[f64; 2]>> = BTreeMap::new();
    for route_move in &plan.route.moves {
        let Some((pass, curve)) = route_move
            .pass
            .and_then(|pass| Some((pass, changes(pass)?)))
        else {
            continue;
        };
        let control = &route_move.curve.control;
        if control.len() == curve.control.len() {
            let place =
                |(index, _): &(usize, PassKind)| [CHANNEL_X, CHANNEL_Y].map(|k| control[*index][k]);
            places.insert(pass, curve.then.iter().map(place).collect());
        }
    }
    if places.is_empty() {
        return uses;
    }
    for (span, mark) in plan.stream.marked_spans() {
        let Some((pass, mark)) = mark.and_then(|mark| Some((mark.pass?, mark))) else {
            continue;
        };
        let Some(of_pass) = places.get(&pass) else {
            continue;
        };
        let at = span.position(0.0);
        for (number, [x, y]) in of_pass.iter().enumerate() {
            let away_mm = (at[CHANNEL_X] - x).hypot(at[CHANNEL_Y] - y);
            let best = nearest.entry((pass, number)).or_insert((f64::INFINITY, 0));
            if away_mm < best.0 {
                *best = (away_mm, span.start_tick.saturating_sub(mark.start_tick));
            }
        }
    }
    for ((pass, number), (_, ticks)) in nearest {
        let (_, kind) = plan.curves[pass as usize].then[number];
        let then = &mut uses[pass as usize].then;
        let last = then.last().map_or(0, |(from, _)| *from);
        then.push((ticks.max(last), Use::of_pass(kind)));
    }
    uses
}

/// The uses of every layer by those of its passes; none for a plan without curves of its own.
pub fn layer_uses(plan: &Plan, uses: &[PassUse], servo_hz: f64) -> Vec<LayerUse> {
    if plan.curves.is_empty() {
        return Vec::new();
    }
    let other = |state: MotionState| match state {
        MotionState::Print => Use::Walls,
        MotionState::Travel => Use::Travel,
        MotionState::Prime | MotionState::Retract | MotionState::Hold => Use::Standing,
    };
    let printed = |state: MotionState, pass: Option<u32>| {
        let pass = pass.filter(|_| state == MotionState::Print)? as usize;
        Some((uses.get(pass)?, plan.curves.get(pass)?))
    };
    let mut all: BTreeMap<(u32, Use), [f64; 3]> = BTreeMap::new();
    for mark in &plan.stream.marks {
        let mut add = |what: Use, ticks: u64| {
            all.entry((mark.layer, what)).or_default()[0] += ticks as f64 / servo_hz;
        };
        let ticks = mark.end_tick - mark.start_tick;
        match printed(mark.state, mark.pass) {
            Some((of_pass, _)) => of_pass.parts(ticks).for_each(|(what, own)| add(what, own)),
            None => add(other(mark.state), ticks),
        }
    }
    for route_move in &plan.route.moves {
        let mut add = |what: Use, control: &[[f64; CHANNELS]]| {
            let (Some(first), Some(last)) = (control.first(), control.last()) else {
                return;
            };
            let of_key = all.entry((route_move.layer, what)).or_default();
            of_key[1] += last[CHANNEL_VOLUME] - first[CHANNEL_VOLUME];
            of_key[2] += way_mm(control);
        };
        let control = &route_move.curve.control;
        let Some((of_pass, curve)) = printed(route_move.state, route_move.pass) else {
            add(other(route_move.state), control);
            continue;
        };
        let froms = [0]
            .into_iter()
            .chain(curve.then.iter().map(|(from, _)| *from));
        let froms: Vec<usize> = froms.take(1 + of_pass.then.len()).collect();
        for (part, from) in froms.iter().enumerate() {
            let end = froms.get(part + 1).map_or(control.len(), |end| end + 1);
            let what = part
                .checked_sub(1)
                .map_or(of_pass.first, |before| of_pass.then[before].1);
            add(what, &control[*from..end]);
        }
    }
    let rows = all.into_iter();
    rows.map(|((layer, what), [seconds, volume_mm3, way_mm])| LayerUse {
        layer,
        what,
        seconds,
        volume_mm3,
        way_mm,
    })
    .collect()
}
