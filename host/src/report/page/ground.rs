//! What was swept of a layer, as runs of equal cells for the page's script.
//!
//! In: a raster and its frame. Out: at most [`SIDE_MAX`] cells along a side, as base64 of runs: the cell's code and a length
//! of 16 bits, low byte first.

use crate::geometry::Point2;
use crate::geometry::coverage::{Cell, Coverage};
use crate::geometry::frame::Frame;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

/// Most cells along a side of the coverage; finer rasters are shown in blocks.
const SIDE_MAX: usize = 1600;

#[derive(Serialize)]
pub struct Ground {
    /// Canvas matrix from the raster's frame to the input's coordinates.
    matrix: [f64; 6],
    origin: [f64; 2],
    cell_mm: f64,
    columns: usize,
    rows: usize,
    rle: String,
}

/// The cells of a raster.
pub fn ground(frame: &Frame, swept: &Coverage) -> Ground {
    let block = swept.columns.max(swept.rows).div_ceil(SIDE_MAX).max(1);
    let (columns, rows) = (swept.columns.div_ceil(block), swept.rows.div_ceil(block));
    let mut runs: Vec<u8> = Vec::new();
    let mut run: Option<(u8, u16)> = None;
    let mut push = |run: (u8, u16)| {
        runs.push(run.0);
        runs.extend(run.1.to_le_bytes());
    };
    for number in 0..columns * rows {
        let cell = greatest(swept, [number % columns, number / columns], block);
        run = match run {
            Some((of, length)) if of == cell && length < u16::MAX => Some((of, length + 1)),
            other => {
                other.into_iter().for_each(&mut push);
                Some((cell, 1))
            }
        };
    }
    run.into_iter().for_each(&mut push);
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
        rle: STANDARD.encode(runs),
    }
}

/// The greatest code in a block of cells: a small gap must not vanish.
fn greatest(swept: &Coverage, [column, row]: [usize; 2], block: usize) -> u8 {
    let end = |at: usize, most: usize| ((at + 1) * block).min(most);
    let rows = row * block..end(row, swept.rows);
    let cells = rows.flat_map(|row| {
        let start = row * swept.columns;
        &swept.cells[start + column * block..start + end(column, swept.columns)]
    });
    cells.map(code).max().unwrap_or(0)
}

fn code(cell: &Cell) -> u8 {
    match cell {
        Cell::Outside => 0,
        Cell::Covered => 1,
        Cell::Overlap => 3,
        Cell::Gap => 4,
        Cell::Spill => 5,
    }
}
