//! The passes of one region in printing order, linked.
//!
//! Walls come first, then the lines of a solid infill, linked with them, then roofs over a sparse infill and bridges, each
//! linked only with each other so that they keep their own speed and flow, then the lines of a sparse infill: the area between
//! them is to stay open, and they are joined along the walls only.
//!
//! In: walls and lines of a region (mm, rad), the head's position (mm), settings. Out: open passes
//! in printing order, before they are optimised.

use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::Region;
use crate::plan::joining::bridges::bridged;
use crate::plan::joining::chains::{around_loops, chained};
use crate::plan::joining::infill_links::linked_along_walls;
use crate::plan::joining::links::linked;
use crate::plan::joining::order::ordered;
use crate::plan::joining::seam::with_seam;
use crate::plan::pass::{LayerPass, PassKind};
use crate::settings::{SeamPlace, Settings};

/// What belongs to one region, local coordinates.
pub struct RegionPasses<'a> {
    /// Its passes in any order, except for those below.
    pub passes: Vec<LayerPass>,
    /// The lines of a sparse infill.
    pub sparse: Vec<LayerPass>,
    /// The lines over open space.
    pub bridges: Vec<LayerPass>,
    /// The edges of the region.
    pub walls: &'a EdgeIndex,
    /// Area of the last two only: the area between them is to stay open.
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
    let finish = Finish {
        lines,
        sparse: region.sparse,
        bridges: region.bridges,
        walls,
        open: region.open,
        from,
        aperture,
    };
    finish.behind(passes)
}

/// Passes, and the lines of a sparse infill behind them; `from` is where the head is if there are none.
pub fn sparse_lines_behind(
    mut passes: Vec<LayerPass>,
    sparse: Vec<LayerPass>,
    open: &[Region],
    from: Point2,
    aperture: &Aperture,
) -> Vec<LayerPass> {
    if !sparse.is_empty() {
        let from = last_place(&passes).unwrap_or(from);
        let sparse = linked_along_walls(sparse, open, aperture);
        passes.extend(ordered(sparse, from, aperture));
    }
    passes
}

/// The loops in the order and with the joins that make the fewest passes.
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
        // The first of equals: bridges are a longer path.
        for other in [chains, tree] {
            if other.len() < passes.len() {
                passes = other;
            }
        }
    }
    passes
}

/// The lines printed once the loops are joined: those of an infill, bridges, sparse lines.
struct Finish<'a> {
    lines: Vec<LayerPass>,
    sparse: Vec<LayerPass>,
    bridges: Vec<LayerPass>,
    walls: &'a EdgeIndex,
    /// Ground that sparse lines and bridges have.
    open: &'a [Region],
    from: Point2,
    aperture: &'a Aperture,
}

impl Finish<'_> {
    /// The passes followed by the lines.
    fn behind(self, mut passes: Vec<LayerPass>) -> Vec<LayerPass> {
        let mut from = last_place(&passes).unwrap_or(self.from);
        let lines = ordered(self.lines, from, self.aperture);
        if !lines.is_empty() {
            passes.extend(lines);
            passes = linked(passes, self.aperture, self.walls);
            from = last_place(&passes).unwrap_or(from);
        }
        let is_roof = |pass: &LayerPass| pass.kind == PassKind::Roof;
        let (roofs, bridges): (Vec<_>, Vec<_>) = self.bridges.into_iter().partition(is_roof);
        for bridges in [roofs, bridges] {
            if bridges.is_empty() {
                continue;
            }
            let bridges = ordered(bridges, from, self.aperture);
            passes.extend(linked(bridges, self.aperture, self.walls));
            from = last_place(&passes).unwrap_or(from);
        }
        sparse_lines_behind(passes, self.sparse, self.open, self.from, self.aperture)
    }
}

fn last_place(passes: &[LayerPass]) -> Option<Point2> {
    let placements = &passes.last()?.placements;
    placements.last().map(|placement| placement.at.center)
}
