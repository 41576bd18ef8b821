//! The optimiser: improves the finished passes of a region together by one objective.
//!
//! ```text
//! OptimisedPass --knots--> seconds + price (open + share of laid twice) --Gauss-Newton--> OptimisedPass
//! (mm, rad, log s)         within limits and walls                                        (mm, rad, log s)
//! ```
//!
//! The earlier stages decide the topology: the beads and how they are joined. Path, heading and speed are then
//! unknowns of one problem: control points of a uniform cubic B-spline of x, y, heading and the log of the span's
//! time. The objective is time, area by strips along the edge of the sweep (`sweep`), limits of motion (`motion`)
//! and walls (`containment`); one banded system is solved in each iteration (`newton`). Numbers are dimensionless,
//! so that one set of constants serves nozzles and machines of any size. Each region uses one thread, so the result
//! does not depend on their number. Not covered: flow. [`least_time`] minimises the time of a finished motion.
#![forbid(unsafe_code)]

mod band;
mod containment;
mod curve;
mod curves;
mod fitting;
mod ground;
pub mod least_time;
mod motion;
mod moving;
mod newton;
mod pose_lanes;
pub mod pose_limits;
mod projection;
mod search;
mod sweep;
mod terms;
mod tool_scale;

pub use self::curves::tight_mm;
use self::search::Search;
use crate::pose_limits::PoseLimits;
use headway_geometry::aperture::Aperture;
use headway_geometry::edge_index::EdgeIndex;
use headway_geometry::place_scale::ScaleField;
use headway_geometry::plane_curve::PlaneControl;
use headway_geometry::polygon::Region;

/// A pass as a uniform cubic B-spline with natural ends: phantom points P_{-1} = 2 P_0 - P_1 make it begin and end
/// on its first and last control point, as [`headway_geometry::plane_curve`] has it.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimisedPass {
    /// x mm, y mm, heading rad.
    pub control: Vec<PlaneControl>,
    /// Log of the span's time in s at each control point: a start value that is improved.
    pub log_pace: Vec<f64>,
}

/// The region of the passes, and the tool.
#[derive(Clone, Copy, Debug)]
pub struct Site<'a> {
    /// The region's boundary, mm, in the passes' frame.
    pub walls: &'a EdgeIndex,
    /// Area inside it that does not belong to these passes: covering it or leaving it open does not count.
    pub left_out: &'a [Region],
    /// The nozzle.
    pub aperture: &'a Aperture,
    /// Of the tip and the joints.
    pub limits: &'a PoseLimits,
    /// Most that a bead's width across the path may be of the path's radius, where that is bounded.
    pub width_by_radius_max: Option<f64>,
    /// Size of the nozzle by position, if the plane is the chart of a curved surface.
    pub scale: Option<&'a ScaleField>,
}

/// The minimised sum: seconds + price x (open + share x laid twice).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Objective {
    /// Price of area left open, s/mm².
    pub price_s_mm2: f64,
    /// Share of that price for area laid twice.
    pub twice_share: f64,
    /// Path of a pass after which a return to a place counts as laid twice, mm.
    pub return_mm: f64,
}

/// How much work is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Iterations: six tenths of them with soft limits.
    pub iterations: usize,
    /// The passes solve nearly the same problem: limits are hardened from the first iteration on, so that they keep their
    /// shape.
    pub is_warm: bool,
}

impl Effort {
    /// So many iterations from passes that were not optimised before.
    pub const fn cold(iterations: usize) -> Effort {
        Effort {
            iterations,
            is_warm: false,
        }
    }
}

/// Whether the passes were optimised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// They were.
    Optimised,
    /// Nothing to do: no walls, no pass long enough, no iterations.
    Nothing,
    /// An aperture so narrow that it is not done; the passes are as they were.
    UnknownAperture,
    /// The region has too many cells; the passes are as they were.
    TooLarge,
    /// Values that are not finite; the passes are unchanged.
    NotFinite,
}

/// What the optimiser did.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimiseReport {
    /// Whether it did anything.
    pub outcome: Outcome,
    /// Printing time by its own pace, s: before and after.
    pub seconds: [f64; 2],
    /// Ground left open by its own count, mm²: before and after.
    pub open_mm2: [f64; 2],
    /// Area laid twice by the optimiser's own count, mm²: before and after.
    pub twice_mm2: [f64; 2],
    /// Depth of each pass outside the walls, mm: before the last projection and after it. A pass that is too far
    /// outside after it should be replaced by the original.
    pub outside_mm: Vec<[f64; 2]>,
    /// Iterations made.
    pub iterations: usize,
    /// Control points of all passes.
    pub knots: usize,
}

impl OptimiseReport {
    fn unchanged(outcome: Outcome, passes: &[OptimisedPass]) -> OptimiseReport {
        OptimiseReport {
            outcome,
            seconds: [0.0; 2],
            open_mm2: [0.0; 2],
            twice_mm2: [0.0; 2],
            outside_mm: vec![[0.0; 2]; passes.len()],
            iterations: 0,
            knots: passes.iter().map(|pass| pass.control.len()).sum(),
        }
    }
}

/// Improves the passes of one region together. Passes of few control points are unchanged. The result
/// is always a curve of finite numbers: at worst the input.
pub fn optimise(
    passes: &mut [OptimisedPass],
    site: &Site,
    objective: &Objective,
    effort: &Effort,
) -> OptimiseReport {
    if effort.iterations == 0 {
        return OptimiseReport::unchanged(Outcome::Nothing, passes);
    }
    let search = match Search::begin(passes, site, objective) {
        Ok(search) => search,
        Err(outcome) => return OptimiseReport::unchanged(outcome, passes),
    };
    let before = search.terms();
    let searched = search.run(effort);
    let mut report = OptimiseReport::unchanged(Outcome::Optimised, passes);
    report.outside_mm = searched.finish(passes, site);
    let both = [before, searched.terms];
    report.seconds = both.map(|terms| terms.time * searched.units.time_s);
    report.open_mm2 = both.map(|terms| terms.open * searched.units.length_mm.powi(2));
    report.twice_mm2 = both.map(|terms| terms.twice * searched.units.length_mm.powi(2));
    report.iterations = effort.iterations;
    report
}

#[cfg(test)]
mod derivative_tests;
#[cfg(test)]
mod fitting_tests;
#[cfg(test)]
mod moving_tests;
#[cfg(test)]
mod test_passes;
#[cfg(test)]
mod tests;
