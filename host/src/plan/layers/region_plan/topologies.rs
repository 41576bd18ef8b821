//! The choice among topologies of a region: passes that are all possible compete by the objective.
//!
//! In: the passes of each topology before they are optimised, the region's hull (mm). Out: the passes that cost least,
//! optimised. Not covered: where several topologies are worth a try, which whoever makes them decides.

use crate::geometry::polygon::Region;
use crate::plan::beads::passes::PassSettings;
use crate::plan::layers::one_heading::{OneHeading, may_keep_one_heading};
use crate::plan::layers::optimised_passes::{BegunPasses, FinishedPasses, RegionJob};
use crate::plan::pass::LayerPass;
use rayon::prelude::*;
use std::cmp::Ordering;

/// Of the passes that compete after their first optimisation, those that get gap-fill moves: one heading gains more by them.
const FINISHED: usize = 2;

/// Of several passes of a region, and for a head that turns slowly those of one heading throughout, the ones that cost
/// least, optimised; and their number, of one heading that of all. The second of several are to save time: where they
/// take more than the first, they do not count.
pub fn least_costly(
    turning: Vec<Vec<LayerPass>>,
    hull: &Region,
    job: &RegionJob,
    how: &PassSettings,
) -> (usize, FinishedPasses) {
    let settings = job.settings;
    let headings = match may_keep_one_heading(job.ground, settings) {
        true => OneHeading::candidates(hull, settings.aperture),
        false => Vec::new(),
    };
    let mut turning = turning;
    if headings.is_empty() && turning.len() <= 1 {
        return (0, job.optimised(turning.pop().unwrap_or_default()));
    }
    let count = turning.len();
    let kept = headings.into_par_iter();
    let kept = kept.map(|heading| (count, heading.passes(hull, how, settings)));
    let mut all: Vec<(usize, BegunPasses)> = (turning.into_par_iter().enumerate())
        .chain(kept)
        .map(|(number, passes)| (number, job.begun(passes)))
        .collect();
    // A stable order: of equals the first.
    all.sort_by(|(_, p), (_, q)| cheaper(p.cost_s(settings), q.cost_s(settings)));
    all.truncate(FINISHED);
    let finished = all.into_par_iter();
    let finished: Vec<(usize, FinishedPasses)> = finished
        .map(|(number, begun)| (number, job.finished(begun)))
        .collect();
    let first_s = finished.iter().find(|(number, _)| *number == 0);
    let first_s = first_s.map_or(f64::INFINITY, |(_, first)| first.time_s);
    let saves_time =
        |number: usize, time_s: f64| !(1..count).contains(&number) || time_s <= first_s;
    let least = finished.into_iter();
    let least = least.filter(|(number, found)| saves_time(*number, found.time_s));
    let least = least.min_by(|(_, p), (_, q)| cheaper(p.cost_s, q.cost_s));
    least.unwrap_or_default()
}

fn cheaper(one_s: Option<f64>, other_s: Option<f64>) -> Ordering {
    let cost_s = |of: Option<f64>| of.unwrap_or(f64::INFINITY);
    cost_s(one_s).total_cmp(&cost_s(other_s))
}
