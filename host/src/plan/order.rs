//! In which order, from where and in which direction the passes of a layer are printed.
//!
//! Greedy nearest neighbour over both ends of open passes and all places of closed ones, then
//! 2-opt on the order with bounded rounds. Only travel counts here: every pass costs one flow
//! interruption whatever the order.

use super::passes::LayerPass;
use crate::geometry::Point2;

/// Places tried as the start of a closed pass.
const STARTS_MAX: usize = 512;
/// Passes above this number are ordered greedily only: 2-opt is quadratic.
const TWO_OPT_MAX: usize = 60;
/// Rounds of 2-opt.
const TWO_OPT_ROUNDS: usize = 8;

/// Orders, turns and rotates the passes; `from` is where the head is. Same passes out as in.
pub fn ordered(passes: Vec<LayerPass>, from: Point2) -> Vec<LayerPass> {
    let order = two_opt(&passes, greedy(&passes, from), from);
    let mut position = from;
    let mut slots: Vec<Option<LayerPass>> = passes.into_iter().map(Some).collect();
    let mut result = Vec::with_capacity(order.len());
    for number in order {
        let Some(pass) = slots[number].take() else {
            continue;
        };
        let placed = started_near(pass, position);
        if let Some(last) = placed.placements.last() {
            position = last.at.center;
        }
        result.push(placed);
    }
    result
}

/// Nearest pass first.
fn greedy(passes: &[LayerPass], from: Point2) -> Vec<usize> {
    let mut left: Vec<usize> = (0..passes.len()).collect();
    let mut order = Vec::with_capacity(passes.len());
    let mut position = from;
    while !left.is_empty() {
        let (mut slot, mut best) = (0, f64::INFINITY);
        for (i, &number) in left.iter().enumerate() {
            let (found, _) = entry(&passes[number], position);
            if found < best {
                (slot, best) = (i, found);
            }
        }
        let number = left.remove(slot);
        position = exit_after(&passes[number], position);
        order.push(number);
    }
    order
}

/// Distance to the nearest start of a pass, and which placement that is.
fn entry(pass: &LayerPass, from: Point2) -> (f64, usize) {
    let count = pass.placements.len();
    let candidates: Vec<usize> = if pass.closed {
        let stride = count.div_ceil(STARTS_MAX).max(1);
        let all = || (0..count).step_by(stride);
        let calm: Vec<usize> = all().filter(|&i| is_calm(pass, i)).collect();
        if calm.is_empty() {
            all().collect()
        } else {
            calm
        }
    } else {
        vec![0, count - 1]
    };
    candidates.into_iter().fold((f64::INFINITY, 0), |best, i| {
        let distance = (pass.placements[i].at.center - from).norm();
        if distance < best.0 {
            (distance, i)
        } else {
            best
        }
    })
}

/// True where wall and heading hardly turn around placement `i`: a seam closes well there, and
/// badly in a corner.
fn is_calm(pass: &LayerPass, i: usize) -> bool {
    let count = pass.placements.len();
    let own = &pass.placements[i];
    [CALM_WINDOW / 2, CALM_WINDOW].iter().all(|&n| {
        [(i + n) % count, (i + count - n % count) % count]
            .iter()
            .all(|&j| {
                let other = &pass.placements[j];
                let turn =
                    (other.at.heading_rad - own.at.heading_rad).rem_euclid(std::f64::consts::PI);
                own.contact.normal.dot(&other.contact.normal) > CALM_COS
                    && turn.min(std::f64::consts::PI - turn) < CALM_TURN_RAD
            })
    })
}

/// Placements to each side that must be calm: about one aperture.
const CALM_WINDOW: usize = 8;
/// Cosine of the largest turn of the wall normal.
const CALM_COS: f64 = 0.985;
/// Largest turn of the heading.
const CALM_TURN_RAD: f64 = 0.3;

/// Where the head is after the pass, entered from `from`.
fn exit_after(pass: &LayerPass, from: Point2) -> Point2 {
    let (_, start) = entry(pass, from);
    let last = pass.placements.len() - 1;
    let end = if pass.closed { start } else { last - start };
    pass.placements[end].at.center
}

/// Travel of an order, mm.
fn travel_mm(passes: &[LayerPass], order: &[usize], from: Point2) -> f64 {
    let mut position = from;
    let mut total = 0.0;
    for &number in order {
        total += entry(&passes[number], position).0;
        position = exit_after(&passes[number], position);
    }
    total
}

/// Reverses stretches of the order while that shortens the travel.
fn two_opt(passes: &[LayerPass], order: Vec<usize>, from: Point2) -> Vec<usize> {
    let count = order.len();
    if !(3..=TWO_OPT_MAX).contains(&count) {
        return order;
    }
    let mut order = order;
    let mut best = travel_mm(passes, &order, from);
    for _ in 0..TWO_OPT_ROUNDS {
        let before = best;
        for i in 0..count - 1 {
            for j in i + 1..count {
                order[i..=j].reverse();
                let found = travel_mm(passes, &order, from);
                if found + 1e-9 < best {
                    best = found;
                } else {
                    order[i..=j].reverse();
                }
            }
        }
        if best >= before {
            break;
        }
    }
    order
}

/// The pass turned or rotated so that it starts nearest to `from`.
fn started_near(pass: LayerPass, from: Point2) -> LayerPass {
    let (_, start) = entry(&pass, from);
    let mut pass = pass;
    if !pass.closed {
        if start > 0 {
            pass.placements.reverse();
        }
        return pass;
    }
    // Headings stay unwrapped over the seam: what moves to the end is turned by the whole lap.
    let count = pass.placements.len();
    let first = pass.placements[0].at.heading_rad;
    let last = pass.placements[count - 1].at.heading_rad;
    let lap = ((last - first) / std::f64::consts::PI).round() * std::f64::consts::PI;
    pass.placements.rotate_left(start);
    for placement in &mut pass.placements[count - start..] {
        placement.at.heading_rad += lap;
    }
    pass
}

/// Regions by nearest centre, starting from `from`.
pub fn region_order(centers: &[Point2], from: Point2) -> Vec<usize> {
    let mut left: Vec<usize> = (0..centers.len()).collect();
    let mut position = from;
    let mut order = Vec::with_capacity(centers.len());
    while !left.is_empty() {
        let distance = |slot: &usize| (centers[left[*slot]] - position).norm_squared();
        let slot = (0..left.len()).fold(0, |b, s| if distance(&s) < distance(&b) { s } else { b });
        let number = left.remove(slot);
        position = centers[number];
        order.push(number);
    }
    order
}
