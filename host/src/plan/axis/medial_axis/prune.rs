//! From the complete axis to the pruned axis: the part where passes have to meet.
//!
//! 1. Keep the parts of edges whose object angle is at least a bound: a corner's bisector sees its
//!    feet under 180° less the corner's angle, so flat corners (and the facets of a flattened
//!    curve) go and sharp tips stay.
//! 2. Prune branches with a free end that are short relative to the radius where they start.
//! 3. Drop what is too narrow for any aperture.
//! 4. Restore the largest disk's centre wherever nothing of the pruned axis is left in that disk (a
//!    square's middle), as a vertex without edges.
//!
//! In: the complete axis, bounds of the object angle (rad), of the ratio of length to radius, of
//! the radius (mm). Out: the part of it that is kept, radii unchanged. Sources: D. Attali and A.
//! Montanvert (1996) for the object angle; the ratio of length and radius is ours.

use super::{AxisEdge, AxisPoint, AxisVertex, MedialAxis};
use crate::geometry::Point2;
use crate::geometry::union_find::root;
use crate::plan::axis::pruned_axis::{BRANCH_RATIO, OBJECT_ANGLE_MIN_RAD};

/// Share of a disk's radius within which the pruned axis must pass for the disk to count as seen.
const SEEN_RATIO: f64 = 0.9;
/// A maximum of the radius counts if the path to a larger one narrows by more than this share of
/// it: less is a bulge, or noise of the outline.
const BULGE_RATIO: f64 = 0.02;
/// Rounds of leaf pruning; each shortens every subtree by one branch.
const ROUNDS_MAX: usize = 64;

/// What the pruned axis keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PruneOptions {
    /// Least object angle.
    pub object_angle_min_rad: f64,
    /// A leaf shorter than this many times the radius at its base is removed.
    pub leaf_length_ratio: f64,
    /// Components whose largest radius is below this are dropped (the aperture's b, or a bit less).
    pub radius_min_mm: f64,
}

impl Default for PruneOptions {
    /// 115° and 0.6, which tiled best in trials on real slices; nothing dropped for its radius.
    fn default() -> Self {
        PruneOptions {
            object_angle_min_rad: OBJECT_ANGLE_MIN_RAD,
            leaf_length_ratio: BRANCH_RATIO,
            radius_min_mm: 0.0,
        }
    }
}

/// See [`MedialAxis::pruned`].
pub(super) fn pruned(axis: &MedialAxis, options: &PruneOptions) -> MedialAxis {
    let mut pruned = clipped(axis, options.object_angle_min_rad);
    for _ in 0..ROUNDS_MAX {
        let doomed = short_leaves(&pruned, options.leaf_length_ratio);
        if !doomed.contains(&true) {
            break;
        }
        remove_edges(&mut pruned, &doomed);
    }
    let narrow = narrow_components(&pruned, options.radius_min_mm);
    remove_edges(&mut pruned, &narrow);
    drop_bare_vertices(&mut pruned);
    add_unseen_maxima(axis, &mut pruned, options.radius_min_mm);
    pruned.link();
    pruned
}

/// The pieces of edges with a large enough object angle, cut where it passes the bound.
fn clipped(axis: &MedialAxis, angle_min_rad: f64) -> MedialAxis {
    let mut result = MedialAxis {
        vertices: axis.vertices.clone(),
        dropped_edges: axis.dropped_edges,
        ..MedialAxis::default()
    };
    for edge in &axis.edges {
        let Some(first) = edge.points.first() else {
            continue;
        };
        let keeps = |p: &AxisPoint| p.object_angle_rad >= angle_min_rad;
        let mut piece: Vec<AxisPoint> = Vec::new();
        let mut start = edge.v0;
        if keeps(first) {
            piece.push(*first);
        }
        for pair in edge.points.windows(2) {
            if keeps(&pair[0]) != keeps(&pair[1]) {
                let cut = cut_point(&pair[0], &pair[1], angle_min_rad);
                let vertex = result.vertices.len();
                result.vertices.push(AxisVertex {
                    point: cut.point,
                    radius_mm: cut.radius_mm,
                    feet: cut.feet.to_vec(),
                });
                piece.push(cut);
                if keeps(&pair[0]) {
                    let points = std::mem::take(&mut piece);
                    let generators = edge.generators;
                    result.edges.push(AxisEdge {
                        v0: start,
                        v1: vertex,
                        points,
                        generators,
                    });
                } else {
                    start = vertex;
                }
            }
            if keeps(&pair[1]) {
                piece.push(pair[1]);
            }
        }
        if piece.len() > 1 {
            let generators = edge.generators;
            result.edges.push(AxisEdge {
                v0: start,
                v1: edge.v1,
                points: piece,
                generators,
            });
        }
    }
    result.link();
    result
}

fn cut_point(p: &AxisPoint, q: &AxisPoint, angle_rad: f64) -> AxisPoint {
    let t = ((angle_rad - p.object_angle_rad) / (q.object_angle_rad - p.object_angle_rad))
        .clamp(0.0, 1.0);
    let between = |a: Point2, b: Point2| a + (b - a) * t;
    AxisPoint {
        point: between(p.point, q.point),
        radius_mm: p.radius_mm + (q.radius_mm - p.radius_mm) * t,
        object_angle_rad: angle_rad,
        feet: [between(p.feet[0], q.feet[0]), between(p.feet[1], q.feet[1])],
    }
}

/// Marks the edges of branches to prune this round. Where a junction has nothing but short leaves
/// its two longest stay for now, as one branch to be judged by its whole length next round.
fn short_leaves(pruned: &MedialAxis, ratio: f64) -> Vec<bool> {
    let mut doomed = vec![false; pruned.edges.len()];
    let chains = pruned.chains();
    let mut leaves_at: Vec<Vec<usize>> = vec![Vec::new(); pruned.vertices.len()];
    for (number, chain) in chains.iter().enumerate() {
        let free = [chain.v0, chain.v1].map(|v| pruned.degree(v) == 1);
        if chain.closed || free == [false, false] {
            continue;
        }
        let radius_mm = if free == [true, true] {
            chain.points.iter().map(|p| p.radius_mm).fold(0.0, f64::max)
        } else {
            pruned.vertices[if free[0] { chain.v1 } else { chain.v0 }].radius_mm
        };
        if chain.length_mm() >= ratio * radius_mm {
            continue;
        }
        if free == [true, true] {
            chain.edges.iter().for_each(|&e| doomed[e] = true);
        } else {
            leaves_at[if free[0] { chain.v1 } else { chain.v0 }].push(number);
        }
    }
    for (junction, mut leaves) in leaves_at.into_iter().enumerate() {
        if leaves.len() == pruned.degree(junction) {
            let by_length = |i: &usize, j: &usize| {
                chains[*j]
                    .length_mm()
                    .total_cmp(&chains[*i].length_mm())
                    .then(i.cmp(j))
            };
            leaves.sort_by(by_length);
            leaves.drain(..2.min(leaves.len()));
        }
        for leaf in leaves {
            chains[leaf].edges.iter().for_each(|&e| doomed[e] = true);
        }
    }
    doomed
}

/// Marks the edges of components that are nowhere wide enough.
fn narrow_components(pruned: &MedialAxis, radius_min_mm: f64) -> Vec<bool> {
    let mut component = vec![usize::MAX; pruned.vertices.len()];
    let mut widest_mm = Vec::new();
    for seed in 0..pruned.vertices.len() {
        if component[seed] != usize::MAX {
            continue;
        }
        let number = widest_mm.len();
        let mut widest: f64 = 0.0;
        let mut stack = vec![seed];
        component[seed] = number;
        while let Some(vertex) = stack.pop() {
            for &e in &pruned.adjacency[vertex] {
                let edge = &pruned.edges[e];
                widest = edge
                    .points
                    .iter()
                    .map(|p| p.radius_mm)
                    .fold(widest, f64::max);
                for next in [edge.v0, edge.v1] {
                    if component[next] == usize::MAX {
                        component[next] = number;
                        stack.push(next);
                    }
                }
            }
        }
        widest_mm.push(widest);
    }
    pruned
        .edges
        .iter()
        .map(|e| widest_mm[component[e.v0]] < radius_min_mm)
        .collect()
}

fn remove_edges(pruned: &mut MedialAxis, doomed: &[bool]) {
    let mut number = 0;
    pruned.edges.retain(|_| {
        number += 1;
        !doomed[number - 1]
    });
    pruned.link();
}

fn drop_bare_vertices(pruned: &mut MedialAxis) {
    let mut kept = 0;
    let number_of: Vec<usize> = (0..pruned.vertices.len())
        .map(|vertex| {
            if pruned.degree(vertex) == 0 {
                return usize::MAX;
            }
            kept += 1;
            kept - 1
        })
        .collect();
    let mut vertex = 0;
    pruned.vertices.retain(|_| {
        vertex += 1;
        number_of[vertex - 1] != usize::MAX
    });
    for edge in &mut pruned.edges {
        edge.v0 = number_of[edge.v0];
        edge.v1 = number_of[edge.v1];
    }
    pruned.link();
}

/// Largest disks first: a maximum of the radius is restored if neither the pruned axis nor a vertex
/// restored before passes through the middle of its disk.
fn add_unseen_maxima(axis: &MedialAxis, pruned: &mut MedialAxis, radius_min_mm: f64) {
    let radius = |v: usize| axis.vertices[v].radius_mm;
    let mut maxima = radius_maxima(axis);
    maxima.retain(|&v| radius(v) >= radius_min_mm.max(f64::MIN_POSITIVE));
    maxima.sort_by(|&i, &j| radius(j).total_cmp(&radius(i)).then(i.cmp(&j)));
    let widest_mm = maxima.first().map_or(1.0, |&v| radius(v));
    let (index, _) = pruned.segment_index(widest_mm);
    let mut added: Vec<Point2> = Vec::new();
    for v in maxima {
        let vertex = &axis.vertices[v];
        let reach_mm = SEEN_RATIO * vertex.radius_mm;
        let seen = index.nearest_within(vertex.point, reach_mm).is_some()
            || added.iter().any(|p| (p - vertex.point).norm() <= reach_mm);
        if !seen {
            added.push(vertex.point);
            pruned.vertices.push(vertex.clone());
        }
    }
}

/// Vertices where the radius is largest until it has narrowed by `BULGE_RATIO` (its persistence):
/// edges join the two sides widest first, and where they do the smaller side's peak is settled.
fn radius_maxima(axis: &MedialAxis) -> Vec<usize> {
    let neck_mm = |e: &AxisEdge| {
        e.points
            .iter()
            .map(|p| p.radius_mm)
            .fold(f64::MAX, f64::min)
    };
    let necks_mm: Vec<f64> = axis.edges.iter().map(neck_mm).collect();
    let mut order: Vec<usize> = (0..axis.edges.len()).collect();
    order.sort_by(|&i, &j| necks_mm[j].total_cmp(&necks_mm[i]).then(i.cmp(&j)));
    let mut parent: Vec<usize> = (0..axis.vertices.len()).collect();
    let mut is_peak = vec![true; axis.vertices.len()];
    let radius = |v: usize| axis.vertices[v].radius_mm;
    for number in order {
        let edge = &axis.edges[number];
        // A root is the peak of its side.
        let (a, b) = (root(&mut parent, edge.v0), root(&mut parent, edge.v1));
        if a == b {
            continue;
        }
        let (high, low) = if (radius(a), b) > (radius(b), a) {
            (a, b)
        } else {
            (b, a)
        };
        parent[low] = high;
        is_peak[low] = radius(low) - necks_mm[number] > BULGE_RATIO * radius(low);
    }
    (0..axis.vertices.len()).filter(|&v| is_peak[v]).collect()
}
