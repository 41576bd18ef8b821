//! The raster on which the area of beads is counted: one engine with a query for each purpose.
//!
//! A cell is covered if its centre is in a placed aperture. Each stage chooses its cell size, since
//! frequent queries may be coarse; stamping, rows and counting are the same for all.
//!
//! ```text
//! of_passes        how many passes cover each cell            (idle_passes, bridge_cost)
//! for_cells_once   what one pass covers, each cell once       (idle_passes)
//! NearbyPasses     what a connection covers again, mm²        (links, chains)
//! newly_covered    cells that each pose covers first          (flow)
//! within_walls     covered, open and overlapped cells of a region (gaps, cuts, order)
//! ```
//!
//! In: passes or poses (mm, rad), bounds (mm), the cell against b. Out: counts for each cell, areas
//! in mm². Not covered: area that one pass itself covers twice, except in [`within_walls`].

use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::cell_grid::{CellGrid, SweptRows};
use crate::geometry::clearance::Configuration;
use crate::geometry::coverage::Coverage;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::point_grid::PointGrid;
use crate::geometry::polygon::Box2;
use crate::plan::pass::sweep::{poses, swept, swept_poses};
use crate::plan::pass::{LayerPass, bounds_of};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Default ratio of a raster cell to the minor semi-axis, and maximum number of cells.
pub const CELL_SHARE: f64 = 0.1;
pub const CELLS_MAX: usize = 8_000_000;
/// Largest cell against the minor semi-axis: a coarser raster (of a region of more than about 0.3 m
/// with the built-in aperture) does not resolve ends and cuts of beads.
const FINE_SHARE_MAX: f64 = 0.5;

/// Rotation of a raster against the region, rad: aslant to walls along the axes or at 45°, where whole rows
/// of cells would be on one side of a wall or of a bead's edge at once.
pub const SKEW_RAD: f64 = 0.4;

/// How far along its path a bead is the same bead for the stages that weigh single moves, against a. A
/// gap-fill move out and back overlaps itself: by [`return_mm`](crate::geometry::coverage::return_mm), which
/// figures count by, few would pay.
const SAME_BEAD_SHARE: f64 = 4.0;

/// See `SAME_BEAD_SHARE`.
pub fn same_bead_mm(aperture: &Aperture) -> f64 {
    SAME_BEAD_SHARE * aperture.major_mm()
}

/// No pose or pass yet.
const NOBODY: u32 = u32::MAX;

/// How many passes cover each cell.
pub struct Raster {
    aperture: Aperture,
    grid: CellGrid,
    counts: Vec<u16>,
    walk: Walk,
}

/// A walk over the raster that sees each cell once; its memory is allocated with the first.
struct Walk {
    number: u32,
    /// The last walk that saw the cell.
    seen: Vec<u32>,
    rows: SweptRows<u32>,
}

impl Raster {
    /// Nothing covered yet, over these bounds.
    pub fn over(bounds: &Box2, aperture: &Aperture, cell_share: f64, cells_max: usize) -> Raster {
        let grid = CellGrid::over(bounds, cell_share * aperture.minor_mm(), cells_max);
        Raster {
            aperture: *aperture,
            grid,
            counts: vec![0; grid.len()],
            walk: Walk {
                number: 0,
                seen: Vec::new(),
                rows: SweptRows::of(&grid.window(), 0),
            },
        }
    }

    /// The number of `passes`, all within `bounds`, that cover each cell, for cells of this share of
    /// b.
    pub fn of_passes(
        passes: &[LayerPass],
        bounds: &Box2,
        aperture: &Aperture,
        cell_share: f64,
    ) -> Raster {
        let mut raster = Raster::over(bounds, aperture, cell_share, CELLS_MAX);
        let (mut dense, mut pass_of) = (Vec::new(), Vec::new());
        for (number, pass) in passes.iter().enumerate() {
            dense.extend(poses(pass, aperture));
            pass_of.resize(dense.len(), number as u32);
        }
        let of_pose = |pose: u32| pass_of.get(pose as usize).copied().unwrap_or(NOBODY);
        stamp(
            &raster.grid,
            (aperture, &[]),
            &dense,
            &mut raster.counts,
            // The last pass that covered the cell.
            NOBODY,
            |before, pose| of_pose(before) == of_pose(pose),
            |counts, last, pose| {
                let own = of_pose(pose);
                for (count, last) in counts.iter_mut().zip(last) {
                    *count = count.saturating_add(u16::from(*last != own));
                    *last = own;
                }
            },
        );
        raster
    }

    /// The nozzle.
    pub fn aperture(&self) -> &Aperture {
        &self.aperture
    }

    /// Its place and size.
    pub fn grid(&self) -> &CellGrid {
        &self.grid
    }

    /// The numbers of passes that cover the cells of a row, from this column on.
    pub fn counts(&self, row: usize, column: usize) -> &[u16] {
        &self.counts[row * self.grid.columns..][column..self.grid.columns]
    }

    /// Area of one cell, mm².
    pub fn cell_area_mm2(&self) -> f64 {
        self.grid.cell_area_mm2()
    }

    /// True if the cells are small enough to resolve the end of a bead.
    pub fn is_fine(&self) -> bool {
        is_fine(self.grid.cell_mm, &self.aperture)
    }

    /// Visits the count of each cell under the poses once.
    pub fn for_cells_once(
        &mut self,
        poses: impl Iterator<Item = Configuration>,
        mut visit: impl FnMut(&mut u16),
    ) {
        self.walk.number += 1;
        self.walk.seen.resize(self.grid.len(), 0);
        let (Walk { number, seen, rows }, counts) = (&mut self.walk, &mut self.counts);
        let window = self.grid.window();
        for at in poses {
            self.grid.for_rows(&self.aperture, at, |row, from, to| {
                let goes_on = |before| before == *number;
                rows.for_new(row, *number, [from, to], goes_on, |columns| {
                    for cell in window.numbers(row, columns) {
                        if seen[cell] != *number {
                            seen[cell] = *number;
                            visit(&mut counts[cell]);
                        }
                    }
                });
            });
        }
    }
}

/// The poses of passes by position. There are few queries for connections, each over a few
/// apertures: only the cells near a connection are stamped, because a raster of the complete region
/// would cost far more.
pub struct NearbyPasses {
    aperture: Aperture,
    grid: CellGrid,
    poses: PointGrid<Configuration>,
}

impl NearbyPasses {
    /// Those of `passes`.
    pub fn of(passes: &[LayerPass], aperture: &Aperture) -> NearbyPasses {
        let cell_mm = CELL_SHARE * aperture.minor_mm();
        let all = passes.iter().flat_map(|pass| poses(pass, aperture));
        NearbyPasses {
            aperture: *aperture,
            grid: CellGrid::over(&bounds_of(passes, aperture), cell_mm, CELLS_MAX),
            poses: PointGrid::of(2.0 * aperture.reach_mm(), all.map(|at| (at.center, at))),
        }
    }

    /// The nozzle.
    pub fn aperture(&self) -> &Aperture {
        &self.aperture
    }

    /// Area of beads that a connection covers again, mm²; the area under the stretches of path
    /// `own` does not count.
    pub fn recovered_mm2(&self, own: [Vec<Configuration>; 2], connection: &[Configuration]) -> f64 {
        // Bits of a cell.
        const OWN: u8 = 1;
        const BEAD: u8 = 2;
        const CONNECTION: u8 = 4;
        let (grid, aperture) = (&self.grid, &self.aperture);
        let window = grid.window_of(aperture, connection, 0.0);
        let mut marks = vec![0u8; window.len()];
        let mut mark = |at: Configuration, mark: u8| {
            grid.for_rows_within(&window, aperture, at, |row, from, to| {
                for cell in &mut marks[window.numbers(row, from..to + 1)] {
                    *cell |= mark;
                }
            });
        };
        let centers: Vec<Point2> = connection.iter().map(|at| at.center).collect();
        let area = Box2::of(&centers).grown(2.0 * aperture.reach_mm());
        self.poses.within(&area).for_each(|at| mark(*at, BEAD));
        for own in own {
            swept(own.into_iter(), aperture).for_each(|at| mark(at, OWN));
        }
        swept(connection.iter().copied(), aperture).for_each(|at| mark(at, CONNECTION));
        let again = marks.iter().filter(|&&mark| mark == BEAD | CONNECTION);
        again.count() as f64 * grid.cell_area_mm2()
    }
}

/// Cells that a pose covers and the previous one does not, and those of them that were uncovered
/// before.
#[derive(Clone, Copy, Debug, Default)]
pub struct Advance {
    /// All of them.
    pub cells: u32,
    /// Those covered for the first time.
    pub fresh: u32,
}

/// For each pose its advance over the previous one, or all of it at the start of a pass (`starts`). `sizes` are
/// those of the aperture at each pose relative to its own, or empty if they are all 1.
pub fn newly_covered(
    poses: &[Configuration],
    starts: &[bool],
    aperture: &Aperture,
    sizes: &[f64],
    cells_max: usize,
) -> Vec<Advance> {
    let Some((first, _)) = poses.split_first() else {
        return Vec::new();
    };
    let cell_mm = CELL_SHARE * aperture.minor_mm();
    let bounds = poses
        .iter()
        .fold(Box2::of(&[first.center]), |bounds, at| Box2 {
            min: bounds.min.inf(&at.center),
            max: bounds.max.sup(&at.center),
        });
    let most = sizes.iter().copied().fold(1.0, f64::max);
    let reach_mm = most * aperture.reach_mm();
    let grid = CellGrid::over(&bounds.grown(reach_mm), cell_mm, cells_max);
    // Sums of whole numbers: the same in whatever order the bands add them.
    let counts: Vec<[AtomicU32; 2]> = (0..poses.len()).map(|_| Default::default()).collect();
    stamp(
        &grid,
        (aperture, sizes),
        poses,
        &mut vec![(); grid.len()],
        false,
        |before, pose| before.wrapping_add(1) == pose && !starts[pose as usize],
        |_, covered, pose| {
            let [cells, fresh] = &counts[pose as usize];
            cells.fetch_add(covered.len() as u32, Ordering::Relaxed);
            let open = covered.iter().filter(|covered| !**covered).count();
            fresh.fetch_add(open as u32, Ordering::Relaxed);
            covered.fill(true);
        },
    );
    let advance = |[cells, fresh]: [AtomicU32; 2]| Advance {
        cells: cells.into_inner(),
        fresh: fresh.into_inner(),
    };
    counts.into_iter().map(advance).collect()
}

/// Sweeps poses in their order over a grid, bands of rows side by side. `visit` gets cells of a row
/// that a pose covers (what belongs to them, and a note for each that begins as `blank`), but not
/// those under the last pose that came to the row where the sweep `goes_on` from that one.
fn stamp<T: Send, N: Clone + Send + Sync>(
    grid: &CellGrid,
    (aperture, sizes): (&Aperture, &[f64]),
    poses: &[Configuration],
    cells: &mut [T],
    blank: N,
    goes_on: impl Fn(u32, u32) -> bool + Sync,
    visit: impl Fn(&mut [T], &mut [N], u32) + Sync,
) {
    let most = sizes.iter().copied().reduce(f64::max);
    let largest = most.map(|most| aperture.scaled(most));
    let of_band = grid.poses_of_bands(largest.as_ref().unwrap_or(aperture), poses.iter().copied());
    let bands = grid.bands_of(cells).zip(&of_band);
    bands.for_each_init(Vec::new, |notes, ((band, cells), numbers)| {
        notes.clear();
        notes.resize(cells.len(), blank.clone());
        let mut rows = SweptRows::of(&band, NOBODY);
        for &pose in numbers {
            let scaled = sizes.get(pose as usize).map(|&size| aperture.scaled(size));
            let aperture = scaled.as_ref().unwrap_or(aperture);
            grid.for_rows_within(&band, aperture, poses[pose as usize], |row, from, to| {
                let goes_on = |before| goes_on(before, pose);
                rows.for_new(row, pose, [from, to], goes_on, |columns| {
                    let own = band.numbers(row, columns);
                    visit(&mut cells[own.clone()], &mut notes[own], pose);
                });
            });
        }
    });
}

/// True if cells of this size resolve the end of a bead.
pub fn is_fine(cell_mm: f64, aperture: &Aperture) -> bool {
    cell_mm <= FINE_SHARE_MAX * aperture.minor_mm()
}

/// Coverage of the region within `walls` by passes, on a raster with a maximum number of cells; a
/// pass that returns after `return_mm` of path covers the place again.
pub fn within_walls(
    passes: &[LayerPass],
    walls: &EdgeIndex,
    aperture: &Aperture,
    cells_max: usize,
    return_mm: f64,
) -> Coverage {
    let poses = swept_poses(passes, aperture);
    let cell_mm = CELL_SHARE * aperture.minor_mm();
    Coverage::sweep(walls, aperture, &poses, cell_mm, cells_max, return_mm)
}
