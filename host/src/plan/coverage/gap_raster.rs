//! The area that all passes leave uncovered, and the area that a placement or a gap-fill move would
//! add, on a raster.
//!
//! In: passes, walls (mm). Out: gaps as sets of cells, the placement that gains most in one, areas
//! in mm². Cells of 0.1 b, at most six million; larger regions get larger ones.

use crate::geometry::aperture::Aperture;
use crate::geometry::cell_grid::{ASIDE, CellGrid, CellWindow, NO_COLUMNS, SweptRows, for_beyond};
use crate::geometry::clearance::{Configuration, is_inside};
use crate::geometry::coverage::{Cell, Coverage};
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::{Point2, Vector2};
use crate::plan::coverage::raster::{same_bead_mm, within_walls};
use crate::plan::headings::profile::slide_inside;
use crate::plan::pass::LayerPass;
use crate::plan::pass::sweep::poses_between;
use rayon::prelude::*;
use std::ops::Range;

/// Least area of a gap that is searched, against that of the aperture (0.003 mm² for the 0.6 x 0.2 mm ellipse): no move
/// into a smaller one is worth its time. With twice as much 31 slices keep their plans.
const GAP_SHARE_MIN: f64 = 0.008;
/// What covering a place again costs a gap-fill move against covering a new one. It counts what the figures count.
const NET_AGAIN_WEIGHT: f64 = 0.22;
/// Headings tried over the aperture's period.
const HEADINGS: usize = 12;
/// Places tried in each gap.
const SEEDS: usize = 12;
/// Offsets of a placement from its place along and across it, against a and b.
const START_SHARES: [f64; 2] = [0.7, 0.6];
/// Slides of a tried placement off the walls.
const SLIDES: usize = 4;
/// Rounds of the refining pattern search, each with half the step of the one before.
const REFINE_ROUNDS: usize = 5;
/// Most cells of the raster.
const CELLS_MAX: usize = 6_000_000;

/// The coverage raster while gaps are filled.
pub struct GapRaster {
    coverage: Coverage,
    grid: CellGrid,
    /// Open cells of each row up to each cell.
    sums: Vec<u32>,
    /// Connected sets of open cells, each from its first cell on, in raster order of that cell.
    gaps: Vec<Vec<u32>>,
    /// Rows newly covered since sums and gaps were found.
    stale_rows: Vec<bool>,
    /// The search for gaps that saw the cell last, and the number of searches.
    seen: Vec<u32>,
    searches: u32,
}

/// The area that a gap-fill move covers, regardless of other moves.
pub struct Footprint {
    cells: Vec<FootprintCell>,
}

/// A cell of it.
#[derive(Clone, Copy)]
struct FootprintCell {
    cell: u32,
    /// The pass covers it too, within 4a of path before or after.
    is_own: bool,
    /// The path, gap-fill move included, visits this cell more than 4a apart.
    is_returned_to: bool,
}

impl FootprintCell {
    /// Whether the cell, `state` before the gap-fill move, counts as covered again after it: by
    /// another pass or long ago by this one, or by one that was here more than 4a of path before or
    /// after.
    fn is_twice(&self, state: Cell) -> bool {
        (state == Cell::Covered && !self.is_own) || self.is_returned_to
    }
}

impl GapRaster {
    /// The raster of the area that `passes` cover within `walls`.
    pub fn of(passes: &[LayerPass], aperture: &Aperture, walls: &EdgeIndex) -> GapRaster {
        let coverage = within_walls(passes, walls, aperture, CELLS_MAX, f64::MAX);
        let cells = coverage.cells.len();
        let open = |cell: &u32| coverage.cells[*cell as usize] == Cell::Gap;
        let open: Vec<u32> = (0..cells as u32).into_par_iter().filter(open).collect();
        let mut raster = GapRaster {
            grid: coverage.grid(),
            sums: vec![0; cells],
            gaps: Vec::from_iter((!open.is_empty()).then_some(open)),
            stale_rows: vec![true; coverage.rows],
            seen: vec![0; cells],
            searches: 0,
            coverage,
        };
        raster.update();
        raster
    }

    fn cell_area_mm2(&self) -> f64 {
        self.grid.cell_area_mm2()
    }

    /// Connected sets of open cells, each from its first cell on, in raster order of that cell.
    pub fn gaps(&self) -> &[Vec<u32>] {
        &self.gaps
    }

    /// Finds gaps and sums again where something was covered.
    pub fn update(&mut self) {
        self.searches += 1;
        let columns = self.grid.columns;
        let is_stale = |cell: &u32| self.stale_rows[*cell as usize / columns];
        let (stale, mut gaps): (Vec<Vec<u32>>, Vec<Vec<u32>>) = std::mem::take(&mut self.gaps)
            .into_iter()
            .partition(|gap| gap.iter().any(is_stale));
        let mut seeds: Vec<u32> = stale.into_iter().flatten().collect();
        seeds.sort_unstable();
        gaps.extend(seeds.into_iter().filter_map(|seed| self.gap_of(seed)));
        gaps.sort_unstable_by_key(|gap| gap[0]);
        self.gaps = gaps;
        let rows = self.sums.par_chunks_mut(columns);
        let rows = rows.zip(self.coverage.cells.par_chunks(columns));
        rows.zip(&mut self.stale_rows)
            .for_each(|((sums, cells), is_stale)| {
                if std::mem::take(is_stale) {
                    sum_row(sums, cells);
                }
            });
    }

    /// The open cells connected with `seed` that this search has not seen, if any.
    fn gap_of(&mut self, seed: u32) -> Option<Vec<u32>> {
        let (cells, columns, rows) = (&self.coverage.cells, self.grid.columns, self.grid.rows);
        let (seen, search) = (&mut self.seen, self.searches);
        let mut is_new = |cell: usize| {
            cells[cell] == Cell::Gap && std::mem::replace(&mut seen[cell], search) != search
        };
        if !is_new(seed as usize) {
            return None;
        }
        let mut gap = vec![seed];
        let mut head = 0;
        while head < gap.len() {
            let at = gap[head] as usize;
            head += 1;
            let (column, row) = (at % columns, at / columns);
            let around = [
                (column > 0).then(|| at - 1),
                (column + 1 < columns).then(|| at + 1),
                (row > 0).then(|| at - columns),
                (row + 1 < rows).then(|| at + columns),
            ];
            let around = around.into_iter().flatten();
            gap.extend(around.filter(|&next| is_new(next)).map(|next| next as u32));
        }
        Some(gap)
    }

    /// The placement in or near a gap with the largest gain, if any has one.
    pub fn best_placement(
        &self,
        gap: &[u32],
        aperture: &Aperture,
        walls: &EdgeIndex,
    ) -> Option<Configuration> {
        if (gap.len() as f64) * self.cell_area_mm2() < GAP_SHARE_MIN * aperture.area_mm2() {
            return None;
        }
        let headings = if aperture.is_round() { 1 } else { HEADINGS };
        let better = |at: Configuration, than: f64| {
            let gain = self.gain_mm2(aperture, at);
            // The costly query only where it can matter.
            (gain > than && is_inside(aperture, at, walls, 0.0)).then_some((gain, at))
        };
        let mut best: Option<(f64, Configuration)> = None;
        for &seed in gap.iter().step_by(gap.len().div_ceil(SEEDS)) {
            let center = self.coverage.center(seed as usize);
            for heading in 0..headings {
                let heading_rad = aperture.period_rad() * heading as f64 / headings as f64;
                let starts = self.starts_about(center, heading_rad, aperture);
                for at in starts {
                    let Some(at) = slide_inside(at, aperture, walls, SLIDES, 0.0) else {
                        continue;
                    };
                    best = better(at, best.map_or(0.0, |b| b.0)).or(best);
                }
            }
        }
        let step_rad = 0.5 * aperture.period_rad() / headings as f64;
        Some(self.refined(best?, step_rad, &better))
    }

    /// The placement centred on a place, and those that touch it with an end or a side.
    fn starts_about(&self, p: Point2, heading_rad: f64, aperture: &Aperture) -> [Configuration; 5] {
        let along = Vector2::new(heading_rad.cos(), heading_rad.sin());
        let across = Vector2::new(-along.y, along.x);
        // Not on the raster's own places: the outline would pass through the middles of cells.
        let p = p + ASIDE * self.grid.cell_mm;
        let end = along * (START_SHARES[0] * aperture.major_mm());
        let side = across * (START_SHARES[1] * aperture.minor_mm());
        [Vector2::zeros(), end, -end, side, -side].map(|shift| Configuration {
            center: p + shift,
            heading_rad,
        })
    }

    /// Pattern search about the best start.
    fn refined(
        &self,
        start: (f64, Configuration),
        step_rad: f64,
        better: &impl Fn(Configuration, f64) -> Option<(f64, Configuration)>,
    ) -> Configuration {
        let (mut best, mut at) = start;
        let mut step_mm = 4.0 * self.coverage.cell_mm;
        let mut step_rad = step_rad;
        for _ in 0..REFINE_ROUNDS {
            let moves = [
                (step_mm, 0.0, 0.0),
                (-step_mm, 0.0, 0.0),
                (0.0, step_mm, 0.0),
                (0.0, -step_mm, 0.0),
                (0.0, 0.0, step_rad),
                (0.0, 0.0, -step_rad),
            ];
            let mut improved = false;
            for (x, y, turn) in moves {
                let next = Configuration {
                    center: at.center + Vector2::new(x, y),
                    heading_rad: at.heading_rad + turn,
                };
                if let Some(found) = better(next, best) {
                    ((best, at), improved) = (found, true);
                }
            }
            if !improved {
                step_mm *= 0.5;
                step_rad *= 0.5;
            }
        }
        at
    }

    /// Newly covered area, mm², from the sums.
    fn gain_mm2(&self, aperture: &Aperture, at: Configuration) -> f64 {
        let mut open = 0;
        self.grid.for_rows(aperture, at, |row, from, to| {
            let row = row * self.grid.columns;
            let before = from.checked_sub(1).map_or(0, |c| self.sums[row + c]);
            open += self.sums[row + to] - before;
        });
        f64::from(open) * self.cell_area_mm2()
    }

    /// What a gap-fill move newly covers, less the weighted area that it covers
    /// again, mm².
    pub fn net_mm2(&self, footprint: &Footprint) -> f64 {
        let (mut open, mut again) = (0, 0);
        for own in &footprint.cells {
            match self.coverage.cells[own.cell as usize] {
                Cell::Gap => open += 1,
                Cell::Covered if own.is_twice(Cell::Covered) => again += 1,
                _ => {}
            }
        }
        (f64::from(open) - NET_AGAIN_WEIGHT * f64::from(again)) * self.cell_area_mm2()
    }

    /// Marks the footprint of a gap-fill move as covered; sums and gaps stay until the next update.
    pub fn cover(&mut self, footprint: &Footprint) {
        for own in &footprint.cells {
            let state = &mut self.coverage.cells[own.cell as usize];
            *state = match (*state, own.is_twice(*state)) {
                (Cell::Gap, false) => Cell::Covered,
                (Cell::Gap | Cell::Covered, true) => Cell::Overlap,
                (other, _) => other,
            };
            self.stale_rows[own.cell as usize / self.grid.columns] = true;
        }
    }

    /// The area that a gap-fill move after placement `after` covers, and that of the 4a of the pass
    /// before and after it; `None` if it covers no more open area than `least_mm2`.
    pub fn footprint(
        &self,
        pass: &LayerPass,
        after: usize,
        fill: &[Configuration],
        aperture: &Aperture,
        least_mm2: f64,
    ) -> Option<Footprint> {
        let return_mm = same_bead_mm(aperture);
        let placements = &pass.placements;
        let start = placements[after].at;
        let step_mm = |p: Configuration, q: Configuration| (q.center - p.center).norm();
        let mut walk = Walk::about(&self.grid, fill, aperture);
        let mut at_mm = 0.0;
        for (&p, &q) in std::iter::once(&start).chain(fill).zip(fill) {
            at_mm += step_mm(p, q);
            walk.go(Part::GapFillMove, q, p, at_mm);
        }
        walk.end(Part::GapFillMove);
        let is_open = |own: &&Listed| self.coverage.cells[own.cell as usize] == Cell::Gap;
        let open = walk.listed.iter().filter(is_open).count();
        if open as f64 * self.cell_area_mm2() <= least_mm2 {
            return None;
        }
        let end_mm = at_mm + return_mm;
        for pair in placements[after..].windows(2) {
            let (p, q) = (pair[0].at, pair[1].at);
            at_mm += step_mm(p, q);
            if at_mm > end_mm {
                break;
            }
            walk.go(Part::Pass, q, p, at_mm);
        }
        walk.end(Part::Pass);
        at_mm = 0.0;
        walk.go(Part::Pass, start, start, at_mm);
        for i in (0..after).rev() {
            let (p, q) = (placements[i].at, placements[i + 1].at);
            at_mm -= step_mm(p, q);
            if at_mm < -return_mm {
                break;
            }
            walk.go(Part::Pass, p, q, at_mm);
        }
        walk.end(Part::Pass);
        let cell = |listed: &Listed| FootprintCell {
            cell: listed.cell,
            is_own: listed.is_own,
            is_returned_to: listed.last_mm - listed.first_mm > return_mm as f32,
        };
        Some(Footprint {
            cells: walk.listed.iter().map(cell).collect(),
        })
    }
}

/// Open cells of a row up to each cell.
fn sum_row(sums: &mut [u32], cells: &[Cell]) {
    let mut open = 0;
    for (sum, cell) in sums.iter_mut().zip(cells) {
        open += u32::from(*cell == Cell::Gap);
        *sum = open;
    }
}

/// The cells of a gap-fill move while the path about it is walked.
struct Walk<'a> {
    grid: &'a CellGrid,
    aperture: &'a Aperture,
    /// Cells about the gap-fill move, and for each of them one more than its place in the list.
    window: CellWindow,
    slots: Vec<u32>,
    listed: Vec<Listed>,
    /// The part of the window that all listed cells are in, `None` before there are any.
    listed_window: Option<CellWindow>,
    /// Where the path was when it came to each row of the window last.
    swept: SweptRows<f32>,
}

/// A cell of the gap-fill move, the first and last place of the path that covers it.
struct Listed {
    cell: u32,
    first_mm: f32,
    last_mm: f32,
    is_own: bool,
}

/// What a stretch of the path does to the cells of the gap-fill move.
#[derive(Clone, Copy, PartialEq)]
enum Part {
    /// Lists them.
    GapFillMove,
    /// Covers them as well.
    Pass,
}

impl<'a> Walk<'a> {
    fn about(grid: &'a CellGrid, fill: &[Configuration], aperture: &'a Aperture) -> Self {
        let window = grid.window_of(aperture, fill, 0.0);
        Walk {
            grid,
            aperture,
            slots: vec![0; window.len()],
            listed: Vec::new(),
            listed_window: None,
            swept: SweptRows::of(&window, 0.0),
            window,
        }
    }

    /// Moves from one pose of a part towards the one before or after it, `at_mm` along the path.
    /// Places along one part only rise or only fall, so that for each cell the first and the last
    /// visit are all that counts; the last one is recorded when the path leaves it, or by
    /// [`Walk::end`]. The pass itself counts where cells are listed.
    fn go(&mut self, part: Part, from: Configuration, towards: Configuration, at_mm: f64) {
        let (grid, aperture, at_mm) = (self.grid, self.aperture, at_mm as f32);
        let window = match part {
            Part::GapFillMove => Some(self.window),
            Part::Pass => self.listed_window,
        };
        let Some(window) = window else {
            return;
        };
        for at in std::iter::once(from).chain(poses_between(aperture, from, towards)) {
            grid.for_rows_within(&window, aperture, at, |row, low, high| {
                let own = [low, high];
                let (before_mm, known) = self.swept.come(row, at_mm, own);
                for_beyond(known, own, |columns| {
                    self.visit(part, row, columns, before_mm);
                });
                if part == Part::GapFillMove {
                    for_beyond(own, known, |columns| self.list(row, columns, at_mm));
                }
            });
        }
    }

    /// Ends a part of the path.
    fn end(&mut self, part: Part) {
        for row in self.window.rows[0]..=self.window.rows[1] {
            let (at_mm, columns) = self.swept.come(row, 0.0, NO_COLUMNS);
            for_beyond(columns, NO_COLUMNS, |columns| {
                self.visit(part, row, columns, at_mm);
            });
        }
    }

    /// Lists those cells of a row that are not listed yet.
    fn list(&mut self, row: usize, columns: Range<usize>, at_mm: f32) {
        let own = CellWindow {
            rows: [row; 2],
            columns: [columns.start, columns.end - 1],
        };
        self.listed_window = Some(self.listed_window.map_or(own, |window| window.with(&own)));
        let first = (row * self.grid.columns + columns.start) as u32;
        let slots = &mut self.slots[self.window.numbers(row, columns)];
        for (slot, cell) in slots.iter_mut().zip(first..) {
            if *slot == 0 {
                self.listed.push(Listed {
                    cell,
                    first_mm: at_mm,
                    last_mm: at_mm,
                    is_own: false,
                });
                *slot = self.listed.len() as u32;
            }
        }
    }

    /// The path came to the listed cells of a row.
    fn visit(&mut self, part: Part, row: usize, columns: Range<usize>, at_mm: f32) {
        for &slot in &self.slots[self.window.numbers(row, columns)] {
            if slot > 0 {
                let listed = &mut self.listed[slot as usize - 1];
                if at_mm < listed.first_mm {
                    listed.first_mm = at_mm;
                }
                if at_mm > listed.last_mm {
                    listed.last_mm = at_mm;
                }
                listed.is_own |= part == Part::Pass;
            }
        }
    }
}

#[cfg(test)]
impl GapRaster {
    /// Share of the region that is covered.
    pub fn covered_pct(&self) -> f64 {
        self.coverage.covered_and_overlap_pct()[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::{ELLIPSE as APERTURE, walls};
    use crate::plan::pass::test_passes::run;
    use std::f64::consts::FRAC_PI_2;

    /// A bar of 6 x 3 mm.
    const BAR: &[[f64; 2]] = &[[0.0, 0.0], [6.0, 0.0], [6.0, 3.0], [0.0, 3.0]];

    fn at(x: f64, y: f64) -> Configuration {
        Configuration {
            center: Point2::new(x, y),
            heading_rad: FRAC_PI_2,
        }
    }

    /// A bead along the bar, 1.2 mm wide.
    fn bead(y: f64) -> LayerPass {
        run([0.3, y], [5.7, y])
    }

    /// Goal: the sums give the gain that counting gives. Method: placements over the border of what
    /// is covered, cell centres asked one by one.
    #[test]
    fn sums_agree_with_counting() {
        let raster = GapRaster::of(&[bead(0.6)], &APERTURE, &walls(&[BAR]));
        for i in 0..60 {
            let at = Configuration {
                center: Point2::new(0.1 * f64::from(i), 1.0 + 0.01 * f64::from(i)),
                heading_rad: 0.1 * f64::from(i),
            };
            let (sin, cos) = at.heading_rad.sin_cos();
            let is_under = |cell: usize| {
                let d = raster.coverage.center(cell) - at.center;
                let (u, v) = (d.x * cos + d.y * sin, d.y * cos - d.x * sin);
                (u / 0.6).powi(2) + (v / 0.2).powi(2) <= 1.0
            };
            let cells = 0..raster.coverage.cells.len();
            let open = cells.filter(|&c| raster.coverage.cells[c] == Cell::Gap);
            let open = open.filter(|&c| is_under(c)).count() as u32;
            let expected = f64::from(open) * raster.cell_area_mm2();
            assert_eq!(raster.gain_mm2(&APERTURE, at), expected);
        }
    }

    /// Goal: own cells count again only after more than 4a of path, that of another pass at once,
    /// and what was covered brings nothing any more. Method: gap-fill moves to where the aperture
    /// covers what lies above its own bead (up to y = 1.2 mm): near, far along the bead and back, and
    /// the near one beside a second pass that was there before.
    #[test]
    fn a_gap_fill_move_pays_for_what_it_covers_again() {
        let way = |stops: &[[f64; 2]]| -> Vec<Configuration> {
            let mut all = Vec::new();
            let mut last = Point2::new(3.0, 0.6);
            for stop in stops {
                let next = Point2::from(*stop);
                for step in 1..=20 {
                    let p = last + (next - last) * (f64::from(step) / 20.0);
                    all.push(at(p.x, p.y));
                }
                last = next;
            }
            all
        };
        let near = way(&[[3.0, 1.0], [3.0, 0.6]]);
        let far = way(&[[3.0, 1.0], [3.0, 0.6], [4.5, 0.6], [3.0, 0.6]]);
        let own = bead(0.6);
        let index = 27;
        let mut raster = GapRaster::of(std::slice::from_ref(&own), &APERTURE, &walls(&[BAR]));
        let footprint_of = |raster: &GapRaster, pass: &LayerPass, fill: &[Configuration]| {
            raster
                .footprint(pass, index, fill, &APERTURE, f64::NEG_INFINITY)
                .expect("no bound")
        };
        let footprint = footprint_of(&raster, &own, &near);
        let gained = raster.net_mm2(&footprint);
        // The aperture swept over 0.4 mm, less what lies in the bead below y = 1.2 mm.
        assert!((0.10..0.17).contains(&gained), "{gained}");
        // 3.8 mm of path: a bead of 1.5 mm and its ends are gone over again.
        let net = raster.net_mm2(&footprint_of(&raster, &own, &far));
        let paid = (gained - net) / NET_AGAIN_WEIGHT;
        assert!((1.0..3.0).contains(&paid), "{paid}");
        raster.cover(&footprint);
        assert!(raster.net_mm2(&footprint) <= 0.0);
        let both = [own, bead(1.8)];
        let raster = GapRaster::of(&both, &APERTURE, &walls(&[BAR]));
        let net = raster.net_mm2(&footprint_of(&raster, &both[0], &near));
        assert!(net < 0.0, "{net}");
    }

    /// Goal: gaps and sums that follow what is covered are those of a fresh search. Method: a bar
    /// with several gaps; gap-fill moves between and into them, one after the other.
    #[test]
    fn gaps_and_sums_follow_what_is_covered() {
        let own = bead(0.6);
        let mut raster = GapRaster::of(&[own.clone(), bead(2.2)], &APERTURE, &walls(&[BAR]));
        let counts = |raster: &GapRaster| -> Vec<(u32, usize)> {
            raster.gaps().iter().map(|g| (g[0], g.len())).collect()
        };
        let first = counts(&raster);
        for (index, y) in [(10, 1.1), (30, 1.3), (50, 1.0)] {
            let x = own.placements[index].at.center.x;
            let way = [at(x, y), at(x, 0.6)];
            let footprint = raster.footprint(&own, index, &way, &APERTURE, 0.0);
            raster.cover(&footprint.expect("open area"));
            raster.update();
            let followed = counts(&raster);
            assert!(followed != first);
            let mut fresh = raster.gaps().concat();
            fresh.sort_unstable();
            let sums = std::mem::take(&mut raster.sums);
            raster.sums = vec![0; sums.len()];
            raster.gaps = vec![fresh];
            raster.stale_rows.fill(true);
            raster.update();
            assert_eq!(followed, counts(&raster));
            assert_eq!(sums, raster.sums);
        }
        // What lies between two gap-fill moves is cut off.
        assert!(raster.gaps().len() >= first.len() + 2);
    }
}
