//! Outer walls of a level -> the outline of what is printed there.
//!
//! In: beads (mm). Out: regions. A loop is a run of outer walls, with the overhanging ones between them, whose ends meet
//! but for the gap at the seam. Its centre line moves outwards by half its width with sharp corners, that of a hole inwards;
//! where the width changes along the loop, by what its beads sweep.

use super::regions::Bead;
use crate::gcode::BeadKind;
use crate::geometry::Point2;
use crate::geometry::boolean::{difference, filled, mitred, swept};
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::repair::FillRule;
use std::collections::BTreeMap;

/// Largest gap at a seam, mm; wider loops leave half a width.
const SEAM_MM: f64 = 0.3;
/// Widths of a loop that differ by less are one.
const SAME_WIDTH_MM: f64 = 0.01;
/// Points that are the same, mm.
const SAME_MM: f64 = 1e-4;

/// A closed outer wall.
struct Loop {
    points: Vec<Point2>,
    widths_mm: Vec<f64>,
}

/// What the closed outer walls enclose, themselves included.
pub(super) fn outline(level: &[Bead]) -> Vec<Region> {
    let is_outer = |bead: &Bead| matches!(bead.kind, BeadKind::OuterWall | BeadKind::Overhang);
    let chains = level.chunk_by(|a, b| is_outer(a) && is_outer(b) && b.follows(a));
    let loops: Vec<Loop> = chains.filter_map(loop_of).collect();
    let rings: Vec<Ring> = loops.iter().map(Loop::ring).collect();
    let mut of_point: BTreeMap<[i64; 2], usize> = BTreeMap::new();
    for (number, ring) in rings.iter().enumerate() {
        of_point.extend(ring.points.iter().map(|point| (cell(*point), number)));
    }
    let of_ring = |ring: &Ring| {
        let mut known = ring.points.iter().map(|point| of_point.get(&cell(*point)));
        known
            .find_map(|number| number.copied())
            .map(|number| &loops[number])
    };
    let mut outline = Vec::new();
    for region in filled(rings.iter(), FillRule::EvenOdd) {
        let mut body = moved(&region.exterior, of_ring(&region.exterior), 1.0);
        for hole in &region.holes {
            let mut inside = hole.clone();
            inside.points.reverse();
            body = difference(&body, &moved(&inside, of_ring(hole), -1.0));
        }
        outline.extend(body);
    }
    filled(outline.iter().flat_map(Region::rings), FillRule::NonZero)
}

/// A run of beads whose ends meet.
fn loop_of(chain: &[Bead]) -> Option<Loop> {
    let is_wall = chain.iter().any(|bead| bead.kind == BeadKind::OuterWall);
    let (first, last) = (chain.first()?, chain.last()?);
    let gap_mm = (first.ends[0] - last.ends[1]).norm();
    let is_closed = gap_mm <= SEAM_MM.max(0.5 * first.width_mm);
    if !is_wall || chain.len() < 3 || !is_closed {
        return None;
    }
    let mut points: Vec<Point2> = chain.iter().map(|bead| bead.ends[0]).collect();
    if gap_mm > SAME_MM {
        points.push(last.ends[1]);
    }
    Some(Loop {
        points,
        widths_mm: chain.iter().map(|bead| bead.width_mm).collect(),
    })
}

impl Loop {
    fn ring(&self) -> Ring {
        Ring {
            points: self.points.clone(),
        }
    }

    /// Its width, where it is the same all along.
    fn width_mm(&self) -> Option<f64> {
        let most = self.widths_mm.iter().copied().fold(0.0, f64::max);
        let least = self.widths_mm.iter().copied().fold(most, f64::min);
        (most - least < SAME_WIDTH_MM).then_some(0.5 * (most + least))
    }
}

/// What a ring encloses, counter-clockwise, its edge moved by half the width of its loop, outwards or inwards.
fn moved(ring: &Ring, own: Option<&Loop>, outwards: f64) -> Vec<Region> {
    let body = vec![Region {
        exterior: ring.clone(),
        holes: Vec::new(),
    }];
    let Some(own) = own else {
        return body;
    };
    if let Some(width_mm) = own.width_mm() {
        return mitred(&body, outwards * 0.5 * width_mm);
    }
    let mut edge = Vec::new();
    for (k, width_mm) in own.widths_mm.iter().enumerate() {
        let next = own.points[(k + 1) % own.points.len()];
        edge.extend(swept(&[vec![own.points[k], next]], *width_mm, false));
    }
    match outwards > 0.0 {
        true => {
            let all = body.iter().chain(&edge);
            filled(all.flat_map(Region::rings), FillRule::NonZero)
        }
        false => {
            let edge = filled(edge.iter().flat_map(Region::rings), FillRule::NonZero);
            difference(&body, &edge)
        }
    }
}

fn cell(point: Point2) -> [i64; 2] {
    [point.x, point.y].map(|mm| (mm / SAME_MM).round() as i64)
}
