//! Time, volume and path length of a plan by layer and kind of bead.
//!
//! In: a plan (its marks, curves and route). Out: a row for each layer and kind: s, mm³, mm. Not
//! covered: primes and retracts, whose volumes cancel.

use super::Plan;
use crate::job::MotionState;
use crate::plan::pass::PassKind;
use crate::plan::route::moves::way_mm;
use headway_protocol::units::CHANNEL_VOLUME;
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

/// What each pass is, by its number.
pub fn pass_uses(plan: &Plan) -> Vec<Use> {
    let curves = plan.curves.iter();
    curves.map(|curve| Use::of_pass(curve.kind)).collect()
}

/// The uses of every layer; none for a plan without curves of its own.
pub fn layer_uses(plan: &Plan, servo_hz: f64) -> Vec<LayerUse> {
    if plan.curves.is_empty() {
        return Vec::new();
    }
    let what = |state: MotionState, pass: Option<u32>| match state {
        MotionState::Travel => Use::Travel,
        MotionState::Print => {
            let curve = pass.and_then(|pass| plan.curves.get(pass as usize));
            curve.map_or(Use::Walls, |curve| Use::of_pass(curve.kind))
        }
        MotionState::Prime | MotionState::Retract | MotionState::Hold => Use::Standing,
    };
    let mut all: BTreeMap<(u32, Use), [f64; 3]> = BTreeMap::new();
    for mark in &plan.stream.marks {
        let seconds = (mark.end_tick - mark.start_tick) as f64 / servo_hz;
        let key = (mark.layer, what(mark.state, mark.pass));
        all.entry(key).or_default()[0] += seconds;
    }
    for route_move in &plan.route.moves {
        let control = &route_move.curve.control;
        let (Some(first), Some(last)) = (control.first(), control.last()) else {
            continue;
        };
        let of_key = all
            .entry((route_move.layer, what(route_move.state, route_move.pass)))
            .or_default();
        of_key[1] += last[CHANNEL_VOLUME] - first[CHANNEL_VOLUME];
        of_key[2] += way_mm(control);
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
