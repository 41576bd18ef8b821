//! How far apart two outlines of nearly the same ground are.
//!
//! Layers of a part mostly are like the next one, and then what lies over and under it need not be cut out: it is within
//! the walls.
//!
//! In: disjoint regions (mm) and a largest distance. Out: a bound of how far each outline is from the other; `None` where
//! that is more, or the two do not enclose the same side.

use crate::Point2;
use crate::edge_index::{Edge, EdgeIndex};
use crate::polygon::Region;

/// Least cosine between an edge and the nearest one of the other outline: those of a fold run against each other.
const ALONG_COS: f64 = -0.5;
/// Most parts that an edge is halved into, as a power of two.
const HALVINGS: u32 = 12;

/// A bound of the distance from any point of either outline to the other outline, at most `most_mm`. What one region has
/// and the other has not then lies within that distance of its outline.
pub fn apart_mm(one: &[Region], other: &[Region], most_mm: f64) -> Option<f64> {
    if one == other {
        return Some(0.0);
    }
    let count = |regions: &[Region]| regions.iter().flat_map(Region::rings).count();
    if count(one) != count(other) || count(one) == 0 {
        return None;
    }
    let [one, other] = [one, other].map(|regions| {
        let edges = regions.iter().flat_map(Region::edges);
        let edges: Vec<Edge> = edges.map(|(a, b)| Edge { a, b }).collect();
        let length_mm: f64 = edges.iter().map(Edge::length_mm).sum();
        let cell_mm = most_mm.max(length_mm / edges.len() as f64);
        EdgeIndex::new(edges, cell_mm)
    });
    let there_mm = farthest_mm(&one, &other, most_mm)?;
    let back_mm = farthest_mm(&other, &one, most_mm)?;
    Some(there_mm.max(back_mm))
}

fn farthest_mm(of: &EdgeIndex, from: &EdgeIndex, most_mm: f64) -> Option<f64> {
    let mut farthest_mm: f64 = 0.0;
    for edge in of.edges() {
        farthest_mm = farthest_mm.max(of_part(*edge, from, most_mm, HALVINGS)?);
    }
    Some(farthest_mm)
}

/// The bound of an edge: the distance to one other edge is a convex function along it, so that it is greatest at an end.
/// Where no single edge is near enough the halves are looked at.
fn of_part(edge: Edge, from: &EdgeIndex, most_mm: f64, halvings: u32) -> Option<f64> {
    let (a, b) = edge.ends();
    let middle = nalgebra::center(&a, &b);
    let nearest = from.nearest_within(middle, most_mm)?;
    let along = from.edges()[nearest.edge];
    let runs_along = edge.normal().dot(&along.normal()) > ALONG_COS;
    if !runs_along && edge.length_mm() > 0.0 {
        return None;
    }
    let to = |p: Point2| (along.foot(p) - p).norm();
    let bound_mm = to(a).max(to(b));
    if bound_mm <= most_mm {
        return Some(bound_mm);
    }
    let halvings = halvings.checked_sub(1)?;
    let halves = [Edge { a, b: middle }, Edge { a: middle, b }];
    let [low_mm, high_mm] = halves.map(|half| of_part(half, from, most_mm, halvings));
    Some(low_mm?.max(high_mm?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector2;
    use crate::boolean::{difference, grown};
    use crate::test_shapes::{random_numbers, region, star};

    /// Goal: the bound holds what one region has beyond the other, and is hardly larger than needed. Method: random stars
    /// with edges of all lengths, moved and turned a little; what of each lies farther out than the other grown by the
    /// bound, which no overlay may find; a shift's bound against its length.
    #[test]
    fn nothing_lies_beyond_the_bound() {
        let mut random = random_numbers(4);
        for count in [5, 40, 300] {
            let points = star(count, |_| 9.0 + 2.0 * random());
            let by = Vector2::new(0.1, -0.05) * random();
            let turned = nalgebra::Rotation2::new(0.004 * random());
            let other: Vec<[f64; 2]> = (points.iter())
                .map(|p| (turned * Point2::from(*p) + by).coords.into())
                .collect();
            let [one, other] = [&points, &other].map(|points| vec![region(&[points])]);
            let bound_mm = apart_mm(&one, &other, 0.5).expect("near");
            assert!(
                bound_mm > 0.0 && bound_mm <= by.norm() + 0.004 * 11.0,
                "{bound_mm}"
            );
            for (p, q) in [(&one, &other), (&other, &one)] {
                let beyond = difference(p, &grown(q, bound_mm * 1.001 + 1e-6));
                let beyond_mm2: f64 = beyond.iter().map(Region::area_mm2).sum();
                assert!(beyond_mm2 < 1e-6, "{count}: {beyond_mm2}");
            }
            let shifted: Vec<Region> = one.iter().map(|r| r.shifted(by)).collect();
            let apart_mm = apart_mm(&one, &shifted, 0.5).expect("near");
            assert!(apart_mm <= by.norm() + 1e-9, "{apart_mm} {}", by.norm());
        }
    }

    /// Goal: outlines that are near each other everywhere and enclose something else are told apart. Method: a square
    /// against a thin frame along its outline, the same opened to one ring that runs out and back, a square with one
    /// corner cut off by more, a hole more.
    #[test]
    fn what_encloses_something_else_is_not_near() {
        let square: &[[f64; 2]] = &[[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]];
        let hole: &[[f64; 2]] = &[[0.1, 0.1], [0.1, 9.9], [9.9, 9.9], [9.9, 0.1]];
        let folded: &[[f64; 2]] = &[
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 10.0],
            [0.0, 10.0],
            [0.0, 0.05],
            [0.1, 0.1],
            [0.1, 9.9],
            [9.9, 9.9],
            [9.9, 0.1],
            [0.1, 0.05],
        ];
        let cut: &[[f64; 2]] = &[
            [0.0, 0.0],
            [9.0, 0.0],
            [10.0, 1.0],
            [10.0, 10.0],
            [0.0, 10.0],
        ];
        let one = [region(&[square])];
        let others: [&[&[[f64; 2]]]; 4] =
            [&[square, hole], &[folded], &[cut], &[square, &hole[..3]]];
        for rings in others {
            assert_eq!(apart_mm(&one, &[region(rings)], 0.3), None, "{rings:?}");
        }
        assert_eq!(apart_mm(&one, &one, 0.3), Some(0.0));
        assert_eq!(apart_mm(&[], &one, 0.3), None);
        let bound_mm = apart_mm(&one, &[region(&[cut])], 1.0).expect("near");
        assert!((bound_mm - 0.5f64.sqrt()).abs() < 0.3, "{bound_mm}");
    }
}
