//! Where the nozzle turns back for its cables: by more than half a turn between two passes.
//!
//! In: the route, and the range of the joint that turns the nozzle. Out: a line, or none if the joint has no
//! ends or never turns so far. A pass is entered within half a turn of any nozzle unless a limit prevents it.

use crate::job::MotionState;
use crate::job::transform::PartTransform;
use crate::plan::route::moves::Route;
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y, CHANNELS};
use std::f64::consts::{PI, TAU};

/// Number of reported places.
const PLACES_TOLD: usize = 3;
/// More than half a turn, with what a curve's ends are off.
const UNWOUND_RAD: f64 = PI + 0.05;

/// A travel on which the nozzle turns back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unwinding {
    /// Where it begins, machine coordinates.
    pub from_mm: [f64; 2],
    /// How far, turns; negative clockwise.
    pub turns: f64,
}

/// All of them, in the order of the route.
pub fn unwindings(route: &Route, settings: &Settings) -> Vec<Unwinding> {
    let joint = settings.turning_joint();
    let has_ends =
        joint.is_some_and(|joint| joint.position_min.is_finite() || joint.position_max.is_finite());
    if !has_ends {
        return Vec::new();
    }
    let mut found = Vec::new();
    let mut travel: Option<([f64; CHANNELS], [f64; CHANNELS])> = None;
    let mut close = |travel: &mut Option<([f64; CHANNELS], [f64; CHANNELS])>| {
        let Some((begin, end)) = travel.take() else {
            return;
        };
        let turned_rad = end[CHANNEL_HEADING] - begin[CHANNEL_HEADING];
        if turned_rad.abs() > UNWOUND_RAD {
            found.push(Unwinding {
                from_mm: [begin[CHANNEL_X], begin[CHANNEL_Y]],
                turns: turned_rad / TAU,
            });
        }
    };
    for route_move in &route.moves {
        let control = &route_move.curve.control;
        let (Some(first), Some(last)) = (control.first(), control.last()) else {
            continue;
        };
        if route_move.state == MotionState::Travel {
            travel = Some((travel.map_or(*first, |(begin, _)| begin), *last));
        } else {
            close(&mut travel);
        }
    }
    close(&mut travel);
    found
}

/// The line.
pub(super) fn note(
    route: &Route,
    transform: &PartTransform,
    settings: &Settings,
) -> Option<String> {
    let found = unwindings(route, settings);
    let joint = settings.turning_joint()?;
    let places: Vec<String> = found
        .iter()
        .take(PLACES_TOLD)
        .map(|unwinding| {
            let [x_mm, y_mm] = unwinding.from_mm;
            let [x, y, _] = transform.to_input([x_mm, y_mm, 0.0]);
            format!("{:.2} turns at ({x:.3}, {y:.3})", unwinding.turns.abs())
        })
        .collect();
    (!found.is_empty()).then(|| {
        format!(
            "the nozzle turns back {} times between passes, to keep within {:.2} to {:.2} turns: {}{}",
            found.len(),
            joint.position_min / TAU,
            joint.position_max / TAU,
            places.join(", "),
            if found.len() > PLACES_TOLD { ", ..." } else { "" },
        )
    })
}
