//! One region of a layer: axis, passes, printing order.
//!
//! In: a [`Contour`] (mm), what is inside its walls, the plans of the regions next to it. Out: a [`RegionPlan`], in the region's
//! own frame.

use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::boolean::{difference, filled};
use crate::geometry::coverage::Cell;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::frame::Frame;
use crate::geometry::place_scale::ScaleField;
use crate::geometry::polygon::Region;
use crate::geometry::repair::FillRule;
use crate::plan::axis::medial_axis::{AxisOptions, MedialAxis};
use crate::plan::axis::pruned_axis::Axis;
use crate::plan::beads::division::{SPANNED_SLACK, WIDEST_SINGLE_SHARE};
use crate::plan::beads::infill::{bridge_lines, infill_passes, roof_lines};
use crate::plan::beads::passes::{PassSettings, outer_passes, passes};
use crate::plan::coverage::raster::{same_bead_mm, within_walls};
use crate::plan::curve::heading_stops::PassCutter;
use crate::plan::headings::profile::turn_weight_mm4;
use crate::plan::joining::printed_order::{RegionPasses, in_printing_order, sparse_lines_behind};
use crate::plan::layers::inside::Inside;
use crate::plan::layers::inside_ground::InsideGround;
use crate::plan::layers::optimised_passes::{FinishedPasses, Ground, RegionJob};
use crate::plan::layers::region_plan::RegionPlan;
use crate::plan::layers::region_plan::topologies::least_costly;
use crate::plan::layers::region_plan::warm_start::{PlacedWalls, WarmStart};
use crate::plan::outline::contour::Contour;
use crate::plan::outline::trimmed_outline::trimmed_outline;
use crate::plan::outline::unreachable::{UnreachableRun, unreachable_runs};
use crate::plan::pass::{LayerPass, PassKind};
use crate::plan::pose_limits::pose_limits;
use crate::settings::{Infill, PassMode, SeamPlace, Settings};
use crate::text::refusal::Refusal;
use rayon::prelude::*;
use std::sync::Arc;

/// A region that becomes a [`RegionPlan`], in its own frame.
#[derive(Clone, Debug)]
pub struct RegionWork {
    contour: Contour,
    frame: Frame,
    settings: Settings,
    hull: Region,
    /// The edges of the hull.
    walls: Arc<EdgeIndex>,
    /// Size of the nozzle by position in its frame, on a curved surface.
    scale: Option<ScaleField>,
    widest: Option<(Point2, f64)>,
    axis: Axis,
    unreachable: Vec<UnreachableRun>,
    passes: Vec<LayerPass>,
    /// The lines of a sparse infill.
    sparse: Vec<LayerPass>,
    /// The lines over open space.
    bridges: Vec<LayerPass>,
    open: Vec<Region>,
    /// What of that sparse lines and bridges have.
    sparse_open: Vec<Region>,
    /// What of that sparse lines have.
    sparse_ground: Vec<Region>,
    /// Part of the open area is filled, part is not.
    is_mixed: bool,
}

impl RegionWork {
    /// The region with its hull and medial axis, and its unreachable boundary. `scale` is in the input's coordinates,
    /// if these are the chart of a curved surface.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn begin(
        contour: Contour,
        scale: Option<&ScaleField>,
        settings: &Settings,
    ) -> Result<RegionWork, Refusal> {
        // Not one made anew: where snapping moved a point, that would turn, and move them all.
        let may_mirror = settings.aperture.is_mirror_image();
        let frame = contour.frame.mirrored_if(may_mirror);
        let contour_offset = contour.offset;
        let outline = frame.snapped_in(&contour.region);
        let mut hull = trimmed_outline(&outline, &settings.aperture);
        hull.begin_at_extremes();
        let reach_mm = settings.aperture.major_mm();
        let walls = EdgeIndex::of_region(&hull, reach_mm);
        // The diagram takes one thread, and most of the time here.
        let (medial_axis, unreachable) = rayon::join(
            || MedialAxis::of_edges(&walls, &AxisOptions::of(&settings.aperture)),
            || {
                let outline = EdgeIndex::of_region(&outline, reach_mm);
                unreachable_runs(&settings.aperture, &outline, &walls)
            },
        );
        let medial_axis = medial_axis?;
        let disks = medial_axis.vertices.iter().map(|v| (v.point, v.radius_mm));
        let axis = Axis::of_medial_axis(&medial_axis, &settings.aperture);
        let mut settings = settings.clone();
        settings.seam.direction_rad = frame.angle_in(settings.seam.untied_rad());
        Ok(RegionWork {
            contour,
            frame,
            settings,
            hull,
            walls: Arc::new(walls),
            scale: scale.map(|scale| scale.in_frame(frame, contour_offset)),
            widest: disks.max_by(|a, b| a.1.total_cmp(&b.1)),
            axis,
            unreachable,
            passes: Vec::new(),
            sparse: Vec::new(),
            bridges: Vec::new(),
            open: Vec::new(),
            sparse_open: Vec::new(),
            sparse_ground: Vec::new(),
            is_mixed: false,
        })
    }

    /// The region with the infill that it is printed with.
    fn asked(&self, inside: &Inside) -> RegionWork {
        let mut work = self.clone();
        work.settings.infill = inside.infill.map(|infill| Infill {
            angle_rad: self.frame.angle_in(infill.angle_rad),
            ..infill
        });
        work
    }

    /// The region's plan with this inside. Where its outline is nearly that of one of the regions `next_to` it, its passes
    /// are those.
    pub fn planned(&self, inside: &Inside, next_to: &[RegionPlan]) -> RegionPlan {
        let mut work = self.asked(inside);
        if let Some(plan) = work.resumed(inside, next_to) {
            return plan;
        }
        work.begin_passes(inside);
        work.in_order()
    }

    /// Its passes, unordered: walls with these lines inside, or loops.
    fn begin_passes(&mut self, inside: &Inside) {
        let how = pass_settings(&self.settings);
        match &self.settings.infill {
            None => self.passes = passes(&self.hull, &self.walls, &self.axis, &how),
            Some(infill) => {
                let walls = infill.walls as usize;
                let (passes, rings) =
                    outer_passes(&self.hull, &self.walls, &self.axis, &how, walls);
                self.passes = passes;
                self.open = filled(rings.iter(), FillRule::Positive);
                self.fill_open(inside);
            }
        }
    }

    /// Adds what is inside the walls.
    fn fill_open(&mut self, inside: &Inside) {
        let Some(infill) = self.settings.infill else {
            return;
        };
        let how = pass_settings(&self.settings);
        let mut rest = self.open.clone();
        let ground = InsideGround {
            frame: &self.frame,
            offset: self.contour.offset,
            aperture: &self.settings.aperture,
        };
        let mut over: [Vec<Region>; 2] = Default::default();
        for bridge in &inside.bridges {
            let over_air = ground.bridged(&bridge.ground, &rest);
            let angle_rad = self.frame.angle_in(bridge.angle_rad);
            let (lines, loops) = match bridge.over_lines {
                true => roof_lines(&over_air, angle_rad, &how),
                false => (bridge_lines(&over_air, angle_rad, &how), Vec::new()),
            };
            self.bridges.extend(lines);
            self.passes.extend(loops);
            if !over_air.is_empty() {
                rest = difference(&rest, &over_air);
            }
            over[usize::from(bridge.over_lines)].extend(over_air);
        }
        let [bridged, roofed] = over;
        let [solid, sparse] = match infill.is_solid() {
            true => [rest, Vec::new()],
            false => ground.divided(&rest, &inside.solid),
        };
        let filled = Infill {
            density_pct: infill.density_pct.max(100.0),
            ..infill
        };
        self.passes.extend(infill_passes(&solid, &filled, &how));
        let parts = [&solid, &sparse, &bridged, &roofed];
        self.is_mixed = parts.iter().filter(|part| !part.is_empty()).count() > 1;
        self.sparse = infill_passes(&sparse, &infill, &how);
        for line in &mut self.sparse {
            line.kind = PassKind::Sparse;
        }
        self.sparse_open = sparse.clone();
        self.sparse_open.extend(bridged);
        self.sparse_ground = sparse;
    }

    /// Centre (input coordinates) and radius of the widest disk, mm.
    pub fn widest_disk(&self) -> Option<(Point2, f64)> {
        let (at, radius_mm) = self.widest?;
        Some((self.contour.to_input(self.frame.point_out(at)), radius_mm))
    }

    /// Its passes in printing order, in either direction ([`RegionPlan::turned`]): joins must not
    /// depend on the region's position on the machine.
    fn in_order(mut self) -> RegionPlan {
        let own = std::mem::take(&mut self.passes);
        let own = self.ordered(own);
        let spanned = self.spanned(&own);
        let turning: Vec<Vec<LayerPass>> = std::iter::once(own).chain(spanned).collect();
        let count = turning.len();
        let ground = self.ground();
        let job = RegionJob::new(&ground, &self.settings);
        let how = pass_settings(&self.settings);
        let (number, mut found) = least_costly(turning, &self.hull, &job, &how);
        let is_spanned = (1..count).contains(&number);
        if let Some(pieces) = self.cutter(&found.passes).cut() {
            found = FinishedPasses {
                solution: None,
                ..job.optimised(pieces)
            };
        }
        if is_spanned {
            self.settings.pass_mode = PassMode::One;
        }
        self.with(found)
    }

    /// The passes with one bead wherever one spans the walls, where that may save much of the path of these: what it costs in
    /// interruptions of flow is for the objective to say.
    fn spanned(&self, own: &[LayerPass]) -> Option<Vec<LayerPass>> {
        let settings = &self.settings;
        let may_be_tried = settings.pass_mode == PassMode::Two
            && settings.infill.is_none()
            && self.may_start_warm();
        if !may_be_tried || self.spanned_mm() <= SPANNED_SHARE * length_mm(own) {
            return None;
        }
        let how = PassSettings {
            one_pass: true,
            ..pass_settings(settings)
        };
        Some(self.ordered(passes(&self.hull, &self.walls, &self.axis, &how)))
    }

    /// Length of the walls that one bead spans, though it would not by default.
    fn spanned_mm(&self) -> f64 {
        let a_mm = self.settings.aperture.major_mm();
        let spanned_mm = WIDEST_SINGLE_SHARE * a_mm..=(1.0 + SPANNED_SLACK) * a_mm;
        let links = self.axis.lengths_and_radii_mm();
        let spanned = links.filter(|(_, half_mm)| spanned_mm.contains(half_mm));
        spanned.map(|(length_mm, _)| length_mm).sum()
    }

    fn ground(&self) -> Ground<'_> {
        Ground {
            walls: &self.walls,
            area_mm2: self.hull.area_mm2(),
            left_out: &self.sparse_open,
            scale: self.scale.as_ref(),
        }
    }

    fn cutter<'a>(&'a self, passes: &'a [LayerPass]) -> PassCutter<'a> {
        PassCutter::new(passes, &self.walls, &self.frame, &self.settings)
    }

    /// The plan with these passes.
    fn with(self, found: FinishedPasses) -> RegionPlan {
        let frame = self.frame;
        let may_start_another = self.may_start_warm();
        let FinishedPasses {
            passes,
            curves,
            solution,
            ..
        } = found;
        // Lines that are linked with walls come after them.
        let is_solid = |infill: Infill| infill.is_solid();
        let is_all_solid = self.settings.infill.is_some_and(is_solid);
        let may_turn = !is_all_solid && !self.is_mixed;
        let is_wall = |pass: &LayerPass| !pass.kind.is_line();
        let lines_from = match may_turn {
            true => passes.iter().take_while(|pass| is_wall(pass)).count(),
            false => passes.len(),
        };
        let (walls, lines) = passes.split_at(lines_from);
        let ends = [walls, lines].map(|group| ends_of(group).filter(|_| may_turn));
        let out = |region: &Region| frame.region_out(region);
        let open: Vec<Region> = self.open.iter().map(out).collect();
        let warm_start = solution.filter(|_| may_start_another);
        let warm_start = warm_start.map(|solution| WarmStart {
            walls: self.settings.infill.map(|infill| infill.walls),
            solution,
            open: self.open,
        });
        let mut axis = self.axis;
        for point in &mut axis.points {
            *point = frame.point_out(*point);
        }
        let unreachable = self.unreachable.iter().map(|run| UnreachableRun {
            from: frame.point_out(run.from),
            to: frame.point_out(run.to),
        });
        RegionPlan {
            frame,
            walls: self.walls,
            scale: self.scale,
            ends,
            lines_from,
            contour: self.contour,
            hull: frame.region_out(&self.hull),
            axis,
            unreachable: unreachable.collect(),
            passes,
            curves,
            open,
            sparse: self.sparse_ground.iter().map(out).collect(),
            pass_mode: self.settings.pass_mode,
            warm_start,
        }
    }

    /// True if only the outline decides where the passes run that the optimiser knows.
    fn may_start_warm(&self) -> bool {
        let is_solid = |infill: Infill| infill.is_solid();
        self.bridges.is_empty()
            && !self.is_mixed
            && !self.settings.infill.is_some_and(is_solid)
            && self.scale.is_none()
            && self.settings.seam.place == SeamPlace::Nearest
            && self.settings.wide_beads.width_by_radius_max().is_none()
    }

    /// The plan by the passes of the region next to it, moved onto it where it has nearly the same outline.
    fn resumed(&self, inside: &Inside, next_to: &[RegionPlan]) -> Option<RegionPlan> {
        if !self.may_start_warm() || !inside.bridges.is_empty() {
            return None;
        }
        let to = PlacedWalls {
            walls: &self.walls,
            frame: self.frame,
            offset: self.contour.offset,
        };
        let walls = self.settings.infill.map(|infill| infill.walls);
        let aperture = &self.settings.aperture;
        let middle = self.contour.to_input(Point2::origin());
        let away_mm = |other: &RegionPlan| (other.middle() - middle).norm();
        let mut near = next_to.iter();
        let first = near.next()?;
        // The first of equals.
        let other = near.fold(first, |best, other| {
            if away_mm(other) < away_mm(best) {
                other
            } else {
                best
            }
        });
        let from = PlacedWalls {
            walls: &other.walls,
            frame: other.frame,
            offset: other.contour.offset,
        };
        let start = other.warm_start.as_ref()?;
        let start = (start.walls == walls).then(|| start.moved(&from, &to, aperture))??;
        let mut work = self.clone();
        work.settings.pass_mode = other.pass_mode;
        work.open = start.open;
        work.fill_open(inside);
        // Solid lines are linked with walls.
        if !work.passes.is_empty() || !work.may_start_warm() {
            return None;
        }
        let ground = work.ground();
        let mut found = RegionJob::new(&ground, &work.settings).resumed(start.solution)?;
        let (sparse, from) = (work.sparse.clone(), work.hull.bounds().min);
        found.passes = sparse_lines_behind(found.passes, sparse, &work.sparse_open, from, aperture);
        found.curves.resize(found.passes.len(), None);
        let is_cut = work.cutter(&found.passes).cut().is_some();
        (!is_cut).then(|| work.with(found))
    }

    /// The passes as they are printed, begun near a corner of the region's box. Of a small region,
    /// where a seam counts for much, near the corner that makes the fewest passes, and of those the
    /// one with little uncovered or re-covered area and a short path: a mm of path weighs as much
    /// as a strip as wide as b.
    fn ordered(&self, passes: Vec<LayerPass>) -> Vec<LayerPass> {
        let bounds = self.hull.bounds();
        let (low, high) = (bounds.min, bounds.max);
        let from = |corner: Point2, passes: Vec<LayerPass>| {
            let region = RegionPasses {
                passes,
                sparse: self.sparse.clone(),
                bridges: self.bridges.clone(),
                walls: &self.walls,
                open: &self.sparse_open,
            };
            in_printing_order(region, corner, &self.settings)
        };
        let all = passes.iter().chain(&self.sparse).chain(&self.bridges);
        let count: usize = all.map(|p| p.placements.len()).sum();
        if count > TINY_MAX {
            return from(low, passes);
        }
        let corners = [
            low,
            Point2::new(high.x, low.y),
            high,
            Point2::new(low.x, high.y),
        ];
        let tried = corners.into_par_iter().map(|corner| {
            let passes = from(corner, passes.clone());
            let aperture = &self.settings.aperture;
            let strip_mm2 = aperture.minor_mm() * length_mm(&passes);
            let wasted_mm2 = wasted_area_mm2(&passes, aperture, &self.walls) + strip_mm2;
            // Of corners that are alike, rounding must not choose.
            ((passes.len(), (wasted_mm2 * 1e3).round() as u64), passes)
        });
        // The first of equals.
        let tried: Vec<((usize, u64), Vec<LayerPass>)> = tried.collect();
        let best = tried.into_iter().min_by_key(|(key, _)| *key);
        best.map_or(Vec::new(), |(_, passes)| passes)
    }
}

/// Share of the path that one bead in place of two has to save to be tried: a second optimisation of the region.
const SPANNED_SHARE: f64 = 0.15;
/// Most placements of a region that is ordered from several corners, of about 60 mm of path: where it begins counts on
/// parts of a few mm. On larger ones the four came out as one, at a third of the processor time of the whole plan.
const TINY_MAX: usize = 600;
/// Most cells of the raster on which it is counted what a small region wastes.
const CELLS_MAX: usize = 1_000_000;

/// Area within the walls that is left open or covered again, mm².
fn wasted_area_mm2(passes: &[LayerPass], aperture: &Aperture, walls: &EdgeIndex) -> f64 {
    let raster = within_walls(passes, walls, aperture, CELLS_MAX, same_bead_mm(aperture));
    let wasted = |cell: &&Cell| matches!(cell, Cell::Gap | Cell::Overlap);
    raster.cells.iter().filter(wasted).count() as f64 * raster.cell_mm.powi(2)
}

fn length_mm(passes: &[LayerPass]) -> f64 {
    passes.iter().map(LayerPass::length_mm).sum()
}

/// Where the first pass begins and the last one ends.
fn ends_of(passes: &[LayerPass]) -> Option<[Point2; 2]> {
    let first = passes.first()?.placements.first()?;
    let last = passes.last()?.placements.last()?;
    Some([first.at.center, last.at.center])
}

fn pass_settings(settings: &Settings) -> PassSettings {
    PassSettings {
        aperture: settings.aperture,
        overlap: settings.overlap_pct / 100.0,
        one_pass: settings.pass_mode == PassMode::One,
        law: settings.heading_law,
        turn_weight_mm4: turn_weight_mm4(&pose_limits(settings), &settings.aperture),
    }
}
