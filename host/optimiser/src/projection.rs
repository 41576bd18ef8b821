//! The last projection: moves poses that are still outside the walls inside by the least change of the
//! path.
//!
//! In: the optimised passes. Out: the passes within the walls, checked densely by the exact depth
//! ([`headway_geometry::clearance`]), which is independent of the optimiser. Gauss-Newton steps on containment only.

use super::band::System;
use super::containment::{Containment, Wall};
use super::curve::{At, CHANNELS, Knot, PassKnots, all_stay, set_phantoms};
use super::newton::prepare;
use super::terms::Terms;
use super::{OptimisedPass, Site};
use headway_geometry::Point2;
use headway_geometry::clearance::{
    Configuration, EdgesAbout, contact, outside_bound_mm, outside_depth_mm,
};
use headway_geometry::place_scale::placed;
use headway_geometry::plane_curve::{configuration, curve_at};
use headway_geometry::polygon::Box2;

/// Poses of a span that are checked.
pub const POSES_CHECKED: usize = 16;
/// Clearance that is sought, in a: what the path may lose between two poses at a corner that points inside.
const CLEARANCE: f64 = 1.0 / 2000.0;
/// Half the squares of what poses miss of that.
const WALL: Wall = Wall {
    weight: 1.0,
    margin: CLEARANCE,
};
/// Knots that move on either side of a span with such a pose.
const BESIDE: usize = 6;
/// Most steps; three are the rule.
const ROUNDS: usize = 12;
/// Half the sum of the squared residuals at which it ends: a thousandth of the margin at any pose.
const SETTLED: f64 = 0.5 * (1e-3 * CLEARANCE) * (1e-3 * CLEARANCE);
/// What keeps the path where it is, against one pose's clearance: little, so that a step leaves little.
const STIFFNESS: f64 = 1e-2;
/// What becomes of it after a step that helped, and after one that did not.
const SOFTENING: f64 = 0.3;
const STIFFENING: f64 = 10.0;
/// Most that a step changes a channel, in a or rad.
const STEP_MAX: f64 = 0.05;

/// The knots of one pass that the projection does not move: all but those beside poses too near to a wall, and none of a
/// pass that begins outside.
pub fn staying(own: &[Knot], range: &PassKnots, containment: &mut Containment) -> Vec<bool> {
    let pass = PassKnots { first: 0, ..*range };
    let at = At {
        knots: own,
        passes: std::slice::from_ref(&pass),
        stays: &[],
    };
    containment.measure(&at, &WALL);
    let mut stays = vec![containment.holds(&own[1]); own.len()];
    for span in containment.short_spans() {
        let end = own.len().min(span + 4 + BESIDE);
        stays[span.saturating_sub(BESIDE)..end].fill(false);
    }
    stays
}

/// Depth of a pass outside the walls, mm: the deepest of [`POSES_CHECKED`] poses of each span that does not stay, and
/// its end.
pub fn outside_mm(pass: &OptimisedPass, stays: &[bool], site: &Site) -> f64 {
    let (walls, aperture) = (site.walls, site.aperture);
    let spans = pass.control.len().saturating_sub(1);
    let mut deepest_mm = 0.0f64;
    for span in (0..spans).filter(|&span| !all_stay(stays, span)) {
        let at = |k: usize| {
            let share = k as f64 / POSES_CHECKED as f64;
            configuration(curve_at(&pass.control, span, share))
        };
        let poses: [Configuration; POSES_CHECKED + 1] = std::array::from_fn(at);
        let about = edges_about(&poses, site);
        for &pose in &poses {
            let (aperture, pose) = placed(site.scale, aperture, pose);
            let is_clear =
                walls.contains(pose.center) && contact(&aperture, pose, &about, 1.0).is_none();
            if !is_clear && outside_bound_mm(&aperture, pose, walls) > deepest_mm {
                deepest_mm = deepest_mm.max(outside_depth_mm(&aperture, pose, walls));
            }
        }
    }
    deepest_mm
}

/// The edges that any of these poses may meet.
fn edges_about(poses: &[Configuration], site: &Site) -> EdgesAbout {
    let walls = site.walls;
    let centers: Vec<Point2> = poses.iter().map(|pose| pose.center).collect();
    let reach_mm = poses.iter().map(|&pose| {
        let (aperture, at) = placed(site.scale, site.aperture, pose);
        aperture.reach_mm() + (at.center - pose.center).norm()
    });
    let area = Box2::of(&centers).grown(reach_mm.fold(0.0, f64::max));
    let mut numbers = Vec::new();
    walls.for_edges_in(area, |number| numbers.push(number));
    numbers.sort_unstable();
    numbers.dedup();
    let edges = numbers.into_iter().map(|number| walls.edges()[number]);
    EdgesAbout::new(edges.filter(|edge| edge.may_meet(&area)).collect())
}

/// The knots of one pass, but those that stay, moved inside the walls, as far as possible (Levenberg and Marquardt: a
/// step without improvement is repeated with more damping).
pub fn projected(
    own: &[Knot],
    range: &PassKnots,
    stays: &[bool],
    containment: &mut Containment,
) -> Vec<Knot> {
    let pass = PassKnots { first: 0, ..*range };
    let unknowns = CHANNELS * own.len();
    let (mut system, mut tried) = (System::new(unknowns), System::new(unknowns));
    let (mut knots, mut stepped) = (own.to_vec(), own.to_vec());
    let mut stiffness = STIFFNESS;
    let mut outside = evaluate(&knots, &pass, stays, containment, &mut system);
    for _ in 0..ROUNDS {
        if outside.is_nan() || outside <= SETTLED {
            break;
        }
        tried.band.copy_from(&system.band);
        for unknown in 0..unknowns {
            tried.band.row_mut(unknown)[0] += stiffness;
        }
        tried.gradient.copy_from_slice(&system.gradient);
        if !tried.band.factor() {
            break;
        }
        tried.band.solve(&mut tried.gradient);
        let steps = tried.gradient.chunks_exact(CHANNELS);
        for ((to, from), step) in stepped.iter_mut().zip(knots.iter()).zip(steps) {
            *to = std::array::from_fn(|c| from[c] - step[c].clamp(-STEP_MAX, STEP_MAX));
        }
        set_phantoms(&mut stepped, &pass);
        let after = evaluate(&stepped, &pass, stays, containment, &mut tried);
        if after < outside {
            outside = after;
            std::mem::swap(&mut knots, &mut stepped);
            std::mem::swap(&mut system, &mut tried);
            stiffness *= SOFTENING;
        } else {
            stiffness *= STIFFENING;
        }
    }
    knots
}

/// Half the squares of the distances short of the margin, with their system.
fn evaluate(
    knots: &[Knot],
    pass: &PassKnots,
    stays: &[bool],
    containment: &mut Containment,
    system: &mut System,
) -> f64 {
    let mut terms = Terms::default();
    system.clear();
    let passes = std::slice::from_ref(pass);
    let at = At {
        knots,
        passes,
        stays,
    };
    containment.add(&at, &WALL, &mut terms, system);
    prepare(system, passes, stays);
    terms.outside
}
