//! The plan of one region of a layer: its passes in printing order, and where the next region is begun from it.
//!
//! All of it is in the region's own frame ([`Frame`]), so that the same region rotated or mirrored gets the same plan. Passes
//! stay in that frame until they are curves; other results are relative to the contour's local origin again.
//!
//! In: what [`region_work`] makes of a contour (mm, rad). Out: a [`RegionPlan`], its passes in either direction.

pub mod region_work;
pub mod topologies;
pub mod warm_start;

use crate::geometry::Point2;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::frame::Frame;
use crate::geometry::place_scale::ScaleField;
use crate::geometry::polygon::Region;
use crate::plan::axis::pruned_axis::Axis;
use crate::plan::layers::optimised_passes::PassCurve;
use crate::plan::layers::region_plan::warm_start::WarmStart;
use crate::plan::outline::contour::Contour;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::pass::LayerPass;
use crate::settings::PassMode;
use std::sync::Arc;

/// The complete plan of one region of a layer.
#[derive(Clone, Debug)]
pub struct RegionPlan {
    /// The frame that it was planned in.
    pub frame: Frame,
    /// The edges of the hull, in that frame.
    pub walls: Arc<EdgeIndex>,
    /// Size of the nozzle by position in that frame, on a curved surface.
    pub scale: Option<ScaleField>,
    /// Where the first of the walls begins and the last one ends, and the same for the lines, in
    /// that frame; `None` if there are none or they may not be reversed.
    ends: [Option<[Point2; 2]>; 2],
    /// The passes before this one are walls, the others lines.
    lines_from: usize,
    /// The cleaned outline about its local origin.
    pub contour: Contour,
    /// What passes are planned on, local: the contour without detail that no part of the aperture
    /// enters.
    pub hull: Region,
    /// The part of the medial axis that passes are planned on, local.
    pub axis: Axis,
    /// Boundary that the aperture cannot touch, local.
    pub unreachable: Vec<UnreachableRun>,
    /// Passes in printing order, or the reverse of it, in that frame.
    pub passes: Vec<LayerPass>,
    /// For each pass its curve, where the optimiser made one.
    pub curves: Vec<PassCurve>,
    /// The area inside the walls that infill lines are to cover, local.
    pub open: Vec<Region>,
    /// What of that is open on purpose between the lines of a sparse infill, local.
    pub sparse: Vec<Region>,
    /// How its passes are laid where a passage is narrow.
    pub pass_mode: PassMode,
    /// What the next layer may start from.
    pub(super) warm_start: Option<WarmStart>,
}

impl RegionPlan {
    /// True if nothing of it can be printed.
    pub fn is_empty(&self) -> bool {
        self.passes.is_empty()
    }

    /// The middle of the region's box, input coordinates.
    pub fn middle(&self) -> Point2 {
        self.contour.to_input(Point2::origin())
    }

    /// The parts to reverse for the shortest travel from `from` (input coordinates) to the walls
    /// and from there to the lines.
    pub fn turned(&self, from: Point2) -> Reversal {
        let from = self.frame.point_in(self.contour.to_local(from));
        let way_mm = |turned: Reversal| {
            let (mut at, mut way_mm) = (from, 0.0);
            for (ends, is_turned) in self.ends.iter().zip([turned.walls, turned.lines]) {
                if let Some([first, last]) = *ends {
                    let (start, end) = if is_turned {
                        (last, first)
                    } else {
                        (first, last)
                    };
                    way_mm += (start - at).norm();
                    at = end;
                }
            }
            way_mm
        };
        let mut best = (Reversal::default(), way_mm(Reversal::default()));
        for (walls, lines) in [(true, false), (false, true), (true, true)] {
            let turned = Reversal { walls, lines };
            let is_idle = |is_turned: bool, ends: Option<_>| is_turned && ends.is_none();
            if is_idle(walls, self.ends[0]) || is_idle(lines, self.ends[1]) {
                continue;
            }
            let way_mm = way_mm(turned);
            // The first of equals: rounding must not choose.
            if way_mm < best.1 - 1e-9 {
                best = (turned, way_mm);
            }
        }
        best.0
    }

    /// Where the printing ends, input coordinates.
    pub fn end(&self, turned: Reversal) -> Option<Point2> {
        let (walls, lines) = self.passes.split_at(self.lines_from);
        let (group, is_turned) = match lines.is_empty() {
            true => (walls, turned.walls),
            false => (lines, turned.lines),
        };
        let placement = match is_turned {
            true => group.first()?.placements.first()?,
            false => group.last()?.placements.last()?,
        };
        let center = self.frame.point_out(placement.at.center);
        Some(self.contour.to_input(center))
    }

    /// The passes in the region's frame, with walls and lines each reversed or not.
    pub fn passes_turned(&self, turned: Reversal) -> Vec<LayerPass> {
        self.turned_round(&self.passes, turned, |pass| pass.placements.reverse())
    }

    /// The curves of [`RegionPlan::passes_turned`].
    pub fn curves_turned(&self, turned: Reversal) -> Vec<PassCurve> {
        self.turned_round(&self.curves, turned, |curve| {
            *curve = curve
                .as_ref()
                .map(|control| control.iter().rev().copied().collect());
        })
    }

    /// What there is of each pass, walls and lines each in their order or, with each turned round, in reverse.
    fn turned_round<T: Clone>(
        &self,
        of_passes: &[T],
        turned: Reversal,
        turn_round: impl Fn(&mut T),
    ) -> Vec<T> {
        let mut of_passes = of_passes.to_vec();
        let (walls, lines) = of_passes.split_at_mut(self.lines_from);
        for (group, is_turned) in [(walls, turned.walls), (lines, turned.lines)] {
            if is_turned {
                group.reverse();
                group.iter_mut().for_each(&turn_round);
            }
        }
        of_passes
    }
}

/// The reversed parts of a region.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Reversal {
    /// The loops.
    pub walls: bool,
    /// The lines inside them, which are printed after them.
    pub lines: bool,
}
