//! What a set of swept placements covers: a raster over a region that counts visits.
//!
//! A cell is covered when its centre lies in any placement, overlapped when it is visited by two
//! passes or by one that left it and came back more than `return_mm` of path later (SPEC section
//! 2). Cells are processed in bands of rows, in parallel, with the same result for any number of
//! threads.

use super::aperture::Aperture;
use super::cell_grid::CellGrid;
use super::clearance::Configuration;
use super::edge_index::EdgeIndex;
use super::rounded_polygon::row_range;
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

/// Rows of one band.
const BAND_ROWS: usize = 64;

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
        let columns = (size.x / cell_mm).ceil() as usize + 1;
        let rows = (size.y / cell_mm).ceil() as usize + 1;
        let origin = bounds.min;
        let bands = rows.div_ceil(BAND_ROWS);
        let band_mm = BAND_ROWS as f64 * cell_mm;
        let mut of_band: Vec<Vec<u32>> = vec![Vec::new(); bands];
        for (number, pose) in poses.iter().enumerate() {
            let [below, above] =
                [-1.0, 1.0].map(|y| aperture.support_mm(pose.at.heading_rad, Vector2::new(0.0, y)));
            let low = ((pose.at.center.y - below - origin.y) / band_mm)
                .floor()
                .max(0.0) as usize;
            let high = ((pose.at.center.y + above - origin.y) / band_mm)
                .floor()
                .max(0.0) as usize;
            for band in of_band.iter_mut().take((high + 1).min(bands)).skip(low) {
                band.push(number as u32);
            }
        }
        let grid = Grid {
            origin,
            cell_mm,
            columns,
            rows,
        };
        let cells = of_band
            .par_iter()
            .enumerate()
            .flat_map_iter(|(band, numbers)| {
                grid.band_cells(band, numbers, poses, aperture, walls, return_mm)
            })
            .collect();
        Coverage {
            origin,
            cell_mm,
            columns,
            rows,
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

    /// Number of cells in a state.
    pub fn count(&self, state: Cell) -> usize {
        self.cells.iter().filter(|&&c| c == state).count()
    }

    /// Cells inside the region.
    pub fn inside(&self) -> usize {
        self.count(Cell::Gap) + self.count(Cell::Covered) + self.count(Cell::Overlap)
    }

    /// Share of the region that was visited, per cent.
    pub fn covered_pct(&self) -> f64 {
        let covered = self.count(Cell::Covered) + self.count(Cell::Overlap);
        100.0 * covered as f64 / self.inside().max(1) as f64
    }

    /// Share of the region that was visited more than once, per cent.
    pub fn overlap_pct(&self) -> f64 {
        100.0 * self.count(Cell::Overlap) as f64 / self.inside().max(1) as f64
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

/// The rows of a turned aperture about its centre.
pub struct RowsOfShape {
    /// How far it reaches below its centre, mm.
    pub below_mm: f64,
    /// How far above, mm.
    pub above_mm: f64,
    shape: TurnedShape,
}

enum TurnedShape {
    /// qxx dx² + 2 qxy dx dy + qyy dy² = 1.
    Quadratic([f64; 3]),
    /// Corners of the core, radius.
    Rounded(Vec<Vector2>, f64),
}

impl RowsOfShape {
    /// The aperture at one heading.
    pub fn new(aperture: &Aperture, heading_rad: f64) -> RowsOfShape {
        let (sin, cos) = heading_rad.sin_cos();
        let shape = match aperture {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let (ia, ib) = (1.0 / (major_mm * major_mm), 1.0 / (minor_mm * minor_mm));
                TurnedShape::Quadratic([
                    cos * cos * ia + sin * sin * ib,
                    cos * sin * (ia - ib),
                    sin * sin * ia + cos * cos * ib,
                ])
            }
            Aperture::Rounded(shape) => {
                let turned =
                    |c: &Vector2| Vector2::new(c.x * cos - c.y * sin, c.x * sin + c.y * cos);
                TurnedShape::Rounded(
                    shape.corners().iter().map(turned).collect(),
                    shape.radius_mm(),
                )
            }
        };
        RowsOfShape {
            below_mm: aperture.support_mm(heading_rad, -Vector2::y()),
            above_mm: aperture.support_mm(heading_rad, Vector2::y()),
            shape,
        }
    }

    /// Least and greatest x at height `dy`, mm about the centre.
    pub fn range(&self, dy: f64) -> Option<[f64; 2]> {
        match &self.shape {
            TurnedShape::Quadratic([qxx, qxy, qyy]) => {
                let disc = (qxy * dy).powi(2) - qxx * (qyy * dy * dy - 1.0);
                (disc >= 0.0).then(|| {
                    let root = disc.sqrt();
                    [(-qxy * dy - root) / qxx, (-qxy * dy + root) / qxx]
                })
            }
            TurnedShape::Rounded(corners, radius) => row_range(corners, *radius, dy),
        }
    }
}

struct Grid {
    origin: Point2,
    cell_mm: f64,
    columns: usize,
    rows: usize,
}

impl Grid {
    /// Sweeps one band of rows.
    fn band_cells(
        &self,
        band: usize,
        numbers: &[u32],
        poses: &[SweptPose],
        aperture: &Aperture,
        walls: &EdgeIndex,
        return_mm: f64,
    ) -> Vec<Cell> {
        let first = band * BAND_ROWS;
        let last = (first + BAND_ROWS).min(self.rows);
        let mut visits = vec![(u32::MAX, 0.0f32, false); (last - first) * self.columns];
        for &number in numbers {
            self.stamp(
                &poses[number as usize],
                aperture,
                first,
                last,
                return_mm,
                &mut visits,
            );
        }
        let inside = self.inside(first, last, walls);
        visits
            .iter()
            .zip(inside)
            .map(
                |(&(pass, _, again), inside)| match (inside, pass != u32::MAX, again) {
                    (false, false, _) => Cell::Outside,
                    (false, true, _) => Cell::Spill,
                    (true, false, _) => Cell::Gap,
                    (true, true, false) => Cell::Covered,
                    (true, true, true) => Cell::Overlap,
                },
            )
            .collect()
    }

    /// Marks the cells of one placement, row by row.
    fn stamp(
        &self,
        pose: &SweptPose,
        aperture: &Aperture,
        first: usize,
        last: usize,
        return_mm: f64,
        visits: &mut [(u32, f32, bool)],
    ) {
        let rows = RowsOfShape::new(aperture, pose.at.heading_rad);
        let c = pose.at.center - self.origin;
        let row0 = ((c.y - rows.below_mm) / self.cell_mm - 0.5)
            .ceil()
            .max(first as f64) as usize;
        let row1 = ((c.y + rows.above_mm) / self.cell_mm - 0.5)
            .floor()
            .min(last as f64 - 1.0);
        if row1 < row0 as f64 {
            return;
        }
        for row in row0..=row1 as usize {
            let dy = (row as f64 + 0.5) * self.cell_mm - c.y;
            let Some([from, to]) = rows.range(dy) else {
                continue;
            };
            let low = (c.x + from) / self.cell_mm - 0.5;
            let high = (c.x + to) / self.cell_mm - 0.5;
            let column0 = low.ceil().max(0.0) as usize;
            let column1 = high.floor().min(self.columns as f64 - 1.0);
            if column1 < column0 as f64 {
                continue;
            }
            let base = (row - first) * self.columns;
            for visit in &mut visits[base + column0..=base + column1 as usize] {
                let (pass, path, again) = visit;
                if *pass != u32::MAX
                    && (*pass != pose.pass || pose.path_mm - f64::from(*path) > return_mm)
                {
                    *again = true;
                }
                *pass = pose.pass;
                *path = pose.path_mm as f32;
            }
        }
    }

    /// Which cell centres of the band lie inside, by scanline.
    fn inside(&self, first: usize, last: usize, walls: &EdgeIndex) -> Vec<bool> {
        let mut inside = vec![false; (last - first) * self.columns];
        let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); last - first];
        let y_of = |row: usize| self.origin.y + (row as f64 + 0.5) * self.cell_mm;
        for edge in walls.edges() {
            let (low, high) = if edge.a.y <= edge.b.y {
                (edge.a, edge.b)
            } else {
                (edge.b, edge.a)
            };
            let from = ((low.y - self.origin.y) / self.cell_mm - 0.5)
                .ceil()
                .max(first as f64);
            let mut row = from as usize;
            while row < last && y_of(row) < high.y {
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
                let from = ((pair[0] - self.origin.x) / self.cell_mm - 0.5)
                    .ceil()
                    .max(0.0) as usize;
                let to = ((pair[1] - self.origin.x) / self.cell_mm - 0.5).floor();
                if to < from as f64 {
                    continue;
                }
                for column in from..=(to as usize).min(self.columns - 1) {
                    inside[row * self.columns + column] = true;
                }
            }
        }
        inside
    }
}
