//! The passes of one region as they are printed: ordered, linked, with excursions into gaps.
//!
//! Walls come first, then the lines of an infill. A solid infill is linked and filled up like
//! everything else; what a sparse one leaves open is meant to stay open.

use super::bridges::bridged;
use super::chains::{around_loops, chained};
use super::darts::fill_gaps;
use super::ends::drop_small;
use super::links::linked;
use super::order::ordered;
use super::passes::{LayerPass, PassKind};
use super::seam::with_seam;
use crate::geometry::Point2;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::Region;
use crate::settings::{SeamPlace, Settings};

/// What belongs to one region, local coordinates.
pub struct RegionPasses<'a> {
    /// Its passes in any order.
    pub passes: Vec<LayerPass>,
    /// The region.
    pub region: &'a Region,
    /// Ground that only infill lines cover.
    pub open: &'a [Region],
}

/// Orders and joins the passes; `from` is where the head is.
pub fn in_printing_order(
    region: RegionPasses,
    from: Point2,
    settings: &Settings,
) -> Vec<LayerPass> {
    let aperture = &settings.aperture;
    let reach_mm = aperture.major_mm();
    let walls = EdgeIndex::of_region(region.region, reach_mm);
    let is_line = |pass: &LayerPass| pass.kind == PassKind::Infill;
    let (lines, loops): (Vec<LayerPass>, Vec<LayerPass>) =
        region.passes.into_iter().partition(is_line);
    let loops = loops.into_iter();
    let loops = loops.map(|pass| with_seam(pass, &settings.seam, aperture));
    let loops: Vec<LayerPass> = loops.collect();
    let joined = |loops| linked(ordered(loops, from, aperture), aperture, &walls);
    // A chosen seam stays open.
    let may_bridge = loops.len() > 1 && settings.seam.place == SeamPlace::Nearest;
    // Loops that hang together like a tree, not like a chain, take bridges.
    let (mut passes, others) = rayon::join(
        || joined(loops.clone()),
        || {
            may_bridge.then(|| {
                let loops = chained(loops.clone(), aperture, &walls);
                let loops = around_loops(loops, aperture, &walls);
                rayon::join(
                    || joined(loops.clone()),
                    || joined(bridged(loops.clone(), aperture, &walls)),
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
    drop_small(&mut passes, aperture);
    let from = last_place(&passes).unwrap_or(from);
    let lines = ordered(lines, from, aperture);
    if settings.infill.is_none_or(|infill| infill.is_solid()) {
        if !lines.is_empty() {
            passes.extend(lines);
            passes = linked(passes, aperture, &walls);
        }
        fill_gaps(&mut passes, aperture, &walls);
        return passes;
    }
    // The ground of the walls alone: between the outline and what the lines are to cover.
    let rings = region.open.iter().flat_map(Region::edges);
    let edges = region.region.edges().chain(rings);
    let band = EdgeIndex::new(edges.map(|(a, b)| Edge { a, b }).collect(), reach_mm);
    fill_gaps(&mut passes, aperture, &band);
    passes.extend(lines);
    passes
}

fn last_place(passes: &[LayerPass]) -> Option<Point2> {
    let placements = &passes.last()?.placements;
    placements.last().map(|placement| placement.at.center)
}
