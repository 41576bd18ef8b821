//! The beads of all passes by place: what a way between two of them would cover again.
//!
//! Few ways are asked for, each over a few apertures: only the ground about the way is looked at,
//! on a raster laid over all passes.
//!
//! In: passes, a way as placements (mm, rad). Out: the ground of other beads under it, mm².

use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::cell_grid::CellGrid;
use crate::geometry::clearance::Configuration;
use crate::geometry::point_grid::PointGrid;
use crate::geometry::polygon::Box2;
use crate::plan::coverage::visits::{CELL_SHARE, CELLS_MAX};
use crate::plan::pass::sweep::{poses, swept};
use crate::plan::pass::{LayerPass, bounds_of};

/// What a cell is under: the end of the one or the start of the other pass, any bead, the way.
const OWN: u8 = 1;
const BEAD: u8 = 2;
const WAY: u8 = 4;

/// All poses of a set of passes.
pub struct Beads {
    aperture: Aperture,
    grid: CellGrid,
    poses: PointGrid<Configuration>,
}

impl Beads {
    /// The beads of `passes`.
    pub fn of(passes: &[LayerPass], aperture: &Aperture) -> Beads {
        let bounds = bounds_of(passes, aperture);
        let all = passes.iter().flat_map(|pass| poses(pass, aperture));
        Beads {
            aperture: *aperture,
            grid: CellGrid::over(&bounds, CELL_SHARE * aperture.minor_mm(), CELLS_MAX),
            poses: PointGrid::of(2.0 * aperture.reach_mm(), all.map(|at| (at.center, at))),
        }
    }

    /// The nozzle.
    pub fn aperture(&self) -> &Aperture {
        &self.aperture
    }

    /// Ground of beads that a way covers again, mm²; what is under the stretches of path `own`
    /// does not count.
    pub fn recovered_mm2(&self, own: [Vec<Configuration>; 2], way: &[Configuration]) -> f64 {
        let (grid, aperture) = (&self.grid, &self.aperture);
        let centers: Vec<Point2> = way.iter().map(|at| at.center).collect();
        let area = Box2::of(&centers).grown(aperture.reach_mm());
        let window = grid.window_about(&area);
        let mut marks = vec![0u8; window.len()];
        let mut mark = |at: Configuration, what: u8| {
            grid.for_rows_within(&window, aperture, at, |row, from, to| {
                for mark in &mut marks[window.number(row, from)..=window.number(row, to)] {
                    *mark |= what;
                }
            });
        };
        for at in self.poses.within(&area.grown(aperture.reach_mm())) {
            mark(*at, BEAD);
        }
        for own in own {
            swept(own.into_iter(), aperture).for_each(|at| mark(at, OWN));
        }
        swept(way.iter().copied(), aperture).for_each(|at| mark(at, WAY));
        let again = marks.iter().filter(|&&mark| mark == BEAD | WAY).count();
        again as f64 * grid.cell_area_mm2()
    }
}
