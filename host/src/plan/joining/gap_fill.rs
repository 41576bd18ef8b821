//! Gap-fill moves: short moves from a pass into the area that all passes together leave uncovered.
//!
//! Corners, junctions of the medial axis and changes of the bead count leave small gaps where no bead channel fits.
//! For each gap the placement with the largest gain is searched over position and heading
//! ([`crate::plan::coverage::gap_raster`]); from a placement of a pass nearby the nozzle goes there and comes back,
//! without an interruption of flow: the placement from which the complete move gains most is chosen.
//!
//! In: passes (mm, rad), the walls, the price of area (s/mm²). Out: the passes with moves into
//! gaps. Not covered: gaps that gain less than their time is worth, which the figures show as
//! uncovered.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::point_grid::PointGrid;
use crate::plan::coverage::connections::{eased, inside_connection};
use crate::plan::coverage::gap_raster::{Footprint, GapRaster};
use crate::plan::joining::links::LENGTH_SHARE;
use crate::plan::pass::sweep::turn_to;
use crate::plan::pass::{LayerPass, Placement};
use crate::plan::pose_limits::AreaPrice;
use rayon::prelude::*;
use std::collections::HashMap;

/// Rounds of looking for gaps: a large one takes several gap-fill moves.
const ROUNDS: usize = 40;
/// Rounds in which the same gap is searched in vain.
const TRIES: usize = 2;
/// Placements of the passes tried as the start of a gap-fill move.
const STARTS: usize = 24;
/// Free paths that are compared.
const WAYS: usize = 4;
/// Gaps searched side by side: enough for any number of threads, and what they may cover fits the
/// memory.
const BATCH: usize = 64;

/// Fills the gaps that `passes` leave in the region bounded by `walls`, with gap-fill moves that gain
/// more than the area that their time is worth.
pub fn fill_gaps(
    passes: &mut [LayerPass],
    aperture: &Aperture,
    walls: &EdgeIndex,
    price: &AreaPrice,
) {
    if passes.iter().all(|pass| pass.placements.is_empty()) {
        return;
    }
    let mut raster = GapRaster::of(passes, aperture, walls);
    // How often nothing reached a gap (first cell, number of cells): some are searched once more,
    // from what was added meanwhile.
    let mut failures: HashMap<(u32, usize), usize> = HashMap::new();
    for _ in 0..ROUNDS {
        let starts = Starts::of(passes, aperture);
        let is_open = |gap: &&Vec<u32>| {
            failures
                .get(&(gap[0], gap.len()))
                .is_none_or(|&n| n < TRIES)
        };
        let gaps: Vec<Vec<u32>> = raster.gaps().iter().filter(is_open).cloned().collect();
        let mut moves: Vec<GapFillMove> = Vec::new();
        for gaps in gaps.chunks(BATCH) {
            let found: Vec<Option<GapFillMove>> = gaps
                .par_iter()
                .map(|gap| {
                    let at = raster.best_placement(gap, aperture, walls)?;
                    starts.best_move_to(at, &raster, passes, aperture, walls, price)
                })
                .collect();
            for (gap, found) in gaps.iter().zip(found) {
                // Gap-fill moves of this round may have closed the gap already.
                match found.filter(|found| found.net_mm2(&raster) > 0.0) {
                    Some(found) => {
                        raster.cover(&found.footprint);
                        moves.push(found);
                    }
                    None => *failures.entry((gap[0], gap.len())).or_default() += 1,
                }
            }
        }
        if moves.is_empty() {
            return;
        }
        insert(passes, moves);
        raster.update();
    }
}

/// A gap-fill move from a placement of a pass.
struct GapFillMove {
    pass: usize,
    after: usize,
    /// Out and back, without the start at the beginning and repeating it at the end.
    fill: Vec<Configuration>,
    footprint: Footprint,
    /// The area that its time is worth.
    cost_mm2: f64,
}

impl GapFillMove {
    /// What it gains beyond its time.
    fn net_mm2(&self, raster: &GapRaster) -> f64 {
        raster.net_mm2(&self.footprint) - self.cost_mm2
    }
}

/// Where gap-fill moves may start: the placements of all passes, by place.
struct Starts {
    reach_mm: f64,
    /// Pass and placement.
    index: PointGrid<(usize, usize)>,
}

impl Starts {
    fn of(passes: &[LayerPass], aperture: &Aperture) -> Starts {
        let reach_mm = LENGTH_SHARE * aperture.major_mm();
        let all = passes.iter().enumerate().flat_map(|(p, pass)| {
            let placements = pass.placements.iter().enumerate();
            placements.map(move |(i, placement)| (placement.at.center, (p, i)))
        });
        Starts {
            reach_mm,
            index: PointGrid::of(reach_mm, all),
        }
    }

    /// The nearest placements from which `at` can be reached, the nearest first.
    fn near(
        &self,
        at: Configuration,
        passes: &[LayerPass],
        aperture: &Aperture,
    ) -> Vec<[usize; 2]> {
        let swing = 0.5 * (aperture.major_mm() + aperture.minor_mm());
        let mut found: Vec<(f64, usize, usize)> = Vec::new();
        for &(p, i) in self.index.around(at.center) {
            let start = passes[p].placements[i].at;
            let apart = (start.center - at.center).norm();
            if apart < self.reach_mm {
                let turn = turn_to(aperture, start.heading_rad, at.heading_rad).abs();
                found.push((apart + swing * turn, p, i));
            }
        }
        found.sort_by(|s, t| s.0.total_cmp(&t.0).then((s.1, s.2).cmp(&(t.1, t.2))));
        found.truncate(STARTS);
        found.iter().map(|f| [f.1, f.2]).collect()
    }

    /// The gap-fill move to `at` with the largest net gain from the nearest starts that have a connection there, if any
    /// is worth its path.
    fn best_move_to(
        &self,
        at: Configuration,
        raster: &GapRaster,
        passes: &[LayerPass],
        aperture: &Aperture,
        walls: &EdgeIndex,
        price: &AreaPrice,
    ) -> Option<GapFillMove> {
        let starts = self.near(at, passes, aperture).into_iter();
        let ways = starts.filter_map(|[pass, after]| {
            let from = passes[pass].placements[after].at;
            let out = inside_connection(eased(from, at, aperture), aperture, walls)?;
            let back = out.iter().rev().skip(1).copied();
            let fill: Vec<Configuration> = out.iter().copied().chain(back).chain([from]).collect();
            Some((pass, after, fill))
        });
        let mut best: Option<(f64, GapFillMove)> = None;
        for (pass, after, fill) in ways.take(WAYS) {
            let cost_mm2 = price.of_gap_fill_mm2(&fill);
            let best_mm2 = best.as_ref().map_or(0.0, |best| best.0);
            let least_mm2 = cost_mm2 + best_mm2;
            let footprint = raster.footprint(&passes[pass], after, &fill, aperture, least_mm2);
            let found = footprint.map(|footprint| GapFillMove {
                pass,
                after,
                fill,
                footprint,
                cost_mm2,
            });
            let found = found.map(|found| (found.net_mm2(raster), found));
            best = found.filter(|found| found.0 > best_mm2).or(best);
        }
        best.map(|(_, found)| found)
    }
}

/// Inserts the gap-fill moves after their placements, last first so that the numbers stay right.
fn insert(passes: &mut [LayerPass], mut moves: Vec<GapFillMove>) {
    moves.sort_by_key(|d| std::cmp::Reverse((d.pass, d.after)));
    for GapFillMove {
        pass, after, fill, ..
    } in moves
    {
        let placements = &mut passes[pass].placements;
        let contact = placements[after].contact;
        let fill = fill.into_iter().map(|at| Placement {
            at,
            feasible: true,
            contact,
        });
        placements.splice(after + 1..after + 1, fill);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::clearance::is_inside;
    use crate::geometry::test_shapes::{self, ELLIPSE as APERTURE};
    use crate::plan::pass::test_passes::run;
    use crate::settings::Settings;

    fn walls(width: f64, height: f64) -> EdgeIndex {
        test_shapes::walls(&[&[[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]])
    }

    /// A pass along y = 0.6 with the major axis across the travel: it covers y up to 1.2.
    fn pass(length: f64) -> LayerPass {
        run([0.3, 0.6], [length - 0.3, 0.6])
    }

    fn price() -> AreaPrice {
        AreaPrice::of(&Settings::default())
    }

    fn covered_pct(passes: &[LayerPass], walls: &EdgeIndex) -> f64 {
        GapRaster::of(passes, &APERTURE, walls).covered_pct()
    }

    /// Goal: a strip beside the pass is filled, every pose stays inside, and the path goes on
    /// without a jump from where it left. Method: a 6 x 1.5 mm bar whose pass covers 1.2 mm.
    #[test]
    fn a_strip_is_filled_by_gap_fill_moves() {
        let walls = walls(6.0, 1.5);
        let mut passes = vec![pass(6.0)];
        let before = covered_pct(&passes, &walls);
        let original = passes[0].placements.clone();
        fill_gaps(&mut passes, &APERTURE, &walls, &price());
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
        fill_gaps(&mut passes, &APERTURE, &walls, &price());
        let count = passes[0].placements.len();
        fill_gaps(&mut passes, &APERTURE, &walls, &price());
        assert_eq!(passes[0].placements.len(), count);
    }
}
