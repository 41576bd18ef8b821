//! A region cut along chords across its passages.
//!
//! In: a region (mm), axis nodes where it is to be cut. Out: its parts (mm), each valid. Chords
//! extend 0.1 µm beyond the walls; the parts are smaller by that much.

use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::touching_rings::turned_back;
use crate::geometry::{Point2, Vector2};
use i_overlay::core::fill_rule::FillRule;
use i_overlay::float::slice::FloatSlice;

/// The cut across the passage at an axis node: wall foot, node, wall foot; the feet are those on either
/// side of `seen_from`, the node or one near it. Each end is on a corner of the wall or a little beyond
/// the wall, so that the cut certainly divides the region.
pub fn chord(
    at: Point2,
    towards: Point2,
    seen_from: Point2,
    walls: &EdgeIndex,
    radius_mm: f64,
) -> Vec<Point2> {
    let along = (towards - at).try_normalize(1e-12).unwrap_or(Vector2::x());
    let across = Vector2::new(-along.y, along.x);
    let foot = |side: f64| {
        let probe = seen_from + across * (side * PROBE_SHARE * radius_mm);
        let Some(nearest) = walls.nearest(probe) else {
            return probe;
        };
        let (foot, edge) = (nearest.foot, walls.edges()[nearest.edge]);
        let is_at = |corner: &Point2| (foot - corner).norm() < AT_CORNER_MM;
        if let Some(corner) = [edge.a, edge.b].into_iter().find(is_at) {
            // Straight on through a corner the slicer may take the chord for one that only touches it.
            return corner;
        }
        let beyond = (foot - at).try_normalize(1e-12).unwrap_or(across * side);
        foot + beyond * CHORD_BEYOND_MM
    };
    vec![foot(1.0), at, foot(-1.0)]
}

/// How far a chord passes the wall: above the slicer's grid, below any wall thickness.
const CHORD_BEYOND_MM: f64 = 1e-4;

/// Distance from the axis at which a wall is sought, against the distance of the walls.
const PROBE_SHARE: f64 = 0.3;

/// A foot this close to a corner is at it, mm.
const AT_CORNER_MM: f64 = 1e-6;

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
    let to_ring = |path: &Vec<[f64; 2]>| Ring {
        points: path.iter().map(|p| Point2::new(p[0], p[1])).collect(),
    };
    pieces
        .iter()
        .filter(|rings| !rings.is_empty())
        .map(|rings| Region {
            exterior: to_ring(&rings[0]),
            holes: rings[1..].iter().map(to_ring).collect(),
        })
        // Two chords from one corner of the walls leave an area of zero width there.
        .flat_map(turned_back)
        .map(|piece| finished(piece, origin))
        .collect()
}

/// The piece back in its place, its points where they should be.
fn finished(mut piece: Region, origin: Point2) -> Region {
    for ring in piece.rings_mut() {
        for point in &mut ring.points {
            *point += origin.coords;
        }
        // Where a cut meets the wall next to a vertex, the slicer's grid leaves one point or two.
        let is_same = |a: &mut Point2, b: &mut Point2| (*a - *b).norm() < SAME_POINT_MM;
        ring.points.dedup_by(is_same);
        ring.begin_at_extreme();
    }
    piece
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::region;

    /// Goal: a chord parts the region wherever its feet are, corners of the wall among them (found on a
    /// snowflake: a pass was led through a neck that was not cut off). Method: passages between two
    /// walls with a corner each, straight across from each other, at many angles of the corners and of
    /// the whole.
    #[test]
    fn chords_through_corners_part_the_region() {
        let mut cuts = 0;
        for turn in 0..24 {
            for slope in 1..12 {
                let (sin, cos) = (0.131 * f64::from(turn)).sin_cos();
                let rise = 0.3 * f64::from(slope);
                let outline = [
                    [-2.0, -0.5 - 2.0 * rise],
                    [0.0, -0.5],
                    [2.0, -0.5 - 2.0 * rise],
                    [2.0, 0.5 + 2.0 * rise],
                    [0.0, 0.5],
                    [-2.0, 0.5 + 2.0 * rise],
                ];
                let turned = |[x, y]: [f64; 2]| [x * cos - y * sin, x * sin + y * cos];
                let region = region(&[&outline.map(turned)]);
                let walls = EdgeIndex::of_region(&region, 1.0);
                for shift in [0.0, 0.02, 0.05, 0.1, 0.2] {
                    let at = Point2::from(turned([shift, 0.0]));
                    let towards = Point2::from(turned([shift + 0.1, 0.0]));
                    let cut = chord(at, towards, at, &walls, 0.5);
                    let pieces = slice(&region, &[cut]);
                    assert_eq!(pieces.len(), 2, "turn {turn}, slope {slope}, shift {shift}");
                    let whole_mm2 = pieces.iter().map(Region::area_mm2).sum::<f64>();
                    // Points that were merged: 1e-5 mm along edges of some mm.
                    assert!((whole_mm2 - region.area_mm2()).abs() < 1e-4);
                    cuts += 1;
                }
            }
        }
        assert_eq!(cuts, 24 * 11 * 5);
    }

    /// Goal: a neck between two corners is cut off on both its sides, and whoever follows the walls does
    /// not pass it (found on a snowflake: a loop went through six necks and was cut there again). Method: a
    /// ring between a notch of the outline and a corner of the hole; both chords from the one to the other.
    #[test]
    fn a_neck_between_two_corners_is_cut_off_on_both_sides() {
        let outline = [
            [-3.0, -3.0],
            [3.0, -3.0],
            [3.0, 2.0],
            [0.0, 1.3],
            [-3.0, 2.0],
        ];
        let hole = [[0.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];
        let region = region(&[&outline, &hole]);
        let walls = EdgeIndex::of_region(&region, 1.0);
        let cuts = [-0.1, 0.1].map(|x| {
            let at = Point2::new(x, 1.15);
            chord(at, Point2::new(2.0 * x, 1.15), at, &walls, 0.18)
        });
        let pieces = slice(&region, &cuts);
        let mut rings: Vec<usize> = pieces.iter().map(|piece| piece.rings().count()).collect();
        rings.sort_unstable();
        // The neck and the rest, whose outline continues along the hole.
        assert_eq!(rings, [1, 1]);
        let area_mm2 = pieces.iter().map(Region::area_mm2).sum::<f64>();
        assert!((area_mm2 - region.area_mm2()).abs() < 1e-4);
    }

    /// Goal: branches that are cut off where they leave a joint leave the others whole (found on a
    /// lattice: two beads were laid over one in all its struts). Method: a cross of four arms whose middle
    /// is as far from all its corners; the left arm and the lower one are cut off.
    #[test]
    fn chords_at_a_joint_cut_their_own_branches_off() {
        let (near, far) = (0.4, 5.0);
        let cross = [
            [-near, -far],
            [near, -far],
            [near, -near],
            [far, -near],
            [far, near],
            [near, near],
            [near, far],
            [-near, far],
            [-near, near],
            [-far, near],
            [-far, -near],
            [-near, -near],
        ];
        let region = region(&[&cross]);
        let walls = EdgeIndex::of_region(&region, 1.0);
        // Rounding is enough to make the far corners the nearest.
        let joint = Point2::new(1e-6, 1e-6);
        let cut = [Point2::new(-0.1, 0.0), Point2::new(0.0, -0.1)]
            .map(|next| chord(joint, next, next, &walls, near * 2f64.sqrt()));
        let pieces = slice(&region, &cut);
        let mut areas_mm2: Vec<f64> = pieces.iter().map(Region::area_mm2).collect();
        areas_mm2.sort_by(f64::total_cmp);
        // An arm and the quarter of the joint before it, twice; the rest.
        let arm_mm2 = 2.0 * near * (far - near) + near * near;
        assert_eq!(areas_mm2.len(), 3);
        for (area_mm2, expected_mm2) in areas_mm2.iter().zip([1.0, 1.0, 2.0]) {
            let error_mm2 = area_mm2 - expected_mm2 * arm_mm2;
            assert!(error_mm2.abs() < 1e-3, "{areas_mm2:?}, arm {arm_mm2}");
        }
    }
}
