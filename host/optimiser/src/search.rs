//! The search for the least objective of one region.
//!
//! In: passes (mm, rad, log s) and their site. Out: the passes as the iterations left them, inside the walls. Beads that fit
//! are left out from the beginning, and what no longer moves after a few iterations from then on.

use super::containment::{Containment, segments_of};
use super::curve::{Knot, PACE, PassKnots, Units, knots_of, write_back};
use super::curves::Curves;
use super::fitting::paces;
use super::ground::Ground;
use super::motion::Motion;
use super::moving::{Moving, moving, part_of, with_those_beside};
use super::newton::{Newton, Objectives};
use super::projection::{POSES_CHECKED, outside_mm, projected, staying};
use super::sweep::{Cells, Shape, Sweep, edge_half};
use super::terms::Terms;
use super::tool_scale::ToolScale;
use super::{Effort, Objective, OptimisedPass, Outcome, Site};
use headway_geometry::edge_index::Edge;
use headway_geometry::polygon::Region;

/// Required share of a bound of curves: what exceeds it costs, so that a few per cent are exceeded (trials).
const KEPT_SHARE: f64 = 0.93;
/// Points of a span at which walls are checked.
const WALL_PLACES: usize = 8;
/// Iterations with all knots; later ones have those that moved in these. With fewer, knots that move late stay.
const WHOLE_ITERATIONS: usize = 4;

/// The problem of one region while it is solved.
pub struct Search<'a> {
    pub units: Units,
    pub newton: Newton<'a>,
    /// All knots, of which the problem has a part.
    whole: Option<Whole>,
}

/// What beads that fit are sought with.
pub struct Tools<'a> {
    pub site: &'a Site<'a>,
    pub units: &'a Units,
    pub shape: &'a Shape,
    pub motion: &'a Motion,
}

/// The knots of a region, of which a part may move.
pub struct Whole {
    knots: Vec<Knot>,
    passes: Vec<PassKnots>,
    part: Moving,
    /// Time of what stays.
    time: f64,
}

impl Whole {
    /// Leaves the part of the knots and passes that has to move; `None` if that is almost all.
    fn leave_out_what_fits(
        knots: &mut Vec<Knot>,
        passes: &mut Vec<PassKnots>,
        tools: &Tools,
    ) -> Option<Whole> {
        // A bound of curves begins with knots that are to move far.
        if tools.site.width_by_radius_max.is_some() {
            return None;
        }
        let paces = paces(knots, passes, tools);
        let has_to_move: Vec<bool> = paces.iter().map(Option::is_none).collect();
        let moves = with_those_beside(&has_to_move, &[], passes);
        let part = part_of(knots, &moves, passes, f64::from(tools.shape.radius()))?;
        for (knot, pace) in knots.iter_mut().zip(paces) {
            knot[PACE] = pace.unwrap_or(knot[PACE]);
        }
        let own = part.own(knots);
        let all = std::mem::replace(knots, own);
        let all_passes = std::mem::replace(passes, part.passes.clone());
        let moving = tools.motion.time(knots, passes, &part.stays);
        Some(Whole {
            time: tools.motion.time(&all, &all_passes, &[]) - moving,
            knots: all,
            passes: all_passes,
            part,
        })
    }
}

impl<'a> Search<'a> {
    /// Brings a region into the optimiser's units, without the beads that fit.
    pub fn begin(
        passes: &[OptimisedPass],
        site: &Site<'a>,
        objective: &Objective,
    ) -> Result<Search<'a>, Outcome> {
        Search::of(passes, site, objective, Whole::leave_out_what_fits)
    }

    /// The same; `leave_out` takes what need not move from the knots and passes.
    pub fn of(
        passes: &[OptimisedPass],
        site: &Site<'a>,
        objective: &Objective,
        leave_out: impl FnOnce(&mut Vec<Knot>, &mut Vec<PassKnots>, &Tools) -> Option<Whole>,
    ) -> Result<Search<'a>, Outcome> {
        let (walls, aperture) = (site.walls, site.aperture);
        let edge_half = edge_half(aperture.minor_mm() / aperture.major_mm());
        let shape = Shape::of(aperture, edge_half as f32).ok_or(Outcome::UnknownAperture)?;
        if walls.edges().is_empty() {
            return Err(Outcome::Nothing);
        }
        let bounds = walls.bounds();
        let middle = bounds.min + bounds.size() / 2.0;
        let units = Units::of(passes, aperture.major_mm(), middle).ok_or(Outcome::Nothing)?;
        let (mut knots, mut ranges) = knots_of(passes, &units);
        let curves = site.width_by_radius_max;
        let curves = curves.map(|bound| Curves::new(aperture, units.length_mm, KEPT_SHARE * bound));
        if let Some(curves) = &curves {
            curves.round(&mut knots, &ranges);
        }
        if !ranges.iter().any(|range| range.free) {
            return Err(Outcome::Nothing);
        }
        let bounding = segments_of(walls.edges().iter().map(Edge::ends), &units);
        let left_out = segments_of(site.left_out.iter().flat_map(Region::edges), &units);
        let mut cells = Cells::of(&bounding, &left_out, edge_half).ok_or(Outcome::TooLarge)?;
        let motion = Motion::new(site.limits, &units);
        let tools = Tools {
            site,
            units: &units,
            shape: &shape,
            motion: &motion,
        };
        let whole = leave_out(&mut knots, &mut ranges, &tools);
        let mut stays = vec![false; knots.len()];
        if let Some(Whole { part, .. }) = &whole {
            stays.clone_from(&part.stays);
            let moving = part.moving(&knots).map(|[x, y, ..]| [*x, *y]);
            cells.keep_near(moving, part.reach);
        }
        let price = objective.price_s_mm2 * units.length_mm.powi(2) / units.time_s;
        let return_path = (objective.return_mm / units.length_mm) as f32;
        let sweep = Sweep::new(shape, cells, return_path, ToolScale::new(site.scale, units));
        let objectives = Objectives {
            motion,
            curves,
            ground: Ground::new(sweep, price, objective.twice_share),
            containment: Containment::new(site, units, knots.len(), WALL_PLACES),
        };
        let newton = Newton::new(objectives, knots, ranges, stays);
        if !newton.terms.sum().is_finite() {
            return Err(Outcome::NotFinite);
        }
        Ok(Search {
            units,
            newton,
            whole,
        })
    }

    /// Seconds and areas by the optimiser's count; beads that fit leave nothing open.
    pub fn terms(&self) -> Terms {
        self.newton
            .terms
            .later(self.whole.as_ref().map_or(0.0, |whole| whole.time))
    }

    /// Makes the iterations.
    pub fn run(self, effort: &Effort) -> Searched {
        let searched = iterated(self.units, self.newton, effort);
        let Some(mut whole) = self.whole else {
            return searched;
        };
        whole.part.put_back(&searched.knots, &mut whole.knots);
        Searched {
            knots: whole.knots,
            passes: whole.passes,
            terms: searched.terms.later(whole.time),
            ..searched
        }
    }
}

/// The iterations: the first with all knots of the problem, the others with those that move.
fn iterated(units: Units, mut newton: Newton, effort: &Effort) -> Searched {
    let count = effort.iterations;
    let passes = newton.passes.clone();
    let mut knots = newton.knots.clone();
    let first = count.min(WHOLE_ITERATIONS);
    newton.run(1..=first, effort, |_, _| {});
    let radius = newton.objectives.ground.radius();
    // Rounding moves a knot little in each iteration, and far in all of them.
    let part = (newton.objectives.curves.is_none() && first < count)
        .then(|| moving([&knots, &newton.knots], newton.stays(), &passes, radius));
    knots.clone_from(&newton.knots);
    let mut terms = newton.terms;
    if let Some(part) = part.flatten() {
        newton = newton.narrowed(&part);
        let before = newton.terms;
        newton.run(first + 1..=count, effort, |_, _| {});
        part.put_back(&newton.knots, &mut knots);
        terms.time += newton.terms.time - before.time;
        terms.open += newton.terms.open - before.open;
        terms.twice += newton.terms.twice - before.twice;
    } else {
        newton.run(first + 1..=count, effort, |_, _| {});
        (knots, terms) = (newton.knots, newton.terms);
    }
    Searched {
        units,
        knots,
        passes,
        terms,
    }
}

/// The solution of a region.
pub struct Searched {
    pub units: Units,
    pub knots: Vec<Knot>,
    passes: Vec<PassKnots>,
    /// Seconds and areas by the optimiser's count.
    pub terms: Terms,
}

impl Searched {
    /// Writes the passes back, brought inside the walls; how far each is outside before that and after it, mm.
    pub fn finish(&self, passes: &mut [OptimisedPass], site: &Site) -> Vec<[f64; 2]> {
        let knots = &self.knots;
        let mut outside = vec![[0.0; 2]; passes.len()];
        // Between the poses that are checked, too: where an end turns on the spot a corner bulges from one to the next.
        let places = 2 * POSES_CHECKED;
        let mut containment = Containment::new(site, self.units, knots.len(), places);
        for range in self.passes.iter().filter(|range| range.free) {
            let pass = &mut passes[range.pass];
            let own = &knots[range.first..range.end()];
            write_back(own, &self.units, pass);
            let stays = staying(own, range, &mut containment);
            let before_mm = outside_mm(pass, &stays, site);
            outside[range.pass] = [before_mm; 2];
            if before_mm > 0.0 {
                let inside = projected(own, range, &stays, &mut containment);
                write_back(&inside, &self.units, pass);
                let after_mm = outside_mm(pass, &stays, site);
                if after_mm < before_mm {
                    outside[range.pass][1] = after_mm;
                } else {
                    write_back(own, &self.units, pass);
                }
            }
        }
        outside
    }
}
