//! Bridges of a layer: areas over open space that are held at two ends, and the direction of their
//! lines.
//!
//! Input: the outlines of a layer and of the one below (mm, input coordinates). Output: [`Bridge`]s, areas with the
//! direction of their lines: the one in which most of the area is between two anchors, and of equally good ones the
//! one whose longest span is the shortest. The directions of the area's own edges and across them, which are exact,
//! and an even fan are tried. Not covered: areas that are held at one end only (overhangs, which are reported), and
//! walls over open space.

use crate::geometry::boolean::{difference, filled, grown, intersection};
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::repair::FillRule;
use crate::geometry::{Point2, Vector2};
use std::f64::consts::{FRAC_PI_2, PI};

/// Distance by which the area is grown back after the part within reach of the anchors was removed, against
/// that reach: into right corners, which are the root of 2 away.
const GROWN_BACK_SHARE: f64 = 1.5;
/// Distance outside an edge at which the presence of the layer below is tested, mm: well above
/// rounding.
const LOOK_MM: f64 = 0.02;
/// Steps of the fan, and of the search around the best of it.
const FAN_RAD: f64 = PI / 36.0;
const FINE_RAD: f64 = PI / 180.0;
/// Directions of edges that are tried, the longest; those closer than this are one.
const EDGES_TRIED: usize = 24;
const SAME_RAD: f64 = PI / 1800.0;
/// Most lines by which a direction is judged.
const LINES_MAX: f64 = 1000.0;
/// Share of the best direction's area that an equal one may lack.
const EQUAL_SHARE: f64 = 0.02;

/// A bridged area of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct Bridge {
    /// Where nothing is below.
    pub ground: Vec<Region>,
    /// Direction of the lines, from anchor to anchor, against the x axis.
    pub angle_rad: f64,
    /// The longest way from one anchor to the next.
    pub span_mm: f64,
    /// Its anchors are the lines of the sparse infill below it.
    pub over_lines: bool,
}

/// The bridges of a layer over the one below; beads extend `reach_mm` over its edge without
/// support.
pub fn bridges(own: &[Region], below: &[Region], reach_mm: f64) -> Vec<Bridge> {
    let whole = open_space(own, below, reach_mm);
    let below: Vec<EdgeIndex> = below
        .iter()
        .map(|region| EdgeIndex::of_region(region, reach_mm))
        .collect();
    let bridge = |piece: &Region| bridge_of(piece, &below, reach_mm);
    whole.iter().filter_map(bridge).collect()
}

/// The area of a layer over nothing, of the pieces that extend farther over it than beads reach.
pub fn open_space(own: &[Region], below: &[Region], reach_mm: f64) -> Vec<Region> {
    if own == below {
        return Vec::new();
    }
    let mut hanging = difference(own, &grown(below, reach_mm));
    hanging.retain(|piece| is_wide(piece, reach_mm));
    if hanging.is_empty() {
        return hanging;
    }
    let open = difference(own, below);
    intersection(&grown(&hanging, GROWN_BACK_SHARE * reach_mm), &open)
}

/// Twice the area over the perimeter is the width of a strip.
pub fn is_wide(region: &Region, width_mm: f64) -> bool {
    let perimeter_mm: f64 = region.rings().map(Ring::perimeter_mm).sum();
    2.0 * region.area_mm2() >= width_mm * perimeter_mm
}

/// An edge of the open area.
#[derive(Clone, Copy)]
struct Side {
    a: Point2,
    b: Point2,
    /// The layer below is beyond it.
    is_anchor: bool,
}

/// What one direction gives.
struct Spans {
    angle_rad: f64,
    /// Ground between two anchors, mm².
    held_mm2: f64,
    /// The longest span, mm.
    longest_mm: f64,
    /// The held strips.
    strips: Vec<Ring>,
}

fn bridge_of(piece: &Region, below: &[EdgeIndex], reach_mm: f64) -> Option<Bridge> {
    let sides: Vec<Side> = piece
        .edges()
        .map(|(a, b)| Side {
            a,
            b,
            is_anchor: is_anchor(a, b, below),
        })
        .collect();
    let best = best_of(&sides, angles(&sides), reach_mm)?;
    let around = (-4..=4).map(|step| best.angle_rad + f64::from(step) * FINE_RAD);
    // The best itself among them goes before those that are no better.
    let around = std::iter::once(best.angle_rad).chain(around).collect();
    let best = best_of(&sides, around, reach_mm)?;
    let strips = filled(best.strips.iter(), FillRule::NonZero);
    let mut ground = intersection(&strips, std::slice::from_ref(piece));
    ground.retain(|region| is_wide(region, reach_mm));
    (!ground.is_empty()).then_some(Bridge {
        ground,
        angle_rad: best.angle_rad,
        span_mm: best.longest_mm,
        over_lines: false,
    })
}

/// Rings have the area on their left.
fn is_anchor(a: Point2, b: Point2, below: &[EdgeIndex]) -> bool {
    let Some(along) = (b - a).try_normalize(1e-12) else {
        return false;
    };
    let outside = nalgebra::center(&a, &b) + Vector2::new(along.y, -along.x) * LOOK_MM;
    below.iter().any(|region| region.contains(outside))
}

/// Directions to try: along and across the longest edges, and the fan.
fn angles(sides: &[Side]) -> Vec<f64> {
    let mut edges: Vec<(f64, f64)> = Vec::new();
    let mut by_length: Vec<&Side> = sides.iter().collect();
    by_length.sort_by(|p, q| (q.b - q.a).norm().total_cmp(&(p.b - p.a).norm()));
    for side in by_length {
        let along = side.b - side.a;
        // Along and across are both tried.
        let angle_rad = along.y.atan2(along.x).rem_euclid(FRAC_PI_2);
        let is_same = |known: f64| {
            let apart = (known - angle_rad).abs();
            apart.min(FRAC_PI_2 - apart) < SAME_RAD
        };
        match edges.iter_mut().find(|(known, _)| is_same(*known)) {
            Some((_, length_mm)) => *length_mm += along.norm(),
            None => edges.push((angle_rad, along.norm())),
        }
        if edges.len() >= 4 * EDGES_TRIED {
            break;
        }
    }
    edges.sort_by(|p, q| q.1.total_cmp(&p.1));
    edges.truncate(EDGES_TRIED);
    let exact = edges
        .into_iter()
        .flat_map(|(angle_rad, _)| [angle_rad, angle_rad + FRAC_PI_2]);
    let fan = (0..(PI / FAN_RAD).round() as u32).map(|step| f64::from(step) * FAN_RAD);
    exact.chain(fan).collect()
}

/// The direction with the most area between anchors; of equals that whose longest span is the shortest, of
/// those the first.
fn best_of(sides: &[Side], angles: Vec<f64>, reach_mm: f64) -> Option<Spans> {
    let all: Vec<Spans> = angles
        .into_iter()
        .map(|angle_rad| spans(sides, angle_rad, reach_mm))
        .collect();
    let most_mm2 = all.iter().map(|spans| spans.held_mm2).fold(0.0, f64::max);
    let equals = all
        .into_iter()
        .filter(|spans| most_mm2 > 0.0 && spans.held_mm2 >= (1.0 - EQUAL_SHARE) * most_mm2);
    // Rounding must not choose.
    equals.min_by_key(|spans| (spans.longest_mm * 1e3).round() as u64)
}

/// The lines in a direction across the area, and their parts between two anchors.
fn spans(sides: &[Side], angle_rad: f64, reach_mm: f64) -> Spans {
    let (sin, cos) = angle_rad.sin_cos();
    let (along, across) = (Vector2::new(cos, sin), Vector2::new(-sin, cos));
    let height = |p: Point2| p.coords.dot(&across);
    let heights = sides.iter().map(|side| height(side.a));
    let [low, high] = heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], h| {
        [low.min(h), high.max(h)]
    });
    let step_mm = (0.25 * reach_mm).max((high - low) / LINES_MAX);
    let count = ((high - low) / step_mm).ceil().max(1.0);
    let step_mm = (high - low) / count;
    // Where each line crosses an edge, and whether that is an anchor.
    let mut crossings: Vec<Vec<(f64, bool)>> = vec![Vec::new(); count as usize];
    for side in sides {
        let (from, to) = (height(side.a), height(side.b));
        let number = |h: f64| (h - low) / step_mm - 0.5;
        let first = number(from.min(to)).ceil().max(0.0) as usize;
        let behind = (number(from.max(to)).ceil().max(0.0) as usize).min(crossings.len());
        for (line, found) in crossings.iter_mut().enumerate().take(behind).skip(first) {
            let share = (low + (line as f64 + 0.5) * step_mm - from) / (to - from);
            let at = side.a + (side.b - side.a) * share;
            found.push((at.coords.dot(&along), side.is_anchor));
        }
    }
    let (mut held_mm, mut longest_mm) = (0.0, 0.0f64);
    let mut strips = Vec::new();
    for (line, mut found) in crossings.into_iter().enumerate() {
        found.sort_by(|p, q| p.0.total_cmp(&q.0));
        let middle = low + (line as f64 + 0.5) * step_mm;
        for pair in found.chunks_exact(2) {
            let [(from, at_start), (to, at_end)] = [pair[0], pair[1]];
            if !(at_start && at_end) {
                continue;
            }
            held_mm += to - from;
            longest_mm = longest_mm.max(to - from);
            // A little more on all sides: the area cuts it off again.
            let half_mm = 0.5 * step_mm + LOOK_MM;
            let corner = |t: f64, h: f64| Point2::from(along * t + across * h);
            let (from, to) = (from - reach_mm, to + reach_mm);
            strips.push(Ring {
                points: vec![
                    corner(from, middle - half_mm),
                    corner(to, middle - half_mm),
                    corner(to, middle + half_mm),
                    corner(from, middle + half_mm),
                ],
            });
        }
    }
    Spans {
        angle_rad,
        held_mm2: held_mm * step_mm,
        longest_mm,
        strips,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::region;
    use nalgebra::Rotation2;

    fn box_of(low: [f64; 2], high: [f64; 2]) -> Region {
        let ([x, y], [u, v]) = (low, high);
        region(&[&[[x, y], [u, y], [u, v], [x, v]]])
    }

    fn turned(regions: &[Region], angle_rad: f64) -> Vec<Region> {
        let turn = Rotation2::new(angle_rad);
        let ring = |ring: &Ring| Ring {
            points: ring.points.iter().map(|p| turn * p).collect(),
        };
        let region = |region: &Region| Region {
            exterior: ring(&region.exterior),
            holes: region.holes.iter().map(ring).collect(),
        };
        regions.iter().map(region).collect()
    }

    fn area_mm2(bridge: &Bridge) -> f64 {
        bridge.ground.iter().map(Region::area_mm2).sum()
    }

    /// Goal: a plate on two legs is bridged from leg to leg, however it lies. Method: a table turned by
    /// several angles; the span's direction and area by hand.
    #[test]
    fn a_table_is_bridged_from_leg_to_leg() {
        let plate = [box_of([0.0, 0.0], [30.0, 12.0])];
        let legs = [
            box_of([0.0, 0.0], [5.0, 12.0]),
            box_of([25.0, 0.0], [30.0, 12.0]),
        ];
        for turn_deg in [0.0, 17.3, 45.0, 90.0, 133.7f64] {
            let turn_rad = turn_deg.to_radians();
            let found = bridges(&turned(&plate, turn_rad), &turned(&legs, turn_rad), 0.6);
            assert_eq!(found.len(), 1, "{turn_deg}");
            let off_rad = (found[0].angle_rad - turn_rad).rem_euclid(PI);
            let off_rad = off_rad.min(PI - off_rad);
            assert!(off_rad.to_degrees() < 0.1, "{turn_deg}: {off_rad}");
            assert!((area_mm2(&found[0]) - 240.0).abs() < 0.1, "{turn_deg}");
        }
    }

    /// Goal: of a ceiling that is held all around, the short way; what juts out is no bridge; where only
    /// a part is held at two ends, that part. Method: shapes by hand.
    #[test]
    fn only_what_is_held_at_two_ends_is_bridged() {
        let ceiling = [box_of([0.0, 0.0], [20.0, 30.0])];
        let room = [region(&[
            &[[0.0, 0.0], [20.0, 0.0], [20.0, 30.0], [0.0, 30.0]],
            &[[4.0, 4.0], [4.0, 26.0], [16.0, 26.0], [16.0, 4.0]],
        ])];
        let found = bridges(&ceiling, &room, 0.6);
        assert_eq!(found.len(), 1);
        let angle_deg = found[0].angle_rad.to_degrees().rem_euclid(180.0);
        assert!(!(0.1..=179.9).contains(&angle_deg), "{angle_deg}");
        let held_mm2 = area_mm2(&found[0]);
        assert!((held_mm2 - 264.0).abs() < 0.1, "{held_mm2}");
        // A shelf.
        let shelf = [box_of([0.0, 0.0], [20.0, 10.0])];
        let post = [box_of([0.0, 0.0], [5.0, 10.0])];
        assert_eq!(bridges(&shelf, &post, 0.6), []);
        assert_eq!(bridges(&shelf, &shelf, 0.6), []);
        // A step that is no wider than beads reach.
        assert_eq!(
            bridges(&shelf, &[box_of([0.0, 0.0], [19.5, 10.0])], 0.6),
            []
        );
        // Legs half as wide as the plate: what lies between them.
        let table = [box_of([0.0, 0.0], [30.0, 12.0])];
        let legs = [
            box_of([0.0, 3.0], [5.0, 9.0]),
            box_of([25.0, 3.0], [30.0, 9.0]),
        ];
        let found = bridges(&table, &legs, 0.6);
        let held_mm2: f64 = found.iter().map(area_mm2).sum();
        assert!((held_mm2 - 120.0).abs() < 6.0, "{held_mm2}");
    }
}
