//! Area that is uncovered at the same position on many layers: a weak column.
//!
//! Input: the coverage rasters of a plan. Output: cells of [`CELL_MM`] in input coordinates, each with the number of
//! layers on which most of it is uncovered. A margin along the outline of half the narrowest bead's width is ignored:
//! no aperture reaches the corners there, whatever the plan. Not covered: layers with a sparse infill.

use super::Plan;
use crate::geometry::edge_index::EdgeIndex;
use std::collections::BTreeMap;

/// Side of a cell: half the width of the narrowest bead of the default nozzle.
pub const CELL_MM: f64 = 0.1;
/// Share of a cell that is open where it counts as open.
const OPEN_SHARE: f64 = 0.5;

/// Cells that are open, and on how many layers.
pub type OpenCells = BTreeMap<[i32; 2], u32>;

/// Open cells of the layers that are to be filled, and how many such layers there are.
pub fn open_cells(plan: &Plan, edge_mm: f64) -> (OpenCells, u32) {
    let mut all = OpenCells::new();
    let mut known: BTreeMap<usize, Vec<[i32; 2]>> = BTreeMap::new();
    let mut layers: Vec<u32> = Vec::new();
    for (number, print) in plan.prints.iter().enumerate() {
        let infill = plan.kinds[print.kind].infill;
        if infill.is_some_and(|infill| !infill.is_solid()) {
            continue;
        }
        layers.push(print.layer);
        let like = print.like.min(number);
        let cells = known
            .entry(like)
            .or_insert_with(|| cells_of(plan, like, edge_mm));
        for cell in cells {
            *all.entry(*cell).or_default() += 1;
        }
    }
    layers.dedup();
    (all, layers.len() as u32)
}

/// The cells of a printing that are open.
fn cells_of(plan: &Plan, print: usize, edge_mm: f64) -> Vec<[i32; 2]> {
    let Some(Some(raster)) = plan.measured.rasters.get(print) else {
        return Vec::new();
    };
    let contour = &plan.region_of(&plan.prints[print]).contour;
    let outline = EdgeIndex::of_region(&contour.region, edge_mm.max(CELL_MM));
    let mut open_mm2: BTreeMap<[i32; 2], f64> = BTreeMap::new();
    for gap in raster.swept.gaps() {
        let local = raster.frame.point_out(gap);
        if outline.nearest_within(local, edge_mm).is_some() {
            continue;
        }
        let at = contour.to_input(local);
        let cell = [at.x, at.y].map(|v| (v / CELL_MM).floor() as i32);
        *open_mm2.entry(cell).or_default() += raster.swept.cell_mm.powi(2);
    }
    let least_mm2 = OPEN_SHARE * CELL_MM * CELL_MM;
    let open = open_mm2.into_iter();
    open.filter(|(_, area_mm2)| *area_mm2 >= least_mm2)
        .map(|(cell, _)| cell)
        .collect()
}

/// The largest number of layers on which a cell is uncovered, and the area that is uncovered on half
/// of `layers` or more, mm².
pub fn stacked(cells: &OpenCells, layers: u32) -> (u32, f64) {
    let most = cells.values().max().copied().unwrap_or(0);
    let often = cells
        .values()
        .filter(|&&count| count > 1 && 2 * count >= layers);
    (most, often.count() as f64 * CELL_MM * CELL_MM)
}
