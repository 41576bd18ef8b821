//! Joins sparse lines along the wall at which they end, without an interruption of flow.
//!
//! In: lines in printing order, their area. Out: fewer passes. From the end of one line to the start
//! of the next one the nozzle moves along the wall, with its long axis along it, so that it prints
//! the narrowest bead next to the wall's. Not covered: ends at different walls, and paths so long
//! that an interruption is faster.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::{Point2, Vector2};
use crate::plan::coverage::connections::bent_connection;
use crate::plan::headings::profile::profile;
use crate::plan::headings::runs::unwrap_headings;
use crate::plan::joining::links::TURN_MAX_RAD;
use crate::plan::pass::{Contact, LayerPass, Placement};

/// Longest path along a wall, relative to a: an interruption takes as long as some 25 mm of path,
/// and the nozzle turns at either end.
const LENGTH_SHARE: f64 = 25.0;
/// Largest distance of the middle of a line's end from the wall, relative to a.
const NEAR_SHARE: f64 = 3.0;
/// Distance of placements along the wall, against b.
const STEP_SHARE: f64 = 0.5;

/// Joins consecutive lines along the walls of `open`, without leaving `walls`. Turning has the
/// weight `turn_weight_mm4`, as along any profile.
pub fn linked_along_walls(
    lines: Vec<LayerPass>,
    open: &[Region],
    turn_weight_mm4: f64,
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Vec<LayerPass> {
    let edges = open.iter().flat_map(Region::edges);
    let edges = edges.map(|(a, b)| Edge { a, b });
    let ground = EdgeIndex::new(edges.collect(), aperture.major_mm());
    let rings: Vec<WallRing> = open
        .iter()
        .flat_map(Region::rings)
        .map(WallRing::of)
        .collect();
    let along = AlongWalls {
        rings,
        ground,
        turn_weight_mm4,
        aperture,
        walls,
    };
    let mut joined: Vec<LayerPass> = Vec::with_capacity(lines.len());
    for next in lines {
        let before = joined.last_mut();
        let way = before.as_ref().and_then(|before| along.way(before, &next));
        match (before, way) {
            (Some(before), Some(way)) => {
                before.placements.extend(way);
                before.placements.extend(next.placements);
                unwrap_headings(&mut before.placements, aperture.period_rad());
            }
            _ => joined.push(next),
        }
    }
    joined
}

/// A ring with the length up to each of its points.
struct WallRing<'a> {
    ring: &'a Ring,
    lengths_mm: Vec<f64>,
}

impl<'a> WallRing<'a> {
    fn of(ring: &'a Ring) -> WallRing<'a> {
        let mut lengths_mm = vec![0.0];
        for (a, b) in ring.edges() {
            lengths_mm.push(lengths_mm[lengths_mm.len() - 1] + (b - a).norm());
        }
        WallRing { ring, lengths_mm }
    }

    fn perimeter_mm(&self) -> f64 {
        self.lengths_mm[self.lengths_mm.len() - 1]
    }

    /// Distance of a point from the ring, and the position of the nearest point along it.
    fn nearest(&self, p: Point2) -> (f64, f64) {
        let mut best = (f64::INFINITY, 0.0);
        for (edge, (a, b)) in self.ring.edges().enumerate() {
            let along = b - a;
            let t = (p - a).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE);
            let t = t.clamp(0.0, 1.0);
            let apart_mm = (p - (a + along * t)).norm();
            if apart_mm < best.0 {
                best = (apart_mm, self.lengths_mm[edge] + t * along.norm());
            }
        }
        best
    }

    /// Point and inward normal at a length along it, which may be beyond either end.
    fn at(&self, length_mm: f64) -> (Point2, Vector2) {
        let within_mm = length_mm.rem_euclid(self.perimeter_mm());
        let points = &self.ring.points;
        let edge = self.lengths_mm.partition_point(|&l| l <= within_mm);
        let edge = edge.clamp(1, points.len()) - 1;
        let (a, b) = (points[edge], points[(edge + 1) % points.len()]);
        let along = (b - a).try_normalize(1e-12).unwrap_or(Vector2::x());
        let point = a + along * (within_mm - self.lengths_mm[edge]);
        (point, Vector2::new(-along.y, along.x))
    }
}

/// Data for paths along the walls.
struct AlongWalls<'a> {
    rings: Vec<WallRing<'a>>,
    ground: EdgeIndex,
    turn_weight_mm4: f64,
    aperture: &'a Aperture,
    walls: &'a EdgeIndex,
}

impl AlongWalls<'_> {
    /// The placements between the end of a line and the start of the next one, if both are at the
    /// same wall.
    fn way(&self, before: &LayerPass, next: &LayerPass) -> Option<Vec<Placement>> {
        let (end, start) = (before.placements.last()?, next.placements.first()?);
        let (ring, [from_mm, to_mm]) = self.common_ring(end.at, start.at)?;
        let contacts = self.contacts(ring, from_mm, to_mm);
        let mut along = profile(
            &contacts,
            false,
            self.turn_weight_mm4,
            self.aperture,
            &self.ground,
        );
        if to_mm < from_mm {
            along.reverse();
        }
        let (first, last) = (along.first()?.at, along.last()?.at);
        if !along.iter().all(|placement| placement.feasible) {
            return None;
        }
        let connection = |from: Configuration, to: Configuration| {
            let way = bent_connection(from, to, TURN_MAX_RAD, self.aperture, self.walls)?;
            let placement = |at| Placement {
                at,
                feasible: true,
                contact: end.contact,
            };
            Some(way.into_iter().map(placement).collect::<Vec<Placement>>())
        };
        let mut way = connection(end.at, first)?;
        let mut back = connection(last, start.at)?;
        // The start of the next line is its own.
        back.pop();
        way.pop();
        way.extend(along);
        way.extend(back);
        Some(way)
    }

    /// The ring next to two placements, and their positions along it, the second less than half a
    /// round from the first.
    fn common_ring(
        &self,
        from: Configuration,
        to: Configuration,
    ) -> Option<(&WallRing<'_>, [f64; 2])> {
        let near_mm = NEAR_SHARE * self.aperture.major_mm();
        let found = self.rings.iter().map(|ring| {
            let (first, second) = (ring.nearest(from.center), ring.nearest(to.center));
            (first.0.max(second.0), ring, [first.1, second.1])
        });
        let (apart_mm, ring, [from_mm, to_mm]) = found.min_by(|x, y| x.0.total_cmp(&y.0))?;
        let perimeter_mm = ring.perimeter_mm();
        let ahead_mm = (to_mm - from_mm).rem_euclid(perimeter_mm);
        let way_mm = if ahead_mm > 0.5 * perimeter_mm {
            ahead_mm - perimeter_mm
        } else {
            ahead_mm
        };
        let is_short = way_mm.abs() <= LENGTH_SHARE * self.aperture.major_mm();
        (apart_mm <= near_mm && is_short).then_some((ring, [from_mm, from_mm + way_mm]))
    }

    /// Contacts along a part of a ring, in its direction, for the narrowest bead.
    fn contacts(&self, ring: &WallRing, from_mm: f64, to_mm: f64) -> Vec<Contact> {
        let step_mm = STEP_SHARE * self.aperture.minor_mm();
        let (low_mm, length_mm) = (from_mm.min(to_mm), (to_mm - from_mm).abs());
        let count = (length_mm / step_mm).ceil().max(1.0) as usize;
        let contact = |i: usize| {
            let share = (i as f64 + 0.5) / count as f64;
            let (point, normal) = ring.at(low_mm + share * length_mm);
            Contact {
                point,
                normal,
                length_mm: length_mm / count as f64,
                extent_mm: self.aperture.minor_mm(),
                on_axis: false,
            }
        };
        (0..count).map(contact).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::clearance::is_inside;
    use crate::geometry::test_shapes::{ELLIPSE, region};
    use crate::plan::headings::profile::TURN_WEIGHT_MM4;
    use crate::plan::pass::test_passes::run;

    /// Goal: lines across a room become one pass, without a jump, inside the walls. Method: five
    /// lines 4 mm apart, there and back, and one behind a wall between.
    #[test]
    fn lines_are_joined_along_the_wall_they_end_at() {
        let room =
            |low: f64, high: f64| region(&[&[[low, 0.0], [high, 0.0], [high, 12.0], [low, 12.0]]]);
        let open = [room(0.0, 21.0), room(24.0, 30.0)];
        let line = |i: u32| {
            let x = 2.0 + 4.0 * f64::from(i);
            if i.is_multiple_of(2) {
                run([x, 0.3], [x, 11.7])
            } else {
                run([x, 11.7], [x, 0.3])
            }
        };
        let lines: Vec<LayerPass> = [0, 1, 2, 3, 4, 6].into_iter().map(line).collect();
        let walls = EdgeIndex::of_region(
            &region(&[&[[-2.0, -2.0], [32.0, -2.0], [32.0, 14.0], [-2.0, 14.0]]]),
            0.6,
        );
        let joined = linked_along_walls(lines, &open, TURN_WEIGHT_MM4, &ELLIPSE, &walls);
        assert_eq!(joined.len(), 2);
        for pair in joined[0].placements.windows(2) {
            assert!(
                (pair[1].at.center - pair[0].at.center).norm() < 0.35,
                "{pair:?}"
            );
            assert!(
                (pair[1].at.heading_rad - pair[0].at.heading_rad).abs() < 0.5,
                "{pair:?}"
            );
        }
        for placement in &joined[0].placements {
            assert!(is_inside(&ELLIPSE, placement.at, &walls, 0.0));
        }
    }
}
