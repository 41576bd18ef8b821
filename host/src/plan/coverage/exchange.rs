//! What replacing some poses of a bead by others changes: area opened, area covered again.
//!
//! In: a [`Raster`] that counts the poses of all beads, the poses replaced (mm, rad). Out: the change,
//! mm², and nothing is stamped for good. Every cell knows how many poses cover it, so that what the
//! bead's own neighbourhood and what other beads cover can be told apart without stamping anything
//! again; a window is compared by sets of bits, 64 cells at a time: some thousand replacements of a
//! region are asked for.

use crate::geometry::cell_grid::CellWindow;
use crate::geometry::clearance::Configuration;
use crate::plan::coverage::raster::Raster;

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
pub struct CoverageChange {
    /// Area that was covered and is open then; negative where an open one is covered.
    pub opened_mm2: f64,
    /// Area covered again then, less what was before.
    pub recovered_mm2: f64,
}

/// The cells about some poses that may be replaced; its memory serves many of them.
#[derive(Default)]
pub struct Exchange {
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

impl Exchange {
    /// Looks at `old` poses that may be replaced by others at most `reach_mm` away; `beside` are those
    /// of the chain before and after them, near enough to count as the same bead.
    pub fn look(
        &mut self,
        raster: &Raster,
        old: &[Configuration],
        beside: &[Configuration],
        reach_mm: f64,
    ) {
        let (grid, aperture) = (raster.grid(), raster.aperture());
        let window = grid.window_of(aperture, old, reach_mm);
        let width = window.columns[1] + 1 - window.columns[0];
        let height = window.rows[1] + 1 - window.rows[0];
        self.window = Some(window);
        self.words_per_row = width.div_ceil(64);
        raster.counts_of(&window, &mut self.counts);
        for at in old.iter().chain(beside) {
            grid.for_rows_within(&window, aperture, *at, |row, from, to| {
                for count in &mut self.counts[window.numbers(row, from..to + 1)] {
                    *count = count.saturating_sub(1);
                }
            });
        }
        self.sweep(raster, beside);
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
        self.before = self.cells_under(raster, old);
    }

    /// What comes of replacing the old poses by these.
    pub fn change(&mut self, raster: &Raster, new: &[Configuration]) -> CoverageChange {
        let [free, taken] = self.cells_under(raster, new);
        let area_mm2 = |cells: u32, before: u32| {
            (f64::from(cells) - f64::from(before)) * raster.cell_area_mm2()
        };
        CoverageChange {
            opened_mm2: -area_mm2(free, self.before[0]),
            recovered_mm2: area_mm2(taken, self.before[1]),
        }
    }

    /// How many of the free and the taken cells the poses cover.
    fn cells_under(&mut self, raster: &Raster, poses: &[Configuration]) -> [u32; 2] {
        self.sweep(raster, poses);
        let count = |among: &Cells| -> u32 {
            let words = among.words.iter().zip(&self.covered.words);
            words.map(|(a, b)| (a & b).count_ones()).sum()
        };
        [count(&self.free), count(&self.taken)]
    }

    /// Marks the cells of the window under the poses.
    fn sweep(&mut self, raster: &Raster, poses: &[Configuration]) {
        let Some(window) = self.window else {
            return;
        };
        let height = window.rows[1] + 1 - window.rows[0];
        self.covered.clear(height * self.words_per_row);
        let (covered, words_per_row) = (&mut self.covered, self.words_per_row);
        let (grid, aperture) = (raster.grid(), raster.aperture());
        for &at in poses {
            grid.for_rows_within(&window, aperture, at, |row, from, to| {
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
    use crate::geometry::polygon::Box2;
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
        let mut raster = Raster::over(&bounds, &ELLIPSE, 0.15, 12_000_000);
        let (own, other) = (row(0.0), row(1.2));
        raster.add(&own);
        raster.add(&other);
        let mut exchange = Exchange::default();
        exchange.look(&raster, &own, &[], 1.3);
        // 4 mm of 1.2 mm and an ellipse at both ends together.
        let area_mm2 = 4.0 * 1.2 + ELLIPSE.area_mm2();
        let is = |found: CoverageChange, opened_mm2: f64, recovered_mm2: f64| {
            let off_mm2 = (found.opened_mm2 - opened_mm2)
                .abs()
                .max((found.recovered_mm2 - recovered_mm2).abs());
            assert!(
                off_mm2 < 0.02 * area_mm2,
                "{found:?} {opened_mm2} {recovered_mm2}"
            );
        };
        is(exchange.change(&raster, &own), 0.0, 0.0);
        is(exchange.change(&raster, &[]), area_mm2, 0.0);
        is(exchange.change(&raster, &row(-1.2)), 0.0, 0.0);
        is(exchange.change(&raster, &row(1.2)), area_mm2, area_mm2);
        raster.remove(&own);
        raster.remove(&other);
        let mut counts = Vec::new();
        raster.counts_of(&raster.grid().window(), &mut counts);
        assert!(counts.iter().all(|count| *count == 0));
    }
}
