//! What a layer has inside the walls of its regions.
//!
//! In: lengths and areas of the layers around it (mm, input coordinates). Out: [`Inside`], for the regions of a layer.
//! Why here: layers are gathered by it, and each region is filled by it.

use crate::geometry::polygon::Region;
use crate::plan::layers::bridge_ground::Bridge;
use crate::settings::Infill;

/// What is inside the walls.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inside {
    /// Walls and lines; `None` for loops all the way in.
    pub infill: Option<Infill>,
    /// Area that is solid whatever the lines' density, input coordinates.
    pub solid: Vec<Region>,
    /// What spans open space, input coordinates.
    pub bridges: Vec<Bridge>,
}
