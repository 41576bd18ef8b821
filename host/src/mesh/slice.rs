//! Closed mesh and planes -> regions: the interior of the surface at each height.
//!
//! The rule: a vertex whose z is not above a plane is below it. So every triangle is either on one
//! side or crosses the plane with exactly one edge going down and one going up, whatever vertices,
//! edges or flat faces are in the plane: a section is that of the plane moved up by an infinitesimal
//! amount. A face in a plane bounds the solid above it, not the one below.
//!
//! The point on an edge is computed once from its lower end, so that both triangles have the same
//! bits; sections are connected through the edge's two triangles, never by coordinates. Loops have
//! the solid on their left, and points with a positive winding number are inside (overlapping
//! shells are united; no tolerance is involved).
//!
//! Cost: triangles x planes that each crosses. Planes are cut in parallel, with results in order.

use super::half_edges::{Edges, NO_TWIN, ends};
use super::{Mesh, Point3};
use crate::geometry::Point2;
use crate::geometry::boolean::{difference, filled};
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::repair::FillRule;
use rayon::prelude::*;

/// Planes whose triangles are gathered at a time: bounds the memory for tall triangles.
const PLANES_AT_A_TIME: usize = 256;
/// Ground wound around more than once that is worth telling, mm² and share of the section: less is
/// rounding on the overlay's grid.
const OVERLAP_MIN_MM2: f64 = 1e-3;
const OVERLAP_MIN_SHARE: f64 = 1e-6;

/// A section of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    /// The interior.
    pub regions: Vec<Region>,
    /// Area with a winding number above 1 or below 0, mm², and a point in it.
    pub overlap: Option<(f64, Point2)>,
}

/// A closed mesh, ready to be cut.
pub struct Slicer<'a> {
    mesh: &'a Mesh,
    twins: Vec<u32>,
}

impl<'a> Slicer<'a> {
    /// Finds the neighbours of triangles.
    pub fn new(mesh: &'a Mesh) -> Slicer<'a> {
        let twins = Edges::of(&mesh.triangles).twins(&mesh.triangles);
        Slicer { mesh, twins }
    }

    /// The sections at ascending heights, mm.
    pub fn sections(&self, heights_mm: &[f64]) -> Vec<Section> {
        let mut sections = Vec::with_capacity(heights_mm.len());
        for heights_mm in heights_mm.chunks(PLANES_AT_A_TIME) {
            let crossing = self.crossing(heights_mm);
            let found = heights_mm.par_iter().zip(&crossing);
            let found = found.map(|(&z_mm, triangles)| section_of(&self.loops(triangles, z_mm)));
            sections.par_extend(found);
        }
        sections
    }

    /// The triangles that cross each of the planes.
    fn crossing(&self, heights_mm: &[f64]) -> Vec<Vec<u32>> {
        let mut crossing = vec![Vec::new(); heights_mm.len()];
        for number in 0..self.mesh.triangles.len() {
            let z_mm = self.mesh.corners(number).map(|p| p.z);
            let low = z_mm[0].min(z_mm[1]).min(z_mm[2]);
            let high = z_mm[0].max(z_mm[1]).max(z_mm[2]);
            // low <= plane < high.
            let first = heights_mm.partition_point(|&plane| plane < low);
            let end = heights_mm.partition_point(|&plane| plane < high);
            for of_plane in &mut crossing[first..end.max(first)] {
                of_plane.push(number as u32);
            }
        }
        crossing
    }

    /// The closed loops in which the plane cuts these triangles.
    fn loops(&self, triangles: &[u32], z_mm: f64) -> Vec<Ring> {
        let mut is_done = vec![false; triangles.len()];
        let place = |triangle: u32| triangles.binary_search(&triangle).ok();
        let mut loops = Vec::new();
        for first in 0..triangles.len() {
            let mut points = Vec::new();
            let mut at = first;
            while !is_done[at] {
                is_done[at] = true;
                let up = self.going_up(triangles[at], z_mm);
                points.push(self.point_on(up, z_mm));
                let twin = self.twins[up as usize];
                // A closed mesh has them all.
                let next = (twin != NO_TWIN).then(|| place(twin / 3)).flatten();
                let Some(next) = next else {
                    break;
                };
                at = next;
            }
            let points = without_flat_points(points);
            if points.len() > 2 {
                loops.push(Ring { points });
            }
        }
        loops
    }

    /// The half-edge of a crossing triangle that goes up through the plane: where its section ends.
    fn going_up(&self, triangle: u32, z_mm: f64) -> u32 {
        let is_above = self.mesh.corners(triangle as usize).map(|p| p.z > z_mm);
        let corner = (0..3).find(|&i| !is_above[i] && is_above[(i + 1) % 3]);
        3 * triangle + corner.unwrap_or(0) as u32
    }

    /// Where a half-edge that goes up crosses the plane.
    fn point_on(&self, half_edge: u32, z_mm: f64) -> Point2 {
        let ends = ends(&self.mesh.triangles, half_edge);
        let [low, high]: [Point3; 2] = ends.map(|vertex| self.mesh.vertices[vertex as usize]);
        let share = (z_mm - low.z) / (high.z - low.z);
        low.xy() + (high.xy() - low.xy()) * share
    }
}

/// Largest distance from the line between its neighbours at which a point is dropped, mm: where a
/// plane crosses the diagonals of an upright face. Layers of upright walls are then the same to the
/// last digit.
const FLAT_MM: f64 = 1e-7;

/// The ring without repeated points and those on a line with the ones kept before and after.
fn without_flat_points(mut points: Vec<Point2>) -> Vec<Point2> {
    points.dedup();
    // Begin at a corner: from there on every point is judged between others.
    let count = points.len();
    let is_corner = |i: usize| {
        let [a, b] = [points[(i + count - 1) % count], points[(i + 1) % count]];
        off_line_mm(points[i], a, b) > FLAT_MM
    };
    let Some(corner) = (0..count).find(|&i| is_corner(i)) else {
        return points;
    };
    points.rotate_left(corner);
    let mut kept: Vec<Point2> = vec![points[0]];
    // Those since the last one kept, all on one line with it.
    let mut flat: Vec<Point2> = Vec::new();
    for i in 1..=count {
        let next = points[i % count];
        let from = kept[kept.len() - 1];
        let is_line =
            flat.len() < FLAT_MAX && flat.iter().all(|&p| off_line_mm(p, from, next) <= FLAT_MM);
        if !is_line && let Some(&last) = flat.last() {
            kept.push(last);
            flat.clear();
        }
        flat.push(next);
    }
    kept
}

/// Most points that are judged against one line.
const FLAT_MAX: usize = 64;

/// Distance from the piece between two points.
fn off_line_mm(p: Point2, a: Point2, b: Point2) -> f64 {
    let along = b - a;
    let share = (p - a).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE);
    (p - (a + along * share.clamp(0.0, 1.0))).norm()
}

/// What the loops wind around.
fn section_of(loops: &[Ring]) -> Section {
    let regions = filled(loops.iter(), FillRule::Positive);
    let area_mm2: f64 = regions.iter().map(Region::area_mm2).sum();
    let wound_mm2: f64 = loops.iter().map(Ring::signed_area_mm2).sum();
    let differ_mm2 = (area_mm2 - wound_mm2).abs();
    if differ_mm2 < OVERLAP_MIN_MM2.max(OVERLAP_MIN_SHARE * area_mm2) {
        let overlap = None;
        return Section { regions, overlap };
    }
    // Odd and positive differ where shells overlap.
    let odd = filled(loops.iter(), FillRule::EvenOdd);
    let mut twice = difference(&regions, &odd);
    twice.extend(difference(&odd, &regions));
    let largest = twice
        .iter()
        .max_by(|p, q| p.area_mm2().total_cmp(&q.area_mm2()));
    let place = largest.and_then(|region| region.exterior.points.first().copied());
    Section {
        overlap: place.map(|at| (differ_mm2, at)),
        regions,
    }
}
