//! The cost of a bridge between two loops: area that it leaves uncovered or covers again, on a
//! raster.
//!
//! In: passes of a region, two loops and the places where they are opened. Out: wasted area, mm².
//! Cells of 0.2 b: many places are tried, and few have similar costs.

use crate::geometry::aperture::Aperture;
use crate::geometry::cell_grid::NO_COLUMNS;
use crate::geometry::clearance::Configuration;
use crate::plan::coverage::raster::Raster;
use crate::plan::pass::sweep::swept;
use crate::plan::pass::{LayerPass, bounds_of};
use std::collections::HashMap;
use std::rc::Rc;

/// Raster cell against the minor semi-axis: many places are tried.
const CELL_SHARE: f64 = 0.2;
/// Path evaluated on either side of an opening, relative to a.
const WINDOW_SHARE: f64 = 2.0;

/// Two loops, each opened over a stretch, and joined by two connections.
#[derive(Clone, Debug)]
pub struct Bridge {
    /// Numbers of the passes, the lower first.
    pub loops: [usize; 2],
    /// For each of them the last placement before the opening and the first after it.
    pub ends: [[usize; 2]; 2],
    /// True if the end before one opening faces the one after the other.
    pub crossed: bool,
    /// The connections from both ends of the first loop to the ones they face, without their own
    /// ends.
    pub ways: [Vec<Configuration>; 2],
}

impl Bridge {
    /// Key that orders bridges of equal cost.
    pub fn key(&self) -> ([usize; 2], [[usize; 2]; 2]) {
        (self.loops, self.ends)
    }
}

/// What bridges cost among the passes of a region.
pub struct BridgeCosts {
    raster: Raster,
}

impl BridgeCosts {
    /// Of all passes of a region.
    pub fn of(passes: &[LayerPass], aperture: &Aperture) -> BridgeCosts {
        let bounds = bounds_of(passes, aperture);
        BridgeCosts {
            raster: Raster::of_passes(passes, &bounds, aperture, CELL_SHARE),
        }
    }

    /// What bridges between two of the passes cost.
    pub fn between<'a>(&'a self, loops: [usize; 2], passes: &'a [LayerPass]) -> PairCosts<'a> {
        PairCosts {
            raster: &self.raster,
            loops: loops.map(|number| &passes[number]),
            steps: HashMap::new(),
            marks: Vec::new(),
        }
    }
}

/// The columns of a row that a swept step covers.
#[derive(Clone, Copy)]
struct RowRun {
    row: u32,
    columns: [u32; 2],
}

/// Costs of bridges between two passes. Many places are tried, with mostly the same connections:
/// the cells under each of their steps are found once.
pub struct PairCosts<'a> {
    raster: &'a Raster,
    loops: [&'a LayerPass; 2],
    /// By side and number of the placement that the step begins with.
    steps: HashMap<(usize, usize), Rc<[RowRun]>>,
    /// Memory for the marks of the cells about a bridge.
    marks: Vec<u8>,
}

impl PairCosts<'_> {
    /// Area that the bridge leaves uncovered or covers again, minus the area that it closes, mm².
    pub fn cost_mm2(&mut self, bridge: &Bridge) -> f64 {
        // Unchanged print belongs to both a loop and a connection.
        let mut swept: Vec<(u8, Rc<[RowRun]>)> = Vec::new();
        for side in [0, 1] {
            let ends = bridge.ends[side];
            for step in self.opened(side, ends) {
                swept.push((1 << side, self.step(side, step)));
            }
            for end in [0, 1] {
                let way = end ^ usize::from(side == 1 && bridge.crossed);
                for step in self.away(side, ends[end], end) {
                    swept.push((1 << side | 4 << way, self.step(side, step)));
                }
            }
        }
        for end in [0, 1] {
            let other = end ^ usize::from(bridge.crossed);
            let [from, to] = [(0, end), (1, other)]
                .map(|(side, end)| self.loops[side].placements[bridge.ends[side][end]].at);
            let between = bridge.ways[end].iter().copied();
            let way: Vec<Configuration> = [from].into_iter().chain(between).chain([to]).collect();
            swept.push((4 << end, self.rows_under(&way)));
        }
        self.wasted_cells(&swept) as f64 * self.raster.cell_area_mm2()
    }

    /// The steps of a loop that a bridge takes out.
    fn opened(&self, side: usize, [from, to]: [usize; 2]) -> impl Iterator<Item = usize> + use<> {
        let pass = self.loops[side];
        let count = pass.placements.len();
        let at_gap = !pass.closed && from > to;
        let steps = if at_gap {
            0
        } else {
            (to + count - from) % count
        };
        (0..steps).map(move |k| (from + k) % count)
    }

    /// The steps of a loop from an end of its opening on, away from it.
    fn away(&self, side: usize, from: usize, end: usize) -> Vec<usize> {
        let pass = self.loops[side];
        let count = pass.placements.len();
        let mut steps = Vec::new();
        let mut left_mm = WINDOW_SHARE * self.raster.aperture().major_mm();
        let mut at = from;
        for _ in 0..count {
            let (step, next) = match end {
                0 => ((at + count - 1) % count, (at + count - 1) % count),
                _ => (at, (at + 1) % count),
            };
            // The step that closes a loop does not belong to an open bead.
            if !pass.closed && step + 1 == count {
                break;
            }
            let [p, q] = [at, next].map(|number| pass.placements[number].at.center);
            left_mm -= (p - q).norm();
            if left_mm < 0.0 {
                break;
            }
            steps.push(step);
            at = next;
        }
        steps
    }

    /// The cells under a step of a loop, from one placement to the next.
    fn step(&mut self, side: usize, step: usize) -> Rc<[RowRun]> {
        if let Some(known) = self.steps.get(&(side, step)) {
            return known.clone();
        }
        let placements = &self.loops[side].placements;
        let ends = [step, (step + 1) % placements.len()].map(|number| placements[number].at);
        let found = self.rows_under(&ends);
        self.steps.insert((side, step), found.clone());
        found
    }

    /// The cells under a connection: of each row all from the first column to the last one, step by
    /// step.
    fn rows_under(&self, way: &[Configuration]) -> Rc<[RowRun]> {
        let (grid, aperture) = (self.raster.grid(), self.raster.aperture());
        let mut found: Vec<RowRun> = Vec::new();
        for ends in way.windows(2) {
            let window = grid.window_of(aperture, ends, 0.0);
            let [first, last] = window.rows;
            let mut rows = vec![NO_COLUMNS; last + 1 - first];
            for at in swept(ends.iter().copied(), aperture) {
                grid.for_rows_within(&window, aperture, at, |row, from, to| {
                    let columns = &mut rows[row - first];
                    *columns = match *columns {
                        NO_COLUMNS => [from, to],
                        [low, high] => [low.min(from), high.max(to)],
                    };
                });
            }
            let numbered = (first as u32..).zip(rows);
            let covered = numbered.filter(|(_, columns)| *columns != NO_COLUMNS);
            found.extend(covered.map(|(row, columns)| RowRun {
                row,
                columns: columns.map(|column| column as u32),
            }));
        }
        found.into()
    }

    /// The increase of wasted cells, from swept steps, each with the marks of the path to which it
    /// belongs: before to either loop (1, 2), after to either connection that joins them (4, 8).
    fn wasted_cells(&mut self, swept: &[(u8, Rc<[RowRun]>)]) -> i64 {
        let runs = || swept.iter().flat_map(|(_, runs)| runs.iter());
        let (mut low, mut high) = ([u32::MAX; 2], [0; 2]);
        for run in runs() {
            low = [low[0].min(run.row), low[1].min(run.columns[0])];
            high = [high[0].max(run.row), high[1].max(run.columns[1])];
        }
        if low[0] > high[0] {
            return 0;
        }
        let columns = (high[1] + 1 - low[1]) as usize;
        self.marks.clear();
        self.marks
            .resize(columns * (high[0] + 1 - low[0]) as usize, 0);
        for (own, runs) in swept {
            for run in runs.iter() {
                let first = (run.row - low[0]) as usize * columns;
                let [from, to] = run.columns.map(|column| (column - low[1]) as usize);
                for mark in &mut self.marks[first + from..=first + to] {
                    *mark |= own;
                }
            }
        }
        // By the marks of a cell, the beads of the two loops over it before and after.
        let beads: [[u16; 2]; 16] = std::array::from_fn(|marks| {
            [marks & 3, marks >> 2].map(|marks| marks.count_ones() as u16)
        });
        let rows = (low[0] as usize..).zip(self.marks.chunks(columns));
        rows.map(|(row, marks)| {
            let counts = self.raster.counts(row, low[1] as usize);
            let of_cells = marks.iter().map(|&mark| beads[usize::from(mark)]);
            // Unchanged print, most of it, is not looked up.
            let changed = of_cells.zip(counts).filter(|([old, new], _)| old != new);
            changed
                .map(|([old, new], &count)| {
                    let others = count.saturating_sub(old);
                    waste(others + new) - waste(others + old)
                })
                .sum::<i64>()
        })
        .sum()
    }
}

/// 1 if a cell under this many beads is open or covered again, 0 under one bead.
fn waste(beads: u16) -> i64 {
    i64::from(beads != 1)
}
