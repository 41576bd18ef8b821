//! Raw triangles -> shared vertices, each triangle once.
//!
//! Corners at the same position (bit for bit) become one vertex. A triangle with two equal corners
//! has no area and is removed. Of triangles with the same three corners one is kept; if they have
//! opposite orientations (a sheet without thickness) none is, unless the surface needs one to be
//! closed: that is found by peeling such sheets from their borders.

use super::half_edges::Edges;
use super::{Mesh, Point3};
use std::collections::HashMap;

/// The triangles removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Cleaned {
    /// Triangles with two corners at one place.
    pub collapsed: usize,
    /// Copies of triangles, and both sides of sheets.
    pub duplicates: usize,
}

/// Makes corners at the same place one vertex.
pub(super) fn with_shared_vertices(mesh: &Mesh) -> Mesh {
    let mut number_of = HashMap::with_capacity(mesh.vertices.len() / 2);
    let mut vertices: Vec<Point3> = Vec::new();
    let numbers: Vec<u32> = mesh
        .vertices
        .iter()
        .map(|p| {
            // -0 and 0 are one place.
            let place = [p.x + 0.0, p.y + 0.0, p.z + 0.0];
            let next = vertices.len() as u32;
            *number_of.entry(place.map(f64::to_bits)).or_insert_with(|| {
                vertices.push(Point3::from(place));
                next
            })
        })
        .collect();
    let triangles = mesh.triangles.iter();
    let triangles = triangles.map(|triangle| triangle.map(|vertex| numbers[vertex as usize]));
    Mesh {
        vertices,
        triangles: triangles.collect(),
    }
}

/// Takes out what covers nothing, or covers it again.
pub(super) fn clean(mesh: &mut Mesh) -> Cleaned {
    let count = mesh.triangles.len();
    mesh.triangles
        .retain(|[a, b, c]| a != b && b != c && c != a);
    let collapsed = count - mesh.triangles.len();
    let count = mesh.triangles.len();
    without_copies(&mut mesh.triangles);
    Cleaned {
        collapsed,
        duplicates: count - mesh.triangles.len(),
    }
}

/// The least corner first, with the same orientation.
fn turned([a, b, c]: [u32; 3]) -> [u32; 3] {
    let least = a.min(b).min(c);
    if least == a {
        [a, b, c]
    } else if least == b {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

fn without_copies(triangles: &mut Vec<[u32; 3]>) {
    // For either orientation.
    let key = |triangle: [u32; 3]| {
        let [a, b, c] = turned(triangle);
        [a, b.min(c), b.max(c)]
    };
    let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
    order.sort_unstable_by_key(|&number| (key(triangles[number as usize]), number));
    let mut keep = vec![true; triangles.len()];
    let mut sheets = Vec::new();
    for copies in order.chunk_by(|&p, &q| key(triangles[p as usize]) == key(triangles[q as usize]))
    {
        for &copy in &copies[1..] {
            keep[copy as usize] = false;
        }
        let first = turned(triangles[copies[0] as usize]);
        if copies
            .iter()
            .any(|&t| turned(triangles[t as usize]) != first)
        {
            sheets.push(copies[0]);
        }
    }
    if !sheets.is_empty() {
        peel(triangles, &mut keep, sheets);
    }
    let mut number = 0;
    triangles.retain(|_| {
        number += 1;
        keep[number - 1]
    });
}

/// Takes out sheets that hang on an edge with an odd number of triangles, and what hangs then.
fn peel(triangles: &[[u32; 3]], keep: &mut [bool], sheets: Vec<u32>) {
    let mut uses: HashMap<u64, u32> = HashMap::new();
    let edges = |triangle: [u32; 3]| {
        [0, 1, 2].map(|i| {
            let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
            (u64::from(a.min(b)) << 32) | u64::from(a.max(b))
        })
    };
    for (triangle, _) in triangles.iter().zip(&*keep).filter(|(_, keep)| **keep) {
        for edge in edges(*triangle) {
            *uses.entry(edge).or_default() += 1;
        }
    }
    let mut left = sheets;
    loop {
        let count = left.len();
        left.retain(|&sheet| {
            let own = edges(triangles[sheet as usize]);
            if own.iter().all(|edge| uses[edge].is_multiple_of(2)) {
                return true;
            }
            for edge in own {
                *uses.entry(edge).or_default() -= 1;
            }
            keep[sheet as usize] = false;
            false
        });
        if left.len() == count {
            return;
        }
    }
}

/// Edges with an odd number of triangles: their ends.
pub(super) fn odd_edges(triangles: &[[u32; 3]]) -> Vec<u32> {
    let edges = Edges::of(triangles);
    let odd = edges.groups().filter(|group| group.len() % 2 == 1);
    odd.map(|group| group[0].1).collect()
}
