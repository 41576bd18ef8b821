//! r(p): radius of the largest disk inside the region that touches the boundary at p.
//!
//! In closed form, edge by edge, and so independent of any medial axis: the disk of radius rho
//! about p + rho N touches another boundary point q where rho = |q - p|² / (2 N·(q - p)); over a
//! straight edge the smallest rho is the one that touches the edge's line (where the foot falls on
//! the edge) or one of its ends. It is r(p) of docs/glossary.md.

use super::edge_index::{Edge, EdgeIndex};
use super::polygon::Box2;
use super::{Point2, Vector2};

/// An edge closer to `p` than this counts as through `p`, mm.
const ON_EDGE_MM: f64 = 1e-9;
/// Directions within this angle of the tangent at `p` are along the boundary, rad.
const GRAZING_RAD: f64 = 1e-9;

/// Radius, mm, of the largest disk inside the region that touches its boundary at `p` from the side
/// of the unit normal `normal`; 0 in a convex corner, infinite if there is nothing opposite.
/// `index` has the region's edges; `p` should be on one of them (or be a reflex vertex, with a
/// normal between those of its two edges).
pub fn tangent_disk_radius_mm(index: &EdgeIndex, p: Point2, normal: Vector2) -> f64 {
    let size = index.bounds().size();
    let reach_max_mm = size.norm() + (p - index.bounds().min).norm();
    let mut reach_mm = index.cell_mm().min(reach_max_mm);
    loop {
        // Everything the disk of radius `reach_mm` can touch is in its own box.
        let center = p + normal * reach_mm;
        let area = Box2 {
            min: center,
            max: center,
        }
        .grown(reach_mm + ON_EDGE_MM);
        let mut radius_mm = f64::INFINITY;
        index.for_edges_in(area, |number| {
            let edge = &index.edges()[number];
            // Behind the tangent nothing is touched.
            let behind = |q: Point2| (q - p).dot(&normal) <= 0.0;
            if !(behind(edge.a) && behind(edge.b)) {
                radius_mm = radius_mm.min(radius_to_edge_mm(edge, p, normal));
            }
        });
        if radius_mm <= reach_mm || reach_mm >= reach_max_mm {
            return radius_mm;
        }
        // What was found bounds how far to look.
        reach_mm = (reach_mm * 2.0).min(radius_mm).min(reach_max_mm);
    }
}

/// The smallest radius at which the growing disk touches this edge.
fn radius_to_edge_mm(edge: &Edge, p: Point2, normal: Vector2) -> f64 {
    let (to_a, to_b) = (edge.a - p, edge.b - p);
    if (p - edge.foot(p)).norm() <= ON_EDGE_MM {
        let rises = |w: &Vector2| normal.dot(w) > GRAZING_RAD.max(1e-7 * w.norm());
        return if rises(&to_a) || rises(&to_b) {
            0.0
        } else {
            f64::INFINITY
        };
    }
    touching_radius(to_a, to_b, normal)
}

/// Radius of the disk that touches the origin from the side of `normal` and the segment a-b, which
/// does not contain the origin; infinite if the segment is behind the tangent. Unit as in the
/// input.
pub fn touching_radius(a: Vector2, b: Vector2, normal: Vector2) -> f64 {
    let radius_to_point = |w: &Vector2| {
        let rise = normal.dot(w);
        if rise <= GRAZING_RAD * w.norm() {
            f64::INFINITY
        } else {
            w.norm_squared() / (2.0 * rise)
        }
    };
    let ends = radius_to_point(&a).min(radius_to_point(&b));
    let along = b - a;
    let length = along.norm();
    if length <= 0.0 {
        return ends;
    }
    // The segment's line, its normal turned away from the origin: touched where the distance to it
    // equals the radius.
    let mut across = Vector2::new(-along.y, along.x) / length;
    let mut distance = across.dot(&a);
    if distance < 0.0 {
        (across, distance) = (-across, -distance);
    }
    let closing = 1.0 + across.dot(&normal);
    if closing <= 1e-12 {
        return ends;
    }
    let radius = distance / closing;
    let touch = (normal + across) * radius;
    let t = along.dot(&(touch - a)) / (length * length);
    if (0.0..=1.0).contains(&t) {
        radius.min(ends)
    } else {
        ends
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::{random_numbers, star, walls};

    fn moved<const N: usize>(points: [[f64; 2]; N], offset: f64) -> EdgeIndex {
        walls(&[&points.map(|[x, y]| [x + offset, y + offset])])
    }

    /// Goal: closed forms of shapes with a known answer. Method: rectangle (half width, and the
    /// corner's bisector), reflex corner (touching the vertex: |q|²/(2 N·q)), far offset.
    #[test]
    fn known_radii() {
        let up = Vector2::new(0.0, 1.0);
        for offset in [0.0, 1e4] {
            let at = |x: f64, y: f64| Point2::new(x + offset, y + offset);
            let rectangle = moved([[0.0, 0.0], [40.0, 0.0], [40.0, 6.0], [0.0, 6.0]], offset);
            assert!((tangent_disk_radius_mm(&rectangle, at(20.0, 0.0), up) - 3.0).abs() < 1e-9);
            assert!((tangent_disk_radius_mm(&rectangle, at(0.25, 0.0), up) - 0.25).abs() < 1e-9);
            let step = moved(
                [
                    [0.0, 0.0],
                    [20.0, 0.0],
                    [20.0, 20.0],
                    [10.0, 20.0],
                    [10.0, 4.0],
                    [0.0, 4.0],
                ],
                offset,
            );
            // Disk on the floor at x = 12.5 touches the wall x = 20 or the vertex (10, 4).
            let vertex = (2.5f64 * 2.5 + 16.0) / 8.0;
            let found = tangent_disk_radius_mm(&step, at(12.5, 0.0), up);
            assert!((found - vertex).abs() < 1e-9, "{found}");
            assert_eq!(tangent_disk_radius_mm(&step, at(0.0, 0.0), up), 0.0);
        }
    }

    /// Goal: the disk found is inside and touches. Method: random points of a random star; its
    /// centre's distance to the boundary must equal the radius.
    #[test]
    fn disk_touches_and_stays_inside() {
        let mut random = random_numbers(7);
        let index = walls(&[&star(120, |_| 6.0 + 8.0 * random())]);
        let mut checked = 0;
        for edge in index.edges() {
            let p = edge.a + (edge.b - edge.a) * (0.05 + 0.9 * random());
            let radius = tangent_disk_radius_mm(&index, p, edge.normal());
            let center = p + edge.normal() * radius;
            let clear = index.nearest(center).unwrap().distance_mm;
            assert!((clear - radius).abs() < 1e-8, "{clear} {radius}");
            checked += 1;
        }
        assert_eq!(checked, 120);
    }
}
