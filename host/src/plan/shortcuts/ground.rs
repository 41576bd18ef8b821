//! The ground that poses cover, counted on a raster.
//!
//! In: the poses of all chains. Out: by how much the ground that is open or laid twice changes where
//! some poses are replaced by others. Every cell knows how many poses cover it, so that what the chain's
//! own neighbourhood and what other beads cover can be told apart without stamping anything again; a
//! window is compared by sets of bits, 64 cells at a time.

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::geometry::cell_grid::{CellGrid, CellWindow};
use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::Box2;

/// Raster cell against the minor semi-axis: 0.03 mm for 0.2 mm.
const CELL_SHARE: f64 = 0.15;
/// Most cells: larger parts get larger ones.
const CELLS_MAX: usize = 12_000_000;

/// How many poses cover each cell.
pub struct Ground {
    aperture: Aperture,
    grid: CellGrid,
    counts: Vec<u16>,
}

impl Ground {
    /// Nothing covered yet, over these bounds.
    pub fn over(bounds: &Box2, aperture: &Aperture) -> Ground {
        let grid = CellGrid::over(bounds, CELL_SHARE * aperture.minor_mm(), CELLS_MAX);
        Ground {
            aperture: *aperture,
            grid,
            counts: vec![0; grid.len()],
        }
    }

    /// Adds poses.
    pub fn add(&mut self, poses: &[Configuration]) {
        self.change(poses, |count| count.saturating_add(1));
    }

    /// Takes poses away that were added before.
    pub fn remove(&mut self, poses: &[Configuration]) {
        self.change(poses, |count| count.saturating_sub(1));
    }

    fn change(&mut self, poses: &[Configuration], change: impl Fn(u16) -> u16) {
        let window = self.grid.window();
        for &at in poses {
            self.grid.for_rows(&self.aperture, at, |row, from, to| {
                let cells = window.numbers(row, from..to + 1);
                for count in &mut self.counts[cells] {
                    *count = change(*count);
                }
            });
        }
    }

    /// Area of a cell, mm².
    pub fn cell_area_mm2(&self) -> f64 {
        self.grid.cell_area_mm2()
    }
}

/// A set of cells of a window, by rows.
#[derive(Default)]
struct Cells {
    words: Vec<u64>,
}

impl Cells {
    fn clear(&mut self, words: usize) {
        self.words.clear();
        self.words.resize(words, 0);
    }

    /// Adds the columns `from..=to` of the row that begins at word `row`.
    fn add(&mut self, row: usize, from: usize, to: usize) {
        let (first, last) = (row + from / 64, row + to / 64);
        let (head, tail) = (u64::MAX << (from % 64), u64::MAX >> (63 - to % 64));
        if first == last {
            self.words[first] |= head & tail;
            return;
        }
        self.words[first] |= head;
        self.words[first + 1..last].fill(u64::MAX);
        self.words[last] |= tail;
    }
}

/// What replacing poses changes, in mm².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GroundChange {
    /// Ground that was covered and is open then; negative where open ground is covered.
    pub lost_mm2: f64,
    /// Ground laid twice then, less what was before.
    pub twice_mm2: f64,
}

/// The ground about some poses that may be replaced; its memory serves many of them.
#[derive(Default)]
pub struct Footprint {
    window: Option<CellWindow>,
    words_per_row: usize,
    counts: Vec<u16>,
    /// Cells that only the replaced poses cover, or nothing.
    free: Cells,
    /// Cells that other beads cover, and none of the poses beside the replaced ones.
    taken: Cells,
    covered: Cells,
    before: [u32; 2],
}

impl Footprint {
    /// Looks at `old` poses that may be replaced by others at most `reach_mm` away; `beside` are those
    /// of the chain before and after them, near enough to count as the same bead.
    pub fn look(
        &mut self,
        ground: &Ground,
        old: &[Configuration],
        beside: &[Configuration],
        reach_mm: f64,
    ) {
        let reach_mm = ground.aperture.reach_mm() + reach_mm;
        let reach = Vector2::new(reach_mm, reach_mm);
        let around = old.iter().map(|at| at.center);
        let (low, high) = around.fold(
            (
                Vector2::repeat(f64::INFINITY),
                Vector2::repeat(f64::NEG_INFINITY),
            ),
            |(low, high), p| (low.inf(&p.coords), high.sup(&p.coords)),
        );
        let area = Box2 {
            min: (low - reach).into(),
            max: (high + reach).into(),
        };
        let window = ground.grid.window_about(&area);
        let width = window.columns[1] + 1 - window.columns[0];
        let height = window.rows[1] + 1 - window.rows[0];
        self.window = Some(window);
        self.words_per_row = width.div_ceil(64);
        self.counts.clear();
        let all = ground.grid.window();
        for row in window.rows[0]..=window.rows[1] {
            let cells = all.numbers(row, window.columns[0]..window.columns[1] + 1);
            self.counts.extend_from_slice(&ground.counts[cells]);
        }
        let (grid, aperture) = (&ground.grid, &ground.aperture);
        for at in old.iter().chain(beside) {
            grid.for_rows_within(&window, aperture, *at, |row, from, to| {
                for count in &mut self.counts[window.numbers(row, from..to + 1)] {
                    *count = count.saturating_sub(1);
                }
            });
        }
        self.sweep(ground, beside);
        self.free.clear(height * self.words_per_row);
        self.taken.clear(height * self.words_per_row);
        for (row, counts) in self.counts.chunks(width).enumerate() {
            for (word, counts) in counts.chunks(64).enumerate() {
                let far = counts.iter().enumerate();
                let far = far.fold(0, |bits, (bit, count)| {
                    bits | (u64::from(*count > 0) << bit)
                });
                let place = row * self.words_per_row + word;
                let others = !self.covered.words[place];
                self.free.words[place] = others & !far;
                self.taken.words[place] = others & far;
            }
        }
        self.before = self.cells_under(ground, old);
    }

    /// What comes of replacing the old poses by these.
    pub fn change(&mut self, ground: &Ground, new: &[Configuration]) -> GroundChange {
        let [free, taken] = self.cells_under(ground, new);
        let area_mm2 = |cells: u32, before: u32| {
            (f64::from(cells) - f64::from(before)) * ground.cell_area_mm2()
        };
        GroundChange {
            lost_mm2: -area_mm2(free, self.before[0]),
            twice_mm2: area_mm2(taken, self.before[1]),
        }
    }

    /// How many of the free and the taken cells the poses cover.
    fn cells_under(&mut self, ground: &Ground, poses: &[Configuration]) -> [u32; 2] {
        self.sweep(ground, poses);
        let count = |among: &Cells| -> u32 {
            let words = among.words.iter().zip(&self.covered.words);
            words.map(|(a, b)| (a & b).count_ones()).sum()
        };
        [count(&self.free), count(&self.taken)]
    }

    /// Marks the cells of the window under the poses.
    fn sweep(&mut self, ground: &Ground, poses: &[Configuration]) {
        let Some(window) = self.window else {
            return;
        };
        let height = window.rows[1] + 1 - window.rows[0];
        self.covered.clear(height * self.words_per_row);
        let (covered, words_per_row) = (&mut self.covered, self.words_per_row);
        for &at in poses {
            ground
                .grid
                .for_rows_within(&window, &ground.aperture, at, |row, from, to| {
                    let row = (row - window.rows[0]) * words_per_row;
                    covered.add(row, from - window.columns[0], to - window.columns[0]);
                });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;
    use crate::geometry::test_shapes::ELLIPSE;

    fn row(y: f64) -> Vec<Configuration> {
        let at = |i: u32| Configuration {
            center: Point2::new(f64::from(i) * 0.05, y),
            heading_rad: std::f64::consts::FRAC_PI_2,
        };
        (0..=80).map(at).collect()
    }

    /// Goal: what a bead leaves open and lays twice is its area. Method: a bead 4 mm long and 1.2 mm wide
    /// beside another one, left out, moved to open ground and moved over the other one.
    #[test]
    fn areas_are_those_of_the_beads() {
        let bounds = Box2 {
            min: Point2::new(-2.0, -4.0),
            max: Point2::new(6.0, 4.0),
        };
        let mut ground = Ground::over(&bounds, &ELLIPSE);
        let (own, other) = (row(0.0), row(1.2));
        ground.add(&own);
        ground.add(&other);
        let mut footprint = Footprint::default();
        footprint.look(&ground, &own, &[], 1.3);
        // 4 mm of 1.2 mm and an ellipse at both ends together.
        let area_mm2 = 4.0 * 1.2 + ELLIPSE.area_mm2();
        let is = |found: GroundChange, lost_mm2: f64, twice_mm2: f64| {
            let off_mm2 = (found.lost_mm2 - lost_mm2)
                .abs()
                .max((found.twice_mm2 - twice_mm2).abs());
            assert!(
                off_mm2 < 0.02 * area_mm2,
                "{found:?} {lost_mm2} {twice_mm2}"
            );
        };
        is(footprint.change(&ground, &own), 0.0, 0.0);
        is(footprint.change(&ground, &[]), area_mm2, 0.0);
        is(footprint.change(&ground, &row(-1.2)), 0.0, 0.0);
        is(footprint.change(&ground, &row(1.2)), area_mm2, area_mm2);
        ground.remove(&own);
        ground.remove(&other);
        assert!(ground.counts.iter().all(|count| *count == 0));
    }
}
