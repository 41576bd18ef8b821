//! Darts: short excursions from a pass into what all passes together leave open.
//!
//! Corners, junctions of the medial axis and changes of the bead count leave small gaps that no
//! channel fits. For each gap the placement with the largest gain (newly covered area less what it
//! covers again) is searched over position and heading; the nearest placement of a pass goes there
//! and comes back, without an interruption of flow.

use super::channel_walls::{poses_between, turn_to};
use super::heading_profile::{Placement, slide_inside};
use super::passes::LayerPass;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::{Configuration, is_inside};
use crate::geometry::coverage::{Cell, Coverage, RowsOfShape, SweptPose};
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::{Point2, Vector2};
use rayon::prelude::*;

/// Least area of a gap that is worth an excursion, against that of the aperture (0.003 mm² for
/// the 0.6 x 0.2 mm ellipse).
const GAP_SHARE_MIN: f64 = 0.008;
/// Least net gain of an excursion, against the aperture's area.
const GAIN_SHARE_MIN: f64 = 0.005;
/// What covering a place again costs against covering a new one.
const AGAIN_WEIGHT: f64 = 0.25;
/// Rounds of looking for gaps: a large one takes several excursions.
const ROUNDS: usize = 6;
/// Headings tried over the aperture's period.
const HEADINGS: usize = 12;
/// Places tried in each gap.
const SEEDS: usize = 12;
/// Rounds of the refining pattern search, each with half the step of the one before.
const REFINE_ROUNDS: usize = 5;
/// Placements of the passes tried as the start of an excursion.
const STARTS: usize = 12;
/// Longest excursion, against the major semi-axis.
const REACH: f64 = 3.0;
/// Raster cell against the minor semi-axis, and most cells.
const CELL_SHARE: f64 = 0.1;
const CELLS_MAX: usize = 6_000_000;
/// Step of the excursion, mm against b and rad.
const STEP_SHARE: f64 = 0.6;
const STEP_RAD: f64 = 0.2;
/// An excursion may cut the wall by this share of the aperture; the finished curve is pushed off.
const CUT_SHARE: f64 = 1e-3;
/// Slides of one pose of the way, and how far it may be slid, against b.
const SLIDES: usize = 4;
const SLIDE_SHARE: f64 = 0.8;

/// Fills the gaps that `passes` leave in the region bounded by `walls`.
pub fn fill_gaps(passes: &mut [LayerPass], aperture: &Aperture, walls: &EdgeIndex) {
    let mut raster = Raster::of(passes, aperture, walls);
    for _ in 0..ROUNDS {
        let gaps = raster.gaps();
        let sums = raster.sums();
        let found: Vec<Option<Configuration>> = gaps
            .par_iter()
            .map(|gap| raster.best_placement(gap, &sums, aperture, walls))
            .collect();
        let mut darts: Vec<Dart> = Vec::new();
        for at in found.into_iter().flatten() {
            // Excursions of this round may have closed it already.
            if raster.gain_mm2(aperture, at) < GAIN_SHARE_MIN * aperture.area_mm2() {
                continue;
            }
            if let Some(dart) = Dart::to(at, passes, aperture, walls) {
                raster.cover(aperture, &dart.excursion);
                darts.push(dart);
            }
        }
        if darts.is_empty() {
            return;
        }
        insert(passes, darts);
    }
}

/// An excursion from a placement of a pass.
struct Dart {
    pass: usize,
    after: usize,
    /// Out and back, the start left out at the beginning and repeated at the end.
    excursion: Vec<Configuration>,
}

impl Dart {
    /// The excursion to `at` from the nearest placement that has a free way there.
    fn to(
        at: Configuration,
        passes: &[LayerPass],
        aperture: &Aperture,
        walls: &EdgeIndex,
    ) -> Option<Dart> {
        let swing = 0.5 * (aperture.major_mm() + aperture.minor_mm());
        let reach = REACH * aperture.major_mm();
        let mut starts: Vec<(f64, usize, usize)> = Vec::new();
        for (p, pass) in passes.iter().enumerate() {
            for (i, placement) in pass.placements.iter().enumerate() {
                let apart = (placement.at.center - at.center).norm();
                if apart < reach {
                    let turn = turn_to(aperture, placement.at.heading_rad, at.heading_rad).abs();
                    starts.push((apart + swing * turn, p, i));
                }
            }
        }
        starts.sort_by(|s, t| s.0.total_cmp(&t.0).then((s.1, s.2).cmp(&(t.1, t.2))));
        starts.truncate(STARTS);
        starts.into_iter().find_map(|(_, pass, after)| {
            let from = passes[pass].placements[after].at;
            let out = inside_way(eased(from, at, aperture), aperture, walls)?;
            let back = out.iter().rev().skip(1).copied();
            let excursion = out.iter().copied().chain(back).chain([from]).collect();
            Some(Dart {
                pass,
                after,
                excursion,
            })
        })
    }
}

/// The way slid off the walls where it cuts them; `None` where that does not help, or where the
/// slide is so long that the way would no longer be a way.
pub(super) fn inside_way(
    way: Vec<Configuration>,
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Option<Vec<Configuration>> {
    let slide_max_mm = SLIDE_SHARE * aperture.minor_mm();
    way.into_iter()
        .map(|at| {
            let slid = slide_inside(at, aperture, walls, SLIDES, CUT_SHARE)?;
            ((slid.center - at.center).norm() <= slide_max_mm).then_some(slid)
        })
        .collect()
}

/// The straight way, the start left out, in steps that begin and end small.
pub(super) fn eased(
    from: Configuration,
    to: Configuration,
    aperture: &Aperture,
) -> Vec<Configuration> {
    let turn = turn_to(aperture, from.heading_rad, to.heading_rad);
    let delta = to.center - from.center;
    let steps = (delta.norm() / (STEP_SHARE * aperture.minor_mm()))
        .max(turn.abs() / STEP_RAD)
        .ceil()
        .max(2.0) as usize;
    (1..=steps)
        .map(|step| {
            let t = 0.5 - 0.5 * (std::f64::consts::PI * step as f64 / steps as f64).cos();
            Configuration {
                center: from.center + delta * t,
                heading_rad: from.heading_rad + turn * t,
            }
        })
        .collect()
}

/// Inserts the excursions behind their placements, last first so that the numbers stay right.
fn insert(passes: &mut [LayerPass], mut darts: Vec<Dart>) {
    darts.sort_by_key(|d| std::cmp::Reverse((d.pass, d.after)));
    for dart in darts {
        let placements = &mut passes[dart.pass].placements;
        let contact = placements[dart.after].contact;
        let excursion = dart.excursion.into_iter().map(|at| Placement {
            at,
            feasible: true,
            contact,
        });
        placements.splice(dart.after + 1..dart.after + 1, excursion);
    }
}

/// The coverage raster while gaps are filled.
struct Raster {
    coverage: Coverage,
}

impl Raster {
    fn of(passes: &[LayerPass], aperture: &Aperture, walls: &EdgeIndex) -> Raster {
        let mut poses = Vec::new();
        for (number, pass) in passes.iter().enumerate() {
            let mut push = |at: Configuration| {
                poses.push(SweptPose {
                    at,
                    pass: number as u32,
                    path_mm: 0.0,
                });
            };
            let placements = &pass.placements;
            for (i, placement) in placements.iter().enumerate() {
                push(placement.at);
                let next = match i + 1 {
                    n if n < placements.len() => placements[n].at,
                    _ if pass.closed => placements[0].at,
                    _ => continue,
                };
                poses_between(aperture, placement.at, next).for_each(&mut push);
            }
        }
        let cell_mm = CELL_SHARE * aperture.minor_mm();
        Raster {
            coverage: Coverage::sweep(walls, aperture, &poses, cell_mm, CELLS_MAX, f64::MAX),
        }
    }

    fn cell_area_mm2(&self) -> f64 {
        self.coverage.cell_mm.powi(2)
    }

    /// Connected sets of open cells, large ones first to last in raster order.
    fn gaps(&self) -> Vec<Vec<u32>> {
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
    fn best_placement(
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

    /// Newly covered area less the weighted area covered again, mm².
    fn gain_mm2(&self, aperture: &Aperture, at: Configuration) -> f64 {
        let (mut open, mut again) = (0, 0);
        self.for_rows(aperture, at, |row, from, to| {
            for cell in row + from..=row + to {
                match self.coverage.cells[cell] {
                    Cell::Gap => open += 1,
                    Cell::Covered | Cell::Overlap => again += 1,
                    Cell::Outside | Cell::Spill => {}
                }
            }
        });
        self.worth_mm2(open, again)
    }

    /// The same from the sums, which do not see what was covered since they were made.
    fn gain_by_sums_mm2(&self, sums: &Sums, aperture: &Aperture, at: Configuration) -> f64 {
        let (mut open, mut again) = (0, 0);
        self.for_rows(aperture, at, |row, from, to| {
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
    fn sums(&self) -> Sums {
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

    /// Marks what an excursion covers.
    fn cover(&mut self, aperture: &Aperture, excursion: &[Configuration]) {
        let mut ranges = Vec::new();
        for pair in excursion.windows(2) {
            let mut add = |at| {
                self.for_rows(aperture, at, |row, from, to| {
                    ranges.push((row + from, row + to))
                });
            };
            add(pair[0]);
            poses_between(aperture, pair[0], pair[1]).for_each(add);
        }
        for (from, to) in ranges {
            for cell in &mut self.coverage.cells[from..=to] {
                if *cell == Cell::Gap {
                    *cell = Cell::Covered;
                }
            }
        }
    }

    /// Visits the rows of cells whose centres lie in the placed aperture: number of the row's first
    /// cell, first and last column.
    fn for_rows(
        &self,
        aperture: &Aperture,
        at: Configuration,
        mut visit: impl FnMut(usize, usize, usize),
    ) {
        let raster = &self.coverage;
        let shape = RowsOfShape::new(aperture, at.heading_rad);
        let row_of = |y: f64| ((y - raster.origin.y) / raster.cell_mm).floor();
        let first = row_of(at.center.y - shape.below_mm).max(0.0) as usize;
        let last = row_of(at.center.y + shape.above_mm).min(raster.rows as f64 - 1.0);
        for row in first..=last.max(0.0) as usize {
            let y = raster.origin.y + (row as f64 + 0.5) * raster.cell_mm;
            let Some([low, high]) = shape.range(y - at.center.y) else {
                continue;
            };
            let column_of = |x: f64| (at.center.x + x - raster.origin.x) / raster.cell_mm - 0.5;
            let from = column_of(low).ceil().max(0.0);
            let to = column_of(high).floor().min(raster.columns as f64 - 1.0);
            if from <= to {
                visit(row * raster.columns, from as usize, to as usize);
            }
        }
    }
}

/// Running sums along the rows of a raster.
struct Sums {
    open: Vec<u32>,
    covered: Vec<u32>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::polygon::{Region, Ring};
    use crate::plan::contacts::Contact;
    use crate::plan::passes::PassKind;

    const APERTURE: Aperture = Aperture::Ellipse {
        major_mm: 0.6,
        minor_mm: 0.2,
    };

    fn walls(width: f64, height: f64) -> EdgeIndex {
        let points = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
        let exterior = Ring {
            points: points.iter().map(|p| Point2::new(p[0], p[1])).collect(),
        };
        EdgeIndex::of_region(
            &Region {
                exterior,
                holes: vec![],
            },
            1.0,
        )
    }

    /// A pass along y = 0.6 with the major axis across the travel: it covers y up to 1.2.
    fn pass(length: f64) -> LayerPass {
        let count = (length / 0.1) as usize;
        let placements = (3..count - 2)
            .map(|i| {
                let center = Point2::new(0.1 * i as f64, 0.6);
                Placement {
                    at: Configuration {
                        center,
                        heading_rad: std::f64::consts::FRAC_PI_2,
                    },
                    feasible: true,
                    contact: Contact {
                        point: Point2::new(center.x, 0.0),
                        normal: Vector2::y(),
                        length_mm: 0.1,
                        extent_mm: 0.6,
                        on_axis: false,
                    },
                }
            })
            .collect();
        LayerPass {
            kind: PassKind::TwoPass,
            channel: 1,
            closed: false,
            placements,
        }
    }

    fn covered_pct(passes: &[LayerPass], walls: &EdgeIndex) -> f64 {
        Raster::of(passes, &APERTURE, walls).coverage.covered_pct()
    }

    /// Goal: a strip beside the pass is filled, every pose stays inside, and the path goes on
    /// without a jump from where it left. Method: a 6 x 1.5 mm bar whose pass covers 1.2 mm.
    #[test]
    fn a_strip_is_filled_by_excursions() {
        let walls = walls(6.0, 1.5);
        let mut passes = vec![pass(6.0)];
        let before = covered_pct(&passes, &walls);
        let original = passes[0].placements.clone();
        fill_gaps(&mut passes, &APERTURE, &walls);
        let after = covered_pct(&passes, &walls);
        assert!(after > before + 8.0, "{before} {after}");
        let placements = &passes[0].placements;
        for pair in placements.windows(2) {
            assert!((pair[1].at.center - pair[0].at.center).norm() < 0.25);
            assert!((pair[1].at.heading_rad - pair[0].at.heading_rad).abs() < 0.4);
        }
        for placement in placements {
            assert!(is_inside(&APERTURE, placement.at, &walls, -2e-3));
        }
        // What was there before is there still, in the same order.
        let mut left = original.iter().peekable();
        for placement in placements {
            if left.peek().is_some_and(|o| o.at == placement.at) {
                left.next();
            }
        }
        assert!(left.next().is_none());
    }

    /// Goal: nothing is added where nothing is open. Method: a bar as wide as the bead, its ends
    /// left out of reach by less than the least gap.
    #[test]
    fn a_full_bar_stays_as_it_is() {
        let walls = walls(3.0, 1.2);
        let mut passes = vec![pass(3.0)];
        fill_gaps(&mut passes, &APERTURE, &walls);
        let count = passes[0].placements.len();
        fill_gaps(&mut passes, &APERTURE, &walls);
        assert_eq!(passes[0].placements.len(), count);
    }

    /// Goal: the sums give the same gain as counting. Method: placements over the border of what
    /// is covered.
    #[test]
    fn sums_agree_with_counting() {
        let walls = walls(6.0, 1.5);
        let raster = Raster::of(&[pass(6.0)], &APERTURE, &walls);
        let sums = raster.sums();
        for i in 0..60 {
            let at = Configuration {
                center: Point2::new(0.1 * f64::from(i), 1.0 + 0.01 * f64::from(i)),
                heading_rad: 0.1 * f64::from(i),
            };
            let counted = raster.gain_mm2(&APERTURE, at);
            assert_eq!(raster.gain_by_sums_mm2(&sums, &APERTURE, at), counted);
        }
    }
}
