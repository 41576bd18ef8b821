//! The passes of one region as they are printed: ordered, linked, with gap-fill moves into gaps.
//!
//! Walls come first, then the lines of a solid infill, linked and filled up like everything else, then
//! bridges, linked with each other alone so that their speed and flow are theirs, then the lines of a sparse
//! infill: what they leave open is meant to stay open, and they are joined along the walls alone.
//!
//! In: walls and lines of a region (mm, rad), where the head is (mm), settings. Out: open passes as
//! they are printed, before shortcuts.

use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::Region;
use crate::plan::coverage::pass_ends::{small_ones, take_back_open};
use crate::plan::headings::profile::turn_weight_mm2;
use crate::plan::joining::bridges::bridged;
use crate::plan::joining::chains::{around_loops, chained};
use crate::plan::joining::gap_fill::fill_gaps;
use crate::plan::joining::infill_links::linked_along_walls;
use crate::plan::joining::links::linked;
use crate::plan::joining::order::ordered;
use crate::plan::joining::seam::with_seam;
use crate::plan::pass::LayerPass;
use crate::plan::pose_limits::{AreaPrice, PoseLimits};
use crate::settings::{SeamPlace, Settings};

/// How often small passes are taken back whose ground gap-fill moves did not reach.
const ROUNDS_MAX: usize = 4;

/// What belongs to one region, local coordinates.
pub struct RegionPasses<'a> {
    /// Its passes in any order, but those below.
    pub passes: Vec<LayerPass>,
    /// The lines of a sparse infill.
    pub sparse: Vec<LayerPass>,
    /// The lines over open space.
    pub bridges: Vec<LayerPass>,
    /// The region, and its edges.
    pub region: &'a Region,
    pub walls: &'a EdgeIndex,
    /// Ground that only the last two have: what stays open between them is meant to.
    pub open: &'a [Region],
}

/// Orders and joins the passes; `from` is where the head is.
pub fn in_printing_order(
    region: RegionPasses,
    from: Point2,
    settings: &Settings,
) -> Vec<LayerPass> {
    let aperture = &settings.aperture;
    let walls = region.walls;
    let is_line = |pass: &LayerPass| pass.kind.is_line();
    let (lines, loops): (Vec<LayerPass>, Vec<LayerPass>) =
        region.passes.into_iter().partition(is_line);
    let passes = joined(loops, from, walls, settings);
    // The ground that is to be filled: between the outline and what the sparse lines have.
    let is_sparse = settings.infill.is_some_and(|infill| !infill.is_solid());
    let band = (is_sparse || !region.bridges.is_empty()).then(|| {
        let rings = region.open.iter().flat_map(Region::edges);
        let edges = region.region.edges().chain(rings);
        let edges = edges.map(|(a, b)| Edge { a, b }).collect();
        EdgeIndex::new(edges, aperture.major_mm())
    });
    let finish = Finish {
        lines,
        sparse: region.sparse,
        bridges: region.bridges,
        walls,
        open: region.open,
        band,
        from,
        aperture,
        price: AreaPrice::of(settings),
        turn_weight_mm2: turn_weight_mm2(&PoseLimits::of(settings), aperture),
    };
    // Gap-fill moves take the place of small passes, if they can.
    let mut is_small = small_ones(&passes, aperture);
    let mut filled = finish.with(&passes, &is_small);
    for _ in 0..ROUNDS_MAX {
        if !take_back_open(&mut is_small, &passes, &filled, aperture) {
            break;
        }
        filled = finish.with(&passes, &is_small);
    }
    filled
}

/// The loops in the order and joined in the way that makes the fewest passes.
fn joined(
    loops: Vec<LayerPass>,
    from: Point2,
    walls: &EdgeIndex,
    settings: &Settings,
) -> Vec<LayerPass> {
    let aperture = &settings.aperture;
    let loops = loops.into_iter();
    let loops = loops.map(|pass| with_seam(pass, &settings.seam, aperture));
    let loops: Vec<LayerPass> = loops.collect();
    let in_order = |loops| linked(ordered(loops, from, aperture), aperture, walls);
    // A chosen seam stays open.
    let may_bridge = loops.len() > 1 && settings.seam.place == SeamPlace::Nearest;
    // Loops that hang together like a tree, not like a chain, take bridges.
    let (mut passes, others) = rayon::join(
        || in_order(loops.clone()),
        || {
            may_bridge.then(|| {
                let loops = chained(loops.clone(), aperture, walls);
                let loops = around_loops(loops, aperture, walls);
                rayon::join(
                    || in_order(loops.clone()),
                    || in_order(bridged(loops.clone(), aperture, walls)),
                )
            })
        },
    );
    if let Some((chains, tree)) = others {
        // The first of equals: bridges are a longer way.
        for other in [chains, tree] {
            if other.len() < passes.len() {
                passes = other;
            }
        }
    }
    passes
}

/// What comes once the loops are joined: the lines of an infill, and gap-fill moves into gaps.
struct Finish<'a> {
    lines: Vec<LayerPass>,
    sparse: Vec<LayerPass>,
    bridges: Vec<LayerPass>,
    walls: &'a EdgeIndex,
    /// Ground that sparse lines and bridges have.
    open: &'a [Region],
    /// Where lines are sparse, what alone is filled up.
    band: Option<EdgeIndex>,
    from: Point2,
    aperture: &'a Aperture,
    /// What gap-fill moves must bring.
    price: AreaPrice,
    turn_weight_mm2: f64,
}

impl Finish<'_> {
    /// The passes but the small ones, the lines behind them, with gap-fill moves.
    fn with(&self, passes: &[LayerPass], is_small: &[bool]) -> Vec<LayerPass> {
        let kept = passes.iter().zip(is_small).filter(|p| !p.1);
        let mut passes: Vec<LayerPass> = kept.map(|p| p.0.clone()).collect();
        let from = last_place(&passes).unwrap_or(self.from);
        let lines = ordered(self.lines.clone(), from, self.aperture);
        if !lines.is_empty() {
            passes.extend(lines);
            passes = linked(passes, self.aperture, self.walls);
        }
        let from = last_place(&passes).unwrap_or(self.from);
        let ground = self.band.as_ref().unwrap_or(self.walls);
        fill_gaps(&mut passes, self.aperture, ground, Some(&self.price));
        let mut from = from;
        if !self.bridges.is_empty() {
            let bridges = ordered(self.bridges.clone(), from, self.aperture);
            passes.extend(linked(bridges, self.aperture, self.walls));
            from = last_place(&passes).unwrap_or(from);
        }
        if self.band.is_some() {
            let joined = linked_along_walls(
                ordered(self.sparse.clone(), from, self.aperture),
                self.open,
                self.turn_weight_mm2,
                self.aperture,
                self.walls,
            );
            passes.extend(joined);
        }
        passes
    }
}

fn last_place(passes: &[LayerPass]) -> Option<Point2> {
    let placements = &passes.last()?.placements;
    placements.last().map(|placement| placement.at.center)
}
