//! A region cut along chords across its passages.

use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::{Point2, Vector2};
use i_overlay::core::fill_rule::FillRule;
use i_overlay::float::slice::FloatSlice;

/// The cut across the passage at an axis node: wall foot, node, wall foot, each end drawn a little
/// beyond the wall so that the slice surely parts the region.
pub fn chord(at: Point2, towards: Point2, walls: &EdgeIndex, radius_mm: f64) -> Vec<Point2> {
    let along = (towards - at).try_normalize(1e-12).unwrap_or(Vector2::x());
    let across = Vector2::new(-along.y, along.x);
    let foot = |side: f64| {
        let probe = at + across * (side * 0.3 * radius_mm);
        let foot = walls.nearest(probe).map_or(probe, |n| n.foot);
        let beyond = (foot - at).try_normalize(1e-12).unwrap_or(across * side);
        foot + beyond * CHORD_BEYOND_MM
    };
    vec![foot(1.0), at, foot(-1.0)]
}

/// How far a chord passes the wall: above the slicer's grid, below any wall thickness.
const CHORD_BEYOND_MM: f64 = 1e-4;

/// Points of a piece closer than this are one: far above the slicer's grid.
const SAME_POINT_MM: f64 = 1e-5;

/// Cuts the region along the chords.
pub fn slice(region: &Region, chords: &[Vec<Point2>]) -> Vec<Region> {
    let origin = region.bounds().min;
    let to_array = |p: &Point2| [p.x - origin.x, p.y - origin.y];
    let shape: Vec<Vec<[f64; 2]>> = region
        .rings()
        .map(|r| r.points.iter().map(to_array).collect())
        .collect();
    let strings: Vec<Vec<[f64; 2]>> = chords
        .iter()
        .map(|c| c.iter().map(to_array).collect())
        .collect();
    let pieces = shape.slice_by_as::<i64>(&strings, FillRule::EvenOdd);
    let to_ring = |path: &Vec<[f64; 2]>| {
        let points = path.iter();
        let points = points.map(|p| Point2::new(p[0] + origin.x, p[1] + origin.y));
        let mut ring = Ring {
            points: points.collect(),
        };
        // Where a cut meets the wall beside a vertex, the slicer's grid leaves one point or two.
        let is_same = |a: &mut Point2, b: &mut Point2| (*a - *b).norm() < SAME_POINT_MM;
        ring.points.dedup_by(is_same);
        ring.begin_at_extreme();
        ring
    };
    pieces
        .iter()
        .filter(|rings| !rings.is_empty())
        .map(|rings| Region {
            exterior: to_ring(&rings[0]),
            holes: rings[1..].iter().map(to_ring).collect(),
        })
        .collect()
}
