//! The raster of one printing of a region: its swept area, and that of the infill lines' area.
//!
//! In: poses of the finished curve (mm, rad), a region. Out: areas swept once and more often, mm²,
//! on cells of 5 to 20 µm, or larger ones if these would be more than six million.

use crate::geometry::coverage::{Cell, Coverage};
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::frame::Frame;
use crate::geometry::polygon::Region;
use crate::geometry::{Point2, Vector2};

/// What was swept of a region.
#[derive(Clone, Debug)]
pub struct RegionRaster {
    /// The raster's frame in the region's local coordinates.
    pub frame: Frame,
    /// The raster, in that frame.
    pub swept: Coverage,
}

/// Area of the raster's cells in the regions, and of those among them that were swept, mm².
pub fn swept_area_mm2(raster: &RegionRaster, regions: &[Region]) -> [f64; 2] {
    let (frame, raster) = (raster.frame, &raster.swept);
    let cell_mm2 = raster.cell_mm * raster.cell_mm;
    let mut area = [0.0; 2];
    for region in regions.iter().map(|region| frame.region_in(region)) {
        let walls = EdgeIndex::of_region(&region, 10.0 * raster.cell_mm);
        let bounds = region.bounds();
        let cell = |p: Point2| (p - raster.origin) / raster.cell_mm;
        let (low, high) = (cell(bounds.min), cell(bounds.max));
        let columns = low.x.max(0.0) as usize..(high.x.max(0.0) as usize + 1).min(raster.columns);
        for row in low.y.max(0.0) as usize..(high.y.max(0.0) as usize + 1).min(raster.rows) {
            let middle = |number: usize| {
                let column = columns.start + number;
                let middle = Vector2::new(column as f64 + 0.5, row as f64 + 0.5);
                raster.origin + middle * raster.cell_mm
            };
            walls.for_contained(middle(0).y, columns.len(), middle, |number| {
                let column = columns.start + number;
                let swept = raster.cells[row * raster.columns + column] != Cell::Gap;
                area[0] += cell_mm2;
                area[1] += if swept { cell_mm2 } else { 0.0 };
            });
        }
    }
    area
}
