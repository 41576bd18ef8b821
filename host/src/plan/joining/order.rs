//! Order, starting point and direction in which the passes of a layer are printed.
//!
//! Greedy nearest neighbour over both ends of open passes and all points of closed ones, then 2-opt
//! on the order with bounded rounds. The cost is travel, plus an interruption of flow where a
//! distance is too long for a link, except before the first pass, which comes after travel anyway.
//!
//! In: passes (mm, rad), the head's position (mm). Out: the passes in order, each in its direction,
//! opened at its seam. Source: G. Croes (1958) for 2-opt. Not covered: the optimum, and 2-opt above
//! 60 passes.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::Box2;
use crate::geometry::{Point2, Vector2};
use crate::plan::joining::links::LENGTH_SHARE;
use crate::plan::pass::LayerPass;

/// Places tried as the start of a closed pass.
const STARTS_MAX: usize = 512;
/// Passes above this number are ordered greedily only: 2-opt is quadratic.
const TWO_OPT_MAX: usize = 60;
/// Rounds of 2-opt.
const TWO_OPT_ROUNDS: usize = 8;

/// Orders, turns and rotates the passes, and opens the closed ones at their seams; `from` is where
/// the head is. Same passes out as in.
pub fn ordered(passes: Vec<LayerPass>, from: Point2, aperture: &Aperture) -> Vec<LayerPass> {
    let period_rad = aperture.period_rad();
    let entry_points: Vec<EntryPoints> = passes
        .iter()
        .map(|pass| EntryPoints::of(pass, period_rad))
        .collect();
    let lengths = Lengths {
        link_mm: LENGTH_SHARE * aperture.major_mm(),
        interruption_mm: interruption_mm(aperture),
    };
    let order = two_opt(&entry_points, greedy(&entry_points, from), from, lengths);
    let mut position = from;
    let mut slots: Vec<Option<LayerPass>> = passes.into_iter().map(Some).collect();
    let mut result = Vec::with_capacity(order.len());
    for number in order {
        let Some(pass) = slots[number].take() else {
            continue;
        };
        let start = entry_points[number]
            .nearest(position)
            .1
            .map_or(0, |d| d.start);
        let placed = opened(started_at(pass, start, period_rad), aperture);
        if let Some(last) = placed.placements.last() {
            position = last.at.center;
        }
        result.push(placed);
    }
    result
}

/// Nearest pass first.
fn greedy(entry_points: &[EntryPoints], from: Point2) -> Vec<usize> {
    let mut left: Vec<usize> = (0..entry_points.len()).collect();
    let mut order = Vec::with_capacity(entry_points.len());
    let mut position = from;
    while !left.is_empty() {
        let (mut slot, mut best) = (0, f64::INFINITY);
        for (i, &number) in left.iter().enumerate() {
            if entry_points[number].is_beyond(position, best) {
                continue;
            }
            let (found, _) = entry_points[number].nearest(position);
            if found < best {
                (slot, best) = (i, found);
            }
        }
        let number = left.remove(slot);
        (position, _) = entry_points[number].passed(position);
        order.push(number);
    }
    order
}

/// A placement at which a pass may be entered.
struct EntryPoint {
    start: usize,
    place: Point2,
    /// Where the head is after the pass.
    exit: Point2,
}

/// All of a pass, found once: they are queried repeatedly.
struct EntryPoints {
    entry_points: Vec<EntryPoint>,
    /// What holds their places.
    bounds: Box2,
}

impl EntryPoints {
    /// The ends of an open pass, the smooth places of a closed one.
    fn of(pass: &LayerPass, period_rad: f64) -> EntryPoints {
        let count = pass.placements.len();
        let numbers: Vec<usize> = if pass.closed {
            let stride = count.div_ceil(STARTS_MAX).max(1);
            let all = || (0..count).step_by(stride);
            let smooth: Vec<usize> = all().filter(|&i| is_smooth(pass, i, period_rad)).collect();
            if smooth.is_empty() {
                all().collect()
            } else {
                smooth
            }
        } else {
            vec![0, count - 1]
        };
        let place = |i: usize| pass.placements[i].at.center;
        let entry = |start: usize| EntryPoint {
            start,
            place: place(start),
            exit: place(if pass.closed {
                start
            } else {
                count - 1 - start
            }),
        };
        let entry_points: Vec<EntryPoint> = numbers.into_iter().map(entry).collect();
        let places: Vec<Point2> = entry_points.iter().map(|entry| entry.place).collect();
        EntryPoints {
            bounds: Box2::of(&places),
            entry_points,
        }
    }

    /// True where every entry is farther away than this, mm.
    fn is_beyond(&self, from: Point2, reach_mm: f64) -> bool {
        !self.bounds.grown(reach_mm).contains(from)
    }

    /// The nearest entry, and how far away it is.
    fn nearest(&self, from: Point2) -> (f64, Option<&EntryPoint>) {
        let (mut best, mut least2) = ((f64::INFINITY, None), f64::INFINITY);
        for entry in &self.entry_points {
            let distance2 = (entry.place - from).norm_squared();
            // The root only where it can be the least.
            if distance2 < least2 && distance2.sqrt() < best.0 {
                (best, least2) = ((distance2.sqrt(), Some(entry)), distance2);
            }
        }
        best
    }

    /// Where the head is after the pass, entered from `from`, and how far it goes there.
    fn passed(&self, from: Point2) -> (Point2, f64) {
        let (distance, entry) = self.nearest(from);
        (entry.map_or(from, |entry| entry.exit), distance)
    }
}

/// True where wall and heading hardly turn around placement `i`: a seam closes well there, and
/// badly in a corner.
fn is_smooth(pass: &LayerPass, i: usize, period_rad: f64) -> bool {
    let count = pass.placements.len();
    let own = &pass.placements[i];
    [SMOOTH_WINDOW / 2, SMOOTH_WINDOW].iter().all(|&n| {
        [(i + n) % count, (i + count - n % count) % count]
            .iter()
            .all(|&j| {
                let other = &pass.placements[j];
                let turn = (other.at.heading_rad - own.at.heading_rad).rem_euclid(period_rad);
                own.contact.normal.dot(&other.contact.normal) > SMOOTH_COS
                    && turn.min(period_rad - turn) < SMOOTH_TURN_RAD
            })
    })
}

/// Placements to each side that must be smooth: about one aperture.
const SMOOTH_WINDOW: usize = 8;
/// Cosine of the largest turn of the wall normal.
const SMOOTH_COS: f64 = 0.985;
/// Largest turn of the heading.
const SMOOTH_TURN_RAD: f64 = 0.3;

/// An order as far as it has been gone through.
#[derive(Clone, Copy)]
struct Progress {
    /// Where the head is.
    at: Point2,
    /// Travel, and what interruptions count as, mm.
    cost_mm: f64,
    /// Passes before.
    passed: usize,
    lengths: Lengths,
}

/// Lengths that depend on the aperture.
#[derive(Clone, Copy)]
struct Lengths {
    /// Longest link, mm.
    link_mm: f64,
    /// What an interruption counts as, mm.
    interruption_mm: f64,
}

impl Progress {
    /// Continues to a pass and along it.
    fn on(self, entry_points: &EntryPoints) -> Progress {
        let (at, way_mm) = entry_points.passed(self.at);
        let interrupts = self.passed > 0 && way_mm > self.lengths.link_mm;
        let interruption_mm = if interrupts {
            self.lengths.interruption_mm
        } else {
            0.0
        };
        Progress {
            at,
            cost_mm: self.cost_mm + way_mm + interruption_mm,
            passed: self.passed + 1,
            ..self
        }
    }

    /// What an order costs from here on, mm; no further than to `most_mm`.
    fn cost_mm(self, entry_points: &[EntryPoints], order: &[usize], most_mm: f64) -> f64 {
        let mut progress = self;
        for &number in order {
            progress = progress.on(&entry_points[number]);
            if progress.cost_mm >= most_mm {
                break;
            }
        }
        progress.cost_mm
    }
}

/// What an interruption of flow counts as, mm of path.
pub fn interruption_mm(aperture: &Aperture) -> f64 {
    INTERRUPTION * aperture.unit_mm()
}

/// What an interruption of flow counts as, of the aperture's unit: retraction, priming and their time.
const INTERRUPTION: f64 = 50.0;

/// Reverses stretches of the order while that makes it cheaper.
fn two_opt(
    entry_points: &[EntryPoints],
    order: Vec<usize>,
    from: Point2,
    lengths: Lengths,
) -> Vec<usize> {
    let count = order.len();
    if !(2..=TWO_OPT_MAX).contains(&count) {
        return order;
    }
    let mut order = order;
    let start = Progress {
        at: from,
        cost_mm: 0.0,
        passed: 0,
        lengths,
    };
    let mut best = start.cost_mm(entry_points, &order, f64::INFINITY);
    for _ in 0..TWO_OPT_ROUNDS {
        let before = best;
        // Up to pass i.
        let mut so_far = start;
        for i in 0..count - 1 {
            for j in i + 1..count {
                order[i..=j].reverse();
                let found = so_far.cost_mm(entry_points, &order[i..], best);
                if found + 1e-9 < best {
                    best = found;
                } else {
                    order[i..=j].reverse();
                }
            }
            so_far = so_far.on(&entry_points[order[i]]);
        }
        if best >= before {
            break;
        }
    }
    order
}

/// The pass turned or rotated so that it starts at placement `start`, one of its entry points.
fn started_at(pass: LayerPass, start: usize, period_rad: f64) -> LayerPass {
    if pass.closed {
        return rotated(pass, start, period_rad);
    }
    let mut pass = pass;
    if start > 0 {
        pass.placements.reverse();
    }
    pass
}

/// A closed pass that starts at placement `start`.
pub fn rotated(mut pass: LayerPass, start: usize, period_rad: f64) -> LayerPass {
    // Headings stay unwrapped over the seam: what moves to the end is turned by the whole lap.
    let count = pass.placements.len();
    let lap = lap_rad(&pass, period_rad);
    pass.placements.rotate_left(start);
    for placement in &mut pass.placements[count - start..] {
        placement.at.heading_rad += lap;
    }
    pass
}

/// The turn of a closed pass over one lap: the multiple of the period that makes its ends meet.
fn lap_rad(pass: &LayerPass, period_rad: f64) -> f64 {
    let first = pass.placements[0].at.heading_rad;
    let last = pass.placements[pass.placements.len() - 1].at.heading_rad;
    ((last - first) / period_rad).round() * period_rad
}

/// How far before its start a closed run ends, against the aperture's extent along the travel:
/// what the two ends then overlap about equals what they leave open.
const SEAM_SHARE: f64 = 1.4;
/// Least placements that the cut at the seam leaves.
const OPENED_MIN: usize = 6;

/// A closed pass as an open one that ends a little short of its start.
pub fn opened(mut pass: LayerPass, aperture: &Aperture) -> LayerPass {
    let was_closed = std::mem::replace(&mut pass.closed, false);
    if !was_closed || pass.placements.len() < OPENED_MIN {
        return pass;
    }
    let lap = lap_rad(&pass, aperture.period_rad());
    let placements = &mut pass.placements;
    let first = placements[0];
    let mut end = first;
    end.at.heading_rad += lap;
    // By one: a long pass is not to have room for twice its length.
    placements.reserve_exact(1);
    placements.push(end);
    let along = (placements[2].at.center - first.at.center)
        .try_normalize(1e-12)
        .unwrap_or(Vector2::x());
    let mut left = SEAM_SHARE * aperture.extent_mm(first.at.heading_rad, along);
    while placements.len() > OPENED_MIN {
        let n = placements.len();
        let (last, before) = (placements[n - 1].at, placements[n - 2].at);
        let step = (last.center - before.center).norm();
        if step > left {
            let t = left / step;
            placements[n - 1].at = Configuration {
                center: last.center + (before.center - last.center) * t,
                heading_rad: last.heading_rad + (before.heading_rad - last.heading_rad) * t,
            };
            break;
        }
        left -= step;
        placements.pop();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::ELLIPSE as APERTURE;
    use crate::plan::pass::test_passes::arc;
    use std::f64::consts::TAU;

    /// Goal: the order leaves few ways too long for a link, even where the nearest pass first would.
    /// Method: a ring of 8 mm, a small one 1 mm inside it at its far side; the head comes from beside
    /// the large one. Nearest first begins and ends there, 14 mm from the small one.
    #[test]
    fn a_pass_begins_where_it_can_be_linked() {
        let large = arc(Point2::origin(), 8.0, 0.0, TAU);
        let small = arc(Point2::new(6.7, 0.0), 0.3, 0.0, TAU);
        let found = ordered(vec![large, small], Point2::new(-10.0, 0.0), &APERTURE);
        let end = found[0].placements[found[0].placements.len() - 1].at.center;
        let way_mm = (found[1].placements[0].at.center - end).norm();
        assert!(way_mm < LENGTH_SHARE * APERTURE.major_mm(), "{way_mm}");
        assert!(found[0].length_mm() < 2.0, "the small one first");
    }
}
