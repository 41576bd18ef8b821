//! Closes gaps that rounding has left between triangles that should meet.
//!
//! Each step examines the edges that are still open (with an odd number of triangles). In rounds with a gap from
//! a small part of [`GAP_MAX_MM`] up to all of it, corners within the gap of each other are merged, and an edge
//! is divided where a corner of the other side is within the gap (a T-junction). Edges too short for that are
//! closed with flat triangles once the corners at their ends are merged, before the gap of a later round reaches
//! the neighbours. Remaining holes are zipped up, the shortest connection across first, with triangles no higher
//! than the gap. Nothing moves by more than the gap. A hole that needs a higher triangle is refused, because its
//! surface would be a guess.

use super::clean::{clean, odd_edges};
use super::half_edges::{Edges, NO_TWIN, ends};
use super::orient::agree;
use super::{Mesh, Point3, Vector3, place};
use crate::text::refusal::{Refusal, refusal};
use std::collections::{BTreeMap, HashMap, HashSet};

/// Widest gap that is closed, mm: less than the width of the finest bead, and as in slicers
/// (PrusaSlicer 2.5: 0.049 mm).
pub const GAP_MAX_MM: f64 = 0.05;
/// Shares of that which are closed first: gaps from rounding are closed before detail of the size of a
/// gap could be treated as one.
const ROUNDS: [f64; 5] = [1.0 / 256.0, 1.0 / 64.0, 1.0 / 16.0, 1.0 / 4.0, 1.0];
/// Edges no longer than this are no detail of an open surface, mm: far below what any machine places.
const DETAIL_MM: f64 = GAP_MAX_MM / 16.0;
/// Most edges around a hole that is zipped up: each is compared with all others.
const HOLE_EDGES_MAX: usize = 4000;

/// What was closed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClosedGaps {
    /// Corners that became one with another.
    pub welded: usize,
    /// Edges divided at a corner on them.
    pub split: usize,
    /// Triangles added to remaining holes.
    pub filled: usize,
    /// The widest gap among them, mm.
    pub widest_mm: f64,
}

/// Closes gaps up to [`GAP_MAX_MM`].
///
/// # Errors
/// A `Refusal` with the largest remaining hole.
pub(super) fn close_gaps(mesh: &mut Mesh) -> Result<ClosedGaps, Refusal> {
    let mut closed = ClosedGaps::default();
    for gap_mm in ROUNDS.map(|share| share * GAP_MAX_MM) {
        let open = odd_edges(&mesh.triangles);
        if open.is_empty() {
            return Ok(closed);
        }
        weld(mesh, &open, gap_mm, &mut closed);
        clean(mesh);
        split(mesh, gap_mm, &mut closed);
        clean(mesh);
        if gap_mm >= DETAIL_MM {
            agree(mesh);
            close_short_edges(mesh, gap_mm, &mut closed);
        }
    }
    agree(mesh);
    fill(mesh, &mut closed)?;
    Ok(closed)
}

/// Cells of the gap's size, by which neighbours are found.
struct NearPoints {
    cell_mm: f64,
    cells: HashMap<[i64; 3], Vec<u32>>,
}

impl NearPoints {
    fn of(mesh: &Mesh, numbers: &[u32], cell_mm: f64) -> NearPoints {
        let mut near = NearPoints {
            cell_mm,
            cells: HashMap::new(),
        };
        for &number in numbers {
            let cell = near.cell_of(mesh.vertices[number as usize]);
            near.cells.entry(cell).or_default().push(number);
        }
        near
    }

    fn cell_of(&self, p: Point3) -> [i64; 3] {
        [p.x, p.y, p.z].map(|x| (x / self.cell_mm).floor() as i64)
    }

    /// Calls with every point in the cell and those around it.
    fn for_near(&self, cell: [i64; 3], mut call: impl FnMut(u32)) {
        for dx in -1..=1 {
            for dy in -1..=1 {
                for dz in -1..=1 {
                    let near = [cell[0] + dx, cell[1] + dy, cell[2] + dz];
                    for &number in self.cells.get(&near).into_iter().flatten() {
                        call(number);
                    }
                }
            }
        }
    }
}

/// The vertices of open edges, each once.
fn open_vertices(mesh: &Mesh, open: &[u32]) -> Vec<u32> {
    let both = open.iter().flat_map(|&edge| ends(&mesh.triangles, edge));
    let mut vertices: Vec<u32> = both.collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

/// Merges open corners that are near each other, the nearest first. Corners that an edge joins stay
/// separate: that is detail, not a gap. Below [`DETAIL_MM`] it is not detail: such edges result from
/// dividing a sliver at both halves of a torn corner, and would keep these separate for good.
fn weld(mesh: &mut Mesh, open: &[u32], gap_max_mm: f64, closed: &mut ClosedGaps) {
    let vertices = open_vertices(mesh, open);
    let near = NearPoints::of(mesh, &vertices, gap_max_mm);
    let is_open: HashSet<u32> = vertices.iter().copied().collect();
    let mut joined: HashSet<[u32; 2]> = HashSet::new();
    for triangle in &mesh.triangles {
        for i in 0..3 {
            let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
            if is_open.contains(&a) && is_open.contains(&b) {
                joined.insert([a.min(b), a.max(b)]);
            }
        }
    }
    let mut pairs = Vec::new();
    for &one in &vertices {
        let at = mesh.vertices[one as usize];
        near.for_near(near.cell_of(at), |other| {
            let gap_mm = (mesh.vertices[other as usize] - at).norm();
            let is_detail = gap_mm > DETAIL_MM && joined.contains(&[one, other]);
            if other > one && gap_mm <= gap_max_mm && !is_detail {
                pairs.push((gap_mm, one, other));
            }
        });
    }
    pairs.sort_by(|p, q| p.0.total_cmp(&q.0).then((p.1, p.2).cmp(&(q.1, q.2))));
    // The corners that became one, by their least.
    let mut members: BTreeMap<u32, Vec<u32>> = vertices.iter().map(|&v| (v, vec![v])).collect();
    let mut least_of: HashMap<u32, u32> = vertices.iter().map(|&v| (v, v)).collect();
    for (gap_mm, one, other) in pairs {
        let (one, other) = (least_of[&one], least_of[&other]);
        let (low, high) = (one.min(other), one.max(other));
        let touch = |&p: &u32, q: u32| joined.contains(&[p.min(q), p.max(q)]);
        let (low_members, high_members) = (&members[&low], &members[&high]);
        let touches = |p: &u32| high_members.iter().any(|&q| touch(p, q));
        let apart_mm =
            |p: u32, q: u32| (mesh.vertices[p as usize] - mesh.vertices[q as usize]).norm();
        let is_far = |p: &u32| high_members.iter().any(|&q| apart_mm(*p, q) > DETAIL_MM);
        let collapses = low_members.iter().any(touches) && low_members.iter().any(is_far);
        if low == high || collapses {
            continue;
        }
        let moved = members.remove(&high).unwrap_or_default();
        closed.welded += moved.len();
        closed.widest_mm = closed.widest_mm.max(gap_mm);
        for &member in &moved {
            least_of.insert(member, low);
        }
        members.entry(low).or_default().extend(moved);
    }
    for vertex in mesh.triangles.iter_mut().flatten() {
        *vertex = *least_of.get(vertex).unwrap_or(vertex);
    }
}

/// Divides open edges at the open corners on them.
fn split(mesh: &mut Mesh, gap_max_mm: f64, closed: &mut ClosedGaps) {
    let open = odd_edges(&mesh.triangles);
    let vertices = open_vertices(mesh, &open);
    // A cell as long as the usual edge: an edge then meets few of them.
    let mut lengths_mm: Vec<f64> = open.iter().map(|&edge| length_mm(mesh, edge)).collect();
    lengths_mm.sort_by(f64::total_cmp);
    let usual_mm = lengths_mm.get(lengths_mm.len() / 2).copied();
    let cell_mm = usual_mm.unwrap_or(gap_max_mm).max(gap_max_mm);
    let near = NearPoints::of(mesh, &vertices, cell_mm);
    // Each triangle's open edges, divided one after the other.
    let mut of_triangle: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for half_edge in open {
        of_triangle
            .entry(half_edge / 3)
            .or_default()
            .push(half_edge);
    }
    for (triangle, half_edges) in of_triangle {
        let corners = mesh.triangles[triangle as usize];
        let mut outline: Vec<u32> = Vec::new();
        for (i, &from) in corners.iter().enumerate() {
            outline.push(from);
            if half_edges.contains(&(3 * triangle + i as u32)) {
                let to = corners[(i + 1) % 3];
                let found = on_edge(mesh, &near, [from, to], &corners, gap_max_mm);
                let found = found.into_iter().map(|(number, gap_mm)| {
                    closed.widest_mm = closed.widest_mm.max(gap_mm);
                    number
                });
                let found: Vec<u32> = found.collect();
                closed.split += usize::from(!found.is_empty());
                outline.extend(found);
            }
        }
        if outline.len() > 3 {
            divide(mesh, triangle as usize, &outline);
        }
    }
}

fn length_mm(mesh: &Mesh, half_edge: u32) -> f64 {
    let [from, to] = ends(&mesh.triangles, half_edge);
    (mesh.vertices[to as usize] - mesh.vertices[from as usize]).norm()
}

/// The open corners along an edge, in its direction, and how far off it each is, mm.
fn on_edge(
    mesh: &Mesh,
    near: &NearPoints,
    [from, to]: [u32; 2],
    corners: &[u32; 3],
    gap_max_mm: f64,
) -> Vec<(u32, f64)> {
    let a = mesh.vertices[from as usize];
    let along = mesh.vertices[to as usize] - a;
    let length_mm = along.norm();
    let steps = (length_mm / near.cell_mm).ceil().max(1.0);
    let mut found: BTreeMap<u32, [f64; 2]> = BTreeMap::new();
    // Long edges of coarse parts: a look at every corner is less than at every cell.
    let mut visit = |number: u32| {
        let p = mesh.vertices[number as usize] - a;
        let at = p.dot(&along) / length_mm.powi(2);
        let gap_mm = (p - along * at).norm();
        // A corner near an end belongs to the end: a later round makes them one.
        let to_end_mm = length_mm * at.min(1.0 - at);
        let is_between = to_end_mm > GAP_MAX_MM;
        if is_between && gap_mm <= gap_max_mm && !corners.contains(&number) {
            found.insert(number, [at, gap_mm]);
        }
    };
    if steps as usize * 27 > near.cells.len() {
        for &number in near.cells.values().flatten() {
            visit(number);
        }
    } else {
        for step in 0..=steps as usize {
            let p = a + along * (step as f64 / steps);
            near.for_near(near.cell_of(p), &mut visit);
        }
    }
    let mut found: Vec<(u32, [f64; 2])> = found.into_iter().collect();
    found.sort_by(|p, q| p.1[0].total_cmp(&q.1[0]).then(p.0.cmp(&q.0)));
    let found = found.into_iter();
    found
        .map(|(number, [_, gap_mm])| (number, gap_mm))
        .collect()
}

/// Puts triangles over the outline of a divided one in its place.
fn divide(mesh: &mut Mesh, triangle: usize, outline: &[u32]) {
    let mut rest = outline.to_vec();
    let mut pieces = Vec::new();
    // Ears of three in a row that are not on one line, the highest first: no piece is flat.
    while rest.len() > 3 {
        let count = rest.len();
        let height = |i: usize| {
            let three = [
                rest[(i + count - 1) % count],
                rest[i],
                rest[(i + 1) % count],
            ];
            height_mm(three.map(|v| mesh.vertices[v as usize]))
        };
        let best = (0..count).max_by(|&i, &j| height(i).total_cmp(&height(j)));
        let i = best.unwrap_or(0);
        pieces.push([
            rest[(i + count - 1) % count],
            rest[i],
            rest[(i + 1) % count],
        ]);
        rest.remove(i);
    }
    mesh.triangles[triangle] = [rest[0], rest[1], rest[2]];
    mesh.triangles.extend(pieces);
}

/// The least height of a triangle.
fn height_mm([a, b, c]: [Point3; 3]) -> f64 {
    let sides = [b - a, c - b, a - c].map(|side: Vector3| side.norm());
    let longest_mm = sides.into_iter().fold(0.0, f64::max);
    (b - a).cross(&(c - a)).norm() / longest_mm.max(f64::MIN_POSITIVE)
}

/// Most corners on a short edge that are closed at a time.
const SHORT_EDGE_CORNERS_MAX: usize = 16;

/// Adds flat triangles between an open edge and the corners on it, if these already connect its two ends.
fn close_short_edges(mesh: &mut Mesh, gap_max_mm: f64, closed: &mut ClosedGaps) {
    let open = open_half_edges(mesh);
    let owners = open.iter();
    let owners: HashMap<[u32; 2], u32> = owners
        .map(|&half_edge| (ends(&mesh.triangles, half_edge), half_edge / 3))
        .collect();
    for hole in holes(mesh, &open) {
        if hole.len() > SHORT_EDGE_CORNERS_MAX + 2 {
            continue;
        }
        let edges = (0..hole.len()).map(|i| [hole[(i + 1) % hole.len()], hole[i]]);
        let length_mm = |[from, to]: [u32; 2]| {
            (mesh.vertices[to as usize] - mesh.vertices[from as usize]).norm()
        };
        let edges: Vec<(Option<u32>, f64)> = edges
            .map(|edge| (owners.get(&edge).copied(), length_mm(edge)))
            .collect();
        let Some(&(longest, _)) = edges.iter().max_by(|p, q| p.1.total_cmp(&q.1)) else {
            continue;
        };
        // Corners nearer to each other may be one that is torn: a later round makes one of them.
        if edges.iter().any(|edge| edge.1 <= gap_max_mm) {
            continue;
        }
        // A triangle that nothing joins yet is no hole around itself.
        if longest.is_none() || edges.iter().filter(|edge| edge.0 == longest).count() > 1 {
            continue;
        }
        if let Some((triangles, widest_mm)) = zipped(mesh, &hole, gap_max_mm) {
            closed.filled += triangles.len();
            closed.widest_mm = closed.widest_mm.max(widest_mm);
            mesh.triangles.extend(triangles);
        }
    }
}

/// A hole: its vertices in the order in which its filling runs.
type Hole = Vec<u32>;

/// Zips up the remaining holes.
fn fill(mesh: &mut Mesh, closed: &mut ClosedGaps) -> Result<(), Refusal> {
    let holes = holes(mesh, &open_half_edges(mesh));
    let mut refused: Vec<Hole> = Vec::new();
    for hole in holes {
        match zipped(mesh, &hole, GAP_MAX_MM) {
            Some((triangles, widest_mm)) => {
                closed.filled += triangles.len();
                closed.widest_mm = closed.widest_mm.max(widest_mm);
                mesh.triangles.extend(triangles);
            }
            None => refused.push(hole),
        }
    }
    let size_mm = |hole: &Hole| {
        let [low, high] = hole_box(mesh, hole);
        (high - low).norm()
    };
    let largest = refused
        .iter()
        .max_by(|p, q| size_mm(p).total_cmp(&size_mm(q)));
    let Some(largest) = largest else {
        return Ok(());
    };
    let [low, high] = hole_box(mesh, largest);
    Err(refusal!(
        "the surface is open in {} place{}: the largest hole is {:.3} mm across, of {} edges near {}; gaps up to \
         {GAP_MAX_MM} mm are closed, this one is wider: close it in the CAD program, or let a mesh tool fill it",
        refused.len(),
        if refused.len() == 1 { "" } else { "s" },
        size_mm(largest),
        largest.len(),
        place(nalgebra::center(&low, &high))
    ))
}

fn hole_box(mesh: &Mesh, hole: &Hole) -> [Point3; 2] {
    let mut points = hole.iter().map(|&vertex| mesh.vertices[vertex as usize]);
    let first = points.next().unwrap_or_default();
    points.fold([first, first], |[low, high], p| [low.inf(&p), high.sup(&p)])
}

/// Half-edges without a twin.
fn open_half_edges(mesh: &Mesh) -> Vec<u32> {
    let twins = Edges::of(&mesh.triangles).twins(&mesh.triangles);
    let open = twins.iter().enumerate().filter(|(_, t)| **t == NO_TWIN);
    open.map(|(half_edge, _)| half_edge as u32).collect()
}

/// The rings of open half-edges, run backwards. A chain that does not close to a ring (on a surface
/// that cannot be oriented consistently) is a hole as well.
fn holes(mesh: &Mesh, open: &[u32]) -> Vec<Hole> {
    let mut next: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for &half_edge in open {
        let [from, to] = ends(&mesh.triangles, half_edge);
        next.entry(to).or_default().push(from);
    }
    let mut holes = Vec::new();
    while let Some((&start, _)) = next.iter().next() {
        let mut path = vec![start];
        let mut place_in_path = HashMap::from([(start, 0)]);
        while let Some(&last) = path.last() {
            let ways = next.get_mut(&last);
            let Some(to) = ways.and_then(Vec::pop) else {
                // The end of what does not close.
                if path.len() > 1 {
                    holes.push(std::mem::take(&mut path));
                }
                next.remove(&last);
                break;
            };
            if let Some(&place) = place_in_path.get(&to) {
                let ring: Vec<u32> = path.drain(place..).collect();
                for vertex in &ring {
                    place_in_path.remove(vertex);
                }
                holes.push(ring);
            }
            place_in_path.insert(to, path.len());
            path.push(to);
        }
    }
    holes
}

/// Triangles over a hole, the shortest connection across first, and the highest one's height;
/// `None` if that is more than a gap.
fn zipped(mesh: &Mesh, hole: &Hole, gap_max_mm: f64) -> Option<(Vec<[u32; 3]>, f64)> {
    if !(3..=HOLE_EDGES_MAX).contains(&hole.len()) {
        return None;
    }
    let place = |vertex: u32| mesh.vertices[vertex as usize];
    let mut rest = hole.clone();
    let mut triangles = Vec::new();
    let mut widest_mm: f64 = 0.0;
    while rest.len() >= 3 {
        let count = rest.len();
        let across_mm = |i: usize| {
            let (before, after) = (rest[(i + count - 1) % count], rest[(i + 1) % count]);
            (place(after) - place(before)).norm()
        };
        let i = (0..count).min_by(|&i, &j| across_mm(i).total_cmp(&across_mm(j)))?;
        let triangle = [
            rest[(i + count - 1) % count],
            rest[i],
            rest[(i + 1) % count],
        ];
        let height_mm = height_mm(triangle.map(place));
        if height_mm > gap_max_mm {
            return None;
        }
        widest_mm = widest_mm.max(height_mm);
        triangles.push(triangle);
        rest.remove(i);
    }
    Some((triangles, widest_mm))
}
