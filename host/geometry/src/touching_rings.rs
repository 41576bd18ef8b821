//! Regions whose boundary touches itself in a vertex, rewritten so that every ring turns back
//! there.
//!
//! A region of zero thickness at a vertex has several possible boundaries: one ring may pass straight
//! by another that touches it, or both turn into each other. An algorithm that follows a ring along
//! its inside must not go through a passage of zero width, so each ring here continues with the edge
//! that bounds the same corner of the interior. Input: a region. Output: the same area, as several
//! regions where only such vertices connect it.

use super::Point2;
use super::polygon::{Region, Ring};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// The region with rings that turn back where they touch; unchanged if none does.
pub fn turned_back(region: Region) -> Vec<Region> {
    let edges: Vec<(Point2, Point2)> = region.edges().collect();
    let place = |p: &Point2| [p.x, p.y].map(f64::to_bits);
    let mut leaving: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (number, (from, _)) in edges.iter().enumerate() {
        leaving.entry(place(from)).or_default().push(number);
    }
    if leaving.values().all(|edges| edges.len() == 1) {
        return vec![region];
    }
    let behind: Option<Vec<usize>> = edges
        .iter()
        .map(|&(from, at)| {
            // The inside is clockwise of the way back.
            let back = from - at;
            let turn_rad = |edge: &usize| {
                let out = edges[*edge].1 - at;
                let turn_rad = out.perp(&back).atan2(out.dot(&back));
                if turn_rad > 0.0 {
                    turn_rad
                } else {
                    turn_rad + TAU
                }
            };
            let leaving = leaving.get(&place(&at))?.iter();
            leaving
                .min_by(|x, y| turn_rad(x).total_cmp(&turn_rad(y)))
                .copied()
        })
        .collect();
    let rings = behind.and_then(|behind| rings_along(&edges, &behind));
    rings.map_or_else(|| vec![region], regions_of)
}

/// The rings that edges form, each followed by its successor in `behind`; `None` if two edges have
/// the same successor.
fn rings_along(edges: &[(Point2, Point2)], behind: &[usize]) -> Option<Vec<Ring>> {
    let mut seen = vec![false; edges.len()];
    let mut rings = Vec::new();
    for first in 0..edges.len() {
        let mut points = Vec::new();
        let mut at = first;
        while !seen[at] {
            seen[at] = true;
            points.push(edges[at].0);
            at = behind[at];
        }
        if points.is_empty() {
            continue;
        }
        if at != first {
            return None;
        }
        rings.push(Ring { points });
    }
    Some(rings)
}

/// Rings about the inside with the holes in them.
fn regions_of(rings: Vec<Ring>) -> Vec<Region> {
    let (exteriors, holes): (Vec<_>, Vec<_>) = rings
        .into_iter()
        .filter(|ring| ring.points.len() > 2)
        .partition(|ring| ring.signed_area_mm2() > 0.0);
    let region = |exterior| Region {
        exterior,
        holes: Vec::new(),
    };
    let mut regions: Vec<Region> = exteriors.into_iter().map(region).collect();
    // Before any has its holes: one may be in a hole of another.
    let around = |hole: &Ring| {
        // Not a vertex, which may be the exterior's as well.
        let inner = nalgebra::center(&hole.points[0], &hole.points[1]);
        let numbered = regions.iter().enumerate();
        let least = numbered
            .filter(|(_, region)| region.contains(inner))
            .min_by(|(_, x), (_, y)| x.area_mm2().total_cmp(&y.area_mm2()));
        least.map_or(0, |(number, _)| number)
    };
    let homes: Vec<usize> = holes.iter().map(around).collect();
    for (hole, home) in holes.into_iter().zip(homes) {
        if let Some(region) = regions.get_mut(home) {
            region.holes.push(hole);
        }
    }
    regions
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::region;

    /// Goal: a ring that touches another goes on along it, the ground stays, and what hangs together by
    /// one vertex alone becomes several. Method: a square with a diamond in it that touches the middle of
    /// the bottom, of bottom and top, or of all sides.
    #[test]
    fn rings_turn_back_where_they_touch() {
        let square = [
            [-2.0, -2.0],
            [0.0, -2.0],
            [2.0, -2.0],
            [2.0, 0.0],
            [2.0, 2.0],
            [0.0, 2.0],
            [-2.0, 2.0],
            [-2.0, 0.0],
        ];
        for (reach, parts, points) in [
            ([1.0, 1.0, 1.0], 1, vec![8, 4]),
            ([2.0, 1.0, 1.0], 1, vec![12]),
            ([2.0, 2.0, 1.0], 2, vec![6, 6]),
            ([2.0, 2.0, 2.0], 4, vec![3, 3, 3, 3]),
        ] {
            let [low, high, beside] = reach;
            let diamond = [[0.0, -low], [-beside, 0.0], [0.0, high], [beside, 0.0]];
            let whole = region(&[&square, &diamond]);
            let parted = turned_back(whole.clone());
            assert_eq!(parted.len(), parts, "{reach:?}");
            let counts = parted
                .iter()
                .flat_map(Region::rings)
                .map(|r| r.points.len());
            assert_eq!(counts.collect::<Vec<_>>(), points, "{reach:?}");
            let area_mm2 = parted.iter().map(Region::area_mm2).sum::<f64>();
            assert!((area_mm2 - whole.area_mm2()).abs() < 1e-12);
        }
    }

    /// Goal: a hole stays in the part that it lies in. Method: two squares that touch in a corner, drawn
    /// as one ring, a hole in the second.
    #[test]
    fn holes_stay_where_they_are() {
        let both = [
            [0.0, 0.0],
            [0.0, 2.0],
            [-2.0, 2.0],
            [-2.0, 0.0],
            [0.0, 0.0],
            [0.0, -2.0],
            [2.0, -2.0],
            [2.0, 0.0],
        ];
        let hole = [[0.5, -0.5], [1.5, -0.5], [1.5, -1.5], [0.5, -1.5]];
        let parted = turned_back(region(&[&both, &hole]));
        let holes: Vec<usize> = parted.iter().map(|part| part.holes.len()).collect();
        let mut areas_mm2: Vec<f64> = parted.iter().map(Region::area_mm2).collect();
        areas_mm2.sort_by(f64::total_cmp);
        assert_eq!(areas_mm2, [3.0, 4.0]);
        assert_eq!(holes.iter().sum::<usize>(), 1);
    }

    /// Goal: a hole of an island that touches the hole it lies in is the island's. Method: a square with a
    /// square hole, a diamond in it that stands on its side and has a hole, which comes first.
    #[test]
    fn an_island_keeps_its_hole() {
        let square = [[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]];
        let own = [[-0.3, -2.0], [0.0, -1.7], [0.3, -2.0], [0.0, -2.3]];
        let hole_and_island = [
            [-3.0, -3.0],
            [-3.0, 3.0],
            [3.0, 3.0],
            [3.0, -3.0],
            [0.0, -3.0],
            [1.0, -2.0],
            [0.0, -1.0],
            [-1.0, -2.0],
            [0.0, -3.0],
        ];
        let parted = turned_back(region(&[&square, &own, &hole_and_island]));
        let found = parted
            .iter()
            .map(|part| (part.area_mm2(), part.holes.len()));
        let found: Vec<_> = found.collect();
        assert_eq!(found.len(), 2);
        assert!(
            (found[0].0 - 28.0).abs() < 1e-12 && found[0].1 == 1,
            "{found:?}"
        );
        assert!(
            (found[1].0 - 1.82).abs() < 1e-12 && found[1].1 == 1,
            "{found:?}"
        );
    }
}
