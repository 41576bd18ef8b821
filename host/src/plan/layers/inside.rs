//! What a layer has inside the walls of its regions.
//!
//! In: lengths and areas of the layers around it (mm, input coordinates). Out: [`Inside`], for the regions of a layer or
//! for those of an object on it. Why here: layers are gathered by it, and each region is filled by it.

use crate::geometry::Point2;
use crate::geometry::polygon::{Box2, Region};
use crate::plan::layers::bridge_ground::Bridge;
use crate::settings::kinds::Kinds;
use crate::settings::{Infill, Seam};

/// What is inside the walls.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inside {
    /// Walls and lines; `None` for loops all the way in.
    pub infill: Option<Infill>,
    /// Area that is solid whatever the lines' density, input coordinates.
    pub solid: Vec<Region>,
    /// What spans open space, input coordinates.
    pub bridges: Vec<Bridge>,
    /// Area of other lines, input coordinates: together all of the region, if there are any.
    pub areas: Vec<(Infill, Vec<Region>)>,
    /// Speeds and flows by kind, where they are not the job's.
    pub kinds: Option<Kinds>,
    /// The seam, where it is not the job's.
    pub seam: Option<Seam>,
}

/// What is inside the walls of an object with settings of its own, or of a part of it that has walls of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnInside {
    /// The box of the object, input coordinates.
    pub around: Box2,
    /// The part of the layer, input coordinates; empty for all of the object.
    pub ground: Vec<Region>,
    /// What is inside.
    pub inside: Inside,
}

impl OwnInside {
    /// True if it is that of a region with this box, and this place well within it.
    pub fn has(&self, bounds: Box2, place: Option<Point2>) -> bool {
        let is_own = |at: Point2| self.ground.iter().any(|region| region.contains(at));
        let is_whole = self.ground.is_empty();
        has_middle(self.around, bounds) && (is_whole || place.is_none_or(is_own))
    }
}

/// True if the middle of a box is in another.
pub fn has_middle(around: Box2, of: Box2) -> bool {
    let middle = nalgebra::center(&of.min, &of.max);
    (0..2).all(|axis| (around.min[axis]..=around.max[axis]).contains(&middle[axis]))
}
