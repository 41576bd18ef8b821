//! What a bridge between two loops spoils: ground that it leaves open or covers again, on a raster.

use super::links::bounds_of;
use super::passes::LayerPass;
use super::visits::{poses, swept};
use crate::geometry::aperture::Aperture;
use crate::geometry::cell_grid::CellGrid;
use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::Box2;
use crate::geometry::{Point2, Vector2};

/// Raster cell against the minor semi-axis, and most cells.
const CELL_SHARE: f64 = 0.2;
const CELLS_MAX: usize = 8_000_000;
/// Path looked at on either side of an opening, against a.
const WINDOW_SHARE: f64 = 2.0;

/// Two loops opened over a stretch each and joined by two ways.
#[derive(Clone, Debug)]
pub struct Bridge {
    /// Numbers of the passes, the lower first.
    pub loops: [usize; 2],
    /// For each of them the last placement before the opening and the first behind it.
    pub ends: [[usize; 2]; 2],
    /// True where the end before the one opening faces the one behind the other.
    pub crossed: bool,
    /// The ways from either end of the first loop to the one it faces, both ends left out.
    pub ways: [Vec<Configuration>; 2],
}

impl Bridge {
    /// What tells bridges of equal cost apart.
    pub fn key(&self) -> ([usize; 2], [[usize; 2]; 2]) {
        (self.loops, self.ends)
    }
}

/// How many passes cover each cell.
pub struct BridgeCosts {
    aperture: Aperture,
    grid: CellGrid,
    counts: Vec<u8>,
}

impl BridgeCosts {
    /// Of all passes of a region.
    pub fn of(passes: &[LayerPass], aperture: &Aperture) -> BridgeCosts {
        let bounds = bounds_of(passes, aperture);
        let grid = CellGrid::over(&bounds, CELL_SHARE * aperture.minor_mm(), CELLS_MAX);
        let mut costs = BridgeCosts {
            aperture: *aperture,
            grid,
            counts: vec![0; grid.len()],
        };
        let mut seen = vec![usize::MAX; grid.len()];
        for (number, pass) in passes.iter().enumerate() {
            for at in poses(pass, aperture) {
                grid.for_rows(aperture, at, |row, from, to| {
                    let cells = row * grid.columns + from..=row * grid.columns + to;
                    let counts = costs.counts[cells.clone()].iter_mut();
                    for (seen, count) in seen[cells].iter_mut().zip(counts) {
                        if std::mem::replace(seen, number) != number {
                            *count = count.saturating_add(1);
                        }
                    }
                });
            }
        }
        costs
    }

    /// Ground that the bridge leaves open or covers again, less what it closes, mm².
    pub fn cost_mm2(&self, bridge: &Bridge, passes: &[LayerPass]) -> f64 {
        let window_mm = WINDOW_SHARE * self.aperture.major_mm();
        let pass = |side: usize| &passes[bridge.loops[side]];
        // The way from an end away from the opening, the end first.
        let away = |side: usize, end: usize| {
            let step = if end == 0 { -1 } else { 1 };
            stretch(pass(side), bridge.ends[side][end], step, window_mm)
        };
        let opening = |side: usize| {
            let [from, to] = bridge.ends[side];
            let count = pass(side).placements.len();
            let between = (to + count - from) % count;
            let at_gap = !pass(side).closed && from > to;
            let printed = (0..=between).filter(move |_| !at_gap);
            printed.map(move |k| pass(side).placements[(from + k) % count].at)
        };
        let mut ways: Vec<(usize, Vec<Configuration>)> = Vec::new();
        for side in [0, 1] {
            ways.push((side, away(side, 0)));
            ways.push((side, opening(side).collect()));
            ways.push((side, away(side, 1)));
        }
        for end in [0, 1] {
            let mut way = away(0, end);
            way.reverse();
            way.extend(&bridge.ways[end]);
            way.extend(away(1, end ^ usize::from(bridge.crossed)));
            ways.push((2 + end, way));
        }
        let spoiled = self.spoiled_cells(&ways);
        spoiled as f64 * self.grid.cell_area_mm2()
    }

    /// How many cells ways 2 and 3 spoil more than ways 0 and 1, each in one or several pieces.
    fn spoiled_cells(&self, ways: &[(usize, Vec<Configuration>)]) -> i64 {
        let poses = ways.iter().flat_map(|(_, way)| way);
        let centers: Vec<Point2> = poses.map(|at| at.center).collect();
        let mut bounds = Box2::of(&centers);
        let reach = Vector2::repeat(self.aperture.reach_mm());
        bounds.min -= reach;
        bounds.max += reach;
        let cell = |p: Point2| (p - self.grid.origin) / self.grid.cell_mm;
        let (low, high) = (cell(bounds.min), cell(bounds.max));
        let (column, row) = (low.x.max(0.0) as usize, low.y.max(0.0) as usize);
        // The part of the raster about the ways; what lies beyond is cut off.
        let part = CellGrid {
            origin: self.grid.origin + Vector2::new(column as f64, row as f64) * self.grid.cell_mm,
            cell_mm: self.grid.cell_mm,
            columns: (high.x.max(0.0) as usize).min(self.grid.columns - 1) + 1 - column,
            rows: (high.y.max(0.0) as usize).min(self.grid.rows - 1) + 1 - row,
        };
        // Which of the ways cover each cell.
        let mut marks = vec![0u8; part.len()];
        for (number, way) in ways {
            for at in swept(way.iter().copied(), &self.aperture) {
                part.for_rows(&self.aperture, at, |row, from, to| {
                    let first = row * part.columns;
                    for mark in &mut marks[first + from..=first + to] {
                        *mark |= 1 << number;
                    }
                });
            }
        }
        let cells = marks.iter().enumerate().filter(|(_, mark)| **mark != 0);
        cells
            .map(|(at, mark)| {
                let (old, new) = ((mark & 3).count_ones(), (mark >> 2).count_ones());
                let (across, up) = (at % part.columns + column, at / part.columns + row);
                let at = up * self.grid.columns + across;
                let others = u32::from(self.counts[at]).saturating_sub(old);
                spoils(others + new) - spoils(others + old)
            })
            .sum()
    }
}

/// What a cell under so many beads is worth: best is one.
fn spoils(beads: u32) -> i64 {
    i64::from(beads != 1)
}

/// The placements of a loop from `from` on, as far as `length_mm`.
fn stretch(pass: &LayerPass, from: usize, step: isize, length_mm: f64) -> Vec<Configuration> {
    let count = pass.placements.len() as isize;
    let mut way: Vec<Configuration> = Vec::new();
    let mut left_mm = length_mm;
    for k in 0..count {
        let i = from as isize + step * k;
        if !pass.closed && !(0..count).contains(&i) {
            break;
        }
        let at = pass.placements[i.rem_euclid(count) as usize].at;
        if let Some(last) = way.last() {
            left_mm -= (at.center - last.center).norm();
        }
        if left_mm < 0.0 {
            break;
        }
        way.push(at);
    }
    way
}
