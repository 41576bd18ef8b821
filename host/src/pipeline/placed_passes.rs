//! Passes in space -> passes in machine coordinates, led past singular points.

use super::{PlanError, start_pose};
use crate::geometry::polygon::Box2;
use crate::job::transform::PartTransform;
use crate::plan::motion::best_place::{FoundPlace, best_place, moved};
use crate::plan::motion::singular::{Passes, SingularPlaces, passed_places};
use crate::plan::route::curve_cuts::Cuts;
use crate::settings::{Place, Settings};

/// Passes at their position on the machine, led past singular poses.
pub(crate) struct PlacedPasses {
    pub passes: Passes,
    /// Where they were cut.
    pub cuts: Option<Cuts>,
    pub transform: PartTransform,
    pub found_place: Option<FoundPlace>,
    pub singular: SingularPlaces,
}

/// Finds the best position, if requested, and leads the tool axis past singular poses, or cuts passes
/// there if they `may_lift`.
pub(crate) fn placed_passes(
    mut passes: Passes,
    mut transform: PartTransform,
    bounds: Box2,
    settings: &Settings,
    may_lift: bool,
) -> Result<PlacedPasses, PlanError> {
    let start = start_pose(settings);
    let mut found_place = None;
    if settings.place == Place::Best && settings.at_mm.is_none() {
        let room_mm = transform.room_mm(bounds, settings);
        let found = best_place(&passes, room_mm, start, settings, may_lift)?;
        passes = moved(&passes, found.shift_mm, 0.0);
        transform.offset_mm[0] += found.shift_mm[0];
        transform.offset_mm[1] += found.shift_mm[1];
        found_place = Some(found);
    }
    let led = passed_places(&passes, start, settings, may_lift)?;
    Ok(PlacedPasses {
        passes: led.passes,
        cuts: led.cuts,
        transform,
        found_place,
        singular: led.singular,
    })
}
