//! Sections of a mesh by curved surfaces, and ground by heights over a grid.
//!
//! In: a mesh and a function that rises with z and is constant on each of the surfaces. Out: regions, as seen from above.
//! The vertices are moved to where that function is their height, so that the surfaces become planes ([`Slicer`]); edges that
//! bend by it, near the surfaces that are wanted, are halved before.

use super::top_grid::TopGrid;
use crate::geometry::polygon::Region;
use crate::mesh::slice::Slicer;
use crate::mesh::{Mesh, Point3};
use std::collections::BTreeMap;

/// An edge that bends by more is halved, of a layer; so often at most; and none shorter than this, of a layer.
const BEND: f64 = 0.005;
const HALVINGS: usize = 9;
const SHORTEST: f64 = 0.25;

/// The sections where `height` has ascending values.
pub fn sections(
    mesh: &Mesh,
    height: &(dyn Fn(&Point3) -> f64 + Sync),
    levels: &[f64],
    layer_mm: f64,
) -> Vec<Vec<Region>> {
    let [Some(&lowest), Some(&highest)] = [levels.first(), levels.last()] else {
        return Vec::new();
    };
    let mut warped = Warped {
        places: mesh.vertices.clone(),
        heights: mesh.vertices.iter().map(height).collect(),
        triangles: mesh.triangles.clone(),
    };
    let wanted = [lowest - layer_mm, highest + layer_mm];
    for _ in 0..HALVINGS {
        if !warped.halve(height, wanted, layer_mm) {
            break;
        }
    }
    let vertices = warped.places.iter().zip(&warped.heights);
    let flat = Mesh {
        vertices: vertices.map(|(p, h)| Point3::new(p.x, p.y, *h)).collect(),
        triangles: warped.triangles,
    };
    let sections = Slicer::new(&flat).sections(levels).into_iter();
    sections.map(|section| section.regions).collect()
}

/// A mesh with the heights that its vertices are moved to.
struct Warped {
    places: Vec<Point3>,
    heights: Vec<f64>,
    triangles: Vec<[u32; 3]>,
}

impl Warped {
    /// Halves the edges that bend; false where none does. What becomes of an edge depends on the edge alone, so that the mesh
    /// stays closed.
    fn halve(
        &mut self,
        height: &(dyn Fn(&Point3) -> f64 + Sync),
        [lowest, highest]: [f64; 2],
        layer_mm: f64,
    ) -> bool {
        let mut middles: BTreeMap<[u32; 2], Option<u32>> = BTreeMap::new();
        for triangle in &self.triangles {
            for [a, b] in edges(triangle) {
                let key = [a.min(b), a.max(b)];
                if middles.contains_key(&key) {
                    continue;
                }
                let ends = key.map(|vertex| vertex as usize);
                let middle = nalgebra::center(&self.places[ends[0]], &self.places[ends[1]]);
                let length_mm = (self.places[ends[1]] - self.places[ends[0]]).norm();
                if length_mm <= SHORTEST * layer_mm {
                    middles.insert(key, None);
                    continue;
                }
                let own = height(&middle);
                let [p, q] = ends.map(|vertex| self.heights[vertex]);
                let is_near = p.min(q).min(own) <= highest && p.max(q).max(own) >= lowest;
                let bends = (own - 0.5 * (p + q)).abs() > BEND * layer_mm;
                let new = (is_near && bends).then(|| {
                    self.places.push(middle);
                    self.heights.push(own);
                    (self.places.len() - 1) as u32
                });
                middles.insert(key, new);
            }
        }
        if middles.values().all(Option::is_none) {
            return false;
        }
        let of = |[a, b]: [u32; 2]| middles.get(&[a.min(b), a.max(b)]).copied().flatten();
        let mut triangles = Vec::with_capacity(2 * self.triangles.len());
        for triangle in &self.triangles {
            divide(*triangle, edges(triangle).map(of), &mut triangles);
        }
        self.triangles = triangles;
        true
    }
}

fn edges(&[a, b, c]: &[u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// The pieces of a triangle some of whose edges are halved.
fn divide(triangle: [u32; 3], middles: [Option<u32>; 3], into: &mut Vec<[u32; 3]>) {
    // Turned so that the first edge is halved and the last one is not, where that goes.
    let turn = (0..3).find(|&k| middles[k].is_some() && middles[(k + 2) % 3].is_none());
    let turn = turn.unwrap_or(0);
    let [a, b, c] = [0, 1, 2].map(|k| triangle[(turn + k) % 3]);
    match [0, 1, 2].map(|k| middles[(turn + k) % 3]) {
        [Some(ab), Some(bc), Some(ca)] => {
            into.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        [Some(ab), Some(bc), _] => into.extend([[ab, b, bc], [a, ab, bc], [a, bc, c]]),
        [Some(ab), _, _] => into.extend([[a, ab, c], [ab, b, c]]),
        _ => into.push(triangle),
    }
}

/// Where heights over a grid, even between its cells, are above some ascending values.
pub fn above(grid: &TopGrid, heights: &[f64], levels: &[f64]) -> Vec<Vec<Region>> {
    let Some(&lowest) = levels.first() else {
        return Vec::new();
    };
    let floor = lowest.min(heights.iter().copied().fold(f64::INFINITY, f64::min)) - 1.0;
    let block = block(grid, heights, floor);
    let sections = Slicer::new(&block).sections(levels).into_iter();
    sections.map(|section| section.regions).collect()
}

/// A closed solid under heights over a grid.
fn block(grid: &TopGrid, heights: &[f64], floor: f64) -> Mesh {
    let [columns, rows] = grid.count;
    let cells = columns * rows;
    let top = (0..cells).map(|cell| {
        let at = grid.place(cell);
        Point3::new(at.x, at.y, heights[cell])
    });
    let bottom = (0..cells).map(|cell| {
        let at = grid.place(cell);
        Point3::new(at.x, at.y, floor)
    });
    let mut mesh = Mesh {
        vertices: top.chain(bottom).collect(),
        triangles: Vec::new(),
    };
    let (at, below) = (|i: usize, j: usize| (j * columns + i) as u32, cells as u32);
    let mut quad = |a: u32, b: u32, c: u32, d: u32| mesh.triangles.extend([[a, b, c], [a, c, d]]);
    for j in 0..rows.saturating_sub(1) {
        for i in 0..columns.saturating_sub(1) {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            quad(a, b, c, d);
            quad(below + a, below + d, below + c, below + b);
        }
    }
    for i in 0..columns.saturating_sub(1) {
        let (a, b) = (at(i, 0), at(i + 1, 0));
        quad(below + a, below + b, b, a);
        let (a, b) = (at(i + 1, rows - 1), at(i, rows - 1));
        quad(below + a, below + b, b, a);
    }
    for j in 0..rows.saturating_sub(1) {
        let (a, b) = (at(columns - 1, j), at(columns - 1, j + 1));
        quad(below + a, below + b, b, a);
        let (a, b) = (at(0, j + 1), at(0, j));
        quad(below + a, below + b, b, a);
    }
    mesh
}
