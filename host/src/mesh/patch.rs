//! Patches of a mesh: their rims, parts of them, and rings cut open.
//!
//! In: a [`Mesh`] with shared vertices, not closed. Out: its rims as sequences of vertices (the patch to their left),
//! the triangles on one side of a line on it, or the patch cut along the shortest path between two rims, so that a
//! surface that closes around an axis can be unrolled. Refused with the place: edges of more than two triangles, or
//! of two with inconsistent orientation.

use super::half_edges::ends;
use super::{Mesh, Point3};
use crate::text::refusal::{Refusal, refusal};
use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

/// An edge that no surface has, with an end of it, mm.
fn no_sheet(at: &Point3) -> Refusal {
    refusal!(
        "the surface is no sheet near ({:.2}, {:.2}, {:.2}) mm: an edge has more than two triangles, triangles beside \
         each other look to different sides, or two rims touch; mend the mesh there",
        at.x,
        at.y,
        at.z
    )
}

/// The edges of a patch: each by its ends as a triangle runs it, with the triangle.
struct RunEdges {
    triangle_of: BTreeMap<[u32; 2], u32>,
}

impl RunEdges {
    fn of(mesh: &Mesh) -> Result<RunEdges, Refusal> {
        let mut triangle_of = BTreeMap::new();
        for half_edge in 0..3 * mesh.triangles.len() as u32 {
            let run = ends(&mesh.triangles, half_edge);
            if triangle_of.insert(run, half_edge / 3).is_some() {
                return Err(no_sheet(&mesh.vertices[run[0] as usize]));
            }
        }
        Ok(RunEdges { triangle_of })
    }

    fn other_side(&self, [from, to]: [u32; 2]) -> Option<u32> {
        self.triangle_of.get(&[to, from]).copied()
    }
}

/// The rims of a patch, the longest first.
///
/// # Errors
/// [`Refusal`].
pub fn rims(mesh: &Mesh) -> Result<Vec<Vec<u32>>, Refusal> {
    let edges = RunEdges::of(mesh)?;
    let mut next = BTreeMap::new();
    for &[from, to] in edges.triangle_of.keys() {
        if edges.other_side([from, to]).is_none() && next.insert(from, to).is_some() {
            // Two rims touch there.
            return Err(no_sheet(&mesh.vertices[from as usize]));
        }
    }
    let mut rims = Vec::new();
    while let Some((first, mut at)) = next.pop_first() {
        let mut rim = vec![first];
        while at != first {
            rim.push(at);
            match next.remove(&at) {
                Some(to) => at = to,
                None => break,
            }
        }
        rims.push(rim);
    }
    let length_mm = |rim: &Vec<u32>| -> f64 {
        let count = rim.len();
        let legs = (0..count).map(|k| apart_mm(mesh, rim[k], rim[(k + 1) % count]));
        legs.sum()
    };
    rims.sort_by(|a, b| length_mm(b).total_cmp(&length_mm(a)));
    Ok(rims)
}

fn apart_mm(mesh: &Mesh, a: u32, b: u32) -> f64 {
    (mesh.vertices[b as usize] - mesh.vertices[a as usize]).norm()
}

/// The triangles that are chosen, over their own vertices.
pub fn chosen(mesh: &Mesh, is_chosen: impl Fn(usize) -> bool) -> Mesh {
    let mut number_of = vec![u32::MAX; mesh.vertices.len()];
    let mut part = Mesh::default();
    let triangles = mesh.triangles.iter().enumerate();
    for (_, triangle) in triangles.filter(|(number, _)| is_chosen(*number)) {
        let corners = triangle.map(|vertex| {
            let number = &mut number_of[vertex as usize];
            if *number == u32::MAX {
                *number = part.vertices.len() as u32;
                part.vertices.push(mesh.vertices[vertex as usize]);
            }
            *number
        });
        part.triangles.push(corners);
    }
    part
}

/// For each triangle the number of its connected part; parts are connected across edges that are
/// not `held`.
pub fn parts(mesh: &Mesh, is_held: impl Fn(usize) -> bool) -> Result<Vec<Option<u32>>, Refusal> {
    let edges = RunEdges::of(mesh)?;
    let mut part_of: Vec<Option<u32>> = vec![None; mesh.triangles.len()];
    let mut count = 0;
    for first in 0..mesh.triangles.len() {
        if part_of[first].is_some() || is_held(first) {
            continue;
        }
        let mut waiting = vec![first];
        part_of[first] = Some(count);
        while let Some(triangle) = waiting.pop() {
            for corner in 0..3 {
                let run = ends(&mesh.triangles, (3 * triangle + corner) as u32);
                let Some(other) = edges.other_side(run).map(|other| other as usize) else {
                    continue;
                };
                if part_of[other].is_none() && !is_held(other) {
                    part_of[other] = Some(count);
                    waiting.push(other);
                }
            }
        }
        count += 1;
    }
    Ok(part_of)
}

/// The patch cut along its edges by the shortest path between two rims; `None` if there is none.
///
/// # Errors
/// [`Refusal`].
pub fn cut_open(mesh: &Mesh, from: &[u32], to: &[u32]) -> Result<Option<Mesh>, Refusal> {
    let edges = RunEdges::of(mesh)?;
    let Some(way) = shortest(mesh, &edges, from, to) else {
        return Ok(None);
    };
    let is_cut = |a: u32, b: u32| way.windows(2).any(|leg| leg == [a, b] || leg == [b, a]);
    let mut cut = mesh.clone();
    for &vertex in &way {
        let around: Vec<u32> = (0..mesh.triangles.len() as u32)
            .filter(|&triangle| mesh.triangles[triangle as usize].contains(&vertex))
            .collect();
        // Triangles about the vertex that meet across edges which are not cut stay together.
        let mut group: Vec<usize> = (0..around.len()).collect();
        let mut joins = true;
        while std::mem::take(&mut joins) {
            for (own, &triangle) in around.iter().enumerate() {
                for corner in 0..3 {
                    let run = ends(&mesh.triangles, 3 * triangle + corner);
                    let crosses = run.contains(&vertex) && !is_cut(run[0], run[1]);
                    let other = edges.other_side(run).filter(|_| crosses);
                    let other = other.and_then(|other| around.iter().position(|&t| t == other));
                    if let Some(other) = other.filter(|&other| group[other] != group[own]) {
                        let least = group[own].min(group[other]);
                        (group[own], group[other]) = (least, least);
                        joins = true;
                    }
                }
            }
        }
        for (own, &triangle) in around.iter().enumerate() {
            if group[own] == group[0] {
                continue;
            }
            let first = group.iter().position(|&g| g == group[own]) == Some(own);
            if first {
                cut.vertices.push(mesh.vertices[vertex as usize]);
            }
            let copy = cut.vertices.len() as u32 - 1;
            for corner in &mut cut.triangles[triangle as usize] {
                if *corner == vertex {
                    *corner = copy;
                }
            }
        }
    }
    Ok(Some(cut))
}

/// A vertex in the queue, the nearest first.
#[derive(PartialEq)]
struct Reached {
    way_mm: f64,
    vertex: u32,
}

impl Eq for Reached {}

impl PartialOrd for Reached {
    fn partial_cmp(&self, other: &Reached) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Reached {
    fn cmp(&self, other: &Reached) -> Ordering {
        let by_way = other.way_mm.total_cmp(&self.way_mm);
        by_way.then(other.vertex.cmp(&self.vertex))
    }
}

/// The shortest path along edges (Dijkstra, 1959).
fn shortest(mesh: &Mesh, edges: &RunEdges, from: &[u32], to: &[u32]) -> Option<Vec<u32>> {
    let mut beside: Vec<Vec<u32>> = vec![Vec::new(); mesh.vertices.len()];
    for &[a, b] in edges.triangle_of.keys() {
        beside[a as usize].push(b);
        beside[b as usize].push(a);
    }
    let mut way_mm = vec![f64::INFINITY; mesh.vertices.len()];
    let mut before = vec![u32::MAX; mesh.vertices.len()];
    let mut waiting = BinaryHeap::new();
    for &vertex in from {
        way_mm[vertex as usize] = 0.0;
        waiting.push(Reached {
            way_mm: 0.0,
            vertex,
        });
    }
    while let Some(Reached {
        way_mm: way,
        vertex,
    }) = waiting.pop()
    {
        if to.contains(&vertex) {
            let mut found = vec![vertex];
            let mut at = vertex;
            while before[at as usize] != u32::MAX {
                at = before[at as usize];
                found.push(at);
            }
            return Some(found);
        }
        if way > way_mm[vertex as usize] {
            continue;
        }
        for &other in &beside[vertex as usize] {
            // Rims are left at once and met once.
            let next = way + apart_mm(mesh, vertex, other);
            if next < way_mm[other as usize] {
                way_mm[other as usize] = next;
                before[other as usize] = vertex;
                waiting.push(Reached {
                    way_mm: next,
                    vertex: other,
                });
            }
        }
    }
    None
}

/// The path along edges between the vertices nearest to two points; `None` where none leads there.
///
/// # Errors
/// [`Refusal`].
pub fn way_along(mesh: &Mesh, [from, to]: [Point3; 2]) -> Result<Option<Vec<u32>>, Refusal> {
    let near = |point: Point3| {
        let away = |vertex: &u32| (mesh.vertices[*vertex as usize] - point).norm_squared();
        let all = 0..mesh.vertices.len() as u32;
        all.min_by(|a, b| away(a).total_cmp(&away(b)))
    };
    let (Some(first), Some(last)) = (near(from), near(to)) else {
        return Ok(None);
    };
    let way = shortest(mesh, &RunEdges::of(mesh)?, &[first], &[last]);
    Ok(way.map(|way| way.into_iter().rev().collect()))
}

/// The triangles with a corner no farther along the edges from those that are chosen, and these.
pub fn grown(mesh: &Mesh, is_chosen: &[bool], by_mm: f64) -> Vec<bool> {
    let mut beside: Vec<Vec<u32>> = vec![Vec::new(); mesh.vertices.len()];
    for &[a, b, c] in &mesh.triangles {
        for [p, q] in [[a, b], [b, c], [c, a]] {
            beside[p as usize].push(q);
            beside[q as usize].push(p);
        }
    }
    let mut way_mm = vec![f64::INFINITY; mesh.vertices.len()];
    let mut waiting = BinaryHeap::new();
    let chosen = mesh.triangles.iter().zip(is_chosen);
    for &vertex in chosen
        .filter(|(_, own)| **own)
        .flat_map(|(triangle, _)| triangle)
    {
        way_mm[vertex as usize] = 0.0;
        waiting.push(Reached {
            way_mm: 0.0,
            vertex,
        });
    }
    while let Some(Reached {
        way_mm: way,
        vertex,
    }) = waiting.pop()
    {
        if way > way_mm[vertex as usize] {
            continue;
        }
        for &other in &beside[vertex as usize] {
            let next = way + apart_mm(mesh, vertex, other);
            if next <= by_mm && next < way_mm[other as usize] {
                way_mm[other as usize] = next;
                waiting.push(Reached {
                    way_mm: next,
                    vertex: other,
                });
            }
        }
    }
    let is_near = |triangle: &[u32; 3]| triangle.iter().any(|v| way_mm[*v as usize].is_finite());
    mesh.triangles.iter().map(is_near).collect()
}

/// The place of a mesh nearest to a point, its distance, mm, and its triangle.
pub fn nearest(mesh: &Mesh, point: Point3) -> Option<(Point3, f64, usize)> {
    let mut best: Option<(Point3, f64, usize)> = None;
    for number in 0..mesh.triangles.len() {
        let corners = mesh.corners(number);
        let reach = best.map_or(f64::INFINITY, |(_, away, _)| away);
        let middle = Point3::from(corners.iter().map(|c| c.coords).sum::<super::Vector3>() / 3.0);
        let size = corners
            .iter()
            .map(|c| (c - middle).norm())
            .fold(0.0, f64::max);
        if (point - middle).norm() - size > reach {
            continue;
        }
        let at = nearest_in(corners, point);
        let away = (at - point).norm();
        if away < reach {
            best = Some((at, away, number));
        }
    }
    best
}

/// The point of a triangle nearest to a point (Ericson, "Real-Time Collision Detection", 2005, 5.1.5).
fn nearest_in([a, b, c]: [Point3; 3], p: Point3) -> Point3 {
    let (ab, ac) = (b - a, c - a);
    let of = |q: Point3| [ab.dot(&(p - q)), ac.dot(&(p - q))];
    let ([d1, d2], [d3, d4], [d5, d6]) = (of(a), of(b), of(c));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let whole = va + vb + vc;
    a + ab * (vb / whole) + ac * (vc / whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of a cylinder, closed around.
    fn tube(around: u32, up: u32) -> Mesh {
        let mut mesh = Mesh::default();
        for j in 0..=up {
            for i in 0..around {
                let (sin, cos) =
                    (std::f64::consts::TAU * f64::from(i) / f64::from(around)).sin_cos();
                mesh.vertices
                    .push(Point3::new(5.0 * cos, 5.0 * sin, f64::from(j)));
            }
        }
        for j in 0..up {
            for i in 0..around {
                let corner = |di: u32, dj: u32| (j + dj) * around + (i + di) % around;
                mesh.triangles
                    .push([corner(0, 0), corner(1, 0), corner(1, 1)]);
                mesh.triangles
                    .push([corner(0, 0), corner(1, 1), corner(0, 1)]);
            }
        }
        mesh
    }

    /// Goal: a tube has two rims, cut open one, and no triangle is lost. Method: a tube of 24 x 6.
    #[test]
    fn a_tube_is_cut_open() {
        let tube = tube(24, 6);
        let ends = rims(&tube).unwrap();
        assert_eq!(ends.iter().map(Vec::len).collect::<Vec<_>>(), [24, 24]);
        let open = cut_open(&tube, &ends[0], &ends[1]).unwrap().unwrap();
        assert_eq!(open.triangles.len(), tube.triangles.len());
        assert_eq!(open.vertices.len(), tube.vertices.len() + 7);
        let rims = rims(&open).unwrap();
        assert_eq!(
            rims.iter().map(Vec::len).collect::<Vec<_>>(),
            [25 + 25 + 5 + 5]
        );
    }

    #[test]
    fn an_edge_of_three_triangles_is_refused() {
        let mut fin = tube(8, 1);
        let [a, b, _] = fin.triangles[0];
        fin.vertices.push(Point3::new(9.0, 9.0, 9.0));
        fin.triangles.push([a, b, fin.vertices.len() as u32 - 1]);
        let refused = rims(&fin).unwrap_err();
        let at = fin.vertices[a as usize];
        let place = format!("no sheet near ({:.2}, {:.2}, {:.2}) mm", at.x, at.y, at.z);
        assert!(refused.to_string().contains(&place), "{refused}");
    }

    #[test]
    fn the_nearest_place_of_a_mesh_is_found() {
        let tube = tube(64, 6);
        let (at, away_mm, _) = nearest(&tube, Point3::new(7.0, 0.1, 3.3)).unwrap();
        // A facet's chord lies 6 um below the cylinder.
        assert!(
            (away_mm - 2.0).abs() < 0.01 && (at.z - 3.3).abs() < 1e-9,
            "{at} {away_mm}"
        );
    }
}
