//! Area that was covered twice in a layer, as cells for the page's script.
//!
//! In: a raster and its frame. Out: at most [`SIDE_MAX`] cells along a side, row by row, as the numbers at which runs of
//! cells that were covered twice begin and end.

use super::columns::Steps;
use crate::geometry::Point2;
use crate::geometry::coverage::{Cell, Coverage};
use crate::geometry::frame::Frame;
use serde::Serialize;

/// Most cells along a side; finer rasters are shown in blocks.
const SIDE_MAX: usize = 1600;

#[derive(Serialize)]
pub struct Ground {
    /// Canvas matrix from the raster's frame to the input's coordinates.
    matrix: [f64; 6],
    origin: [f64; 2],
    cell_mm: f64,
    columns: usize,
    rows: usize,
    twice: Steps,
}

/// The cells of a raster.
pub fn ground(frame: &Frame, swept: &Coverage) -> Ground {
    let block = swept.columns.max(swept.rows).div_ceil(SIDE_MAX).max(1);
    let (columns, rows) = (swept.columns.div_ceil(block), swept.rows.div_ceil(block));
    let mut twice = vec![false; columns * rows];
    for (number, cell) in swept.cells.iter().enumerate() {
        let (column, row) = (number % swept.columns, number / swept.columns);
        twice[row / block * columns + column / block] |= *cell == Cell::Overlap;
    }
    let changes = (0..twice.len()).filter(|&n| twice[n] != (n > 0 && twice[n - 1]));
    let (x, y) = (
        frame.vector_out([1.0, 0.0].into()),
        frame.vector_out([0.0, 1.0].into()),
    );
    let at = frame.point_out(Point2::origin());
    Ground {
        matrix: [x.x, x.y, y.x, y.y, at.x, at.y],
        origin: [swept.origin.x, swept.origin.y],
        cell_mm: swept.cell_mm * block as f64,
        columns,
        rows,
        twice: Steps::of(changes.map(|n| n as f64), 1.0),
    }
}

#[cfg(test)]
mod tests {
    //! Goal: what was covered twice is where the raster has it. Method: rasters by hand, one finer than the page's cells.
    use super::*;

    fn of(columns: usize, rows: usize, twice: &[usize]) -> Ground {
        let mut cells = vec![Cell::Covered; columns * rows];
        twice.iter().for_each(|n| cells[*n] = Cell::Overlap);
        let raster = Coverage {
            origin: Point2::origin(),
            cell_mm: 0.1,
            columns,
            rows,
            cells,
        };
        ground(&Frame::IDENTITY, &raster)
    }

    #[test]
    fn cells_covered_twice_are_runs() {
        let steps = |numbers: &[f64]| Steps::of(numbers.iter().copied(), 1.0);
        let (one, want) = (of(4, 3, &[0, 6, 7, 8]), steps(&[0.0, 1.0, 6.0, 9.0]));
        assert_eq!((one.columns, one.rows, one.twice), (4, 3, want));
        // Blocks of two by two cells, incomplete ones at the right and at the top.
        let (one, want) = (of(1601, 3, &[1603, 4802]), steps(&[1.0, 2.0, 1601.0]));
        assert_eq!((one.columns, one.rows, one.twice), (801, 2, want));
        assert_eq!(one.cell_mm, 0.2);
    }
}
