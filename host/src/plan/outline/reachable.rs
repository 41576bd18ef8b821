//! Can any placed aperture inside the region cover a point?
//!
//! For a heading phi, in the frame that makes the aperture a unit disk, the question is whether the
//! point is within 1 of a centre whose distance to the boundary is at least 1. Starting at the
//! point, the centre is alternately pushed away from the nearest boundary and pulled back to the
//! point (alternating projections), for headings all round and then more finely around the best
//! ones. Apertures other than ellipses are pushed and pulled in the plane itself, by their
//! distances.
//!
//! Time is bounded by 24 headings and 30 finer ones from five starts, 24 projections each, over the
//! edges within an aperture's length; bounding boxes of edges and [`ClearanceGrid`] avoid most of
//! that.
//!
//! This is a search, not a proof: an answer "yes" comes with its placement, which is inside to
//! [`SLACK`]; a "no" can be wrong by a sliver (by tests against brute force, a few µm next to the
//! true edge of the reachable area).
//!
//! In: aperture, a point, an index of edges (mm). Out: a placement (mm, rad) or `None`.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::Box2;
use crate::geometry::rounded_polygon::Gap;
use crate::geometry::{Point2, Vector2};
use crate::plan::outline::clearance_grid::ClearanceGrid;
use rayon::prelude::*;
use std::f64::consts::PI;

/// A placement counts as inside if it cuts by at most this share of the aperture.
pub const SLACK: f64 = 2e-5;
/// Headings tried all round the half turn.
const HEADINGS: usize = 24;
/// Projections per heading.
const PUSHES: usize = 24;
/// Where the centre starts, in aperture radii from the point: on it, and at either end and side.
const STARTS: [[f64; 2]; 5] = [[0.0, 0.0], [0.9, 0.0], [-0.9, 0.0], [0.0, 0.9], [0.0, -0.9]];
/// After this number of projections a start must have come closer by this share to continue.
const STALL: (usize, f64) = (8, 0.02);
/// Headings refined, and halvings of the step around each.
const REFINED: usize = 3;
const HALVINGS: usize = 5;

/// A placement inside the region that covers `p`, where one is found.
pub fn covering_configuration(
    aperture: &Aperture,
    p: Point2,
    index: &EdgeIndex,
) -> Option<Configuration> {
    search(aperture, p, index, None)
}

/// The same; headings for which the clearance around `p` certainly has no centre are omitted.
fn search(
    aperture: &Aperture,
    p: Point2,
    index: &EdgeIndex,
    clearance: Option<&ClearanceGrid>,
) -> Option<Configuration> {
    if !index.contains(p) {
        return None;
    }
    let centres = clearance.map(|grid| grid.centres_about(p));
    let may_fit = |heading_rad: f64| match (clearance, &centres) {
        (Some(grid), Some(centres)) => grid.may_fit(centres, p, heading_rad),
        _ => true,
    };
    let (axes, starts) = match aperture {
        Aperture::Ellipse { major_mm, minor_mm } => ([*major_mm, *minor_mm], STARTS),
        Aperture::Rounded(_) => ([1.0; 2], STARTS.map(|s| start_of(aperture, s))),
    };
    let mut search = PlacementSearch {
        p,
        axes,
        aperture,
        index,
        edges: Vec::new(),
        scaled: Vec::new(),
        boxes: Vec::new(),
        last_nearest: 0,
    };
    if centres.as_ref().is_some_and(Vec::is_empty) {
        return None;
    }
    search.collect_edges();
    if aperture.is_round() {
        return search.try_heading(0.0, &starts).ok();
    }
    let headings = (HEADINGS as f64 * aperture.period_rad() / PI).round() as usize;
    let step = aperture.period_rad() / headings as f64;
    // Along the nearest wall first: that settles most points at once.
    let along = index.nearest(p).map_or(0.0, |n| {
        let d = index.edges()[n.edge].b - index.edges()[n.edge].a;
        d.y.atan2(d.x)
    });
    let mut misses: Vec<(f64, f64)> = Vec::with_capacity(headings);
    for k in 0..headings {
        let heading = along + k as f64 * step;
        if !may_fit(heading) {
            continue;
        }
        match search.try_heading(heading, &starts[..1]) {
            Ok(found) => return Some(found),
            Err(miss) => misses.push((miss, heading)),
        }
    }
    misses.sort_by(|a, b| a.0.total_cmp(&b.0));
    for &(miss, heading) in misses.iter().take(REFINED) {
        let (mut best, mut center, mut width) = (miss, heading, step);
        for _ in 0..HALVINGS {
            width /= 2.0;
            for heading in [center - width, center + width] {
                if !may_fit(heading) {
                    continue;
                }
                match search.try_heading(heading, &starts) {
                    Ok(found) => return Some(found),
                    Err(miss) if miss < best => (best, center) = (miss, heading),
                    Err(_) => {}
                }
            }
        }
    }
    None
}

/// A start, given in aperture radii, for an aperture that is not scaled: as far towards the side.
fn start_of(aperture: &Aperture, [x, y]: [f64; 2]) -> [f64; 2] {
    let direction = Vector2::new(x, y);
    let far = direction.norm();
    if far <= 0.0 {
        return [0.0; 2];
    }
    // The centre goes one way where the point comes to lie on the other side of the aperture.
    let point = aperture.support_point(0.0, -direction / far) * -far;
    [point.x, point.y]
}

struct PlacementSearch<'a> {
    p: Point2,
    /// Semi-axes that the frame is scaled by; 1 for an aperture that is no ellipse.
    axes: [f64; 2],
    aperture: &'a Aperture,
    index: &'a EdgeIndex,
    /// Edges within an aperture's length of p, ends from p, mm.
    edges: Vec<[Vector2; 2]>,
    /// The same in the scaled frame of the current heading.
    scaled: Vec<[Vector2; 2]>,
    /// Boxes about [`EDGES_PER_BOX`] of those and where they begin: consecutive edges are close
    /// together. Boxes that no placement can meet are omitted.
    boxes: Vec<(usize, [Vector2; 2])>,
    /// Where the box begins that held the nearest wall of the place before: mostly the next one
    /// too, and farther ones need not be checked.
    last_nearest: usize,
}

/// Edges that share a box.
const EDGES_PER_BOX: usize = 8;

impl PlacementSearch<'_> {
    fn collect_edges(&mut self) {
        let reach_mm = 2.0 * self.aperture.major_mm();
        let mut numbers = Vec::new();
        let area = Box2 {
            min: self.p,
            max: self.p,
        }
        .grown(reach_mm);
        self.index.for_edges_in(area, |number| numbers.push(number));
        numbers.sort_unstable();
        numbers.dedup();
        for number in numbers {
            let edge = self.index.edges()[number];
            if (edge.foot(self.p) - self.p).norm() <= reach_mm {
                self.edges.push([edge.a - self.p, edge.b - self.p]);
            }
        }
    }

    /// A covering placement at this heading, or by how much the best one misses.
    fn try_heading(&mut self, heading_rad: f64, starts: &[[f64; 2]]) -> Result<Configuration, f64> {
        let (sin, cos) = heading_rad.sin_cos();
        let [a, b] = self.axes;
        let scale =
            |w: &Vector2| Vector2::new((w.x * cos + w.y * sin) / a, (w.y * cos - w.x * sin) / b);
        self.scaled.clear();
        self.scaled
            .extend(self.edges.iter().map(|[q, r]| [scale(q), scale(r)]));
        // Centres keep within one aperture of the point, and what they meet within another one.
        let reach = match self.aperture {
            Aperture::Ellipse { .. } => 2.0,
            Aperture::Rounded(shape) => 2.0 * shape.reach_mm(),
        };
        self.boxes.clear();
        for (group, edges) in self.scaled.chunks(EDGES_PER_BOX).enumerate() {
            let ends = edges.iter().flatten();
            let area = ends.fold([edges[0][0]; 2], |[low, high], q| [low.inf(q), high.sup(q)]);
            if to_box2(Vector2::zeros(), &area) < reach * reach {
                self.boxes.push((group * EDGES_PER_BOX, area));
            }
        }
        let mut least = f64::INFINITY;
        for start in starts {
            match self.pushed_clear(Vector2::from(*start)) {
                Ok(center) => match self.placed(center, heading_rad) {
                    Some(found) => return Ok(found),
                    // On the far side of a wall: no closer than any other miss.
                    None => least = least.min(1.0),
                },
                Err(miss) => least = least.min(miss),
            }
        }
        Err(least)
    }

    /// Pushes a centre away from the boundary and pulls it back to p, in turn, until it is clear.
    fn pushed_clear(&mut self, mut center: Vector2) -> Result<Vector2, f64> {
        let (mut least, mut least_before) = (f64::INFINITY, f64::INFINITY);
        for push in 0..PUSHES {
            let (distance, away) = self.nearest_wall(center);
            least = least.min(1.0 - distance);
            if distance >= 1.0 - SLACK {
                return Ok(center);
            }
            if away == Vector2::zeros() {
                break;
            }
            if push % STALL.0 == STALL.0 - 1 {
                if least > least_before * (1.0 - STALL.1) {
                    break;
                }
                least_before = least;
            }
            // Slightly past contact, so that touching walls in turn ends in finitely many steps.
            center += away * ((1.0 + SLACK / 2.0) - distance);
            match self.aperture {
                Aperture::Ellipse { .. } => {
                    let off = center.norm();
                    if off > 1.0 {
                        center /= off;
                    }
                }
                Aperture::Rounded(shape) => center = -shape.nearest_point(-center),
            }
        }
        Err(least)
    }

    /// The nearest wall: its scaled distance (1 is contact), and the displacement away from it for
    /// a difference of 1.
    fn nearest_wall(&mut self, center: Vector2) -> (f64, Vector2) {
        match self.aperture {
            Aperture::Ellipse { .. } => {
                let away = self.away_from_nearest(center);
                let distance = away.norm();
                (
                    distance,
                    away.try_normalize(0.0).unwrap_or(Vector2::zeros()),
                )
            }
            Aperture::Rounded(shape) => {
                let unit_mm = self.aperture.minor_mm();
                let reach_mm = shape.reach_mm();
                let mut least = Gap {
                    gap_mm: unit_mm,
                    outward: Vector2::zeros(),
                };
                let last = self.boxes.partition_point(|b| b.0 < self.last_nearest);
                let last_first = self.boxes[last..].iter().take(1).chain(&self.boxes);
                let mut nearest = self.last_nearest;
                for (first, area) in last_first {
                    let near_mm = reach_mm + least.gap_mm;
                    let [low, high] = area.map(|corner| corner - center);
                    if near_mm <= 0.0
                        || to_box2(center, area) >= near_mm * near_mm
                        || shape.is_beyond(low, high, least.gap_mm)
                    {
                        continue;
                    }
                    for [q, r] in self.edges_from(*first) {
                        if let Some(gap) = shape.gap_to(q - center, r - center, least.gap_mm)
                            && gap.gap_mm < least.gap_mm
                        {
                            (least, nearest) = (gap, *first);
                        }
                    }
                }
                self.last_nearest = nearest;
                (1.0 + least.gap_mm / unit_mm, -least.outward * unit_mm)
            }
        }
    }

    /// The scaled edges of the box that begins with number `first`.
    fn edges_from(&self, first: usize) -> &[[Vector2; 2]] {
        &self.scaled[first..self.scaled.len().min(first + EDGES_PER_BOX)]
    }

    /// Vector from the nearest boundary point to the centre, scaled; any vector of length 1 if none
    /// is nearer.
    fn away_from_nearest(&self, center: Vector2) -> Vector2 {
        let mut best = Vector2::x();
        let mut best2 = 1.0;
        for (first, area) in &self.boxes {
            if to_box2(center, area) >= best2 {
                continue;
            }
            for [q, r] in self.edges_from(*first) {
                let along = r - q;
                let length2 = along.norm_squared();
                let t = if length2 > 0.0 {
                    ((center - q).dot(&along) / length2).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                let away = center - (q + along * t);
                let away2 = away.norm_squared();
                if away2 < best2 {
                    (best, best2) = (away, away2);
                }
            }
        }
        best
    }

    /// Back to the plane; `None` if the path there went through a wall.
    fn placed(&self, center: Vector2, heading_rad: f64) -> Option<Configuration> {
        let (sin, cos) = heading_rad.sin_cos();
        let (u, v) = (center.x * self.axes[0], center.y * self.axes[1]);
        let center = self.p + Vector2::new(u * cos - v * sin, u * sin + v * cos);
        self.index.contains(center).then_some(Configuration {
            center,
            heading_rad,
        })
    }
}

/// Squared distance from a point to a box, 0 inside.
fn to_box2(p: Vector2, [low, high]: &[Vector2; 2]) -> f64 {
    let x = (low.x - p.x).max(p.x - high.x).max(0.0);
    let y = (low.y - p.y).max(p.y - high.y).max(0.0);
    x * x + y * y
}

/// Searches in vain, of points near each other, after which it is worth finding where there is
/// room.
const MISSES: usize = 8;

/// The points, and whether each can be covered. Neighbouring points are evaluated in sequence: the placement found for one
/// often covers the next, and without room there is no search.
pub fn reachable(aperture: &Aperture, points: &[Point2], index: &EdgeIndex) -> Vec<(Point2, bool)> {
    let tile_mm = aperture.reach_mm();
    let tile = |p: &Point2| [p.y, p.x].map(|c| (c / tile_mm).floor() as i64);
    let mut sorted = points.to_vec();
    sorted.sort_by_key(tile);
    let tiles: Vec<&[Point2]> = sorted.chunk_by(|p, q| tile(p) == tile(q)).collect();
    let of_tile = |points: &&[Point2]| {
        let mut clearance: Option<ClearanceGrid> = None;
        let mut found: Vec<Configuration> = Vec::new();
        let mut missed = 0;
        let is_reached = |p: Point2| {
            let covers = |at: &Configuration| aperture.contains(at.heading_rad, p - at.center);
            if found.iter().rev().any(covers) {
                return true;
            }
            if missed == MISSES && clearance.is_none() {
                clearance = Some(ClearanceGrid::about(aperture, points, index));
            }
            let at = search(aperture, p, index, clearance.as_ref());
            found.extend(at);
            missed += usize::from(at.is_none());
            at.is_some()
        };
        let of_points = points
            .iter()
            .copied()
            .zip(points.iter().copied().map(is_reached));
        of_points.collect::<Vec<_>>()
    };
    tiles.par_iter().flat_map_iter(of_tile).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::clearance::{outside_depth_mm, scaled_clearance};
    use crate::geometry::test_shapes::{ELLIPSE, SQUARE, random_numbers, star, walls};
    use crate::plan::feasible::{configuration_at, feasible_angles};

    /// Goal: the search misses no more than slivers. Method: random points of spiky shapes; the
    /// truth from below is a family of tangent placements: all headings at dense boundary points,
    /// and a grid of centres with headings, each shrunk by 5 µm so that only what is missed by more
    /// counts. Every "yes" is checked to cover and to be inside.
    #[test]
    fn agrees_with_dense_families() {
        let mut random = random_numbers(3);
        let spiky = star(22, |i| match i % 2 {
            0 => 2.6 + random(),
            _ => 0.9 + 0.8 * random(),
        });
        let wedge = vec![
            [0.0, 0.0],
            [4.0, 0.9],
            [4.0, 2.0],
            [2.0, 1.6],
            [0.5, 3.0],
            [0.0, 1.4],
        ];
        let (mut yes, mut no, mut missed) = (0, 0, 0);
        for shape in [spiky, wedge] {
            let index = walls(&[&shape]);
            let mut family = Vec::new();
            for edge in index.edges() {
                let pieces = (edge.length_mm() / 0.02).ceil() as usize;
                for k in 0..pieces {
                    let p = edge.a + (edge.b - edge.a) * ((k as f64 + 0.5) / pieces as f64);
                    let angles = feasible_angles(&ELLIPSE, &index, p, edge.normal());
                    for [low, high] in angles.intervals() {
                        let count = ((high - low) / 0.03).ceil() as usize;
                        for j in 0..=count {
                            let alpha = low + (high - low) * j as f64 / count.max(1) as f64;
                            family.push(configuration_at(&ELLIPSE, p, edge.normal(), alpha));
                        }
                    }
                }
            }
            let bounds = index.bounds();
            for _ in 0..4000 {
                let p = bounds.min
                    + Vector2::new(bounds.size().x * random(), bounds.size().y * random());
                if !index.contains(p) {
                    continue;
                }
                if let Some(found) = covering_configuration(&ELLIPSE, p, &index) {
                    yes += 1;
                    assert!(scaled_clearance(&ELLIPSE, found, &index, 2.0) > 1.0 - 2e-4);
                    assert!(outside_depth_mm(&ELLIPSE, found, &index) < 1e-4);
                    let from = p - found.center;
                    assert!(ELLIPSE.contains(found.heading_rad, from * (1.0 - 1e-6)));
                } else {
                    no += 1;
                    let smaller = Aperture::Ellipse {
                        major_mm: 0.595,
                        minor_mm: 0.195,
                    };
                    let covered = family
                        .iter()
                        .any(|c| smaller.contains(c.heading_rad, p - c.center));
                    missed += u32::from(covered);
                }
            }
        }
        println!("yes {yes}, no {no}, of these missed {missed}");
        assert!(yes > 1000 && no > 50, "{yes} {no}");
        assert!(missed <= 3, "{missed} missed of {no}");
    }

    /// Goal: what the clearance grid leaves out is never what could be covered, and it leaves most of it out.
    /// Method: random points of a coast with bays far smaller than the aperture; every "yes" of the
    /// plain search must stay one, and what was counted side by side is at least that.
    #[test]
    fn room_leaves_out_only_what_cannot_be_covered() {
        let mut random = random_numbers(9);
        let coast = star(600, |i| {
            let slow = 0.7 * (i as f64 * 0.2).sin();
            1.3 + slow + 0.2 * random()
        });
        let index = walls(&[&coast]);
        let bounds = index.bounds();
        let points: Vec<Point2> = (0..3000)
            .map(|_| {
                bounds.min + Vector2::new(bounds.size().x * random(), bounds.size().y * random())
            })
            .filter(|p| index.contains(*p))
            .collect();
        let grid = ClearanceGrid::about(&ELLIPSE, &points, &index);
        let (mut yes, mut shut) = (0, 0);
        for p in &points {
            let plain = covering_configuration(&ELLIPSE, *p, &index).is_some();
            let found = search(&ELLIPSE, *p, &index, Some(&grid));
            assert!(!plain || found.is_some(), "{p}");
            yes += usize::from(plain);
            let centres = grid.centres_about(*p);
            let is_shut = (0..180).all(|k| !grid.may_fit(&centres, *p, f64::from(k).to_radians()));
            shut += usize::from(is_shut);
        }
        println!(
            "{} points, {yes} covered, {shut} certainly not",
            points.len()
        );
        assert!(yes > 200 && shut * 2 > points.len() - yes, "{yes} {shut}");
        let side_by_side = reachable(&ELLIPSE, &points, &index);
        assert!(
            side_by_side
                .iter()
                .filter(|(_, is_reached)| *is_reached)
                .count()
                >= yes
        );
    }

    /// Goal: what cannot be reached is a spot in the corner. Method: a grid over the corner of a square.
    #[test]
    fn a_corner_keeps_a_spot_that_no_pose_covers() {
        let square = walls(&[SQUARE]);
        let grid = (0..10_000).map(|k| [f64::from(k / 100), f64::from(k % 100)]);
        let points = grid.map(|[i, j]| Point2::new((i + 0.5) * 0.002, (j + 0.5) * 0.002));
        let no = points.filter(|p| covering_configuration(&ELLIPSE, *p, &square).is_none());
        let no = no.count();
        assert!((100..3000).contains(&no), "{no}");
    }
}
