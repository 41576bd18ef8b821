//! A region's own frame, so that the same region, rotated or mirrored, gets the same plan.
//!
//! Rasters and sweeps follow the axes, so their results depend on the orientation of a region. In
//! its own frame it always has the same one:
//! - the axes are along most of the boundary, by the mean of e^{4 i theta} over its length, or of the
//!   exterior alone (a plate with many round holes); where no direction prevails (a disk, a gear), the
//!   first axis points to a farthest vertex;
//! - the moments of the boundary choose among quarter turns, farthest vertices and mirror images,
//!   and if they vanish (the teeth of a gear), the boundary on either side of the vertex does.
//!
//! All of it is integrated or traversed along the boundary, so needless points change nothing.
//! Shapes that are equal in several frames are symmetric, and any of these frames can be used.
//!
//! The result is snapped ([`Frame::snapped_in`]): it is the same to the last digit, so that no
//! later decision depends on how rotations and shifts were rounded.

use super::clearance::Configuration;
use super::polygon::{Box2, Region, Ring};
use super::{Point2, Vector2};
use nalgebra::Complex;
use std::cmp::Ordering;
use std::f64::consts::FRAC_PI_2;

/// Mean of e^{4 i theta} from which a direction prevails.
const PREVAILS_SHARE: f64 = 0.05;
/// Moments that differ by less count as equal, against the boundary's length and mean radius.
const SAME_SHARE: f64 = 1e-7;
/// Radii that differ by less count as equal, against the greatest.
const SAME_RADIUS_SHARE: f64 = 1e-9;
/// Most of them that are compared; a circle of more points is the same from each.
const FARTHEST_MAX: usize = 1024;
/// Most points of all equivalent frames whose snapped coordinates are compared; beyond that the first
/// frame is used.
const POINTS_ALIKE_MAX: usize = 200_000;
/// Distances from a vertex at which the boundary's radius is sampled, against the radius of the
/// vertex.
const WALKED_SHARES: [f64; 4] = [0.01, 0.03, 0.1, 0.3];
/// Most edges walked to each side.
const EDGES_WALKED_MAX: usize = 256;
/// Coordinates are snapped on multiples of this (mm, rad): 10⁴ times what turning a part of 100 mm rounds
/// (one coordinate in 10⁴ ends a step off), and no more: with steps of 10⁻⁶ mm a sixth of the real slices
/// is planned differently. A power of two: round dimensions are never halfway between multiples.
const SETTLED: f64 = 1.0 / (1 << 27) as f64;
/// A snapped point this near the line of its neighbours was on it: each of the three moves by up to 0.7
/// steps.
pub const ON_LINE_MM: f64 = 2.0 * SETTLED;
/// Gauss-Legendre nodes and weights on [0, 1]: exact to the fifth degree.
const NODES: [(f64, f64); 3] = [
    (0.112_701_665_379_258_31, 5.0 / 18.0),
    (0.5, 8.0 / 18.0),
    (0.887_298_334_620_741_7, 5.0 / 18.0),
];

/// A turn, perhaps a mirroring, about a centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// What becomes the origin.
    pub centre: Point2,
    /// Direction of the frame's first axis, rad.
    pub turn_rad: f64,
    /// True where the second axis points to the right of the first.
    pub is_mirrored: bool,
}

impl Frame {
    /// The frame that changes nothing.
    pub const IDENTITY: Frame = Frame {
        centre: Point2::new(0.0, 0.0),
        turn_rad: 0.0,
        is_mirrored: false,
    };

    /// A region's own frame, its origin the middle of the region's box there.
    pub fn of_region(region: &Region) -> Frame {
        let length_mm: f64 = region.rings().map(Ring::perimeter_mm).sum();
        if !(length_mm.is_finite() && length_mm > 0.0) {
            return Frame::IDENTITY;
        }
        let centre = middle(region, length_mm);
        let prevailing = prevailing_rad(region.edges());
        let candidates = match prevailing.or_else(|| prevailing_rad(region.exterior.edges())) {
            Some(turn_rad) => {
                let quarter = |k: u8| turn_rad + f64::from(k) * FRAC_PI_2;
                [0, 1, 2, 3].map(|k| (quarter(k), None)).to_vec()
            }
            None => farthest(&region.exterior, centre),
        };
        let moments = Moments::of(region, centre, length_mm);
        let mut lies = Vec::new();
        for (turn_rad, vertex) in candidates {
            for is_mirrored in [false, true] {
                lies.push(Lie {
                    frame: Frame {
                        centre,
                        turn_rad,
                        is_mirrored,
                    },
                    moments: moments.turned(turn_rad, is_mirrored),
                    vertex,
                });
            }
        }
        first_of(lies, region)
    }

    /// The same, mirrored only where that is allowed.
    pub fn mirrored_if(self, may_mirror: bool) -> Frame {
        Frame {
            is_mirrored: self.is_mirrored && may_mirror,
            ..self
        }
    }

    /// The same about the middle of the region's box in it.
    fn about_the_middle(mut self, region: &Region) -> Frame {
        let bounds = self.region_in(region).bounds();
        self.centre = self.point_out(nalgebra::center(&bounds.min, &bounds.max));
        self
    }

    /// A point in the frame.
    pub fn point_in(&self, p: Point2) -> Point2 {
        Point2::from(self.vector_in(p - self.centre))
    }

    /// A point of the frame outside it.
    pub fn point_out(&self, p: Point2) -> Point2 {
        self.centre + self.vector_out(p.coords)
    }

    /// A vector in the frame.
    pub fn vector_in(&self, v: Vector2) -> Vector2 {
        let (sin, cos) = self.turn_rad.sin_cos();
        self.flipped(Vector2::new(v.x * cos + v.y * sin, v.y * cos - v.x * sin))
    }

    /// A vector of the frame outside it.
    pub fn vector_out(&self, v: Vector2) -> Vector2 {
        let (sin, cos) = self.turn_rad.sin_cos();
        let v = self.flipped(v);
        Vector2::new(v.x * cos - v.y * sin, v.y * cos + v.x * sin)
    }

    /// An angle against the first axis, rad.
    pub fn angle_in(&self, angle_rad: f64) -> f64 {
        self.sign() * (angle_rad - self.turn_rad)
    }

    /// An angle of the frame outside it, rad.
    pub fn angle_out(&self, angle_rad: f64) -> f64 {
        self.sign() * angle_rad + self.turn_rad
    }

    /// A configuration of the frame outside it.
    pub fn configuration_out(&self, at: Configuration) -> Configuration {
        Configuration {
            center: self.point_out(at.center),
            heading_rad: self.angle_out(at.heading_rad),
        }
    }

    /// A region in the frame; the inside stays on the left.
    pub fn region_in(&self, region: &Region) -> Region {
        self.region_by(region, |p| self.point_in(p))
    }

    /// A region in the frame, the same to the last digit in whatever form it was given: coordinates
    /// on a grid, rings beginning at their extreme points, holes in the order of these.
    pub fn snapped_in(&self, region: &Region) -> Region {
        let mut region = self.region_by(region, |p| self.point_in(p).map(snapped));
        for ring in region.rings_mut() {
            ring.points.dedup();
            while ring.points.len() > 1 && ring.points.first() == ring.points.last() {
                ring.points.pop();
            }
        }
        region.begin_at_extremes();
        region.holes.sort_by(Ring::cmp_begins);
        region
    }

    /// A region of the frame outside it.
    pub fn region_out(&self, region: &Region) -> Region {
        self.region_by(region, |p| self.point_out(p))
    }

    fn region_by(&self, region: &Region, map: impl Fn(Point2) -> Point2) -> Region {
        let ring = |ring: &Ring| {
            let mut points: Vec<Point2> = ring.points.iter().map(|&p| map(p)).collect();
            if self.is_mirrored {
                points.reverse();
            }
            Ring { points }
        };
        Region {
            exterior: ring(&region.exterior),
            holes: region.holes.iter().map(ring).collect(),
        }
    }

    fn flipped(&self, v: Vector2) -> Vector2 {
        Vector2::new(v.x, self.sign() * v.y)
    }

    fn sign(&self) -> f64 {
        if self.is_mirrored { -1.0 } else { 1.0 }
    }
}

/// A coordinate or an angle without the digits that rounding decides.
pub fn snapped(value: f64) -> f64 {
    // Never the negative zero.
    (value / SETTLED).round() * SETTLED + 0.0
}

/// Centre of gravity of the boundary.
fn middle(region: &Region, length_mm: f64) -> Point2 {
    let origin = Box2::of(&region.exterior.points).min;
    let weighted = region.edges().map(|(a, b)| {
        let middle = nalgebra::center(&a, &b) - origin;
        middle * (b - a).norm()
    });
    origin + weighted.sum::<Vector2>() / length_mm
}

/// Direction modulo a quarter turn that most of these edges have, if any.
fn prevailing_rad(edges: impl Iterator<Item = (Point2, Point2)>) -> Option<f64> {
    let (mut fourfold, mut length_mm) = (Vector2::zeros(), 0.0);
    for (a, b) in edges {
        let along = b - a;
        let angle_rad = 4.0 * along.y.atan2(along.x);
        fourfold += Vector2::new(angle_rad.cos(), angle_rad.sin()) * along.norm();
        length_mm += along.norm();
    }
    let prevails = fourfold.norm() >= PREVAILS_SHARE * length_mm;
    prevails.then(|| fourfold.y.atan2(fourfold.x) / 4.0)
}

/// Directions to the vertices farthest out, with their numbers.
fn farthest(exterior: &Ring, centre: Point2) -> Vec<(f64, Option<usize>)> {
    let radius_mm = |p: &Point2| (p - centre).norm();
    let radii_mm = exterior.points.iter().map(radius_mm);
    let least_mm = (1.0 - SAME_RADIUS_SHARE) * radii_mm.fold(0.0, f64::max);
    let vertices = exterior.points.iter().enumerate();
    let farthest = vertices.filter(|(_, p)| radius_mm(p) >= least_mm);
    let direction = |(i, p): (usize, &Point2)| {
        let v = p - centre;
        (v.y.atan2(v.x), Some(i))
    };
    farthest.map(direction).take(FARTHEST_MAX).collect()
}

/// An orientation of a region.
struct Lie {
    frame: Frame,
    moments: [f64; 9],
    /// The vertex that the first axis points to, if it points to one.
    vertex: Option<usize>,
}

impl Lie {
    /// Greater if the first moment that differs is greater, or, if none differs, the radius of the
    /// boundary after the vertex.
    fn cmp(&self, other: &Lie, exterior: &Ring) -> Ordering {
        let first_that_differs = |pairs: &mut dyn Iterator<Item = (f64, f64)>| {
            let mut differ = pairs.filter(|(m, n)| (m - n).abs() > SAME_SHARE);
            differ
                .next()
                .map_or(Ordering::Equal, |(m, n)| m.total_cmp(&n))
        };
        let mut moments = self.moments.into_iter().zip(other.moments);
        first_that_differs(&mut moments).then_with(|| {
            let (Some(own), Some(others)) = (self.vertex, other.vertex) else {
                return Ordering::Equal;
            };
            let radii = |vertex: usize, lie: &Lie| radii_beside(exterior, vertex, &lie.frame);
            let mut radii = radii(own, self).into_iter().zip(radii(others, other));
            first_that_differs(&mut radii)
        })
    }
}

/// The frame with the greatest order; of equivalent ones (the region is symmetric, up to the rounding
/// of its coordinates) the one in which its snapped corners, by x and y, are first.
fn first_of(lies: Vec<Lie>, region: &Region) -> Frame {
    let mut alike: Vec<Lie> = Vec::new();
    for lie in lies {
        let against = alike.first().map(|first| lie.cmp(first, &region.exterior));
        match against {
            Some(Ordering::Less) => continue,
            Some(Ordering::Greater) => alike.clear(),
            _ => {}
        }
        alike.push(lie);
    }
    let mut frames = alike.iter().map(|lie| lie.frame.about_the_middle(region));
    let points: usize = region.rings().map(|ring| ring.points.len()).sum();
    if alike.len() == 1 || alike.len() * points > POINTS_ALIKE_MAX {
        return frames.next().unwrap_or(Frame::IDENTITY);
    }
    let mut best: Option<(Frame, Vec<Point2>)> = None;
    for frame in frames {
        let snapped = frame.snapped_in(region);
        let mut points: Vec<Point2> = snapped.rings().flat_map(corners).collect();
        points.sort_by(|p, q| p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)));
        let key = |p: &Point2| [p.x, p.y];
        let is_first =
            |(_, others): &(Frame, Vec<Point2>)| points.iter().map(key).lt(others.iter().map(key));
        if best.as_ref().is_none_or(is_first) {
            best = Some((frame, points));
        }
    }
    best.map_or(Frame::IDENTITY, |(frame, _)| frame)
}

/// The points of a snapped ring that are not on the line of their neighbours, up to the displacement of
/// snapping: a redundant point must not determine the frame.
fn corners(ring: &Ring) -> impl Iterator<Item = Point2> + '_ {
    let (points, count) = (&ring.points, ring.points.len());
    let is_corner = move |i: &usize| {
        let (before, after) = (points[(i + count - 1) % count], points[(i + 1) % count]);
        let chord = after - before;
        chord.perp(&(points[*i] - before)).abs() > ON_LINE_MM * chord.norm()
    };
    (0..count).filter(is_corner).map(move |i| points[i])
}

/// The boundary's radius at some distances from a vertex, ahead and behind alternately, against the
/// radius of the vertex; ahead is counter-clockwise, in a mirror image clockwise.
fn radii_beside(exterior: &Ring, vertex: usize, frame: &Frame) -> [f64; 8] {
    let (points, centre) = (&exterior.points, frame.centre);
    let radius_mm = (points[vertex] - centre).norm();
    let is_forwards = (exterior.signed_area_mm2() > 0.0) != frame.is_mirrored;
    let walk = |is_forwards: bool| -> [f64; 4] {
        let step = if is_forwards { 1 } else { points.len() - 1 };
        let (mut at, mut left, mut walked_mm) = (vertex, EDGES_WALKED_MAX, 0.0);
        WALKED_SHARES.map(|share| {
            let way_mm = share * radius_mm;
            loop {
                let next = (at + step) % points.len();
                let (p, q) = (points[at], points[next]);
                let edge_mm = (q - p).norm();
                if walked_mm + edge_mm >= way_mm {
                    let t = (way_mm - walked_mm) / edge_mm.max(f64::MIN_POSITIVE);
                    return (p + (q - p) * t - centre).norm() / radius_mm;
                }
                if left == 0 {
                    return 0.0;
                }
                (at, left, walked_mm) = (next, left - 1, walked_mm + edge_mm);
            }
        })
    };
    let (ahead, behind) = (walk(is_forwards), walk(!is_forwards));
    std::array::from_fn(|i| {
        if i % 2 == 0 {
            ahead[i / 2]
        } else {
            behind[i / 2]
        }
    })
}

/// Moments of the boundary about a point as complex numbers z = x + i y: those tell its turns and
/// mirror images apart, and turn with it.
struct Moments {
    /// Means of z^2, z^3, |z|^2 z, z^4 and z^5, against the mean radius.
    means: [Complex<f64>; 5],
}

impl Moments {
    fn of(region: &Region, centre: Point2, length_mm: f64) -> Moments {
        let mut means = [Complex::new(0.0, 0.0); 5];
        let mut radius_mm = 0.0;
        for (a, b) in region.edges() {
            let edge_mm = (b - a).norm();
            for (t, weight) in NODES {
                let p = a + (b - a) * t - centre;
                let (z, weight) = (Complex::new(p.x, p.y), weight * edge_mm / length_mm);
                let square = z * z;
                let powers = [
                    square,
                    square * z,
                    z * z.norm_sqr(),
                    square * square,
                    square * square * z,
                ];
                radius_mm += weight * z.norm_sqr().sqrt();
                for (mean, power) in means.iter_mut().zip(powers) {
                    *mean += power * weight;
                }
            }
        }
        const DEGREES: [i32; 5] = [2, 3, 3, 4, 5];
        for (mean, degree) in means.iter_mut().zip(DEGREES) {
            *mean /= radius_mm.powi(degree);
        }
        Moments { means }
    }

    /// The means of x² - y², x³, x y², y³, x² y, x y, x³ y - x y³ and the parts of z^5 in a frame.
    fn turned(&self, turn_rad: f64, is_mirrored: bool) -> [f64; 9] {
        const TURNS: [f64; 5] = [2.0, 3.0, 1.0, 4.0, 5.0];
        let mut means = self.means;
        for (mean, turns) in means.iter_mut().zip(TURNS) {
            let (sin, cos) = (turns * turn_rad).sin_cos();
            *mean *= Complex::new(cos, -sin);
            if is_mirrored {
                *mean = mean.conj();
            }
        }
        let [second, third, outer, fourth, fifth] = means;
        [
            second.re,
            0.25 * (third.re + 3.0 * outer.re),
            0.25 * (outer.re - third.re),
            0.25 * (3.0 * outer.im - third.im),
            0.25 * (third.im + outer.im),
            0.5 * second.im,
            0.25 * fourth.im,
            fifth.re,
            fifth.im,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(points: &[[f64; 2]]) -> Region {
        Region {
            exterior: Ring {
                points: points.iter().map(|&p| Point2::from(p)).collect(),
            },
            holes: Vec::new(),
        }
    }

    fn farthest_apart_mm(a: &Region, b: &Region) -> f64 {
        let nearest = |p: &Point2| {
            let apart = b.exterior.points.iter().map(|q| (p - q).norm());
            apart.fold(f64::INFINITY, f64::min)
        };
        a.exterior.points.iter().map(nearest).fold(0.0, f64::max)
    }

    /// One of the poses in which a region is given, every other one a mirror image.
    fn pose(k: i32) -> Frame {
        Frame {
            centre: Point2::new(3.0 * f64::from(k), -7.0),
            turn_rad: 0.37 * f64::from(k),
            is_mirrored: k % 2 == 1,
        }
    }

    /// Goal: a region lies the same way in its own frame however it is given. Method: shapes that
    /// need the direction, the quadrant, the mirror image and the farthest vertex, in 40 poses.
    #[test]
    fn poses_of_a_region_come_out_the_same() {
        let gear: Vec<[f64; 2]> = (0..48)
            .map(|i| {
                let radius = if i % 4 < 2 { 10.0 } else { 12.0 };
                let angle = std::f64::consts::TAU * (f64::from(i) + f64::from(i % 2) * 0.2) / 48.0;
                [radius * angle.cos(), radius * angle.sin()]
            })
            .collect();
        let shapes = [
            region(&[
                [0.0, 0.0],
                [30.0, 0.0],
                [30.0, 8.0],
                [8.0, 8.0],
                [8.0, 20.0],
                [0.0, 20.0],
            ]),
            region(&[[0.0, 0.0], [20.0, 0.0], [26.0, 10.0], [6.0, 10.0]]),
            region(&[[0.0, 0.0], [9.0, 0.0], [5.0, 8.0]]),
            region(&[[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]),
            region(&gear),
        ];
        for shape in &shapes {
            let own = Frame::of_region(shape).region_in(shape);
            for k in 0..40 {
                let posed = pose(k).region_in(shape);
                let frame = Frame::of_region(&posed);
                let apart_mm = farthest_apart_mm(&frame.region_in(&posed), &own);
                assert!(apart_mm < 1e-9, "pose {k}: {apart_mm}");
            }
        }
    }

    /// Goal: parts that are symmetric, or nearly so, and gears whose farthest vertices come in pairs
    /// snap to the same digits however they are given, needless points or none. Method: a hinge leaf
    /// whose one hole is off by what rounding leaves, a gear with a bore, both with rings begun elsewhere
    /// and holes in another order, in 40 poses; the frame made again with points on the edges.
    #[test]
    fn symmetric_regions_snap_to_the_same_digits() {
        let circle = |x: f64, y: f64, count: u32| Ring {
            points: (0..count)
                .map(|i| -std::f64::consts::TAU * f64::from(i) / f64::from(count))
                .map(|t| Point2::new(x + 1.3 * t.cos(), y + 1.3 * t.sin()))
                .collect(),
        };
        let mut leaf = region(&[[0.0, 0.0], [30.0, 0.0], [30.0, 11.0], [0.0, 11.0]]);
        leaf.holes = vec![circle(6.1, 4.0, 24), circle(23.9 + 3e-8, 4.0, 24)];
        let tooth = |i: u32| {
            let (radius_mm, share) =
                [(10.0, 0.1), (12.0, 0.3), (12.0, 0.6), (10.0, 0.9)][i as usize % 4];
            let angle = std::f64::consts::TAU * (f64::from(i / 4) + share) / 17.0;
            [radius_mm * angle.cos(), radius_mm * angle.sin()]
        };
        let mut gear = region(&(0..68).map(tooth).collect::<Vec<_>>());
        gear.holes = vec![circle(0.0, 0.0, 34)];
        for shape in [&leaf, &gear] {
            let own = Frame::of_region(shape).snapped_in(shape);
            for k in 0..40 {
                let mut posed = pose(k).region_in(shape);
                let count = posed.exterior.points.len();
                posed.exterior.points.rotate_left(7 * k as usize % count);
                if k % 3 == 1 {
                    posed.holes.reverse();
                }
                let snapped = Frame::of_region(&posed).snapped_in(&posed);
                assert_eq!(snapped, own, "pose {k}");
                let frame = Frame::of_region(&with_needless_points(&posed));
                assert_eq!(frame.snapped_in(&posed), own, "pose {k}");
            }
        }
    }

    /// Goal: many round holes do not hide the direction of the exterior. Method: a rectangle with 40 x 30 holes, 24 times
    /// its perimeter, in 40 poses: its box in its own frame is the rectangle.
    #[test]
    fn a_plate_lies_along_its_exterior() {
        let hole = |i: usize| {
            let middle = Point2::new(1.2 + 2.2 * (i % 40) as f64, 1.2 + 2.2 * (i / 40) as f64);
            let angles = (0..24).map(|k| -std::f64::consts::TAU * f64::from(k) / 24.0);
            let points = angles.map(|t| middle + Vector2::new(t.cos(), t.sin()));
            Ring {
                points: points.collect(),
            }
        };
        let mut plate = region(&[[0.0, 0.0], [89.0, 0.0], [89.0, 67.0], [0.0, 67.0]]);
        plate.holes = (0..1200).map(hole).collect();
        let holes_mm: f64 = plate.holes.iter().map(Ring::perimeter_mm).sum();
        assert!(plate.exterior.perimeter_mm() < 0.9 * PREVAILS_SHARE * holes_mm);
        for k in 0..40 {
            let posed = pose(k).region_in(&plate);
            let size = Frame::of_region(&posed).region_in(&posed).bounds().size();
            let [short_mm, long_mm] = [size.x.min(size.y), size.x.max(size.y)];
            let off_mm = (short_mm - 67.0).abs().max((long_mm - 89.0).abs());
            assert!(off_mm < 1e-9, "pose {k}: {size}");
        }
    }

    /// Every edge with a point on it, near its beginning.
    fn with_needless_points(region: &Region) -> Region {
        let mut with_points = region.clone();
        for ring in with_points.rings_mut() {
            let edges = ring.edges();
            ring.points = edges.flat_map(|(a, b)| [a, a + (b - a) * 0.2]).collect();
        }
        with_points
    }

    /// Goal: into and out are inverse to each other, for points, angles and regions, and the inside
    /// stays on the left.
    #[test]
    fn out_undoes_into() {
        let shape = region(&[[1.0, 2.0], [9.0, 2.5], [4.0, 8.0]]);
        let frame = Frame {
            centre: Point2::new(4.0, -3.0),
            turn_rad: 0.8,
            is_mirrored: true,
        };
        let inside = frame.region_in(&shape);
        assert!(inside.area_mm2() > 0.0);
        assert!(farthest_apart_mm(&frame.region_out(&inside), &shape) < 1e-12);
        let at = Configuration {
            center: Point2::new(2.0, 1.0),
            heading_rad: 0.3,
        };
        let out = frame.configuration_out(at);
        assert!((frame.point_in(out.center) - at.center).norm() < 1e-12);
        assert!((frame.angle_in(out.heading_rad) - 0.3).abs() < 1e-12);
        // A heading is the direction of a vector.
        let ahead = frame.vector_out(Vector2::new(0.3_f64.cos(), 0.3_f64.sin()));
        assert!((ahead.y.atan2(ahead.x) - out.heading_rad).abs() < 1e-12);
    }

    /// Goal: where mirroring is not allowed, a region lies the same way however it is turned, its mirror
    /// image as the mirror image. Method: a shape and its image, each turned by three angles.
    #[test]
    fn mirroring_can_be_forbidden() {
        let shape = region(&[[0.0, 0.0], [9.0, 0.0], [5.0, 8.0]]);
        let lies = |turn_rad: f64, is_mirrored: bool| {
            let pose = Frame {
                turn_rad,
                is_mirrored,
                ..Frame::IDENTITY
            };
            let posed = pose.region_in(&shape);
            let frame = Frame::of_region(&posed).mirrored_if(false);
            assert!(!frame.is_mirrored);
            frame.region_in(&posed)
        };
        let (own, mut image) = (lies(0.0, false), lies(0.0, true));
        for turn_rad in [1.0, 2.0] {
            assert!(farthest_apart_mm(&lies(turn_rad, false), &own) < 1e-12);
            assert!(farthest_apart_mm(&lies(turn_rad, true), &image) < 1e-12);
        }
        assert!(farthest_apart_mm(&own, &image) > 0.1);
        for point in &mut image.exterior.points {
            point.y = -point.y;
        }
        assert!(farthest_apart_mm(&own, &image) < 1e-12);
    }
}
