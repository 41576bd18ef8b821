//! The cells of a raster that a placed aperture covers.

use super::Point2;
use super::aperture::Aperture;
use super::clearance::Configuration;
use super::coverage::RowsOfShape;
use super::polygon::Box2;

/// A raster's place and size; cells are numbered row by row from the lower left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellGrid {
    /// Lower left corner of cell 0.
    pub origin: Point2,
    /// Cell size, mm.
    pub cell_mm: f64,
    /// Cells in x.
    pub columns: usize,
    /// Cells in y.
    pub rows: usize,
}

impl CellGrid {
    /// A grid over `bounds` with cells of `cell_mm`, larger ones where that would make more than
    /// `cells_max`.
    pub fn over(bounds: &Box2, cell_mm: f64, cells_max: usize) -> CellGrid {
        let size = bounds.max - bounds.min;
        let least_mm = (size.x * size.y / cells_max as f64).sqrt();
        let cell_mm = cell_mm.max(least_mm);
        let cells = |length_mm: f64| (length_mm / cell_mm).ceil() as usize + 1;
        CellGrid {
            origin: bounds.min,
            cell_mm,
            columns: cells(size.x),
            rows: cells(size.y),
        }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// True without cells.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Area of one cell, mm².
    pub fn cell_area_mm2(&self) -> f64 {
        self.cell_mm.powi(2)
    }

    /// Visits the rows of cells whose centres lie in the placed aperture: number of the row's first
    /// cell, first and last column.
    pub fn for_rows(
        &self,
        aperture: &Aperture,
        at: Configuration,
        mut visit: impl FnMut(usize, usize, usize),
    ) {
        let shape = RowsOfShape::new(aperture, at.heading_rad);
        let row_of = |y: f64| ((y - self.origin.y) / self.cell_mm).floor();
        let first = row_of(at.center.y - shape.below_mm).max(0.0) as usize;
        let last = row_of(at.center.y + shape.above_mm).min(self.rows as f64 - 1.0);
        for row in first..=last.max(0.0) as usize {
            let y = self.origin.y + (row as f64 + 0.5) * self.cell_mm;
            let Some([low, high]) = shape.range(y - at.center.y) else {
                continue;
            };
            let column_of = |x: f64| (at.center.x + x - self.origin.x) / self.cell_mm - 0.5;
            let from = column_of(low).ceil().max(0.0);
            let to = column_of(high).floor().min(self.columns as f64 - 1.0);
            if from <= to {
                visit(row * self.columns, from as usize, to as usize);
            }
        }
    }
}
