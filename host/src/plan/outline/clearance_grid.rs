//! Where an aperture that covers a point can be placed at all: a coarse grid of clearances.
//!
//! Every aperture holds a disk about its centre, an ellipse also smaller ones along its major axis;
//! all of them must be clear of the boundary. The clearance of a cell is that of its middle plus
//! the largest error of the cell, so a "no" is certain and a "yes" is not.
//!
//! In: aperture, points, an index of edges (mm). Out: centres (mm) that are not ruled out, and
//! whether a heading (rad) is.

use crate::geometry::aperture::Aperture;
use crate::geometry::cell_grid::CellGrid;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::Box2;
use crate::geometry::{Point2, Vector2};

/// Cells to the radius of the disk: what they round off is a twelfth of it.
const CELLS: f64 = 8.0;
/// An aperture with next to no disk about its centre: cells stay this large against its length.
const LEAST_SHARE: f64 = 0.1;
/// Positions of the other disks, relative to the distance of the ellipse's foci.
const DISKS: [f64; 4] = [0.45, -0.45, 0.75, -0.75];
/// More than the slack that a placement is granted, and than rounding, against the aperture.
const MARGIN: f64 = 1e-4;

/// Clearances about a few places.
pub struct ClearanceGrid<'a> {
    aperture: &'a Aperture,
    grid: CellGrid,
    /// Signed distance to the boundary of each cell's middle, at most `inner_mm`.
    clear_mm: Vec<f64>,
    inner_mm: f64,
    /// What a cell rounds off.
    rounded_mm: f64,
}

impl<'a> ClearanceGrid<'a> {
    /// The space of an aperture that covers one of the points.
    pub fn about(
        aperture: &'a Aperture,
        points: &[Point2],
        index: &EdgeIndex,
    ) -> ClearanceGrid<'a> {
        let inner_mm = match aperture {
            Aperture::Ellipse { minor_mm, .. } => *minor_mm,
            Aperture::Rounded(shape) => shape.axis_inside_mm(),
        };
        let reach_mm = aperture.reach_mm();
        let cell_mm = inner_mm.max(LEAST_SHARE * reach_mm) / CELLS;
        let area = Box2::of(points).grown(2.0 * reach_mm + cell_mm);
        let grid = CellGrid::over(&area, cell_mm, usize::MAX);
        let clear_mm = |cell: usize| {
            let p = middle_of(&grid, cell);
            let distance_mm = index
                .nearest_within(p, inner_mm)
                .map_or(inner_mm, |n| n.distance_mm);
            if index.contains(p) {
                distance_mm
            } else {
                -distance_mm
            }
        };
        ClearanceGrid {
            aperture,
            clear_mm: (0..grid.len()).map(clear_mm).collect(),
            inner_mm,
            rounded_mm: grid.cell_mm * std::f64::consts::FRAC_1_SQRT_2,
            grid,
        }
    }

    /// Middles of the cells in which the centre of an aperture that covers `p` may be.
    pub fn centres_about(&self, p: Point2) -> Vec<Point2> {
        let reach_mm = self.aperture.reach_mm() + self.rounded_mm;
        let window = self
            .grid
            .window_about(&Box2 { min: p, max: p }.grown(reach_mm));
        let mut found = Vec::new();
        for row in window.rows[0]..=window.rows[1] {
            for column in window.columns[0]..=window.columns[1] {
                let cell = row * self.grid.columns + column;
                let middle = middle_of(&self.grid, cell);
                if self.may_be_clear(self.clear_mm[cell], self.inner_mm)
                    && (middle - p).norm() <= reach_mm
                {
                    found.push(middle);
                }
            }
        }
        found
    }

    /// False where no aperture at this heading, centred about one of the places, is clear and
    /// covers `p`.
    pub fn may_fit(&self, centres: &[Point2], p: Point2, heading_rad: f64) -> bool {
        let (sin, cos) = heading_rad.sin_cos();
        let disks = self.disks();
        centres.iter().any(|c| {
            let d = p - c;
            let local = Vector2::new(d.x * cos + d.y * sin, d.y * cos - d.x * sin);
            self.aperture.beyond_mm(local) <= self.rounded_mm
                && disks.iter().all(|[along_mm, radius_mm]| {
                    let at = c + Vector2::new(cos, sin) * *along_mm;
                    let cell = self.grid.window_about(&Box2 { min: at, max: at });
                    let cell = cell.rows[0] * self.grid.columns + cell.columns[0];
                    // The disk's centre is in the cell of `at` or in an adjacent one.
                    self.may_be_clear(self.clear_mm[cell] + self.rounded_mm, *radius_mm)
                })
        })
    }

    /// Disks within an ellipse along its major axis: where, and their radius
    /// b sqrt(1 - t²/(a² - b²)).
    fn disks(&self) -> Vec<[f64; 2]> {
        let Aperture::Ellipse { major_mm, minor_mm } = self.aperture else {
            return Vec::new();
        };
        let focus_mm = (major_mm * major_mm - minor_mm * minor_mm).max(0.0).sqrt();
        let disk = |share: &f64| [share * focus_mm, minor_mm * (1.0 - share * share).sqrt()];
        DISKS.iter().map(disk).collect()
    }

    /// False where a clearance of `clear_mm` in a middle means less than `radius_mm` in all of the
    /// cell.
    fn may_be_clear(&self, clear_mm: f64, radius_mm: f64) -> bool {
        clear_mm + self.rounded_mm >= radius_mm * (1.0 - MARGIN) - MARGIN * self.inner_mm
    }
}

fn middle_of(grid: &CellGrid, cell: usize) -> Point2 {
    let (column, row) = (cell % grid.columns, cell / grid.columns);
    grid.origin + Vector2::new(column as f64 + 0.5, row as f64 + 0.5) * grid.cell_mm
}
