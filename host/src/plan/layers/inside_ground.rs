//! The ground inside the walls of a region: which of it is bridged, filled, or has sparse lines.
//!
//! In: ground inside the walls (mm, in the region's frame), areas of the layer (mm, input coordinates). Out: the parts of
//! that ground, in the region's frame. Leaves out where these areas come from.

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::geometry::boolean::{difference, grown, intersection};
use crate::geometry::frame::Frame;
use crate::geometry::polygon::Region;
use crate::plan::layers::bridge_ground::is_wide;

/// Where the ground of a region is.
pub struct InsideGround<'a> {
    /// The region's frame.
    pub frame: &'a Frame,
    /// From the contour's local coordinates to those of the input.
    pub offset: Vector2,
    /// The nozzle.
    pub aperture: &'a Aperture,
}

impl InsideGround<'_> {
    /// The open area of a bridge: its span, and a bead's width more on its anchors.
    pub fn bridged(&self, ground: &[Region], open: &[Region]) -> Vec<Region> {
        let mut inside = intersection(&self.local(ground), open);
        // What the walls leave of it may be too thin to be worth lines of its own.
        inside.retain(|region| is_wide(region, self.aperture.major_mm()));
        if inside.is_empty() {
            return inside;
        }
        intersection(&grown(&inside, 2.0 * self.aperture.major_mm()), open)
    }

    /// The area inside the walls that is filled, and the rest. The filled area extends into the
    /// rest by a bead's width, to bond to the lines there; strips thinner than the narrowest bead,
    /// which the walls leave on a slope, are not filled.
    pub fn divided(&self, open: &[Region], solid: &[Region]) -> [Vec<Region>; 2] {
        if solid.is_empty() {
            return [Vec::new(), open.to_vec()];
        }
        let aperture = self.aperture;
        let mut inside = intersection(&self.local(solid), open);
        inside.retain(|region| is_wide(region, aperture.minor_mm()));
        let solid = intersection(&grown(&inside, 2.0 * aperture.major_mm()), open);
        let mut sparse = difference(open, &solid);
        // A strip in which no bead fits gets no lines.
        let (sparse_ground, strips): (Vec<Region>, Vec<Region>) = sparse
            .drain(..)
            .partition(|region| is_wide(region, 2.0 * aperture.major_mm()));
        if strips.is_empty() {
            return [solid, sparse_ground];
        }
        [difference(open, &sparse_ground), sparse_ground]
    }

    /// Regions of input coordinates in the region's frame.
    fn local(&self, regions: &[Region]) -> Vec<Region> {
        let shifted = regions.iter().map(|region| region.shifted(-self.offset));
        shifted
            .map(|region| self.frame.region_in(&region))
            .collect()
    }
}
