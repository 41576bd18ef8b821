//! Hands the passes of a region to the optimiser, and turns its result into the printed curves.
//!
//! In: passes in printing order (mm, rad), the walls, the settings. Out: for each pass the control points of its
//! curve, inside the walls; `None` if the optimiser does not apply (lines of a sparse infill and bridges) or its
//! result is not inside: such a pass becomes a curve unchanged, by [`crate::plan::curve::layer_path`].

use crate::geometry::coverage::return_mm;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::place_scale::ScaleField;
use crate::geometry::plane_curve::PlaneControl;
use crate::geometry::polygon::Region;
use crate::plan::curve::curls::without_curls;
use crate::plan::curve::even_spans::even_spans;
use crate::plan::curve::layer_path::{merged, path_tolerance_mm, sharpened, whole_inside};
use crate::plan::curve::optimised_curve::{Begun, placements_on, take};
use crate::plan::curve::pushing_inside::InsideWalls;
use crate::plan::joining::gap_fill::fill_gaps;
use crate::plan::joining::order::interruption_mm;
use crate::plan::pass::{LayerPass, PassKind};
use crate::plan::pose_limits::{AreaPrice, PoseLimits, pose_limits, price_s_mm2};
use crate::settings::{Quality, Settings};
use headway_optimiser::{Effort, Objective, OptimisedPass, Outcome, Site, optimise};
use std::sync::Arc;

/// Ground laid twice against ground left open.
const TWICE_SHARE: f64 = 0.5;
/// Prices of ground by which gap-fill moves are added, against that of the objective. Where little is open the first: it
/// was not worth its seconds to the optimiser, and where it pays at half the price the topology lacks a bead. Else the
/// second, and the last where that leaves more than twice as much.
const FILL_SHARES: [f64; 3] = [0.5, 1.0, 4.0];
/// Share of the area that counts as little: in a part as small as the aperture, or with a round nozzle, the area
/// that beads cannot reach is larger.
const OPEN_SHARE: f64 = 0.01;
/// The curve of a pass, if there is one.
pub type PassCurve = Option<Arc<[PlaneControl]>>;

/// True for the passes that the optimiser knows: their beads are to cover area.
fn is_known(pass: &LayerPass) -> bool {
    let is_filling = matches!(pass.kind, PassKind::Infill | PassKind::Roof);
    let covers_ground = pass.kind.follows_walls() || is_filling;
    covers_ground && !pass.placements.is_empty()
}

/// The ground of a region, for its optimisation.
#[derive(Clone, Copy, Debug)]
pub struct Ground<'a> {
    /// Edges that the beads stay within.
    pub walls: &'a EdgeIndex,
    /// Area inside them, mm².
    pub area_mm2: f64,
    /// What of it belongs to sparse lines and bridges.
    pub left_out: &'a [Region],
    /// Size of the nozzle by position, on a curved surface.
    pub scale: Option<&'a ScaleField>,
}

/// Optimised passes of a region.
#[derive(Default)]
pub struct FinishedPasses {
    /// The passes, with gap-fill moves.
    pub passes: Vec<LayerPass>,
    /// For each its curve.
    pub curves: Vec<PassCurve>,
    /// The objective, s ([`BegunPasses::cost_s`]).
    pub cost_s: Option<f64>,
    /// What of it is time.
    pub time_s: f64,
    /// What another region like this one may start from.
    pub solution: Option<Solution>,
}

/// Passes of a region as the optimiser left them, if all of them have curves.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Those that it knows.
    pub passes: Vec<LayerPass>,
    /// Their unknowns.
    pub begun: Vec<Begun>,
    /// The objective of the one that began without another's, for its area, s/mm².
    pub cost_s_mm2: f64,
}

/// Passes of a region after their first optimisation.
pub struct BegunPasses {
    passes: Vec<LayerPass>,
    /// Those that the optimiser knows.
    numbers: Vec<usize>,
    known: Vec<LayerPass>,
    begun: Vec<Begun>,
    /// `None` where the optimiser does not apply.
    reached: Option<Reached>,
}

impl BegunPasses {
    /// The objective, s: seconds of motion, the price of ground that is left open or laid twice, and a flow interruption for
    /// each pass. `None` where the optimiser does not know all passes.
    pub fn cost_s(&self, settings: &Settings) -> Option<f64> {
        let is_all = self.numbers.len() == self.passes.len();
        let reached = self.reached.filter(|_| is_all)?;
        Some(reached.cost_s + self.interrupted_s(settings))
    }

    fn interrupted_s(&self, settings: &Settings) -> f64 {
        self.passes.len() as f64 * interruption_s(settings)
    }
}

/// The time that an interruption of flow counts as.
pub fn interruption_s(settings: &Settings) -> f64 {
    interruption_mm(&settings.aperture) / pose_limits(settings).tip_speed_mm_s
}

/// What a run of the optimiser reached.
#[derive(Clone, Copy, Debug)]
struct Reached {
    open_mm2: f64,
    /// Its objective, s.
    cost_s: f64,
    /// What of it is time.
    time_s: f64,
}

/// A pass that the optimiser knows, when it is done.
struct KnownPass {
    pass: LayerPass,
    curve: PassCurve,
    begun: Begun,
}

impl KnownPass {
    fn without_curve((pass, begun): (LayerPass, Begun)) -> KnownPass {
        let curve = None;
        KnownPass { pass, curve, begun }
    }
}

impl Solution {
    /// `None` unless all passes have curves.
    fn of(found: &[KnownPass], cost_s_mm2: f64) -> Option<Solution> {
        let is_whole = found.iter().all(|known| known.curve.is_some());
        (is_whole && cost_s_mm2.is_finite()).then(|| Solution {
            passes: found.iter().map(|known| known.pass.clone()).collect(),
            begun: found.iter().map(|known| known.begun.clone()).collect(),
            cost_s_mm2,
        })
    }
}

/// The optimisation of the passes of a region, except for sparse lines and bridges.
pub struct RegionJob<'a> {
    /// The region's ground.
    pub ground: &'a Ground<'a>,
    /// The job's settings.
    pub settings: &'a Settings,
    limits: PoseLimits,
    /// What bounds gap-fill moves where area is omitted: the walls, and that.
    filled_to: Option<EdgeIndex>,
    /// Area that is to be covered, mm².
    ground_mm2: f64,
}

impl<'a> RegionJob<'a> {
    /// The job of a region.
    pub fn new(ground: &'a Ground, settings: &'a Settings) -> RegionJob<'a> {
        let left_out = ground.left_out;
        let filled_to = (!left_out.is_empty()).then(|| {
            let others = left_out.iter().flat_map(Region::edges);
            let edges = ground.walls.edges().iter().copied();
            let edges = edges.chain(others.map(|(a, b)| Edge { a, b }));
            EdgeIndex::new(edges.collect(), settings.aperture.major_mm())
        });
        RegionJob {
            ground,
            settings,
            limits: pose_limits(settings),
            filled_to,
            ground_mm2: ground.area_mm2 - left_out.iter().map(Region::area_mm2).sum::<f64>(),
        }
    }

    /// Optimises the passes together. The uncovered area then gets gap-fill moves, with which they are optimised again. The
    /// placements of passes with a curve become poses of it.
    pub fn optimised(&self, passes: Vec<LayerPass>) -> FinishedPasses {
        self.finished(self.begun(passes))
    }

    /// The first optimisation.
    pub fn begun(&self, passes: Vec<LayerPass>) -> BegunPasses {
        let numbers: Vec<usize> = (0..passes.len())
            .filter(|&i| is_known(&passes[i]))
            .collect();
        let mut known: Vec<LayerPass> = numbers.iter().map(|&i| passes[i].clone()).collect();
        let (begun, reached) = self.begin(&mut known);
        BegunPasses {
            passes,
            numbers,
            known,
            begun,
            reached,
        }
    }

    /// The passes with gap-fill moves, and their curves.
    pub fn finished(&self, mut all: BegunPasses) -> FinishedPasses {
        let known = std::mem::take(&mut all.known);
        let begun = std::mem::take(&mut all.begun);
        let (found, reached) = self.filled(known, begun, all.reached);
        all.reached = reached;
        let cost_s = all.cost_s(self.settings);
        let moving_s = reached.map_or(0.0, |reached| reached.time_s);
        let time_s = moving_s + all.interrupted_s(self.settings);
        let mut passes = all.passes;
        let mut curves = vec![None; passes.len()];
        let cost_s_mm2 = reached.map(|reached| reached.cost_s / self.ground_mm2);
        let solution = cost_s_mm2.and_then(|cost_s_mm2| Solution::of(&found, cost_s_mm2));
        for (number, known) in all.numbers.into_iter().zip(found) {
            passes[number] = known.pass;
            curves[number] = known.curve;
        }
        FinishedPasses {
            passes,
            curves,
            cost_s,
            time_s,
            solution,
        }
    }

    /// The passes of a region like this one, moved onto it and optimised briefly; `None` where the result is worse than
    /// what it was there, or leaves the walls.
    pub fn resumed(&self, start: Solution) -> Option<FinishedPasses> {
        let Solution {
            mut passes,
            mut begun,
            cost_s_mm2,
        } = start;
        let reached = self.settle(&mut passes, &mut begun)?;
        if reached.cost_s > WORSE_MAX * cost_s_mm2 * self.ground_mm2 {
            return None;
        }
        let found = self.with_curves(passes, begun);
        let solution = Solution::of(&found, cost_s_mm2)?;
        let known = found.into_iter().map(|known| (known.pass, known.curve));
        let (passes, curves) = known.unzip();
        Some(FinishedPasses {
            passes,
            curves,
            solution: Some(solution),
            ..FinishedPasses::default()
        })
    }

    /// A few more iterations of passes that were optimised here, or on ground like this.
    fn settle(&self, passes: &mut [LayerPass], begun: &mut [Begun]) -> Option<Reached> {
        let effort = Effort {
            iterations: iterations(self.settings)[2],
            is_warm: true,
        };
        let reached = self.run(begun, &effort, None);
        take(passes, begun);
        reached
    }

    fn site(&self) -> Site<'_> {
        Site {
            walls: self.ground.walls,
            left_out: self.ground.left_out,
            aperture: &self.settings.aperture,
            limits: &self.limits,
            width_by_radius_max: None,
            scale: self.ground.scale,
        }
    }

    /// The passes after the first optimisation; `None` if it does not apply.
    fn begin(&self, passes: &mut [LayerPass]) -> (Vec<Begun>, Option<Reached>) {
        let mut begun: Vec<Begun> = passes.iter().map(|pass| self.in_spans(pass)).collect();
        let [first, ..] = iterations(self.settings);
        let bound = self.settings.wide_beads.width_by_radius_max();
        let unrounded = bound.map(|bound| (bound, begun.clone()));
        let reached = self.run(&mut begun, &Effort::cold(first), None);
        if let Some(Reached { open_mm2, .. }) = reached {
            if let Some((bound, unrounded)) = unrounded {
                self.round(&mut begun, unrounded, bound, open_mm2);
            }
            take(passes, &mut begun);
        }
        (begun, reached)
    }

    /// Known passes with gap-fill moves, and their curves.
    fn filled(
        &self,
        mut passes: Vec<LayerPass>,
        mut begun: Vec<Begun>,
        mut reached: Option<Reached>,
    ) -> (Vec<KnownPass>, Option<Reached>) {
        let Some(Reached { open_mm2, .. }) = reached else {
            self.fill(&mut passes, 1.0);
            let unchanged = passes.into_iter().zip(begun);
            return (unchanged.map(KnownPass::without_curve).collect(), None);
        };
        let [_, again, _] = iterations(self.settings);
        let mut is_filled = false;
        let price_shares = match self.is_little(open_mm2) {
            true => &FILL_SHARES[..1],
            false => &FILL_SHARES[1..],
        };
        for price_share in price_shares {
            if !self.fill(&mut passes, *price_share) {
                continue;
            }
            is_filled = true;
            for (pass, begun) in passes.iter().zip(&mut begun) {
                if pass.placements.len() != begun.numbers.len() {
                    *begun = self.in_spans(pass);
                }
            }
            let again = self.run(&mut begun, &Effort::cold(again), None);
            take(&mut passes, &mut begun);
            reached = again.or(reached);
            if again.is_some_and(|again| self.is_little(0.5 * again.open_mm2)) {
                break;
            }
        }
        if is_filled {
            self.uncurl(&mut passes, &mut begun, &mut reached);
        }
        // Curves within a bound stay as they are.
        if !is_filled && self.settings.wide_beads.width_by_radius_max().is_none() {
            reached = self.settle(&mut passes, &mut begun).or(reached);
        }
        (self.with_curves(passes, begun), reached)
    }

    fn is_little(&self, open_mm2: f64) -> bool {
        open_mm2 < OPEN_SHARE * self.ground_mm2
    }

    /// Leaves out the curls of the passes where the objective is no worse for it, and little is open.
    fn uncurl(
        &self,
        passes: &mut Vec<LayerPass>,
        begun: &mut Vec<Begun>,
        reached: &mut Option<Reached>,
    ) {
        let major_mm = self.settings.aperture.major_mm();
        let kept = |begun: &Begun| without_curls(&begun.unknown.control, major_mm);
        let kept: Vec<Option<Vec<usize>>> = begun.iter().map(kept).collect();
        if kept.iter().all(Option::is_none) {
            return;
        }
        let (mut own, mut own_begun) = (passes.clone(), begun.clone());
        for ((pass, begun), kept) in own.iter_mut().zip(&mut own_begun).zip(kept) {
            if let Some(kept) = kept {
                begun.keep(&kept);
                pass.placements = kept.iter().map(|&i| pass.placements[i]).collect();
            }
        }
        let settled = self.settle(&mut own, &mut own_begun);
        let is_better = |settled: &Reached| {
            reached.is_some_and(|r| settled.cost_s <= r.cost_s) && self.is_little(settled.open_mm2)
        };
        if let Some(settled) = settled.filter(is_better) {
            (*passes, *begun, *reached) = (own, own_begun, Some(settled));
        }
    }

    /// The passes with their curves, where these are inside the walls.
    fn with_curves(&self, passes: Vec<LayerPass>, begun: Vec<Begun>) -> Vec<KnownPass> {
        let inside = InsideWalls {
            aperture: &self.settings.aperture,
            walls: self.ground.walls,
            tolerance_mm: path_tolerance_mm(self.settings),
            scale: self.ground.scale,
        };
        let known = passes.into_iter().zip(begun).map(|(mut pass, mut begun)| {
            let curve = whole_inside(&begun.unknown.control, &inside);
            if let Some(control) = &curve {
                // A curve that was led around has a few more points than it began with.
                let share = (begun.numbers.len() - 1) as f64 / (control.len() - 1) as f64;
                let number = |i: usize| begun.numbers[(i as f64 * share) as usize];
                pass.placements = placements_on(control, |i| pass.placements[number(i)]);
                let own = |i: usize| ((i as f64 / share) as usize).min(control.len() - 1);
                begun.numbers = (0..begun.numbers.len()).map(own).collect();
            }
            KnownPass {
                pass,
                curve: curve.map(Into::into),
                begun,
            }
        });
        known.collect()
    }

    /// A pass in even spans.
    fn in_spans(&self, pass: &LayerPass) -> Begun {
        let (control, numbers) = merged(pass, &self.settings.aperture);
        let even = even_spans(&sharpened(&control), &self.settings.aperture, &self.limits);
        Begun {
            unknown: OptimisedPass {
                control: even.control,
                log_pace: even.log_pace,
            },
            numbers: even.numbers.into_iter().map(|i| numbers[i]).collect(),
        }
    }

    /// Rounds the passes where they curve more than wide beads take. If walls leave no room for that they would only
    /// waver: they stay unchanged unless half of the tight curvature is removed and the open area is little more than
    /// the earlier `open_mm2`. `rounded` is their start.
    fn round(&self, begun: &mut Vec<Begun>, mut rounded: Vec<Begun>, bound: f64, open_mm2: f64) {
        let tight_mm = |begun: &[Begun]| {
            let unknowns: Vec<OptimisedPass> = begun.iter().map(|b| b.unknown.clone()).collect();
            headway_optimiser::tight_mm(&unknowns, &self.settings.aperture, bound)
        };
        let before_mm = tight_mm(begun);
        if before_mm > 0.0
            && (self.run(&mut rounded, &Effort::cold(ROUNDING), Some(bound)))
                .is_some_and(|rounded| self.is_little(0.5 * (rounded.open_mm2 - open_mm2)))
            && tight_mm(&rounded) <= 0.5 * before_mm
        {
            *begun = rounded;
        }
    }

    /// One run of the optimiser; `None` if it does not apply.
    fn run(
        &self,
        begun: &mut [Begun],
        effort: &Effort,
        width_by_radius_max: Option<f64>,
    ) -> Option<Reached> {
        let mut unknowns: Vec<OptimisedPass> = begun.iter().map(|b| b.unknown.clone()).collect();
        let site = Site {
            width_by_radius_max,
            ..self.site()
        };
        let objective = objective(self.settings);
        let report = optimise(&mut unknowns, &site, &objective, effort);
        if report.outcome != Outcome::Optimised {
            return None;
        }
        for (begun, unknown) in begun.iter_mut().zip(unknowns) {
            begun.unknown = unknown;
        }
        let ([_, open_mm2], [_, twice_mm2]) = (report.open_mm2, report.twice_mm2);
        let area_mm2 = open_mm2 + objective.twice_share * twice_mm2;
        Some(Reached {
            open_mm2,
            cost_s: report.seconds[1] + objective.price_s_mm2 * area_mm2,
            time_s: report.seconds[1],
        })
    }

    /// Adds gap-fill moves at this share of the price; whether there are any.
    fn fill(&self, passes: &mut [LayerPass], price_share: f64) -> bool {
        // A move out and back is as tight a curve as there is.
        if self.settings.wide_beads.width_by_radius_max().is_some() {
            return false;
        }
        let count = |passes: &[LayerPass]| -> usize {
            passes.iter().map(|pass| pass.placements.len()).sum()
        };
        let before = count(passes);
        let price = AreaPrice::of(self.settings).times(price_share);
        let walls = self.filled_to.as_ref().unwrap_or(self.ground.walls);
        fill_gaps(passes, &self.settings.aperture, walls, &price);
        count(passes) != before
    }
}

/// The price of area. Beads with a requested overlap may overlap: area covered twice costs nothing
/// then.
fn objective(settings: &Settings) -> Objective {
    let overlaps = settings.overlap_pct > 0.0;
    Objective {
        price_s_mm2: price_s_mm2(settings),
        twice_share: if overlaps { 0.0 } else { TWICE_SHARE },
        return_mm: return_mm(&settings.aperture),
    }
}

/// Iterations in which a corner is rounded to a radius of some widths: a step moves a point by a quarter of a at most.
const ROUNDING: usize = 80;

/// What the objective may be, for the area, against the layer that was planned without another's passes.
const WORSE_MAX: f64 = 1.02;

/// Iterations that a quality pays for, once more where gap-fill moves were added, and from passes that were optimised: those
/// that get no gap-fill moves, and those of the layer next to it. A round nozzle has no heading to find, and most straight
/// lines of an infill fit: what it gains there is a few tenths of a per cent of cover, and no time.
fn iterations(settings: &Settings) -> [usize; 3] {
    let is_bounded = settings.wide_beads.width_by_radius_max().is_some();
    let is_plain = settings.aperture.is_round() && settings.infill.is_some() && !is_bounded;
    match settings.quality {
        Quality::Fast if is_plain => [0; 3],
        Quality::Standard if is_plain => [8, 8, 4],
        Quality::Fast => [10, 10, 4],
        Quality::Standard => [16, 30, 6],
        Quality::Fine => [24, 36, 12],
    }
}
