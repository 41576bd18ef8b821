//! How many passes cover each place of a region, on a raster.
//!
//! In: passes, bounds (mm), the cell against b. Out: a count for each cell, areas in mm². Leaves
//! out: what one pass covers twice itself.

use crate::geometry::aperture::Aperture;
use crate::geometry::cell_grid::{CellGrid, NO_COLUMNS, for_beyond};
use crate::geometry::clearance::Configuration;
use crate::geometry::coverage::{Coverage, return_mm};
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::Box2;
use crate::plan::pass::LayerPass;
use crate::plan::pass::sweep::{poses, swept_poses};
use rayon::prelude::*;
use std::ops::Range;

/// Raster cell against the minor semi-axis where nothing else is said, and most cells.
pub const CELL_SHARE: f64 = 0.1;
pub const CELLS_MAX: usize = 8_000_000;

/// How many passes cover each cell of a raster.
pub struct Visits {
    aperture: Aperture,
    grid: CellGrid,
    counts: Vec<u32>,
    /// The last walk that saw the cell: each walk visits a cell once.
    seen: Vec<u32>,
    walk: u32,
    /// In each row the last walk that came there, and columns that it has seen.
    seen_of_row: Vec<(u32, [usize; 2])>,
}

impl Visits {
    /// The visits of `passes`, which lie within `bounds`, in cells of this share of b.
    pub fn of_passes(
        passes: &[LayerPass],
        bounds: &Box2,
        aperture: &Aperture,
        cell_share: f64,
    ) -> Visits {
        let grid = CellGrid::over(bounds, cell_share * aperture.minor_mm(), CELLS_MAX);
        let (mut dense, mut pass_of) = (Vec::new(), Vec::new());
        for (number, pass) in passes.iter().enumerate() {
            dense.extend(poses(pass, aperture));
            pass_of.resize(dense.len(), number as u32 + 1);
        }
        let mut counts = vec![0; grid.len()];
        let of_band = grid.poses_of_bands(aperture, dense.iter().copied());
        let bands = grid.bands_of(&mut counts).zip(&of_band);
        bands.for_each_init(Vec::new, |last_of_cell, ((band, counts), numbers)| {
            // The last pass that covered the cell; in each row the last one and where it was.
            last_of_cell.clear();
            last_of_cell.resize(counts.len(), 0);
            let mut last_of_row = vec![(0, [0; 2]); band.rows[1] + 1 - band.rows[0]];
            for &number in numbers {
                let (at, own) = (dense[number as usize], pass_of[number as usize]);
                grid.for_rows_within(&band, aperture, at, |row, from, to| {
                    let before = &mut last_of_row[row - band.rows[0]];
                    for_new_of_row(before, own, [from, to], |columns| {
                        let cells = band.numbers(row, columns);
                        let last = &mut last_of_cell[cells.clone()];
                        for (last, count) in last.iter_mut().zip(&mut counts[cells]) {
                            *count += u32::from(*last != own);
                            *last = own;
                        }
                    });
                });
            }
        });
        Visits {
            aperture: *aperture,
            grid,
            counts,
            seen: vec![0; grid.len()],
            walk: 0,
            seen_of_row: vec![(0, [0; 2]); grid.rows],
        }
    }

    /// The nozzle.
    pub fn aperture(&self) -> &Aperture {
        &self.aperture
    }

    /// The raster.
    pub fn grid(&self) -> CellGrid {
        self.grid
    }

    /// How many passes cover a cell.
    pub fn count(&self, cell: usize) -> u32 {
        self.counts[cell]
    }

    /// Area of one cell, mm².
    pub fn cell_area_mm2(&self) -> f64 {
        self.grid.cell_area_mm2()
    }

    /// From here on every cell is new again.
    pub fn begin_walk(&mut self) {
        self.walk += 1;
    }

    /// Visits each cell under the poses once: its number and its count.
    pub fn for_cells_once(
        &mut self,
        poses: impl Iterator<Item = Configuration>,
        visit: impl FnMut(usize, &mut u32),
    ) {
        self.begin_walk();
        self.for_cells_new(poses, visit);
    }

    /// The same, but not those that this walk has seen before.
    pub fn for_cells_new(
        &mut self,
        poses: impl Iterator<Item = Configuration>,
        mut visit: impl FnMut(usize, &mut u32),
    ) {
        let (walk, seen, counts) = (self.walk, &mut self.seen, &mut self.counts);
        let (rows, window) = (&mut self.seen_of_row, self.grid.window());
        for at in poses {
            self.grid.for_rows(&self.aperture, at, |row, from, to| {
                for_new_of_row(&mut rows[row], walk, [from, to], |columns| {
                    for cell in window.numbers(row, columns) {
                        if seen[cell] != walk {
                            seen[cell] = walk;
                            visit(cell, &mut counts[cell]);
                        }
                    }
                });
            });
        }
    }
}

/// Visits the columns (first and last) of a row that are new to a pass or walk, where it came last in
/// the row is known: what one pose of a sweep adds to the one before it is little.
fn for_new_of_row(
    last: &mut (u32, [usize; 2]),
    own: u32,
    columns: [usize; 2],
    visit: impl FnMut(Range<usize>),
) {
    let (before, known) = std::mem::replace(last, (own, columns));
    let known = if before == own { known } else { NO_COLUMNS };
    for_beyond(columns, known, visit);
}

/// What passes cover of the region within `walls`, on a raster of at most so many cells.
pub fn coverage(
    passes: &[LayerPass],
    walls: &EdgeIndex,
    aperture: &Aperture,
    cells_max: usize,
) -> Coverage {
    let poses = swept_poses(passes, aperture);
    let cell_mm = CELL_SHARE * aperture.minor_mm();
    let return_mm = return_mm(aperture);
    Coverage::sweep(walls, aperture, &poses, cell_mm, cells_max, return_mm)
}
