//! What a bridge between two loops spoils: ground that it leaves open or covers again, on a raster.

use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::Box2;
use crate::plan::coverage::visits::Visits;
use crate::plan::pass::sweep::swept;
use crate::plan::pass::{LayerPass, bounds_of};

/// Raster cell against the minor semi-axis: many places are tried.
const CELL_SHARE: f64 = 0.2;
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

/// What bridges cost among the passes of a region.
pub struct BridgeCosts {
    visits: Visits,
}

impl BridgeCosts {
    /// Of all passes of a region.
    pub fn of(passes: &[LayerPass], aperture: &Aperture) -> BridgeCosts {
        let bounds = bounds_of(passes, aperture);
        BridgeCosts {
            visits: Visits::of_passes(passes, &bounds, aperture, CELL_SHARE),
        }
    }

    /// Ground that the bridge leaves open or covers again, less what it closes, mm².
    pub fn cost_mm2(&self, bridge: &Bridge, passes: &[LayerPass]) -> f64 {
        let window_mm = WINDOW_SHARE * self.visits.aperture().major_mm();
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
        // What is printed as before belongs to a loop and to a way both.
        let mut ways: Vec<(u8, Vec<Configuration>)> = Vec::new();
        for side in [0, 1] {
            ways.push((1 << side, opening(side).collect()));
            for end in [0, 1] {
                let way = end ^ usize::from(side == 1 && bridge.crossed);
                ways.push((1 << side | 4 << way, away(side, end)));
            }
        }
        for end in [0, 1] {
            let other = end ^ usize::from(bridge.crossed);
            let [from, to] = [(0, end), (1, other)]
                .map(|(side, end)| pass(side).placements[bridge.ends[side][end]].at);
            let between = bridge.ways[end].iter().copied();
            let way = [from].into_iter().chain(between).chain([to]);
            ways.push((4 << end, way.collect()));
        }
        let spoiled = self.spoiled_cells(&ways);
        spoiled as f64 * self.visits.cell_area_mm2()
    }

    /// How many cells are spoiled more after than before, by ways of poses each with the marks of what it
    /// belongs to: before to either loop (1, 2), after to either way that joins them (4, 8).
    fn spoiled_cells(&self, ways: &[(u8, Vec<Configuration>)]) -> i64 {
        let (grid, aperture) = (self.visits.grid(), self.visits.aperture());
        let poses = ways.iter().flat_map(|(_, way)| way);
        let centers: Vec<Point2> = poses.map(|at| at.center).collect();
        let window = grid.window_about(&Box2::of(&centers).grown(aperture.reach_mm()));
        let ([bottom, top], [left, right]) = (window.rows, window.columns);
        let columns = right + 1 - left;
        let mut marks = vec![0u8; columns * (top + 1 - bottom)];
        for (own, way) in ways {
            for at in swept(way.iter().copied(), aperture) {
                grid.for_rows_within(&window, aperture, at, |row, from, to| {
                    let first = (row - bottom) * columns;
                    for mark in &mut marks[first + from - left..=first + to - left] {
                        *mark |= own;
                    }
                });
            }
        }
        let cells = marks.iter().enumerate().filter(|(_, mark)| **mark != 0);
        cells
            .map(|(at, mark)| {
                let (old, new) = ((mark & 3).count_ones(), (mark >> 2).count_ones());
                let cell = (at / columns + bottom) * grid.columns + at % columns + left;
                let others = self.visits.count(cell).saturating_sub(old);
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
