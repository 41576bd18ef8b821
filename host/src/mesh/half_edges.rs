//! Which triangles share which edge.
//!
//! Half-edge 3 t + i runs from corner i of triangle t to the next one. In a closed, consistently
//! oriented surface, every edge has as many half-edges in one direction as in the other; half-edges of
//! opposite directions are twins. Where more than two triangles share an edge (two cubes that touch),
//! they pair up in the order of their numbers: this affects a section's loops, but not the winding
//! numbers.

use rayon::prelude::*;

/// The twin of a half-edge that has none.
pub(super) const NO_TWIN: u32 = u32::MAX;

/// From and to of a half-edge.
pub(super) fn ends(triangles: &[[u32; 3]], half_edge: u32) -> [u32; 2] {
    let triangle = triangles[half_edge as usize / 3];
    let corner = half_edge as usize % 3;
    [triangle[corner], triangle[(corner + 1) % 3]]
}

/// All half-edges, those of one edge together, by edge and number.
pub(super) struct Edges {
    by_edge: Vec<(u64, u32)>,
}

impl Edges {
    pub(super) fn of(triangles: &[[u32; 3]]) -> Edges {
        let all = 0..3 * triangles.len() as u32;
        let mut by_edge: Vec<(u64, u32)> = all
            .into_par_iter()
            .map(|half_edge| {
                let [from, to] = ends(triangles, half_edge);
                let key = (u64::from(from.min(to)) << 32) | u64::from(from.max(to));
                (key, half_edge)
            })
            .collect();
        by_edge.par_sort_unstable();
        Edges { by_edge }
    }

    /// The half-edges of each edge.
    pub(super) fn groups(&self) -> impl Iterator<Item = &[(u64, u32)]> {
        self.by_edge.chunk_by(|a, b| a.0 == b.0)
    }

    /// The twin of every half-edge.
    pub(super) fn twins(&self, triangles: &[[u32; 3]]) -> Vec<u32> {
        let mut twins = vec![NO_TWIN; 3 * triangles.len()];
        let (mut forwards, mut backwards) = (Vec::new(), Vec::new());
        for group in self.groups() {
            forwards.clear();
            backwards.clear();
            for &(_, half_edge) in group {
                let [from, to] = ends(triangles, half_edge);
                if from < to {
                    forwards.push(half_edge);
                } else {
                    backwards.push(half_edge);
                }
            }
            for (&one, &other) in forwards.iter().zip(&backwards) {
                twins[one as usize] = other;
                twins[other as usize] = one;
            }
        }
        twins
    }
}
