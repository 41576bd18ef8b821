//! How many passes cover each place of a region, on a raster.

use super::channel_walls::poses_between;
use super::passes::LayerPass;
use crate::geometry::aperture::Aperture;
use crate::geometry::cell_grid::CellGrid;
use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::Box2;

/// Raster cell against the minor semi-axis, and most cells.
const CELL_SHARE: f64 = 0.1;
const CELLS_MAX: usize = 8_000_000;

/// How many passes cover each cell of a raster.
pub struct Visits {
    aperture: Aperture,
    grid: CellGrid,
    counts: Vec<u32>,
    /// The last walk that saw the cell: each walk visits a cell once.
    seen: Vec<u32>,
    walk: u32,
}

impl Visits {
    /// The visits of `passes`, which lie within `bounds`.
    pub fn of_passes(passes: &[LayerPass], bounds: &Box2, aperture: &Aperture) -> Visits {
        let grid = CellGrid::over(bounds, CELL_SHARE * aperture.minor_mm(), CELLS_MAX);
        let mut visits = Visits {
            aperture: *aperture,
            grid,
            counts: vec![0; grid.len()],
            seen: vec![0; grid.len()],
            walk: 0,
        };
        for pass in passes {
            visits.for_cells_once(poses(pass, aperture), |_, count| *count += 1);
        }
        visits
    }

    /// The nozzle.
    pub fn aperture(&self) -> &Aperture {
        &self.aperture
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
        for at in poses {
            self.grid.for_rows(&self.aperture, at, |row, from, to| {
                for cell in row + from..=row + to {
                    if seen[cell] != walk {
                        seen[cell] = walk;
                        visit(cell, &mut counts[cell]);
                    }
                }
            });
        }
    }
}

/// All poses of a pass, dense.
pub fn poses(pass: &LayerPass, aperture: &Aperture) -> impl Iterator<Item = Configuration> {
    let count = pass.placements.len();
    (0..count).flat_map(move |i| {
        let at = pass.placements[i].at;
        let next = match i + 1 {
            n if n < count => Some(pass.placements[n].at),
            _ if pass.closed => Some(pass.placements[0].at),
            _ => None,
        };
        let between = next.map(|next| poses_between(aperture, at, next));
        std::iter::once(at).chain(between.into_iter().flatten())
    })
}
