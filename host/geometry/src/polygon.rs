//! Rings and regions: planar polygons with holes, mm.

use super::{Point2, Vector2};
use std::cmp::Ordering;

/// Direction from which rings begin: slanted, so that the points of a side of a usual part are not
/// all equally far along, and rounding does not choose between them.
const START: Vector2 = Vector2::new(0.743, 0.669);

/// A closed polygon; the first point is not repeated.
#[derive(Clone, Debug, PartialEq)]
pub struct Ring {
    /// Vertices in order.
    pub points: Vec<Point2>,
}

/// A region with holes: exterior counter-clockwise, holes clockwise, so that the inside is always
/// on the left of an edge.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// Outer boundary, counter-clockwise.
    pub exterior: Ring,
    /// Holes, clockwise.
    pub holes: Vec<Ring>,
}

/// Axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box2 {
    /// Lower left corner.
    pub min: Point2,
    /// Upper right corner.
    pub max: Point2,
}

impl Ring {
    /// Signed area, mm²: positive where counter-clockwise. Summed about the first vertex, so that
    /// a ring far from the origin loses no digits.
    pub fn signed_area_mm2(&self) -> f64 {
        let Some(&origin) = self.points.first() else {
            return 0.0;
        };
        self.edges()
            .map(|(p, q)| (p - origin).perp(&(q - origin)))
            .sum::<f64>()
            / 2.0
    }

    /// Length of the closed boundary, mm.
    pub fn perimeter_mm(&self) -> f64 {
        self.edges().map(|(p, q)| (q - p).norm()).sum()
    }

    /// Makes the ring begin at its extreme point along `START`, wherever it began.
    pub fn begin_at_extreme(&mut self) {
        let along_mm = |i: usize| self.points[i].coords.dot(&START);
        let count = self.points.len();
        let first = (0..count).min_by(|&i, &j| along_mm(i).total_cmp(&along_mm(j)));
        self.points.rotate_left(first.unwrap_or(0));
    }

    /// Less where the first point comes before the other ring's along `START`.
    pub fn cmp_begins(&self, other: &Ring) -> Ordering {
        let first = |ring: &Ring| ring.points.first().map_or(0.0, |p| p.coords.dot(&START));
        first(self).total_cmp(&first(other))
    }

    /// Directed edges, the closing one included.
    pub fn edges(&self) -> impl Iterator<Item = (Point2, Point2)> + '_ {
        let count = self.points.len();
        (0..count).map(move |i| (self.points[i], self.points[(i + 1) % count]))
    }
}

impl Region {
    /// Exterior first, then the holes.
    pub fn rings(&self) -> impl Iterator<Item = &Ring> + Clone {
        std::iter::once(&self.exterior).chain(&self.holes)
    }

    /// Makes every ring begin at its extreme point ([`Ring::begin_at_extreme`]).
    pub fn begin_at_extremes(&mut self) {
        for ring in self.rings_mut() {
            ring.begin_at_extreme();
        }
    }

    /// The rings, mutable, in the order of [`Region::rings`].
    pub fn rings_mut(&mut self) -> impl Iterator<Item = &mut Ring> {
        std::iter::once(&mut self.exterior).chain(&mut self.holes)
    }

    /// Directed edges of all rings, inside on the left.
    pub fn edges(&self) -> impl Iterator<Item = (Point2, Point2)> + '_ {
        self.rings().flat_map(|ring| ring.edges())
    }

    /// Area, mm².
    pub fn area_mm2(&self) -> f64 {
        self.rings().map(Ring::signed_area_mm2).sum()
    }

    /// The same elsewhere.
    pub fn shifted(&self, by: Vector2) -> Region {
        let ring = |ring: &Ring| Ring {
            points: ring.points.iter().map(|p| p + by).collect(),
        };
        Region {
            exterior: ring(&self.exterior),
            holes: self.holes.iter().map(ring).collect(),
        }
    }

    /// Bounding box of the exterior.
    pub fn bounds(&self) -> Box2 {
        Box2::of(&self.exterior.points)
    }

    /// Even-odd containment by ray casting over all edges; O(n). For many queries use
    /// [`super::edge_index::EdgeIndex::contains`].
    pub fn contains(&self, p: Point2) -> bool {
        self.edges().filter(|&(a, b)| crosses_ray(a, b, p)).count() % 2 == 1
    }
}

impl Box2 {
    /// The smallest box around the points; degenerate at the origin if there are none.
    pub fn of(points: &[Point2]) -> Box2 {
        let Some(&first) = points.first() else {
            return Box2 {
                min: Point2::origin(),
                max: Point2::origin(),
            };
        };
        points.iter().fold(
            Box2 {
                min: first,
                max: first,
            },
            |b, p| Box2 {
                min: Point2::new(b.min.x.min(p.x), b.min.y.min(p.y)),
                max: Point2::new(b.max.x.max(p.x), b.max.y.max(p.y)),
            },
        )
    }

    /// Width and height, mm.
    pub fn size(&self) -> Vector2 {
        self.max - self.min
    }

    /// False where the boxes have no point in common.
    pub fn meets(&self, other: &Box2) -> bool {
        self.min.x <= other.max.x
            && self.max.x >= other.min.x
            && self.min.y <= other.max.y
            && self.max.y >= other.min.y
    }

    /// True for points in it and on its border.
    pub fn contains(&self, p: Point2) -> bool {
        (self.min.x..=self.max.x).contains(&p.x) && (self.min.y..=self.max.y).contains(&p.y)
    }

    /// The box grown on all sides.
    pub fn grown(&self, by_mm: f64) -> Box2 {
        let d = Vector2::new(by_mm, by_mm);
        Box2 {
            min: self.min - d,
            max: self.max + d,
        }
    }
}

/// True where the ray from `p` towards +x crosses edge a-b (half-open in y).
pub fn crosses_ray(a: Point2, b: Point2, p: Point2) -> bool {
    (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
}
