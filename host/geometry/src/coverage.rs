//! The area that a set of swept placements covers: a raster over a region that counts visits.
//!
//! A cell is covered if its centre is in any placement, overlapped if it is visited by two passes
//! or by one that left it and returned after more than `return_mm` of path. Cells are processed in
//! bands of rows, in parallel, with the same result for any number of threads.

use super::aperture::Aperture;
use super::cell_grid::{ASIDE, CellGrid, CellWindow, NO_COLUMNS, for_beyond};
use super::clearance::Configuration;
use super::edge_index::EdgeIndex;
use super::{Point2, Vector2};
use rayon::prelude::*;

/// One placement of a sweep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweptPose {
    /// Where.
    pub at: Configuration,
    /// Pass number.
    pub pass: u32,
    /// Path length of the pass so far, mm.
    pub path_mm: f64,
}

/// State of a raster cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cell {
    /// Outside the region, never visited.
    Outside,
    /// Inside, never visited.
    Gap,
    /// Inside, visited once.
    Covered,
    /// Inside, visited again.
    Overlap,
    /// Visited though outside the region.
    Spill,
}

/// The raster and its sums.
#[derive(Clone, Debug)]
pub struct Coverage {
    /// Lower left corner of cell (0, 0).
    pub origin: Point2,
    /// Cell size, mm.
    pub cell_mm: f64,
    /// Cells in x.
    pub columns: usize,
    /// Cells in y.
    pub rows: usize,
    /// Row by row.
    pub cells: Vec<Cell>,
}

/// A pass that returns to a place after more than this path length covers it again, against a. The
/// aperture is 2a long, yet on a bead it is mostly across or oblique: a smaller value would count a
/// tight turn as two visits, a larger one would let beads overlap without a penalty.
const RETURN_SHARE: f64 = 1.5;

/// Path after which a returning pass covers a place again: the definition of "laid twice" in all
/// figures.
pub fn return_mm(aperture: &Aperture) -> f64 {
    RETURN_SHARE * aperture.major_mm()
}

impl Coverage {
    /// Sweeps the poses over the region; `cell_mm` grows until the raster has at most
    /// `cells_max` cells.
    pub fn sweep(
        walls: &EdgeIndex,
        aperture: &Aperture,
        poses: &[SweptPose],
        cell_mm: f64,
        cells_max: usize,
        return_mm: f64,
    ) -> Coverage {
        let bounds = walls.bounds();
        let size = bounds.size();
        let mut cell_mm = cell_mm;
        while (size.x / cell_mm + 1.0) * (size.y / cell_mm + 1.0) > cells_max as f64 {
            cell_mm *= 1.1;
        }
        let grid = CellGrid {
            origin: bounds.min - ASIDE * cell_mm,
            cell_mm,
            columns: (size.x / cell_mm).ceil() as usize + 1,
            rows: (size.y / cell_mm).ceil() as usize + 1,
        };
        let of_band = grid.poses_of_bands(aperture, poses.iter().map(|pose| pose.at));
        let mut cells = vec![Cell::Outside; grid.len()];
        let bands = grid.bands_of(&mut cells).zip(&of_band);
        bands.for_each_init(Vec::new, |visits, ((band, cells), numbers)| {
            let poses = numbers.iter().map(|&number| &poses[number as usize]);
            visits.clear();
            visits.resize(cells.len(), NO_VISIT);
            visit_band(&grid, &band, poses, aperture, return_mm, visits);
            let inside = cells_inside(&grid, &band, walls);
            for ((cell, visit), inside) in cells.iter_mut().zip(&*visits).zip(inside) {
                *cell = visit.state(inside);
            }
        });
        Coverage {
            origin: grid.origin,
            cell_mm,
            columns: grid.columns,
            rows: grid.rows,
            cells,
        }
    }

    /// Its place and size.
    pub fn grid(&self) -> CellGrid {
        CellGrid {
            origin: self.origin,
            cell_mm: self.cell_mm,
            columns: self.columns,
            rows: self.rows,
        }
    }

    /// For each cell whether its middle is inside these walls.
    pub fn inside(&self, walls: &EdgeIndex) -> Vec<bool> {
        let grid = self.grid();
        cells_inside(&grid, &grid.window(), walls)
    }

    /// Number of cells in a state.
    pub fn count(&self, state: Cell) -> usize {
        let parts = self.cells.par_chunks(CELLS_AT_ONCE);
        parts
            .map(|cells| cells.iter().filter(|&&c| c == state).count())
            .sum()
    }

    /// Shares of the region that were visited, and visited more than once, per cent.
    pub fn covered_and_overlap_pct(&self) -> [f64; 2] {
        let [gap, covered, overlap] =
            [Cell::Gap, Cell::Covered, Cell::Overlap].map(|state| self.count(state));
        let inside = (gap + covered + overlap).max(1) as f64;
        [covered + overlap, overlap].map(|cells| 100.0 * cells as f64 / inside)
    }

    /// Centre of a cell.
    pub fn center(&self, number: usize) -> Point2 {
        let (column, row) = (number % self.columns, number / self.columns);
        self.origin + Vector2::new(column as f64 + 0.5, row as f64 + 0.5) * self.cell_mm
    }

    /// Centres of the unvisited cells inside the region.
    pub fn gaps(&self) -> impl Iterator<Item = Point2> + '_ {
        (0..self.cells.len())
            .filter(|&n| self.cells[n] == Cell::Gap)
            .map(|n| self.center(n))
    }
}

/// The last visit of a cell.
#[derive(Clone, Copy)]
struct Visit {
    pass: u32,
    path_mm: f32,
    /// There was one before that, which counts.
    again: bool,
}

const NO_VISIT: Visit = Visit {
    pass: u32::MAX,
    path_mm: 0.0,
    again: false,
};

impl Visit {
    fn state(&self, inside: bool) -> Cell {
        match (inside, self.pass != NO_VISIT.pass, self.again) {
            (false, false, _) => Cell::Outside,
            (false, true, _) => Cell::Spill,
            (true, false, _) => Cell::Gap,
            (true, true, false) => Cell::Covered,
            (true, true, true) => Cell::Overlap,
        }
    }
}

/// Cells that one thread counts.
const CELLS_AT_ONCE: usize = 1 << 16;

/// Sweeps one band of rows. Of the cells that a pose shares with the one before it in a row only the
/// first and the last visit count.
fn visit_band<'a>(
    grid: &CellGrid,
    band: &CellWindow,
    poses: impl Iterator<Item = &'a SweptPose>,
    aperture: &Aperture,
    return_mm: f64,
    visits: &mut [Visit],
) {
    // The last pose of each row and the columns under it, whose visits are not brought up to it yet.
    let mut last_of_row: Vec<Option<(&SweptPose, [usize; 2])>> =
        vec![None; band.rows[1] + 1 - band.rows[0]];
    for pose in poses {
        grid.for_rows_within(band, aperture, pose.at, |row, from, to| {
            let own = [from, to];
            let before = last_of_row[row - band.rows[0]].replace((pose, own));
            let mut known = NO_COLUMNS;
            if let Some((last, before)) = before {
                let goes_on = last.pass == pose.pass
                    && pose.path_mm - f64::from(last.path_mm as f32) <= return_mm;
                if goes_on {
                    known = before;
                }
                for_beyond(before, if goes_on { own } else { NO_COLUMNS }, |columns| {
                    for visit in &mut visits[band.numbers(row, columns)] {
                        visit.path_mm = last.path_mm as f32;
                    }
                });
            }
            for_beyond(own, known, |columns| {
                for visit in &mut visits[band.numbers(row, columns)] {
                    visit.again |= visit.pass != NO_VISIT.pass
                        && (visit.pass != pose.pass
                            || pose.path_mm - f64::from(visit.path_mm) > return_mm);
                    visit.pass = pose.pass;
                    visit.path_mm = pose.path_mm as f32;
                }
            });
        });
    }
}

/// The cell centres of the band that are inside, by scanline.
fn cells_inside(grid: &CellGrid, band: &CellWindow, walls: &EdgeIndex) -> Vec<bool> {
    let [first, last] = band.rows;
    let mut inside = vec![false; (last + 1 - first) * grid.columns];
    let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); last + 1 - first];
    let y_of = |row: usize| grid.origin.y + (row as f64 + 0.5) * grid.cell_mm;
    for edge in walls.edges() {
        let (low, high) = if edge.a.y <= edge.b.y {
            (edge.a, edge.b)
        } else {
            (edge.b, edge.a)
        };
        if high.y <= y_of(first) || low.y > y_of(last) {
            continue;
        }
        let from = ((low.y - grid.origin.y) / grid.cell_mm - 0.5)
            .ceil()
            .max(first as f64);
        let mut row = from as usize;
        while row <= last && y_of(row) < high.y {
            if y_of(row) >= low.y {
                let t = (y_of(row) - low.y) / (high.y - low.y);
                crossings[row - first].push(low.x + t * (high.x - low.x));
            }
            row += 1;
        }
    }
    for (row, xs) in crossings.iter_mut().enumerate() {
        xs.sort_by(f64::total_cmp);
        for pair in xs.chunks_exact(2) {
            let from = ((pair[0] - grid.origin.x) / grid.cell_mm - 0.5)
                .ceil()
                .max(0.0) as usize;
            let to = ((pair[1] - grid.origin.x) / grid.cell_mm - 0.5).floor();
            if to < from as f64 {
                continue;
            }
            let row = &mut inside[row * grid.columns..(row + 1) * grid.columns];
            row[from..=(to as usize).min(grid.columns - 1)].fill(true);
        }
    }
    inside
}
