//! What all passes leave open, and what a placement or an excursion would add, on a raster.

use super::channel_walls::poses_between;
use super::heading_profile::slide_inside;
use super::passes::LayerPass;
use super::visits::{CELL_SHARE, poses};
use crate::geometry::aperture::Aperture;
use crate::geometry::cell_grid::{CellGrid, CellWindow};
use crate::geometry::clearance::{Configuration, is_inside};
use crate::geometry::coverage::{Cell, Coverage, SweptPose};
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::{Point2, Vector2};

/// Least area of a gap that is worth an excursion, against that of the aperture (0.003 mm² for
/// the 0.6 x 0.2 mm ellipse).
const GAP_SHARE_MIN: f64 = 0.008;
/// Least net gain of a placement, against the aperture's area.
const GAIN_SHARE_MIN: f64 = 0.005;
/// What covering a place again costs against covering a new one, where a placement is searched: it
/// does not know yet from where it is reached.
const AGAIN_WEIGHT: f64 = 0.06;
/// The same for the whole excursion, which only counts what the figures count.
const NET_AGAIN_WEIGHT: f64 = 0.3;
/// Headings tried over the aperture's period.
const HEADINGS: usize = 12;
/// Places tried in each gap.
const SEEDS: usize = 12;
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
    marks: Vec<Mark>,
    walk: u32,
    /// Cells of the last excursion looked at.
    changed: Vec<Changed>,
}

/// The last excursion that covered the cell, and where the cell stands in its list.
#[derive(Clone, Copy, Default)]
struct Mark {
    walk: u32,
    slot: u32,
}

/// A cell of an excursion: the first and last place of the path that covers it.
struct Changed {
    cell: u32,
    first_mm: f32,
    last_mm: f32,
    /// True where the pass covers it too, shortly before or after.
    is_own: bool,
}

impl GapRaster {
    /// The raster of what `passes` cover within `walls`.
    pub fn of(passes: &[LayerPass], aperture: &Aperture, walls: &EdgeIndex) -> GapRaster {
        let swept: Vec<SweptPose> = passes
            .iter()
            .enumerate()
            .flat_map(|(number, pass)| {
                poses(pass, aperture).map(move |at| SweptPose {
                    at,
                    pass: number as u32,
                    path_mm: 0.0,
                })
            })
            .collect();
        let cell_mm = CELL_SHARE * aperture.minor_mm();
        let coverage = Coverage::sweep(walls, aperture, &swept, cell_mm, CELLS_MAX, f64::MAX);
        GapRaster {
            grid: coverage.grid(),
            marks: vec![Mark::default(); coverage.cells.len()],
            walk: 0,
            changed: Vec::new(),
            coverage,
        }
    }

    fn cell_area_mm2(&self) -> f64 {
        self.grid.cell_area_mm2()
    }

    /// Connected sets of open cells, large ones first to last in raster order.
    pub fn gaps(&self) -> Vec<Vec<u32>> {
        let (cells, columns) = (&self.coverage.cells, self.coverage.columns);
        let mut seen = vec![false; cells.len()];
        let mut gaps = Vec::new();
        for seed in 0..cells.len() {
            if seen[seed] || cells[seed] != Cell::Gap {
                continue;
            }
            seen[seed] = true;
            let mut gap = vec![seed as u32];
            let mut head = 0;
            while head < gap.len() {
                let at = gap[head] as usize;
                head += 1;
                let (column, row) = (at % columns, at / columns);
                let around = [
                    (column > 0).then(|| at - 1),
                    (column + 1 < columns).then(|| at + 1),
                    (row > 0).then(|| at - columns),
                    (row + 1 < self.coverage.rows).then(|| at + columns),
                ];
                for next in around.into_iter().flatten() {
                    if !seen[next] && cells[next] == Cell::Gap {
                        seen[next] = true;
                        gap.push(next as u32);
                    }
                }
            }
            gaps.push(gap);
        }
        gaps
    }

    /// The placement in or about a gap with the largest gain, if any is worth its way.
    pub fn best_placement(
        &self,
        gap: &[u32],
        sums: &Sums,
        aperture: &Aperture,
        walls: &EdgeIndex,
    ) -> Option<Configuration> {
        let area = aperture.area_mm2();
        if (gap.len() as f64) * self.cell_area_mm2() < GAP_SHARE_MIN * area {
            return None;
        }
        let headings = if aperture.is_round() { 1 } else { HEADINGS };
        let value = |at: Configuration| {
            let gain = self.gain_by_sums_mm2(sums, aperture, at);
            // The costly query only where it can matter.
            if gain > 0.0 && is_inside(aperture, at, walls, 0.0) {
                gain
            } else {
                f64::NEG_INFINITY
            }
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
                    let found = value(at);
                    if found > best.map_or(0.0, |b| b.0) {
                        best = Some((found, at));
                    }
                }
            }
        }
        let (found, at) =
            self.refined(best?, 0.5 * aperture.period_rad() / headings as f64, &value);
        (found >= GAIN_SHARE_MIN * area).then_some(at)
    }

    /// The placement centred on a place, and those that touch it with an end or a side.
    fn starts_about(&self, p: Point2, heading_rad: f64, aperture: &Aperture) -> [Configuration; 5] {
        let along = Vector2::new(heading_rad.cos(), heading_rad.sin());
        let across = Vector2::new(-along.y, along.x);
        let end = along * (0.7 * aperture.major_mm());
        let side = across * (0.6 * aperture.minor_mm());
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
        value: &impl Fn(Configuration) -> f64,
    ) -> (f64, Configuration) {
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
                let found = value(next);
                if found > best {
                    (best, at, improved) = (found, next, true);
                }
            }
            if !improved {
                step_mm *= 0.5;
                step_rad *= 0.5;
            }
        }
        (best, at)
    }

    /// Newly covered area less the weighted area covered again, mm², from the sums.
    fn gain_by_sums_mm2(&self, sums: &Sums, aperture: &Aperture, at: Configuration) -> f64 {
        let (mut open, mut again) = (0, 0);
        self.grid.for_rows(aperture, at, |row, from, to| {
            let in_range = |sums: &[u32]| {
                let before = from.checked_sub(1).map_or(0, |c| sums[row + c]);
                sums[row + to] - before
            };
            open += in_range(&sums.open);
            again += in_range(&sums.covered);
        });
        self.worth_mm2(open, again)
    }

    fn worth_mm2(&self, open: u32, again: u32) -> f64 {
        (f64::from(open) - AGAIN_WEIGHT * f64::from(again)) * self.cell_area_mm2()
    }

    /// Sums along each row: open and covered cells before each one and itself.
    pub fn sums(&self) -> Sums {
        let mut sums = Sums {
            open: Vec::with_capacity(self.coverage.cells.len()),
            covered: Vec::with_capacity(self.coverage.cells.len()),
        };
        for row in self.coverage.cells.chunks_exact(self.coverage.columns) {
            let (mut open, mut covered) = (0, 0);
            for cell in row {
                open += u32::from(*cell == Cell::Gap);
                covered += u32::from(matches!(cell, Cell::Covered | Cell::Overlap));
                sums.open.push(open);
                sums.covered.push(covered);
            }
        }
        sums
    }

    /// What an excursion from behind placement `after` newly covers, less the weighted ground that
    /// it covers again, mm².
    pub fn net_mm2(
        &mut self,
        pass: &LayerPass,
        after: usize,
        excursion: &[Configuration],
        aperture: &Aperture,
    ) -> f64 {
        let (mut open, mut again) = (0, 0);
        self.mark_changes(pass, after, excursion, aperture);
        for changed in &self.changed {
            match self.coverage.cells[changed.cell as usize] {
                Cell::Gap => open += 1,
                Cell::Covered if changed.is_twice(Cell::Covered, aperture) => again += 1,
                _ => {}
            }
        }
        (f64::from(open) - NET_AGAIN_WEIGHT * f64::from(again)) * self.cell_area_mm2()
    }

    /// Marks what an excursion covers.
    pub fn cover(
        &mut self,
        pass: &LayerPass,
        after: usize,
        excursion: &[Configuration],
        aperture: &Aperture,
    ) {
        self.mark_changes(pass, after, excursion, aperture);
        for changed in &self.changed {
            let state = &mut self.coverage.cells[changed.cell as usize];
            *state = match (*state, changed.is_twice(*state, aperture)) {
                (Cell::Gap, false) => Cell::Covered,
                (Cell::Gap | Cell::Covered, true) => Cell::Overlap,
                (other, _) => other,
            };
        }
    }

    /// Lists the cells that the excursion covers, each once, and where the path covers them: the
    /// excursion and 4a of the pass before and after it.
    fn mark_changes(
        &mut self,
        pass: &LayerPass,
        after: usize,
        excursion: &[Configuration],
        aperture: &Aperture,
    ) {
        let return_mm = return_mm(aperture);
        let placements = &pass.placements;
        let start = placements[after].at;
        let step_mm = |p: Configuration, q: Configuration| (q.center - p.center).norm();
        self.walk += 1;
        self.changed.clear();
        let mut at_mm = 0.0;
        let mut window = CellWindow::empty();
        for (&p, &q) in std::iter::once(&start).chain(excursion).zip(excursion) {
            at_mm += step_mm(p, q);
            self.list(aperture, q, p, at_mm, &mut window);
        }
        let end_mm = at_mm + return_mm;
        for pair in placements[after..].windows(2) {
            let (p, q) = (pair[0].at, pair[1].at);
            at_mm += step_mm(p, q);
            if at_mm > end_mm {
                break;
            }
            self.mark(aperture, q, p, at_mm, &window);
        }
        at_mm = 0.0;
        self.mark(aperture, start, start, at_mm, &window);
        for i in (0..after).rev() {
            let (p, q) = (placements[i].at, placements[i + 1].at);
            at_mm -= step_mm(p, q);
            if at_mm < -return_mm {
                break;
            }
            self.mark(aperture, p, q, at_mm, &window);
        }
    }

    /// Lists the cells from one pose of the excursion towards the next, `at_mm` along it, and grows
    /// the window about them.
    fn list(
        &mut self,
        aperture: &Aperture,
        from: Configuration,
        towards: Configuration,
        at_mm: f64,
        window: &mut CellWindow,
    ) {
        let (walk, at_mm) = (self.walk, at_mm as f32);
        let (columns, changed) = (self.grid.columns, &mut self.changed);
        for at in std::iter::once(from).chain(poses_between(aperture, from, towards)) {
            self.grid.for_rows(aperture, at, |row, low, high| {
                window.grow(row / columns, low, high);
                let marks = &mut self.marks[row + low..=row + high];
                for (mark, cell) in marks.iter_mut().zip((row + low) as u32..) {
                    if mark.walk == walk {
                        // The excursion goes on: its places only rise.
                        changed[mark.slot as usize].last_mm = at_mm;
                        continue;
                    }
                    let slot = changed.len() as u32;
                    *mark = Mark { walk, slot };
                    changed.push(Changed {
                        cell,
                        first_mm: at_mm,
                        last_mm: at_mm,
                        is_own: false,
                    });
                }
            });
        }
    }

    /// Marks the listed cells from one pose of the pass towards the next with its place there.
    fn mark(
        &mut self,
        aperture: &Aperture,
        from: Configuration,
        towards: Configuration,
        at_mm: f64,
        window: &CellWindow,
    ) {
        let (walk, at_mm) = (self.walk, at_mm as f32);
        let (grid, marks) = (&self.grid, &self.marks);
        for at in std::iter::once(from).chain(poses_between(aperture, from, towards)) {
            grid.for_rows_within(window, aperture, at, |row, low, high| {
                for mark in &marks[row + low..=row + high] {
                    if mark.walk == walk {
                        let changed = &mut self.changed[mark.slot as usize];
                        changed.first_mm = changed.first_mm.min(at_mm);
                        changed.last_mm = changed.last_mm.max(at_mm);
                        changed.is_own = true;
                    }
                }
            });
        }
    }
}

/// Path after which a pass that comes back covers the ground again, mm.
fn return_mm(aperture: &Aperture) -> f64 {
    4.0 * aperture.major_mm()
}

impl Changed {
    /// Whether the cell, `state` before the excursion, counts as covered again after it: by another
    /// pass or long ago by this one, or by one that was here more than 4a of path before or after
    /// (SPEC section 2).
    fn is_twice(&self, state: Cell, aperture: &Aperture) -> bool {
        (state == Cell::Covered && !self.is_own)
            || self.last_mm - self.first_mm > return_mm(aperture) as f32
    }
}

/// Running sums along the rows of a raster.
pub struct Sums {
    open: Vec<u32>,
    covered: Vec<u32>,
}

#[cfg(test)]
impl GapRaster {
    /// Share of the region that is covered.
    pub fn covered_pct(&self) -> f64 {
        self.coverage.covered_pct()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::edge_index::Edge;
    use crate::plan::contacts::Contact;
    use crate::plan::heading_profile::Placement;
    use crate::plan::passes::PassKind;
    use std::f64::consts::FRAC_PI_2;

    const APERTURE: Aperture = Aperture::Ellipse {
        major_mm: 0.6,
        minor_mm: 0.2,
    };

    /// A bar of 6 x 3 mm.
    fn walls() -> EdgeIndex {
        let corners = [[0.0, 0.0], [6.0, 0.0], [6.0, 3.0], [0.0, 3.0]].map(Point2::from);
        let edges = (0..4).map(|i| Edge {
            a: corners[i],
            b: corners[(i + 1) % 4],
        });
        EdgeIndex::new(edges.collect(), 1.0)
    }

    fn at(x: f64, y: f64) -> Configuration {
        Configuration {
            center: Point2::new(x, y),
            heading_rad: FRAC_PI_2,
        }
    }

    /// A pass along y, the major axis across it.
    fn pass(y: f64) -> LayerPass {
        let placement = |i: i32| Placement {
            at: at(0.1 * f64::from(i), y),
            feasible: true,
            contact: Contact {
                point: Point2::new(0.1 * f64::from(i), y - 0.6),
                normal: Vector2::y(),
                length_mm: 0.1,
                extent_mm: 0.6,
                on_axis: false,
            },
        };
        LayerPass {
            kind: PassKind::TwoPass,
            channel: 1,
            closed: false,
            placements: (3..=57).map(placement).collect(),
        }
    }

    /// Goal: the sums give the gain that counting gives. Method: placements over the border of what
    /// is covered, cell centres asked one by one.
    #[test]
    fn sums_agree_with_counting() {
        let raster = GapRaster::of(&[pass(0.6)], &APERTURE, &walls());
        let sums = raster.sums();
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
            let count = |states: &[Cell]| {
                let cells = 0..raster.coverage.cells.len();
                let found = cells.filter(|&c| states.contains(&raster.coverage.cells[c]));
                found.filter(|&c| is_under(c)).count() as u32
            };
            let worth =
                raster.worth_mm2(count(&[Cell::Gap]), count(&[Cell::Covered, Cell::Overlap]));
            assert_eq!(raster.gain_by_sums_mm2(&sums, &APERTURE, at), worth);
        }
    }

    /// Goal: own ground counts again only after more than 4a of path, that of another pass at once,
    /// and what was covered brings nothing any more. Method: excursions to where the aperture covers
    /// ground above its own bead (up to y = 1.2 mm): near, far along the bead and back, and the near
    /// one beside a second pass that was there before.
    #[test]
    fn an_excursion_pays_for_what_it_covers_again() {
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
        let own = pass(0.6);
        let index = 27;
        let mut raster = GapRaster::of(std::slice::from_ref(&own), &APERTURE, &walls());
        let gained = raster.net_mm2(&own, index, &near, &APERTURE);
        // The aperture swept over 0.4 mm, less what lies in the bead below y = 1.2 mm.
        assert!((0.10..0.17).contains(&gained), "{gained}");
        // 3.8 mm of path: a bead of 1.5 mm and its ends are gone over again.
        let net = raster.net_mm2(&own, index, &far, &APERTURE);
        let paid = (gained - net) / NET_AGAIN_WEIGHT;
        assert!((1.0..3.0).contains(&paid), "{paid}");
        raster.cover(&own, index, &near, &APERTURE);
        assert!(raster.net_mm2(&own, index, &near, &APERTURE) <= 0.0);
        let both = [own, pass(1.8)];
        let mut raster = GapRaster::of(&both, &APERTURE, &walls());
        let net = raster.net_mm2(&both[0], index, &near, &APERTURE);
        assert!(net < 0.0, "{net}");
    }
}
