//! What was swept of a layer, as runs of equal cells for the page's script.
//!
//! In: a [`Raster`]. Out: at most [`SIDE_MAX`] cells along a side, as base64 of runs: the cell's code and a length
//! of 16 bits, low byte first.

use crate::geometry::Point2;
use crate::report::coverage_picture::{Cell, Raster};
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

/// The cells of a raster; `None` where it has none.
pub fn ground(raster: &Raster) -> Option<Ground> {
    let rows = raster.cells.len().checked_div(raster.columns)?;
    if rows == 0 {
        return None;
    }
    let block = raster.columns.max(rows).div_ceil(SIDE_MAX);
    let (columns, block_rows) = (raster.columns.div_ceil(block), rows.div_ceil(block));
    let mut runs: Vec<u8> = Vec::new();
    let mut run: Option<(Cell, u16)> = None;
    let mut push = |run: (Cell, u16)| {
        runs.push(code(run.0));
        runs.extend(run.1.to_le_bytes());
    };
    for number in 0..columns * block_rows {
        let cell = greatest(raster, rows, [number % columns, number / columns], block);
        run = match run {
            Some((of, length)) if of == cell && length < u16::MAX => Some((of, length + 1)),
            other => {
                other.into_iter().for_each(&mut push);
                Some((cell, 1))
            }
        };
    }
    run.into_iter().for_each(&mut push);
    let frame = &raster.frame;
    let (x, y) = (
        frame.vector_out([1.0, 0.0].into()),
        frame.vector_out([0.0, 1.0].into()),
    );
    let at = frame.point_out(Point2::origin());
    Some(Ground {
        matrix: [x.x, x.y, y.x, y.y, at.x, at.y],
        origin: [raster.origin.x, raster.origin.y],
        cell_mm: raster.cell_mm * block as f64,
        columns,
        rows: block_rows,
        rle: STANDARD.encode(runs),
    })
}

/// The greatest cell of a block: a small gap must not vanish.
fn greatest(raster: &Raster, rows: usize, [column, row]: [usize; 2], block: usize) -> Cell {
    let end = |at: usize, most: usize| ((at + 1) * block).min(most);
    let rows = row * block..end(row, rows);
    rows.flat_map(|row| {
        let start = row * raster.columns;
        &raster.cells[start + column * block..start + end(column, raster.columns)]
    })
    .copied()
    .max()
    .unwrap_or(Cell::Empty)
}

fn code(cell: Cell) -> u8 {
    match cell {
        Cell::Empty => 0,
        Cell::Once => 1,
        Cell::Unreachable => 2,
        Cell::Overlap => 3,
        Cell::Gap => 4,
        Cell::Spill => 5,
    }
}
