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

    /// All of its cells.
    pub fn window(&self) -> CellWindow {
        CellWindow {
            rows: [0, self.rows - 1],
            columns: [0, self.columns - 1],
        }
    }

    /// Visits the rows of cells whose centres lie in the placed aperture: number of the row's first
    /// cell, first and last column.
    pub fn for_rows(
        &self,
        aperture: &Aperture,
        at: Configuration,
        visit: impl FnMut(usize, usize, usize),
    ) {
        self.for_rows_within(&self.window(), aperture, at, visit);
    }

    /// The same for the cells of a window alone.
    pub fn for_rows_within(
        &self,
        window: &CellWindow,
        aperture: &Aperture,
        at: Configuration,
        mut visit: impl FnMut(usize, usize, usize),
    ) {
        let middle = (at.center.y - self.origin.y) / self.cell_mm;
        let reach = aperture.reach_mm() / self.cell_mm + 1.0;
        if middle + reach < window.rows[0] as f64 || middle - reach > window.rows[1] as f64 {
            return;
        }
        let shape = RowsOfShape::new(aperture, at.heading_rad);
        let row_of = |y: f64| (y - self.origin.y) / self.cell_mm;
        let above = row_of(at.center.y + shape.above_mm);
        if above < 0.0 {
            return;
        }
        let first = (row_of(at.center.y - shape.below_mm) as usize).max(window.rows[0]);
        let last = (above as usize).min(window.rows[1]);
        for row in first..=last {
            let y = self.origin.y + (row as f64 + 0.5) * self.cell_mm;
            let Some([low, high]) = shape.range(y - at.center.y) else {
                continue;
            };
            let column_of = |x: f64| (at.center.x + x - self.origin.x) / self.cell_mm - 0.5;
            let (low, high) = (column_of(low), column_of(high));
            if high < 0.0 {
                continue;
            }
            let from = index_above(low).max(window.columns[0]);
            let to = (high as usize).min(window.columns[1]);
            if from <= to {
                visit(row * self.columns, from, to);
            }
        }
    }
}

/// The least whole number that is not below `value`, at least 0 (`ceil` is a call on plain x86-64).
fn index_above(value: f64) -> usize {
    let whole = value as usize;
    whole + usize::from((whole as f64) < value)
}

/// A rectangle of cells, first and last of each included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellWindow {
    /// Rows.
    pub rows: [usize; 2],
    /// Columns.
    pub columns: [usize; 2],
}

impl CellWindow {
    /// One that holds nothing, to be grown.
    pub fn empty() -> CellWindow {
        CellWindow {
            rows: [usize::MAX, 0],
            columns: [usize::MAX, 0],
        }
    }

    /// Grows by a part of a row.
    pub fn grow(&mut self, row: usize, from: usize, to: usize) {
        self.rows = [self.rows[0].min(row), self.rows[1].max(row)];
        self.columns = [self.columns[0].min(from), self.columns[1].max(to)];
    }
}
