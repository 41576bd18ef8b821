//! Cleans an input region: the result is the contour that the planner uses.
//!
//! Input: a valid region, mm, anywhere. Output: the same region about a local origin (its box
//! centre), so that a part far from the machine's zero loses no digits, without repeated and
//! needless points and with oriented rings (inside on the left). A point is needless where the
//! chord that replaces it and its dropped neighbours passes within `tolerance_mm` of each: the
//! boundary moves by no more than that, to either side. Noise larger than the tolerance stays:
//! detail that no part of the aperture can enter is cut off next (`trimmed_outline`), and the rest
//! is handled where the medial axis is pruned and normals are smoothed.

use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::frame::{Frame, ON_LINE_MM};
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::validity::validate;
use crate::geometry::{Point2, Vector2};
use crate::text::refusal::{Refusal, refusal};

/// Default of the largest distance between the cleaned boundary and the given one: a fifth of the
/// default tolerance of a plan (1 µm), so that most of it is left for the fit of segments.
pub const SIMPLIFY_MM: f64 = 2e-4;

/// Points closer than this to the one before are the same point, whatever the tolerance.
const SAME_POINT_MM: f64 = 1e-7;

/// Longest run of points that one chord replaces; bounds the work on a finely sampled line.
const RUN_MAX: usize = 256;

/// A cleaned region about a local origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Contour {
    /// The region in local coordinates: input minus `offset`.
    pub region: Region,
    /// The frame in which it was snapped to a grid and cleaned: its points are on the grid there.
    pub frame: Frame,
    /// Add this to local coordinates to get the input's.
    pub offset: Vector2,
    /// Points of the input that were dropped.
    pub removed_points: usize,
    /// Holes of the input that vanished because they are thinner than the tolerance.
    pub removed_holes: usize,
}

/// A coordinate is infinite or not a number.
pub fn not_finite(ring: usize, point: usize) -> Refusal {
    refusal!(
        "a coordinate of ring {ring} is not a finite number (point {point}); correct the input"
    )
}

impl Contour {
    /// Cleans a region; see the head of this file for the meaning of `tolerance_mm`. If that would
    /// make rings cross (features closer together than the tolerance), only repeated points are
    /// removed.
    pub fn of_region(region: &Region, tolerance_mm: f64) -> Result<Contour, Refusal> {
        let contour = Contour::cleaned(region, tolerance_mm)?;
        if contour.removed_points > 0 && validate(&contour.region).is_err() {
            return Contour::cleaned(region, 0.0);
        }
        Ok(contour)
    }

    fn cleaned(region: &Region, tolerance_mm: f64) -> Result<Contour, Refusal> {
        for (ring, points) in region.rings().enumerate() {
            let bad = |p: &Point2| !(p.x.is_finite() && p.y.is_finite());
            if let Some(point) = points.points.iter().position(bad) {
                return Err(not_finite(ring, point));
            }
        }
        let bounds = region.bounds();
        let offset = (bounds.min.coords + bounds.max.coords) / 2.0;
        // Which points are needless must not depend on the region's orientation.
        let local = region.shifted(-offset);
        let frame = Frame::of_region(&local);
        let local = frame.snapped_in(&local);
        let clean = |ring: &Ring, is_exterior: bool| cleaned_ring(ring, tolerance_mm, is_exterior);
        let first = region.exterior.points.first().copied();
        let exterior = clean(&local.exterior, true).ok_or_else(|| {
            let [x, y] = first.map_or([0.0; 2], |p| [p.x, p.y]);
            refusal!(
                "the outline near ({x:.3}, {y:.3}) mm has no area beyond the tolerance; check the units"
            )
        })?;
        let holes = local.holes.iter();
        let holes: Vec<Ring> = holes.filter_map(|hole| clean(hole, false)).collect();
        let removed_holes = region.holes.len() - holes.len();
        let cleaned = Region { exterior, holes };
        let count = |region: &Region| region.rings().map(|r| r.points.len()).sum::<usize>();
        Ok(Contour {
            region: frame.region_out(&cleaned),
            frame,
            offset,
            removed_points: count(region) - count(&cleaned),
            removed_holes,
        })
    }

    /// Edge index over the local region, for queries about as long as `reach_mm`.
    pub fn edge_index(&self, reach_mm: f64) -> EdgeIndex {
        EdgeIndex::of_region(&self.region, reach_mm)
    }

    /// Local coordinates to the input's.
    pub fn to_input(&self, p: Point2) -> Point2 {
        p + self.offset
    }

    /// The input's coordinates to local ones.
    pub fn to_local(&self, p: Point2) -> Point2 {
        p - self.offset
    }
}

/// The ring without needless points, oriented; `None` if nothing remains.
fn cleaned_ring(ring: &Ring, tolerance_mm: f64, is_exterior: bool) -> Option<Ring> {
    let mut points: Vec<Point2> = Vec::with_capacity(ring.points.len());
    for &p in &ring.points {
        if points.last().is_none_or(|q| (p - q).norm() > SAME_POINT_MM) {
            points.push(p);
        }
    }
    while points.len() > 1 && (points[0] - points[points.len() - 1]).norm() <= SAME_POINT_MM {
        points.pop();
    }
    let mut ring = Ring { points };
    if (ring.signed_area_mm2() > 0.0) != is_exterior {
        ring.points.reverse();
    }
    ring.begin_at_extreme();
    // Points on a line first: a chord that ends at one keeps it instead of the adjacent corner.
    let on_line_mm = ON_LINE_MM.min(tolerance_mm);
    ring.points = simplified(&ring.points, on_line_mm);
    ring.points = simplified(&ring.points, tolerance_mm - on_line_mm);
    let is_left = ring.points.len() >= 3 && (ring.signed_area_mm2() > 0.0) == is_exterior;
    (is_left && ring.signed_area_mm2() != 0.0).then_some(ring)
}

/// Greedy chords around the ring, which begins at an extreme point (never needless by more than the
/// tolerance).
fn simplified(points: &[Point2], tolerance_mm: f64) -> Vec<Point2> {
    let count = points.len();
    if count < 3 {
        return Vec::new();
    }
    let at = |i: usize| points[i % count];
    let mut kept = vec![at(0)];
    let mut from = 0;
    while from < count {
        let mut to = from + 1;
        while to < count
            && to + 1 - from <= RUN_MAX
            && chord_replaces(at(from), at(to + 1), (from + 1..=to).map(at), tolerance_mm)
        {
            to += 1;
        }
        if to < count {
            kept.push(at(to));
        }
        from = to;
    }
    kept
}

/// True if every point is within the tolerance of chord a-b, in order along it (a spike that runs
/// back on itself is not needless).
fn chord_replaces(
    a: Point2,
    b: Point2,
    mut between: impl Iterator<Item = Point2>,
    tolerance_mm: f64,
) -> bool {
    let chord = b - a;
    let length = chord.norm();
    if length <= tolerance_mm {
        return false;
    }
    let unit = chord / length;
    let mut reached = 0.0;
    between.all(|p| {
        let along = unit.dot(&(p - a));
        let in_order = along >= reached && along <= length;
        reached = along;
        in_order && unit.perp(&(p - a)).abs() <= tolerance_mm
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(points: &[[f64; 2]]) -> Ring {
        Ring {
            points: points.iter().map(|p| Point2::new(p[0], p[1])).collect(),
        }
    }

    fn square_at(x: f64, y: f64) -> Region {
        Region {
            exterior: ring(&[[x, y], [x + 10.0, y], [x + 10.0, y + 10.0], [x, y + 10.0]]),
            holes: vec![],
        }
    }

    /// Goal: repeated and collinear points go, corners stay. Method: a square with such points
    /// added, far from the origin, against the plain square.
    #[test]
    fn needless_points_go() {
        let mut region = square_at(9000.0, -9000.0);
        let points = &mut region.exterior.points;
        points.insert(1, Point2::new(9005.0, -9000.0));
        points.insert(1, Point2::new(9002.5, -9000.0 + 1e-4));
        points.insert(1, Point2::new(9002.5, -9000.0 + 1e-4));
        points.push(points[0]);
        let contour = Contour::of_region(&region, SIMPLIFY_MM).unwrap();
        assert_eq!(contour.region.exterior.points.len(), 4);
        assert_eq!(contour.removed_points, 4);
        assert!((contour.region.area_mm2() - 100.0).abs() < 1e-9);
        assert_eq!(
            contour.to_input(contour.region.bounds().min),
            Point2::new(9000.0, -9000.0)
        );
    }

    /// Goal: no input point ends farther than the tolerance from the cleaned boundary. Method:
    /// a circle of 20,000 points (sagitta between neighbours far below the tolerance).
    #[test]
    fn deviation_is_bounded() {
        let points: Vec<Point2> = (0..20_000)
            .map(|i| {
                let (sin, cos) = (i as f64 * std::f64::consts::TAU / 20_000.0).sin_cos();
                Point2::new(30.0 * cos, 30.0 * sin)
            })
            .collect();
        let region = Region {
            exterior: Ring { points },
            holes: vec![],
        };
        let contour = Contour::of_region(&region, SIMPLIFY_MM).unwrap();
        let count = contour.region.exterior.points.len();
        assert!((500..5_000).contains(&count), "{count}");
        let index = contour.edge_index(1.0);
        for p in &region.exterior.points {
            let nearest = index.nearest(contour.to_local(*p)).unwrap();
            assert!(nearest.distance_mm <= SIMPLIFY_MM + 1e-12);
        }
    }

    /// Goal: points on edges do not choose which corners a fine curve keeps. Method: a circle of
    /// which a chord replaces some points, with and without two more points on every edge.
    #[test]
    fn points_on_edges_choose_no_corners() {
        let points = (0..2_000).map(|i| {
            let (sin, cos) = (i as f64 * std::f64::consts::TAU / 2_000.0).sin_cos();
            Point2::new(21.0 * cos, 18.0 * sin)
        });
        let plain = Ring {
            points: points.collect(),
        };
        let edges = plain.edges();
        let with_points = edges.flat_map(|(a, b)| [0.0, 0.25, 0.8].map(|t| a + (b - a) * t));
        let with_points = Ring {
            points: with_points.collect(),
        };
        let [own, other] = [plain, with_points].map(|exterior| {
            let holes = vec![];
            let contour = Contour::of_region(&Region { exterior, holes }, SIMPLIFY_MM);
            contour.unwrap().region.exterior.points
        });
        assert!((200..1_500).contains(&own.len()), "{}", own.len());
        assert_eq!(other.len(), own.len());
        for (p, q) in own.iter().zip(&other) {
            assert!((p - q).norm() < 1e-7, "{p} {q}");
        }
    }

    /// Goal: cleaning never makes rings cross. Method: a hole 0.1 µm beside a bump of 0.15 µm that
    /// the tolerance alone would cut off.
    #[test]
    fn cleaning_keeps_rings_apart() {
        let mut region = square_at(0.0, 0.0);
        region.exterior.points.insert(1, Point2::new(5.0, -1.5e-4));
        region
            .holes
            .push(ring(&[[5.0, -0.5e-4], [5.5, 2.0], [4.5, 2.0]]));
        assert_eq!(validate(&region), Ok(()));
        let contour = Contour::of_region(&region, SIMPLIFY_MM).unwrap();
        assert_eq!(validate(&contour.region), Ok(()));
        assert_eq!(contour.region.exterior.points.len(), 5);
    }

    /// Goal: rings come out with the inside on the left, whatever way they came in.
    #[test]
    fn orientation_is_mended() {
        let mut region = square_at(0.0, 0.0);
        region.exterior.points.reverse();
        region
            .holes
            .push(ring(&[[4.0, 4.0], [6.0, 4.0], [6.0, 6.0]]));
        let contour = Contour::of_region(&region, SIMPLIFY_MM).unwrap();
        assert!(contour.region.exterior.signed_area_mm2() > 0.0);
        assert!(contour.region.holes[0].signed_area_mm2() < 0.0);
    }

    /// Goal: what cannot be planned is refused with its place; slits vanish and are counted.
    #[test]
    fn degenerate_rings() {
        let mut region = square_at(0.0, 0.0);
        region
            .holes
            .push(ring(&[[4.0, 4.0], [6.0, 4.0], [5.0, 4.0 + 1e-5]]));
        assert_eq!(
            Contour::of_region(&region, SIMPLIFY_MM)
                .unwrap()
                .removed_holes,
            1
        );
        region.exterior.points[2].x = f64::NAN;
        assert_eq!(
            Contour::of_region(&region, SIMPLIFY_MM),
            Err(not_finite(0, 2))
        );
        let flat = Region {
            exterior: ring(&[[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]),
            holes: vec![],
        };
        let refused = Contour::of_region(&flat, SIMPLIFY_MM).unwrap_err();
        assert!(
            refused.to_string().contains("has no area beyond"),
            "{refused}"
        );
    }
}
