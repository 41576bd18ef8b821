//! A frame of a region's own, so that the same region given turned or mirrored is planned the same.
//!
//! Rasters and sweeps follow the axes, so what they decide depends on how a region lies. In its own
//! frame it always lies the same way:
//! - the axes lie along most of the boundary, by the mean of e^{4 i theta} over its length; where no
//!   direction prevails (a disk, a gear), the first axis points to the vertex farthest out;
//! - which of the quarter turns and mirror images it is, the moments of the boundary say.
//!
//! All of it is integrated along the boundary, so needless points change nothing. Shapes that come
//! out the same in several frames are symmetric, and any of these frames serves.

use super::clearance::Configuration;
use super::polygon::{Box2, Region, Ring};
use super::{Point2, Vector2};
use std::f64::consts::FRAC_PI_2;

/// Mean of e^{4 i theta} from which a direction prevails.
const PREVAILS_SHARE: f64 = 0.05;
/// Moments that differ by less count as equal, against the boundary's length and mean radius.
const SAME_SHARE: f64 = 1e-7;
/// Radii that differ by less count as equal, against the greatest.
const SAME_RADIUS_SHARE: f64 = 1e-9;
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

    /// A region's own frame, its origin the middle of the region's box there; mirrored only where
    /// that is allowed.
    pub fn of_region(region: &Region, may_mirror: bool) -> Frame {
        let length_mm: f64 = region.rings().map(Ring::perimeter_mm).sum();
        if !(length_mm.is_finite() && length_mm > 0.0) {
            return Frame::IDENTITY;
        }
        let mut frame = Frame {
            centre: middle(region, length_mm),
            ..Frame::IDENTITY
        };
        let turns = match prevailing_rad(region, length_mm) {
            Some(turn_rad) => {
                let quarter = |k: u8| turn_rad + f64::from(k) * FRAC_PI_2;
                [0, 1, 2, 3].map(quarter).to_vec()
            }
            None => vec![farthest_rad(region, frame.centre)],
        };
        let mut best: Option<(Frame, Vec<f64>)> = None;
        for turn_rad in turns {
            for is_mirrored in [false, true] {
                frame.turn_rad = turn_rad;
                frame.is_mirrored = is_mirrored;
                if is_mirrored && !may_mirror {
                    continue;
                }
                let moments = moments(region, &frame, length_mm);
                if best.as_ref().is_none_or(|(_, b)| is_more(&moments, b)) {
                    best = Some((frame, moments));
                }
            }
        }
        let mut frame = best.map_or(frame, |(frame, _)| frame);
        let bounds = frame.region_in(region).bounds();
        frame.centre = frame.point_out(nalgebra::center(&bounds.min, &bounds.max));
        frame
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

/// Centre of gravity of the boundary.
fn middle(region: &Region, length_mm: f64) -> Point2 {
    let origin = Box2::of(&region.exterior.points).min;
    let weighted = region.edges().map(|(a, b)| {
        let middle = nalgebra::center(&a, &b) - origin;
        middle * (b - a).norm()
    });
    origin + weighted.sum::<Vector2>() / length_mm
}

/// Direction modulo a quarter turn that most of the boundary has, if any.
fn prevailing_rad(region: &Region, length_mm: f64) -> Option<f64> {
    let fourfold = region.edges().map(|(a, b)| {
        let along = b - a;
        let angle_rad = 4.0 * along.y.atan2(along.x);
        Vector2::new(angle_rad.cos(), angle_rad.sin()) * along.norm()
    });
    let mean = fourfold.sum::<Vector2>() / length_mm;
    (mean.norm() >= PREVAILS_SHARE).then(|| mean.y.atan2(mean.x) / 4.0)
}

/// Direction to the vertex farthest out; the first of equals.
fn farthest_rad(region: &Region, centre: Point2) -> f64 {
    let mut farthest = Vector2::new(1.0, 0.0) * f64::MIN_POSITIVE;
    for p in &region.exterior.points {
        let v = p - centre;
        if v.norm() > (1.0 + SAME_RADIUS_SHARE) * farthest.norm() {
            farthest = v;
        }
    }
    farthest.y.atan2(farthest.x)
}

/// Moments of the boundary in the frame that tell its turns and mirror images apart.
fn moments(region: &Region, frame: &Frame, length_mm: f64) -> Vec<f64> {
    let mut sums = [0.0; 9];
    let mut radius_mm = 0.0;
    for (a, b) in region.edges() {
        let (a, b) = (frame.point_in(a), frame.point_in(b));
        let edge_mm = (b - a).norm();
        for (t, weight) in NODES {
            let p = a + (b - a) * t;
            let (x, y, weight) = (p.x, p.y, weight * edge_mm / length_mm);
            let terms = [
                x * x - y * y,
                x * x * x,
                x * y * y,
                y * y * y,
                x * x * y,
                x * y,
                x * x * x * y - x * y * y * y,
                x.powi(5) - 10.0 * x.powi(3) * y * y + 5.0 * x * y.powi(4),
                5.0 * x.powi(4) * y - 10.0 * x * x * y.powi(3) + y.powi(5),
            ];
            radius_mm += weight * p.coords.norm();
            for (sum, term) in sums.iter_mut().zip(terms) {
                *sum += weight * term;
            }
        }
    }
    const DEGREES: [i32; 9] = [2, 3, 3, 3, 3, 2, 4, 5, 5];
    let scaled = sums.iter().zip(DEGREES);
    scaled
        .map(|(sum, degree)| sum / radius_mm.powi(degree))
        .collect()
}

/// True where the first moment that differs is greater.
fn is_more(moments: &[f64], than: &[f64]) -> bool {
    let mut pairs = moments.iter().zip(than);
    pairs
        .find(|(m, n)| (**m - **n).abs() > SAME_SHARE)
        .is_some_and(|(m, n)| m > n)
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
            let own = Frame::of_region(shape, true).region_in(shape);
            for k in 0..40 {
                let pose = Frame {
                    centre: Point2::new(3.0 * f64::from(k), -7.0),
                    turn_rad: 0.37 * f64::from(k),
                    is_mirrored: k % 2 == 1,
                };
                let posed = pose.region_in(shape);
                let frame = Frame::of_region(&posed, true);
                let apart_mm = farthest_apart_mm(&frame.region_in(&posed), &own);
                assert!(apart_mm < 1e-9, "pose {k}: {apart_mm}");
            }
        }
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

    /// Goal: where mirroring is not allowed, quarter turns still are. Method: a mirrored shape comes
    /// out mirrored.
    #[test]
    fn mirroring_can_be_forbidden() {
        let shape = region(&[[0.0, 0.0], [9.0, 0.0], [5.0, 8.0]]);
        for turn_rad in [0.0, 1.0, 2.0] {
            let pose = Frame {
                turn_rad,
                is_mirrored: true,
                ..Frame::IDENTITY
            };
            let posed = pose.region_in(&shape);
            assert!(!Frame::of_region(&posed, false).is_mirrored);
        }
    }
}
