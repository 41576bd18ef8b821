//! The raster of a layer on a surface: cells with what visited them, and the places that nothing did.
//!
//! In: cells of a chart, each with its point on the layer and its area there (mm). Out: [`OpenPlace`]s.

use crate::geometry::{Point2, Vector2};
use nalgebra::Vector3;

/// Ground that nothing covers, connected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpenPlace {
    /// Its area.
    pub area_mm2: f64,
    /// A place in it, near its middle.
    pub at_mm: [f64; 3],
}

/// The raster: cells row by row.
pub(super) struct Raster {
    /// Its lowest corner.
    pub origin: Point2,
    /// Side of a cell.
    pub cell_mm: f64,
    /// Cells of a row.
    pub columns: usize,
    /// Number of rows.
    pub rows: usize,
}

impl Raster {
    /// The middle of a cell, by its number.
    pub fn middle(&self, cell: usize) -> Point2 {
        let (column, row) = (cell % self.columns, cell / self.columns);
        self.origin + self.cell_mm * Vector2::new(column as f64 + 0.5, row as f64 + 0.5)
    }
}

/// A cell of a layer.
#[derive(Clone, Copy)]
pub(super) struct GroundCell {
    /// Its point on the layer.
    pub at_mm: Vector3<f64>,
    /// Its area there.
    pub area_mm2: f64,
    /// True in what is to be covered.
    pub is_inside: bool,
}

/// The last visit of a cell: pass and path; whether there was one before that counts.
#[derive(Clone, Copy)]
pub(super) struct Visit {
    /// The pass.
    pub pass: u32,
    /// Path of the pass up to there.
    pub path_mm: f64,
    /// Whether an earlier visit counts.
    pub is_again: bool,
}

/// Of a cell that nothing visited.
pub(super) const NO_VISIT: Visit = Visit {
    pass: u32::MAX,
    path_mm: 0.0,
    is_again: false,
};

/// Connected open cells of the regions, the largest first.
pub(super) fn open_places(
    raster: &Raster,
    cells: &[GroundCell],
    visits: &[Visit],
) -> Vec<OpenPlace> {
    let is_open = |cell: usize| cells[cell].is_inside && visits[cell].pass == NO_VISIT.pass;
    let mut is_seen = vec![false; cells.len()];
    let mut found = Vec::new();
    for first in 0..cells.len() {
        if is_seen[first] || !is_open(first) {
            continue;
        }
        is_seen[first] = true;
        let (mut piece, mut next) = (vec![first], 0);
        while let Some(&cell) = piece.get(next) {
            next += 1;
            let column = cell % raster.columns;
            let beside = [
                (column > 0).then(|| cell - 1),
                (column + 1 < raster.columns).then_some(cell + 1),
                cell.checked_sub(raster.columns),
                Some(cell + raster.columns).filter(|&above| above < cells.len()),
            ];
            for other in beside.into_iter().flatten() {
                if !is_seen[other] && is_open(other) {
                    is_seen[other] = true;
                    piece.push(other);
                }
            }
        }
        let area_mm2 = piece.iter().map(|&cell| cells[cell].area_mm2).sum();
        let sum: Vector3<f64> = piece.iter().map(|&cell| cells[cell].at_mm).sum();
        let middle = sum / piece.len() as f64;
        let away = |cell: &usize| (cells[*cell].at_mm - middle).norm_squared();
        let nearest = piece.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        let at = nearest.map_or(middle, |&cell| cells[cell].at_mm);
        found.push(OpenPlace {
            area_mm2,
            at_mm: at.into(),
        });
    }
    found.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    found
}
