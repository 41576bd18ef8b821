//! The area that the passes of a region cover, queried where one of them is to be cut in two.
//!
//! Both sides of a cut at one placement cover the complete aperture there. So the second part
//! begins where area covered twice and uncovered area cost least together; and a cut is cheapest
//! where beads swing or overlap anyway. Input: passes. Output: the cost of a cut, and the start of
//! the part after it.

use crate::geometry::aperture::Aperture;
use crate::geometry::coverage::{Cell, Coverage};
use crate::geometry::edge_index::EdgeIndex;
use crate::plan::coverage::raster::{CELLS_MAX, is_fine, same_bead_mm, within_walls};
use crate::plan::pass::sweep::poses_between;
use crate::plan::pass::{LayerPass, Placement};

/// Cost of uncovered area relative to area covered twice: the objective's, by which the parts are optimised afterwards.
const OPEN_WEIGHT: i64 = 2;
/// Maximum number of placements of the second part that are omitted.
const SKIPPED_MAX: usize = 64;

/// What the passes of a region cover, and how often.
pub struct DepositedArea {
    raster: Coverage,
    aperture: Aperture,
}

impl DepositedArea {
    /// The area of `passes` within `walls`, if the raster is fine enough for the aperture.
    pub fn of_passes(
        passes: &[LayerPass],
        walls: &EdgeIndex,
        aperture: &Aperture,
    ) -> Option<DepositedArea> {
        let raster = within_walls(passes, walls, aperture, CELLS_MAX, same_bead_mm(aperture));
        is_fine(raster.cell_mm, aperture).then_some(DepositedArea {
            raster,
            aperture: *aperture,
        })
    }

    /// The costs of cuts of a pass with these placements.
    pub fn cuts_of(&self, placements: &[Placement]) -> CutCosts {
        let mut cells = self.laid_once(placements);
        cells.sort_unstable_by_key(|cell| cell.begin_without());
        let mut crossed = vec![0i64; placements.len() + 1];
        for cell in &cells {
            crossed[cell.first_pose.div_ceil(2) as usize] += 1;
            crossed[cell.begin_without()] -= 1;
        }
        let mut sum = 0;
        for crossed in &mut crossed {
            sum += *crossed;
            *crossed = sum;
        }
        CutCosts { cells, crossed }
    }

    /// The cells that only this pass covers.
    fn laid_once(&self, placements: &[Placement]) -> Vec<LaidCell> {
        let grid = self.raster.grid();
        let placed = placements.iter().map(|placement| &placement.at);
        let window = grid.window_of(&self.aperture, placed, 0.0);
        let mut laid: Vec<Option<LaidCell>> = vec![None; window.len()];
        let poses = (0..placements.len()).flat_map(|number| {
            let at = placements[number].at;
            let from = number.checked_sub(1).map(|before| placements[before].at);
            let between = from.map(|from| poses_between(&self.aperture, from, at));
            let pose = 2 * number as u32;
            let between = between.into_iter().flatten().map(move |at| (pose - 1, at));
            between.chain([(pose, at)])
        });
        for (pose, at) in poses {
            grid.for_rows_within(&window, &self.aperture, at, |row, from, to| {
                let cells = grid.window().numbers(row, from..to + 1);
                let own = window.numbers(row, from..to + 1);
                for (cell, laid) in self.raster.cells[cells].iter().zip(&mut laid[own]) {
                    if *cell == Cell::Covered {
                        let first_pose = laid.map_or(pose, |laid| laid.first_pose);
                        *laid = Some(LaidCell {
                            first_pose,
                            last_pose: pose,
                        });
                    }
                }
            });
        }
        laid.into_iter().flatten().collect()
    }
}

/// A cell and the poses that cover it first and last: twice the number of a placement, one less
/// before it.
#[derive(Clone, Copy, Debug)]
struct LaidCell {
    first_pose: u32,
    last_pose: u32,
}

impl LaidCell {
    /// The first placement from which a pass does not cover the cell.
    fn begin_without(self) -> usize {
        self.last_pose as usize / 2 + 1
    }

    /// True if a pass up to and including a placement covers the cell.
    fn is_laid_up_to(self, placement: usize) -> bool {
        self.first_pose as usize <= 2 * placement
    }
}

/// The cost of cutting a pass at each of its placements, in cells of the raster.
pub struct CutCosts {
    /// Sorted by [`LaidCell::begin_without`].
    cells: Vec<LaidCell>,
    /// For each placement the cells on both sides of it.
    crossed: Vec<i64>,
}

impl CutCosts {
    /// The least cost of a cut after placement `cut`, and the placement, `begin_max` at most, with
    /// which the second part then begins.
    pub fn cut(&self, cut: usize, begin_max: usize) -> (i64, usize) {
        let mut cells = self.cells[self.cells.partition_point(|c| c.begin_without() <= cut)..]
            .iter()
            .peekable();
        let (mut twice, mut open) = (self.crossed[cut], 0);
        let mut best = (twice, cut);
        for begin in cut + 1..=begin_max.min(cut + SKIPPED_MAX) {
            while let Some(cell) = cells.next_if(|cell| cell.begin_without() == begin) {
                match cell.is_laid_up_to(cut) {
                    true => twice -= 1,
                    false => open += OPEN_WEIGHT,
                }
            }
            best = best.min((twice + open, begin));
            if open > best.0 {
                break;
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::{ELLIPSE, walls};
    use crate::plan::pass::test_passes::run;
    use std::f64::consts::FRAC_PI_2;

    /// Goal: on a straight way the second piece begins where what both cover and twice what stays open
    /// between them are least; where another pass lies across, a cut costs next to nothing.
    /// Method: a run with the ellipse across, with and without a second one over its middle; areas
    /// of two ellipses side by side in closed form, of which 0.3 mm of 0.1 to 0.4 cost least.
    #[test]
    fn a_cut_lays_little_twice() {
        let walls = walls(&[&[[-6.0, -1.0], [6.0, -1.0], [6.0, 1.0], [-6.0, 1.0]]]);
        let straight = run([-5.0, 0.0], [5.0, 0.0]);
        let ground = |passes: &[LayerPass]| {
            let ground = DepositedArea::of_passes(passes, &walls, &ELLIPSE);
            ground.expect("a raster fine enough")
        };
        let alone = ground(std::slice::from_ref(&straight));
        let costs = alone.cuts_of(&straight.placements);
        let cell_mm2 = alone.raster.cell_mm.powi(2);
        let (cost, begin) = costs.cut(50, 100);
        // 0.3 mm on: twice 0.6 * 0.2 * (2 acos(s) - 2 s t), s = 0.75; open is what lies between the ellipses
        // where they are less than 0.3 mm wide, beyond t of their height.
        assert_eq!(begin, 53);
        let s = 0.75f64;
        let t = (1.0 - s * s).sqrt();
        let twice_mm2 = 0.12 * (2.0 * s.acos() - 2.0 * s * t);
        let tip_mm2 = 0.5 * (FRAC_PI_2 - t * s - t.asin());
        let open_mm2 = 2.0 * 0.6 * (0.3 * (1.0 - t) - 0.4 * tip_mm2);
        let expected_mm2 = twice_mm2 + 2.0 * open_mm2;
        let cost_mm2 = cost as f64 * cell_mm2;
        assert!(
            (cost_mm2 - expected_mm2).abs() < 0.03,
            "{cost_mm2} {expected_mm2}"
        );
        let whole_mm2 = costs.cut(50, 50).0 as f64 * cell_mm2;
        assert!((whole_mm2 - ELLIPSE.area_mm2()).abs() < 0.02, "{whole_mm2}");

        let both = ground(&[straight.clone(), run([0.0, -0.5], [0.0, 0.5])]);
        let costs = both.cuts_of(&straight.placements);
        let cost_mm2 = costs.cut(50, 100).0 as f64 * cell_mm2;
        assert!(cost_mm2 < 0.05, "{cost_mm2}");
    }
}
