//! A bead's moves -> its parts between the nozzle's stops, each from rest to rest.

use super::{BeadCurve, BeadMove};
use crate::plan::headings::stops::Stops;
use crate::plan::route::curve_cuts::turning_back::turned_back;
use crate::plan::route::curve_cuts::{CurvePart, CutPasses};
use crate::plan::route::moves::PathCurve;
use crate::settings::Settings;
use headway_protocol::units::CHANNEL_HEADING;

/// Headings of all control points of some moves.
pub fn headings_rad(moves: &[BeadMove]) -> impl Iterator<Item = f64> {
    let control = moves.iter().flat_map(|of_move| &of_move.control);
    control.map(|point| point[CHANNEL_HEADING])
}

impl BeadCurve {
    /// Takes its moves, in one part or in as many as the nozzle's stops ask for, with some room before these.
    pub fn parts(&mut self, room_rad: f64, settings: &Settings) -> Vec<Vec<BeadMove>> {
        let moves = std::mem::take(&mut self.moves);
        // Nearly all: they are not copied.
        if Stops::of(settings).headings_fit(headings_rad(&moves), room_rad) {
            return vec![moves];
        }
        let curve = |of_move: &BeadMove| PathCurve {
            control: of_move.control.clone(),
        };
        let curves = vec![moves.iter().map(curve).collect()];
        let Some(CutPasses { passes, cuts }) = turned_back(&curves, |_| true, room_rad, settings)
        else {
            return vec![moves];
        };
        let speeds: Vec<_> = moves
            .iter()
            .map(|of_move| of_move.speeds_mm_s.clone())
            .collect();
        let mut parts = cuts.parts.iter().zip(cuts.speeds(&speeds));
        let made = passes.into_iter().map(|pass| {
            let own = pass.into_iter().zip(parts.by_ref());
            let part_move = |(curve, (part, speeds_mm_s)): (PathCurve, (&CurvePart, _))| {
                let whole = &moves[part.curve];
                BeadMove {
                    control: curve.control,
                    speed_mm_s: whole.speed_mm_s,
                    speeds_mm_s,
                }
            };
            own.map(part_move).collect()
        });
        made.collect()
    }
}
