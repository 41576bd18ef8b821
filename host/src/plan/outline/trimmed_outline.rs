//! The outline for planning passes: detail that no part of the aperture can enter, such as the
//! teeth of a scan, is cut off inwards.
//!
//! Input: a valid region about its local origin, mm, inside on the left; the aperture. Output: a
//! valid region inside it, its points some of the input's.
//!
//! The aperture is a union of disks as large as its least radius of curvature rho (Blaschke). Such
//! a disk reaches no farther past a chord of length c with its ends on the outline than the sagitta
//! rho - sqrt(rho² - c²/4). So convex points are cut off one after another (ears), in the order of
//! increasing area, while
//!
//! - the chord's sagitta is at most [`REACH_LOST`]; the ear's sides are at most `SIDE_CHORDS` such
//!   chords, so that it is searched in bounded time;
//! - no other point is in the ear: the rings stay simple and separate;
//! - one edge has cut at most half off a disk: no disk has its larger part beyond the edge. An
//!   ear's lines along its chord are no longer than the chord, so the part of a disk in it is at
//!   most the chord times the disk's width: a deep tooth counts no more than a shallow one.
//!
//! A placement whose clearance to the given outline is [`REACH_LOST`] or more is therefore inside
//! the hull, and one inside the outline leaves the hull by no more than that. No placement reaches
//! a cut-off area that is farther than that from the hull. Time is n log n. With sharp corners (rho
//! = 0) nothing is cut off. The start of a ring only matters for equal ears at one place.
//!
//! The figures of a plan are measured on the outline as given.

use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::point_grid::PointGrid;
use crate::geometry::polygon::{Box2, Region, Ring};
use crate::geometry::predicates::orientation;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use std::f64::consts::PI;

/// Largest loss of the aperture's reach, of its unit: half the default tolerance of a plan. Beads then stay
/// back from the outline by less than the positioning accuracy of the head.
pub const REACH_LOST: f64 = 5e-4;

/// Longest side of an ear, in longest chords: teeth of 6 mm with the built-in aperture.
const SIDE_CHORDS: f64 = 400.0;

/// The hull; the region itself where nothing can be cut off.
pub fn trimmed_outline(region: &Region, aperture: &Aperture) -> Region {
    let rho_mm = aperture.sharpest_radius_mm();
    let lost_mm = REACH_LOST * aperture.unit_mm();
    if rho_mm <= lost_mm {
        return region.clone();
    }
    let mut cutting = Cutting::of(region, rho_mm, lost_mm);
    cutting.run();
    cutting.into_region(region.holes.len())
}

/// True where no placement inside the outline reaches the point: it is cut off, and farther from
/// the hull (its edges) than any gets.
pub fn is_beyond_reach(hull: &EdgeIndex, p: Point2, aperture: &Aperture) -> bool {
    let lost_mm = REACH_LOST * aperture.unit_mm();
    hull.nearest_within(p, lost_mm).is_none() && !hull.contains(p)
}

/// The rings while they are cut, all points in one list.
struct Cutting {
    points: Vec<Point2>,
    ring_of: Vec<u32>,
    before: Vec<u32>,
    after: Vec<u32>,
    is_cut: Vec<bool>,
    /// What the edge to the next point has cut off a disk at most.
    cut_mm2: Vec<f64>,
    /// Points left of each ring.
    left: Vec<usize>,
    point_grid: PointGrid<u32>,
    chord_max_mm: f64,
    /// Width of the disk.
    disk_mm: f64,
    cut_max_mm2: f64,
}

/// A point that may be cut off, with the neighbours that it had then.
#[derive(PartialEq)]
struct Ear {
    area_mm2: f64,
    /// Largest share of a disk in it.
    of_disk_mm2: f64,
    at: Point2,
    points: [u32; 3],
}

impl Eq for Ear {}

impl Ord for Ear {
    fn cmp(&self, other: &Ear) -> Ordering {
        self.area_mm2
            .total_cmp(&other.area_mm2)
            .then(self.at.x.total_cmp(&other.at.x))
            .then(self.at.y.total_cmp(&other.at.y))
            .then(self.points.cmp(&other.points))
    }
}

impl PartialOrd for Ear {
    fn partial_cmp(&self, other: &Ear) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Cutting {
    fn of(region: &Region, rho_mm: f64, lost_mm: f64) -> Cutting {
        let mut cutting = Cutting {
            points: Vec::new(),
            ring_of: Vec::new(),
            before: Vec::new(),
            after: Vec::new(),
            is_cut: Vec::new(),
            cut_mm2: Vec::new(),
            left: Vec::new(),
            point_grid: PointGrid::of(rho_mm, std::iter::empty()),
            chord_max_mm: 2.0 * (lost_mm * (2.0 * rho_mm - lost_mm)).sqrt(),
            disk_mm: 2.0 * rho_mm,
            cut_max_mm2: 0.5 * PI * rho_mm * rho_mm,
        };
        for (number, ring) in region.rings().enumerate() {
            let (first, count) = (cutting.points.len(), ring.points.len());
            let name = |i: usize| (first + i % count) as u32;
            cutting.points.extend(&ring.points);
            cutting.ring_of.extend((0..count).map(|_| number as u32));
            cutting.after.extend((0..count).map(|i| name(i + 1)));
            cutting
                .before
                .extend((0..count).map(|i| name(i + count - 1)));
            cutting.left.push(count);
        }
        let count = cutting.points.len();
        cutting.is_cut = vec![false; count];
        cutting.cut_mm2 = vec![0.0; count];
        let places = cutting.points.iter().copied().zip(0..count as u32);
        cutting.point_grid = PointGrid::of(cutting.chord_max_mm, places);
        cutting
    }

    /// Cuts off what may go, least ears first. Each cut makes two new ears at most, so there are at
    /// most three for each point.
    fn run(&mut self) {
        let mut ears: BinaryHeap<Reverse<Ear>> = (0..self.points.len() as u32)
            .filter_map(|k| self.ear(k))
            .map(Reverse)
            .collect();
        while let Some(Reverse(ear)) = ears.pop() {
            let [p, k, n] = ear.points;
            let is_stale = self.is_cut[k as usize]
                || self.before[k as usize] != p
                || self.after[k as usize] != n;
            if is_stale || !self.may_cut(&ear) {
                continue;
            }
            self.cut(&ear);
            ears.extend([p, n].into_iter().filter_map(|k| self.ear(k)).map(Reverse));
        }
    }

    /// The ear at a convex point, where it is small enough.
    fn ear(&self, k: u32) -> Option<Ear> {
        let (p, n) = (self.before[k as usize], self.after[k as usize]);
        let [a, b, c] = [p, k, n].map(|i| self.points[i as usize]);
        let area_mm2 = 0.5 * (b - a).perp(&(c - b));
        let is_convex = orientation(a, b, c) == Ordering::Greater;
        let chord_mm = (c - a).norm();
        let side_max_mm = SIDE_CHORDS * self.chord_max_mm;
        let is_small = chord_mm <= self.chord_max_mm
            && (b - a).norm() <= side_max_mm
            && (c - b).norm() <= side_max_mm;
        (is_convex && is_small).then_some(Ear {
            area_mm2,
            of_disk_mm2: area_mm2.min(chord_mm * self.disk_mm),
            at: b,
            points: [p, k, n],
        })
    }

    /// True if a triangle of the ring remains, the edge has not cut off too much, and nothing is in
    /// the ear.
    fn may_cut(&self, ear: &Ear) -> bool {
        let [p, k, _] = ear.points;
        let cut_mm2 = self.cut_mm2[p as usize] + self.cut_mm2[k as usize] + ear.of_disk_mm2;
        if self.left[self.ring_of[k as usize] as usize] <= 3 || cut_mm2 > self.cut_max_mm2 {
            return false;
        }
        let corners = ear.points.map(|i| self.points[i as usize]);
        let lies_in_it = |i: u32| {
            !self.is_cut[i as usize]
                && !ear.points.contains(&i)
                && is_in_triangle(self.points[i as usize], &corners)
        };
        let mut slices = self.slices(&corners);
        !slices.any(|area| self.point_grid.within(&area).any(|&i| lies_in_it(i)))
    }

    /// Boxes that hold a triangle: one about it, or, of a long thin one, many from its chord to its
    /// tip, the middle corner.
    fn slices(&self, corners: &[Point2; 3]) -> impl Iterator<Item = Box2> + use<> {
        let [a, b, c] = *corners;
        let side_mm = (b - a).norm().max((c - b).norm());
        let count = match side_mm <= self.disk_mm {
            true => 1,
            false => (side_mm / self.chord_max_mm).ceil() as usize,
        };
        let at = move |k: usize| k as f64 / count as f64;
        (0..count).map(move |k| {
            let ends = [at(k), at(k + 1)].map(|t| [a + (b - a) * t, c + (b - c) * t]);
            Box2::of(ends.as_flattened())
        })
    }

    fn cut(&mut self, ear: &Ear) {
        let [p, k, n] = ear.points.map(|i| i as usize);
        self.cut_mm2[p] += self.cut_mm2[k] + ear.of_disk_mm2;
        self.after[p] = n as u32;
        self.before[n] = p as u32;
        self.is_cut[k] = true;
        self.left[self.ring_of[k] as usize] -= 1;
    }

    fn into_region(self, holes: usize) -> Region {
        let mut rings = vec![Ring { points: Vec::new() }; holes + 1];
        for (i, point) in self.points.iter().enumerate() {
            if !self.is_cut[i] {
                rings[self.ring_of[i] as usize].points.push(*point);
            }
        }
        let holes = rings.split_off(1);
        let exterior = rings.remove(0);
        Region { exterior, holes }
    }
}

/// True in the triangle (corners counter-clockwise) and on its border.
fn is_in_triangle(p: Point2, corners: &[Point2; 3]) -> bool {
    (0..3).all(|i| {
        let side = orientation(corners[i], corners[(i + 1) % 3], p);
        side != Ordering::Less
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vector2;
    use crate::geometry::clearance::{Configuration, outside_bound_mm, outside_depth_mm};
    use crate::geometry::rounded_polygon::RoundedPolygon;
    use crate::geometry::test_shapes::{ELLIPSE, random_numbers};
    use crate::geometry::validity::validate;
    use crate::plan::feasible::{configuration_at, feasible_angles, is_touchable};
    use std::f64::consts::TAU;

    /// Rounding of a placement in contact, mm.
    const INSIDE_MM: f64 = 1e-6;

    fn circle(
        center: Point2,
        radius_mm: f64,
        count: usize,
        mut noise: impl FnMut() -> f64,
    ) -> Ring {
        let point = |i: usize| {
            let (sin, cos) = (i as f64 * TAU / count as f64).sin_cos();
            center + Vector2::new(cos, sin) * (radius_mm + noise())
        };
        Ring {
            points: (0..count).map(point).collect(),
        }
    }

    fn backwards(mut ring: Ring) -> Ring {
        ring.points.reverse();
        ring
    }

    /// A disk of teeth with two holes of teeth, `edge_mm` and noise as given.
    fn toothed(edge_mm: f64, noise_mm: f64, seed: u64) -> Region {
        let mut random = random_numbers(seed);
        let mut ring = |x: f64, radius_mm: f64| {
            let count = (TAU * radius_mm / edge_mm) as usize;
            let noise = || noise_mm * (2.0 * random() - 1.0);
            circle(Point2::new(x, 0.0), radius_mm, count, noise)
        };
        Region {
            exterior: ring(0.0, 1.6),
            holes: vec![backwards(ring(-0.6, 0.3)), backwards(ring(0.7, 0.2))],
        }
    }

    fn shapes() -> Vec<Region> {
        let mut all = Vec::new();
        for (seed, [edge_mm, noise_mm]) in [[0.003, 0.005], [0.005, 0.001], [0.01, 0.02]]
            .into_iter()
            .enumerate()
        {
            all.push(toothed(edge_mm, noise_mm, seed as u64 + 1));
        }
        // Finely drawn, without noise, and two chambers behind a neck of 10 um.
        all.push(toothed(0.002, 0.0, 1));
        all.push(dumbbell());
        all
    }

    /// Two finely drawn chambers of 0.8 mm across joined by a neck of 10 um.
    fn dumbbell() -> Region {
        let half = |x: f64, turn: f64| {
            let open = (0.005f64 / 0.4).asin();
            (0..=1000).map(move |i| {
                let angle = turn + open + (TAU - 2.0 * open) * f64::from(i) / 1000.0;
                let (sin, cos) = angle.sin_cos();
                Point2::new(x + 0.4 * cos, 0.4 * sin)
            })
        };
        let exterior = Ring {
            points: half(-0.5, 0.0).chain(half(0.5, 0.5 * TAU)).collect(),
        };
        Region {
            exterior,
            holes: Vec::new(),
        }
    }

    fn count(region: &Region) -> usize {
        region.rings().map(|ring| ring.points.len()).sum()
    }

    /// Goal: the hull is a valid region inside the given one, of fewer points. Method: validity by
    /// the exact check; points along every edge of the hull against the region.
    #[test]
    fn the_hull_lies_inside() {
        let mut cut = 0;
        for region in shapes() {
            assert_eq!(validate(&region), Ok(()));
            let hull = trimmed_outline(&region, &ELLIPSE);
            assert_eq!(validate(&hull), Ok(()));
            let index = EdgeIndex::of_region(&region, 0.1);
            for (a, b) in hull.edges() {
                for t in [0.0, 0.1, 0.5, 0.9] {
                    let outward_mm = -index.signed_distance_mm(a + (b - a) * t);
                    assert!(outward_mm < 1e-12, "{a} {b}: {outward_mm}");
                }
            }
            assert_eq!(hull.holes.len(), region.holes.len());
            assert!(hull.area_mm2() <= region.area_mm2());
            cut += count(&region) - count(&hull);
        }
        assert!(cut > 5_000, "{cut}");
    }

    fn reach_lost_mm() -> f64 {
        REACH_LOST * ELLIPSE.unit_mm()
    }

    /// Goal: what the aperture reaches is kept but for the stated length. Method: placements that
    /// touch the given outline, all round it and at the ends of what fits; they lie inside it, so
    /// they may leave the hull by that length at most.
    #[test]
    fn no_more_reach_is_lost_than_stated() {
        let mut asked = 0;
        let mut deepest_mm: f64 = 0.0;
        for region in shapes() {
            let hull = trimmed_outline(&region, &ELLIPSE);
            let walls = EdgeIndex::of_region(&region, 0.6);
            let own = EdgeIndex::of_region(&hull, 0.6);
            for edge in walls.edges().iter().step_by(23) {
                let p = edge.a + (edge.b - edge.a) * 0.5;
                let angles = feasible_angles(&ELLIPSE, &walls, p, edge.normal());
                for [low, high] in angles.intervals() {
                    for alpha in [low + 1e-6, 0.5 * (low + high), high - 1e-6] {
                        let at = configuration_at(&ELLIPSE, p, edge.normal(), alpha);
                        // Among thousands of edges in reach the ends are settled early, too far.
                        if outside_bound_mm(&ELLIPSE, at, &walls) < INSIDE_MM {
                            let depth_mm = outside_depth_mm(&ELLIPSE, at, &own);
                            deepest_mm = deepest_mm.max(depth_mm);
                            asked += 1;
                        }
                    }
                }
            }
        }
        println!(
            "{asked} placements leave the hull by {:.3} um at most",
            deepest_mm * 1e3
        );
        assert!(asked > 1_000, "{asked}");
        assert!(deepest_mm <= reach_lost_mm() + INSIDE_MM, "{deepest_mm}");
        assert!(deepest_mm > 0.1 * reach_lost_mm(), "{deepest_mm}");
    }

    /// Goal: a placement that keeps the stated length clear of the outline lies inside the hull.
    /// Method: random placements, their clearance by points all round the aperture.
    #[test]
    fn what_keeps_clear_is_kept() {
        let mut random = random_numbers(5);
        let mut kept = 0;
        for region in shapes() {
            let hull = EdgeIndex::of_region(&trimmed_outline(&region, &ELLIPSE), 0.6);
            let walls = EdgeIndex::of_region(&region, 0.6);
            let size = walls.bounds().size();
            for _ in 0..4_000 {
                let at = Configuration {
                    center: walls.bounds().min + Vector2::new(size.x * random(), size.y * random()),
                    heading_rad: TAU * random(),
                };
                let mut outline = ELLIPSE.outline(at.heading_rad, 90).into_iter();
                let is_clear = walls.contains(at.center)
                    && outline.all(|q| walls.signed_distance_mm(at.center + q) >= reach_lost_mm());
                if is_clear && outside_depth_mm(&ELLIPSE, at, &walls) == 0.0 {
                    kept += 1;
                    let depth_mm = outside_depth_mm(&ELLIPSE, at, &hull);
                    // The clearance between two points of the outline is not tested.
                    assert!(depth_mm < 1e-4, "{at:?}: {depth_mm}");
                }
            }
        }
        assert!(kept > 300, "{kept}");
    }

    /// Goal: what is called beyond reach is touched nowhere. Method: the query for feasible
    /// headings at points of the outline between its corners, near noise in which some can be
    /// touched.
    #[test]
    fn beyond_reach_nothing_is_touched() {
        let (mut beyond, mut touched) = (0, 0);
        for region in [toothed(0.005, 0.001, 2), toothed(0.01, 0.02, 3)] {
            let hull = EdgeIndex::of_region(&trimmed_outline(&region, &ELLIPSE), 0.6);
            let walls = EdgeIndex::of_region(&region, 0.6);
            for edge in walls.edges() {
                let p = edge.a + (edge.b - edge.a) * 0.3;
                let is_touched = is_touchable(&ELLIPSE, &walls, p, edge.normal());
                let is_beyond = is_beyond_reach(&hull, p, &ELLIPSE);
                assert!(!(is_touched && is_beyond), "{p}");
                beyond += u32::from(is_beyond);
                touched += u32::from(is_touched);
            }
        }
        assert!(beyond > 500 && touched > 50, "{beyond} {touched}");
    }

    /// Goal: no ground where a disk fits goes, whatever the way in. Method: the dumbbell; a chamber
    /// is closed off point by point only as far as half a disk.
    #[test]
    fn chambers_behind_a_neck_stay() {
        let region = dumbbell();
        let hull = trimmed_outline(&region, &ELLIPSE);
        assert!(count(&hull) < count(&region));
        let half_disk_mm2 = 0.5 * PI * ELLIPSE.sharpest_radius_mm().powi(2);
        assert!(hull.area_mm2() > region.area_mm2() - half_disk_mm2);
        let walls = EdgeIndex::of_region(&hull, 0.6);
        for x in [-0.5, 0.5] {
            let clear_mm = walls.signed_distance_mm(Point2::new(x, 0.0));
            assert!(clear_mm > 0.4 - 2.0 * reach_lost_mm(), "{clear_mm}");
        }
    }

    /// Goal: teeth far deeper than a disk is wide go too, and nothing behind them. Method: a ring of
    /// 3,000 needles, their roots on a circle, and the same turned inwards about a hole.
    #[test]
    fn deep_teeth_are_cut_off() {
        let needles = |radius_mm: f64, depth_mm: f64| {
            let point = |i: usize| {
                let (sin, cos) = (i as f64 * TAU / 6000.0).sin_cos();
                Point2::new(cos, sin)
                    * (radius_mm + if i.is_multiple_of(2) { 0.0 } else { depth_mm })
            };
            Ring {
                points: (0..6000).map(point).collect(),
            }
        };
        let region = Region {
            exterior: needles(3.0, 1.5),
            holes: vec![backwards(needles(1.5, -1.2))],
        };
        assert_eq!(validate(&region), Ok(()));
        let hull = trimmed_outline(&region, &ELLIPSE);
        assert_eq!(validate(&hull), Ok(()));
        assert!(count(&hull) <= 6000, "{}", count(&hull));
        let walls = EdgeIndex::of_region(&hull, 0.6);
        // The roots are 6 um apart; cutting on may take the stated length.
        let clear_mm = walls.signed_distance_mm(Point2::new(2.25, 0.0));
        assert!(
            (0.75 - 2.0 * reach_lost_mm()..=0.75).contains(&clear_mm),
            "{clear_mm}"
        );
    }

    /// Goal: it does not matter where a ring begins, and sharp corners keep everything. Method: the
    /// same points from another start, as sets; a polygon aperture.
    #[test]
    fn where_a_ring_begins_does_not_matter() {
        let region = toothed(0.004, 0.005, 3);
        let mut turned = region.clone();
        turned.exterior.points.rotate_left(777);
        turned.holes[0].points.rotate_left(100);
        let points = |region: &Region| {
            let hull = trimmed_outline(region, &ELLIPSE);
            let mut all: Vec<[u64; 2]> = hull
                .rings()
                .flat_map(|ring| ring.points.iter().map(|p| [p.x.to_bits(), p.y.to_bits()]))
                .collect();
            all.sort_unstable();
            all
        };
        assert_eq!(points(&region), points(&turned));
        let sharp = Aperture::Rounded(RoundedPolygon::rectangle(1.2, 0.4, 0.0));
        assert_eq!(trimmed_outline(&region, &sharp), region);
    }
}
