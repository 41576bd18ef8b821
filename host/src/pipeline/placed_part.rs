//! A part that is planned before its headings are known -> its place on the machine, and the settings there.
//!
//! On an arm these have the joint solution that reaches all of the part's box and the stops of a wrist that turns the
//! nozzle ([`crate::plan::motion::box_reach`]); `--place best` moves the part to where its joints move least.

use super::start_pose;
use crate::geometry::polygon::Box2;
use crate::job::transform::PartTransform;
use crate::plan::motion::best_place::{FoundPlace, shifts};
use crate::plan::motion::box_reach::{BoxReach, box_reach};
use crate::settings::{Place, Settings};
use crate::text::refusal::Refusal;
use headway_firmware::kinematics::winds;
use rayon::prelude::*;

/// Places along x and y that are tried.
const PLACES: usize = 7;

/// A part at its place.
pub(crate) struct PlacedPart {
    pub transform: PartTransform,
    /// With the joint solution of an arm, and its wrist's stops.
    pub settings: Settings,
    /// The place found, if one was requested.
    pub found: Option<FoundPlace>,
}

/// Places a box that reaches from the first to the second height above the part's own z = 0, mm. Where the machine does not
/// reach all of it the settings stay as they are: the check of the joints' ranges names the place.
///
/// # Errors
/// If it is larger than the work area, or outside it.
pub(crate) fn placed_part(
    bounds: Box2,
    heights_mm: [f64; 2],
    settings: &Settings,
) -> Result<PlacedPart, Refusal> {
    let transform = PartTransform::choose_box(bounds, heights_mm, settings)?;
    let mut placed = PlacedPart {
        transform,
        settings: settings.clone(),
        found: None,
    };
    let is_asked = settings.place == Place::Best && settings.at_mm.is_none();
    if winds(&settings.machine.kinematics) == 0 {
        placed.found = is_asked.then_some(FoundPlace {
            shift_mm: [0.0; 2],
            reached: 1,
            tried: 1,
        });
        return Ok(placed);
    }
    let reach_at = |[x, y]: [f64; 2]| {
        let [along, across, up] = transform.offset_mm;
        let at = [along + x, across + y];
        let low = [
            bounds.min.x + at[0],
            bounds.min.y + at[1],
            heights_mm[0] + up,
        ];
        let high = [
            bounds.max.x + at[0],
            bounds.max.y + at[1],
            heights_mm[1] + up + settings.lift_mm,
        ];
        box_reach([low, high], &start_pose(settings), settings).ok()
    };
    let mut reach = None;
    if is_asked {
        let shifts = shifts(transform.room_mm(bounds, settings), PLACES);
        let reached: Vec<([f64; 2], BoxReach)> = shifts
            .par_iter()
            .filter_map(|shift| Some((*shift, reach_at(*shift)?)))
            .collect();
        let count = reached.len();
        let best = reached.into_iter().min_by(|(_, a), (_, b)| {
            let is_short = |of: &BoxReach| of.turn_rad <= settings.aperture.period_rad();
            (is_short(a).cmp(&is_short(b))).then(a.seconds.total_cmp(&b.seconds))
        });
        if let Some((shift_mm, best)) = best {
            placed.transform.offset_mm[0] += shift_mm[0];
            placed.transform.offset_mm[1] += shift_mm[1];
            placed.found = Some(FoundPlace {
                shift_mm,
                reached: count,
                tried: shifts.len(),
            });
            reach = Some(best);
        }
    }
    let reach = reach.or_else(|| reach_at([0.0; 2]));
    // Without a wrist the joint solution is chosen by the whole route.
    if let Some(reach) = reach.filter(|reach| reach.settings.wrist.is_some()) {
        placed.settings = reach.settings;
    }
    Ok(placed)
}
