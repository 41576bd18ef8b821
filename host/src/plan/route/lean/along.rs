//! Tilts that change along a pass: the smallest of a set of tilts at each point, then smoothed.
//!
//! In: the points of a pass, its axes, the largest tilt. Out: an axis for each waypoint. With the lean as the tilt
//! away from the given axis, the sum of |lean|² ds + L² |change of lean|² / ds over points of the pass a few
//! millimetres apart is minimised (R. Bellman, Dynamic Programming, 1957): leans are small and change over a length
//! of L or more. Free axes are looked up with the margin at every point between; smoothing then moves each lean
//! towards the mean of its neighbours and towards 0, where that stays free.

use super::laid::{Laid, PassPlaces};
use super::{Blocked, cone_rad, leaning};
use crate::input::waypoints::Waypoint;
use headway_reach::Vector3;
use nalgebra::Vector2;
use rayon::prelude::*;

/// Distance of leans in the grid, rad.
const NET_RAD: f64 = 4.0 * std::f64::consts::PI / 180.0;
/// Length of path over which a lean changes, relative to the distance of the knots.
const CHANGE_KNOTS: f64 = 6.0;
/// Knots of a pass, and the least distance of two, mm.
const KNOTS_MAX: usize = 1000;
const KNOT_MM: f64 = 2.0;
/// Sweeps of smoothing, and the share of the distance of each at first.
const SWEEPS: usize = 40;
const PULL: f64 = 0.05;

type Lean = Vector2<f64>;

/// A waypoint at which a lean is chosen.
struct Knot {
    waypoint: usize,
    /// Path from the beginning of the pass, mm.
    at_mm: f64,
    cone_rad: f64,
    /// Places that are nearer to it than to the next knots.
    places: std::ops::Range<usize>,
}

/// Axes of a pass at its waypoints, free at all of its points.
pub fn axes_along(
    laid: &Laid,
    pass: &PassPlaces,
    points: &[Waypoint],
    tilt_max_rad: f64,
) -> Result<Vec<Vector3>, Blocked> {
    let knots = knots(pass, points, tilt_max_rad);
    let mut leans = least_leans(laid, pass, points, &knots, tilt_max_rad)?;
    smooth(laid, pass, points, &knots, &mut leans);
    let axes = waypoint_axes(points, &knots, &leans);
    match laid.first_touch(pass, &axes, false) {
        None => Ok(axes),
        Some((place, by)) => Err(Blocked {
            waypoint: pass.places[place].after,
            tip_mm: pass.places[place].place.tip_mm,
            by,
        }),
    }
}

fn knots(pass: &PassPlaces, points: &[Waypoint], tilt_max_rad: f64) -> Vec<Knot> {
    let mut ways_mm = vec![0.0];
    for pair in points.windows(2) {
        let before = ways_mm[ways_mm.len() - 1];
        ways_mm.push(before + (pair[1].tip_mm - pair[0].tip_mm).norm());
    }
    let all_mm = ways_mm[ways_mm.len() - 1];
    let apart_mm = KNOT_MM.max(all_mm / KNOTS_MAX as f64);
    let mut chosen = vec![0];
    for waypoint in 1..points.len() {
        let is_last = waypoint + 1 == points.len();
        let before = chosen[chosen.len() - 1];
        if is_last || ways_mm[waypoint] - ways_mm[before] >= apart_mm {
            chosen.push(waypoint);
        }
    }
    let place_mm = |index: usize| {
        let place = &pass.places[index];
        let [from, to] = [place.after, place.after + 1].map(|k| ways_mm[k.min(points.len() - 1)]);
        from + place.share * (to - from)
    };
    let mut next = 0;
    let knot = |(number, &waypoint): (usize, &usize)| {
        let from = next;
        let after = chosen
            .get(number + 1)
            .map_or(f64::INFINITY, |after| ways_mm[*after]);
        let until_mm = 0.5 * (ways_mm[waypoint] + after);
        while next < pass.places.len() && place_mm(next) <= until_mm {
            next += 1;
        }
        let before = chosen
            .get(number.wrapping_sub(1))
            .copied()
            .unwrap_or(waypoint);
        let around = points[before..=waypoint].iter();
        let cones = around.map(|point| cone_rad(point, tilt_max_rad));
        Knot {
            waypoint,
            at_mm: ways_mm[waypoint],
            cone_rad: cones.fold(tilt_max_rad, f64::min),
            places: from..next,
        }
    };
    chosen.iter().enumerate().map(knot).collect()
}

/// Leans on a hexagonal net, the upright one first.
fn net(tilt_max_rad: f64) -> Vec<Lean> {
    let rows = (tilt_max_rad / NET_RAD).ceil() as i32 + 1;
    let height = 0.75f64.sqrt();
    let mut leans = Vec::new();
    for row in -rows..=rows {
        for column in -2 * rows..=2 * rows {
            let (x, y) = (
                f64::from(column) + 0.5 * f64::from(row),
                height * f64::from(row),
            );
            let lean = NET_RAD * Lean::new(x, y);
            if lean.norm() <= tilt_max_rad {
                leans.push(lean);
            }
        }
    }
    leans.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    leans
}

/// Dynamic programming over the knots and the net.
fn least_leans(
    laid: &Laid,
    pass: &PassPlaces,
    points: &[Waypoint],
    knots: &[Knot],
    tilt_max_rad: f64,
) -> Result<Vec<Lean>, Blocked> {
    let net = net(tilt_max_rad);
    let free = |knot: &Knot| -> Vec<usize> {
        let is_free = |lean: &Lean| {
            lean.norm() <= knot.cone_rad + 1e-12
                && pass.places[knot.places.clone()].iter().all(|place| {
                    let axis = leaning(&given_axis(points, place.after, place.share), *lean);
                    laid.touch(&place.place, axis, true).is_none()
                })
        };
        (0..net.len()).filter(|node| is_free(&net[*node])).collect()
    };
    let free: Vec<Vec<usize>> = knots.par_iter().map(free).collect();
    if let Some(blocked) = free.iter().position(Vec::is_empty) {
        return Err(blocked_at(laid, pass, points, &knots[blocked]));
    }
    let change_mm = CHANGE_KNOTS * knot_distance_mm(knots);
    let mut costs: Vec<f64> = free[0]
        .iter()
        .map(|node| net[*node].norm_squared())
        .collect();
    let mut from: Vec<Vec<usize>> = vec![Vec::new()];
    for k in 1..knots.len() {
        let step_mm = (knots[k].at_mm - knots[k - 1].at_mm).max(1e-3);
        let weight = change_mm * change_mm / step_mm;
        let best = |node: &usize| {
            let lean = net[*node];
            let of = |(index, before): (usize, &usize)| {
                (
                    costs[index] + weight * (lean - net[*before]).norm_squared(),
                    index,
                )
            };
            let all = free[k - 1].iter().enumerate().map(of);
            let least = all.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let (cost, index) = least.unwrap_or((f64::INFINITY, 0));
            (cost + step_mm * lean.norm_squared(), index)
        };
        let found: Vec<(f64, usize)> = free[k].par_iter().map(best).collect();
        costs = found.iter().map(|(cost, _)| *cost).collect();
        from.push(found.into_iter().map(|(_, index)| index).collect());
    }
    let least = costs.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
    let mut at = least.map_or(0, |(index, _)| index);
    let mut leans = vec![Lean::zeros(); knots.len()];
    for k in (0..knots.len()).rev() {
        leans[k] = net[free[k][at]];
        if k > 0 {
            at = from[k][at];
        }
    }
    Ok(leans)
}

fn knot_distance_mm(knots: &[Knot]) -> f64 {
    let all_mm = knots.last().map_or(0.0, |last| last.at_mm);
    (all_mm / (knots.len().max(2) - 1) as f64).max(1e-3)
}

/// The obstacle at a knot where nothing of the grid is free: what the given axis meets.
fn blocked_at(laid: &Laid, pass: &PassPlaces, points: &[Waypoint], knot: &Knot) -> Blocked {
    let places = &pass.places[knot.places.clone()];
    let met = places.iter().find_map(|place| {
        let axis = given_axis(points, place.after, place.share);
        let by = laid.touch(&place.place, axis, true)?;
        Some((place, by))
    });
    let first = &pass.places[knot.places.start.min(pass.places.len() - 1)];
    let (place, by) = met.unwrap_or((first, None));
    Blocked {
        waypoint: place.after,
        tip_mm: place.place.tip_mm,
        by,
    }
}

fn given_axis(points: &[Waypoint], after: usize, share: f64) -> Vector3 {
    let to = points.get(after + 1).unwrap_or(&points[after]);
    let axis = points[after].axis.lerp(&to.axis, share);
    axis.normalize()
}

/// Moves each lean towards the mean of its neighbours, and a little towards 0, as far as places stay free.
fn smooth(laid: &Laid, pass: &PassPlaces, points: &[Waypoint], knots: &[Knot], leans: &mut [Lean]) {
    for _ in 0..SWEEPS {
        for k in 0..leans.len() {
            let before = leans[k.saturating_sub(1)];
            let after = leans[(k + 1).min(leans.len() - 1)];
            let mean = (1.0 - PULL) * 0.5 * (before + after);
            let own = leans[k];
            for share in [1.0, 0.5, 0.25] {
                leans[k] = own + share * (mean - own);
                if leans[k].norm() <= knots[k].cone_rad
                    && is_free_about(laid, pass, points, knots, leans, k)
                {
                    break;
                }
                leans[k] = own;
            }
        }
    }
}

/// True where all places from the knot before to the knot after are free.
fn is_free_about(
    laid: &Laid,
    pass: &PassPlaces,
    points: &[Waypoint],
    knots: &[Knot],
    leans: &[Lean],
    k: usize,
) -> bool {
    let from = knots[k.saturating_sub(1)].places.start;
    let to = knots[(k + 1).min(knots.len() - 1)].places.end;
    pass.places[from..to].iter().all(|place| {
        let lean = lean_at(points, knots, leans, place.after, place.share);
        let axis = leaning(&given_axis(points, place.after, place.share), lean);
        laid.touch(&place.place, axis, true).is_none()
    })
}

/// The lean between two waypoints.
fn lean_at(points: &[Waypoint], knots: &[Knot], leans: &[Lean], after: usize, share: f64) -> Lean {
    let [from, to] = [after, (after + 1).min(points.len() - 1)]
        .map(|waypoint| lean_of_waypoint(knots, leans, points, waypoint));
    from.lerp(&to, share)
}

/// The lean of a waypoint, even over the path between two knots.
fn lean_of_waypoint(knots: &[Knot], leans: &[Lean], points: &[Waypoint], waypoint: usize) -> Lean {
    let after = knots.partition_point(|knot| knot.waypoint < waypoint);
    if after == 0 || after == knots.len() {
        return leans[after.min(knots.len() - 1)];
    }
    let [from, to] = [&knots[after - 1], &knots[after]];
    let along = points[from.waypoint..=waypoint].windows(2);
    let at_mm: f64 = along
        .map(|pair| (pair[1].tip_mm - pair[0].tip_mm).norm())
        .sum();
    let share = (at_mm / (to.at_mm - from.at_mm).max(1e-9)).clamp(0.0, 1.0);
    leans[after - 1].lerp(&leans[after], share)
}

fn waypoint_axes(points: &[Waypoint], knots: &[Knot], leans: &[Lean]) -> Vec<Vector3> {
    let axes = points.iter().enumerate().map(|(waypoint, point)| {
        let lean = lean_of_waypoint(knots, leans, points, waypoint);
        leaning(&point.axis.into_inner(), lean)
    });
    axes.collect()
}
