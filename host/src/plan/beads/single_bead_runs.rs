//! Stretches of the axis where only one bead fits across, and the region cut along their ends.
//!
//! In: a region with its walls and axis (mm). Out: single-bead paths along the axis, and the parts of
//! the region (mm) that remain for two sides. Why here: both cuts must be at the same nodes.

use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::Region;
use crate::geometry::{Point2, Vector2};
use crate::plan::axis::pruned_axis::{Axis, flood};
use crate::plan::axis::region_cut::{chord, slice};
use crate::plan::beads::division::cheapest_division;
use crate::plan::beads::passes::PassSettings;
use crate::plan::beads::single_bead_paths::{SingleBeadPath, single_bead_paths};
use crate::plan::pass::Contact;
use rayon::prelude::*;

/// A one-pass run along the axis.
#[derive(Clone, Debug, PartialEq)]
pub struct SingleRun {
    /// Contacts on the axis, in order.
    pub contacts: Vec<Contact>,
    /// True where the run is a closed loop.
    pub closed: bool,
}

/// A part of the region for two-sided channels, with its part of the axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Outline, the cutting chords included.
    pub region: Region,
    /// Axis nodes inside it.
    pub axis: Axis,
}

/// A region divided.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Split {
    /// Pieces for two-sided channels.
    pub pieces: Vec<Piece>,
    /// One-pass runs.
    pub runs: Vec<SingleRun>,
}

/// Divides a region into single beads and two-sided parts. `axis` must be densified.
pub fn split_region(
    region: &Region,
    walls: &EdgeIndex,
    axis: &Axis,
    settings: &PassSettings,
) -> Split {
    let neighbours = axis.neighbours();
    let single = single_nodes(axis, &neighbours, settings);
    if !single.iter().any(|&s| s) {
        let piece = Piece {
            region: region.clone(),
            axis: axis.clone(),
        };
        return Split {
            pieces: vec![piece],
            runs: Vec::new(),
        };
    }
    let mut chords = Vec::new();
    for &[a, b] in &axis.links {
        let (a, b) = (a as usize, b as usize);
        if single[a] != single[b] {
            let (inner, outer) = if single[a] { (a, b) } else { (b, a) };
            // A joint is as far from the corners of its other branches.
            let seen_from = if neighbours[inner].len() > 2 {
                outer
            } else {
                inner
            };
            let [at, towards, seen_from] = [inner, outer, seen_from].map(|n| axis.points[n]);
            chords.push(chord(at, towards, seen_from, walls, axis.radii_mm[inner]));
        }
    }
    let nodes = NodesByPlace::new(axis, &single);
    let pieces = slice(region, &chords)
        .into_par_iter()
        .filter_map(|outline| piece_of(outline, axis, &nodes))
        .collect();
    let runs = runs(axis, &neighbours, &single, settings);
    Split { pieces, runs }
}

/// Marks the nodes of single runs: the cheapest division of the axis into stretches with one bead
/// and with two sides, and all stretches that are too narrow to print but lead to a printable one.
fn single_nodes(axis: &Axis, neighbours: &[Vec<u32>], settings: &PassSettings) -> Vec<bool> {
    let is_neck = necks(axis, neighbours, settings.aperture.minor_mm());
    let mut single = cheapest_division(axis, neighbours, &is_neck, settings);
    drop_short_pieces(&mut single, axis, neighbours, settings.aperture.major_mm());
    for (single, is_neck) in single.iter_mut().zip(is_neck) {
        *single |= is_neck;
    }
    single
}

/// Marks the nodes that are too narrow to print but lead to printable ones.
fn necks(axis: &Axis, neighbours: &[Vec<u32>], b: f64) -> Vec<bool> {
    let mut is_neck = vec![false; axis.points.len()];
    let mut seen = is_neck.clone();
    for seed in 0..axis.points.len() {
        if seen[seed] || axis.radii_mm[seed] >= b {
            continue;
        }
        let component = flood(seed, neighbours, &mut seen, |n| axis.radii_mm[n] < b);
        if !is_tip(&component, neighbours) {
            for node in component {
                is_neck[node] = true;
            }
        }
    }
    is_neck
}

/// Least length that a contact on the axis represents, mm.
const LENGTH_MIN_MM: f64 = 0.02;

/// Gives pieces to the single runs about them that are too short for two sides and not too wide for
/// one bead.
fn drop_short_pieces(single: &mut [bool], axis: &Axis, neighbours: &[Vec<u32>], a: f64) {
    let divided = single.to_vec();
    if !divided.contains(&true) {
        return;
    }
    let mut seen = vec![false; axis.points.len()];
    for seed in 0..axis.points.len() {
        if seen[seed] || divided[seed] {
            continue;
        }
        let piece = flood(seed, neighbours, &mut seen, |n| !divided[n]);
        let step = |n: usize| {
            let near = neighbours[n].iter().map(|&m| m as usize);
            let links = near.filter(|&m| !divided[m]);
            links
                .map(|m| (axis.points[m] - axis.points[n]).norm())
                .sum::<f64>()
        };
        let length_mm = 0.5 * piece.iter().map(|&n| step(n)).sum::<f64>();
        let meets_run = piece
            .iter()
            .any(|&n| neighbours[n].iter().any(|&m| divided[m as usize]));
        if meets_run && length_mm < 2.0 * a && piece.iter().all(|&n| axis.radii_mm[n] <= a) {
            for node in piece {
                single[node] = true;
            }
        }
    }
}

/// True where the unprintable nodes of a component only end in a corner (a leaf), so that nothing
/// beyond them is cut off.
fn is_tip(component: &[usize], neighbours: &[Vec<u32>]) -> bool {
    component.iter().any(|&n| neighbours[n].len() <= 1)
}

/// The nodes that belong to parts, so that a part only searches those near it.
struct NodesByPlace {
    /// Numbers of the nodes by rising x.
    by_x: Vec<u32>,
    /// For each node the numbers of the links of which it is the first node.
    links: Vec<Vec<u32>>,
}

impl NodesByPlace {
    fn new(axis: &Axis, single: &[bool]) -> NodesByPlace {
        let mut by_x: Vec<u32> = (0..axis.points.len() as u32)
            .filter(|&node| !single[node as usize])
            .collect();
        by_x.sort_by(|&m, &n| {
            let x = |node: u32| axis.points[node as usize].x;
            x(m).total_cmp(&x(n))
        });
        let mut links = vec![Vec::new(); axis.points.len()];
        for (number, &[a, _]) in axis.links.iter().enumerate() {
            links[a as usize].push(number as u32);
        }
        NodesByPlace { by_x, links }
    }
}

/// The piece with its axis nodes; `None` if it belongs to single runs.
fn piece_of(outline: Region, axis: &Axis, nodes: &NodesByPlace) -> Option<Piece> {
    let index = EdgeIndex::of_region(&outline, 1.0);
    let bounds = index.bounds();
    let x = |node: &u32| axis.points[*node as usize].x;
    let first = nodes.by_x.partition_point(|node| x(node) < bounds.min.x);
    let behind = nodes.by_x.partition_point(|node| x(node) <= bounds.max.x);
    // In the axis's own order.
    let mut own_nodes: Vec<u32> = nodes.by_x[first..behind.max(first)]
        .iter()
        .copied()
        .filter(|&node| index.contains(axis.points[node as usize]))
        .collect();
    own_nodes.sort_unstable();
    if own_nodes.is_empty() {
        return None;
    }
    let number = |node: u32| own_nodes.binary_search(&node).ok().map(|n| n as u32);
    let starts = own_nodes.iter().map(|&node| node as usize);
    let mut links: Vec<u32> = starts
        .clone()
        .flat_map(|node| nodes.links[node].iter().copied())
        .collect();
    links.sort_unstable();
    let links = links.into_iter().map(|link| axis.links[link as usize]);
    let own = Axis {
        points: starts.clone().map(|node| axis.points[node]).collect(),
        radii_mm: starts.map(|node| axis.radii_mm[node]).collect(),
        links: links
            .filter_map(|[a, b]| Some([number(a)?, number(b)?]))
            .collect(),
    };
    Some(Piece {
        region: outline,
        axis: own,
    })
}

/// Single-bead paths of single nodes as contacts on the axis.
fn runs(
    axis: &Axis,
    neighbours: &[Vec<u32>],
    single: &[bool],
    settings: &PassSettings,
) -> Vec<SingleRun> {
    let (a, b) = (settings.aperture.major_mm(), settings.aperture.minor_mm());
    let usable: Vec<bool> = (0..single.len())
        .map(|n| single[n] && axis.radii_mm[n] >= b)
        .collect();
    let is_long = |path: &SingleBeadPath| path.nodes.len() >= 2;
    let run = |path: SingleBeadPath| {
        let last = path.nodes.len() - 1;
        let ends = [(0, 0), (1, last)].map(|(end, at)| {
            let near = neighbours[path.nodes[at]].iter().map(|&n| n as usize);
            let piece = near.filter(|&n| !single[n]).min();
            match path.joints[end].or(piece) {
                Some(node) => RunEnd::Meets(node),
                None => RunEnd::Free,
            }
        });
        SingleRun {
            contacts: axis_contacts(&path.nodes, ends, axis, settings, path.closed),
            closed: path.closed,
        }
    };
    let paths = single_bead_paths(axis, neighbours, &usable, a);
    paths.into_iter().filter(is_long).map(run).collect()
}

/// The continuation after the end of a single bead.
#[derive(Clone, Copy, Debug)]
enum RunEnd {
    /// A wall.
    Free,
    /// Another bead, on this node.
    Meets(usize),
}

/// Contacts on a chain of axis nodes. A free end is lengthened by r - b so that the aperture
/// reaches the wall beyond it; one that meets another bead continues to the junction.
fn axis_contacts(
    chain: &[usize],
    ends: [RunEnd; 2],
    axis: &Axis,
    settings: &PassSettings,
    closed: bool,
) -> Vec<Contact> {
    let (a, b) = (settings.aperture.major_mm(), settings.aperture.minor_mm());
    let mut points: Vec<(Point2, f64)> = chain
        .iter()
        .map(|&n| (axis.points[n], axis.radii_mm[n]))
        .collect();
    if !closed {
        finish(&mut points, ends[1], axis, b);
        points.reverse();
        finish(&mut points, ends[0], axis, b);
        points.reverse();
    }
    let count = points.len();
    (0..count)
        .map(|i| {
            let (p, r) = points[i];
            let before = points[i.saturating_sub(2)].0;
            let after = points[(i + 2).min(count - 1)].0;
            let along = (after - before)
                .try_normalize(1e-12)
                .unwrap_or(Vector2::x());
            let step = if i + 1 < count {
                (points[i + 1].0 - p).norm()
            } else {
                0.0
            };
            Contact {
                point: p,
                normal: Vector2::new(-along.y, along.x),
                length_mm: step.max(LENGTH_MIN_MM),
                extent_mm: settings.law_extent_mm(r.clamp(b, a)),
                on_axis: true,
            }
        })
        .collect()
}

/// Lengthens the end of a run to the wall or to the joint.
fn finish(points: &mut Vec<(Point2, f64)>, end: RunEnd, axis: &Axis, b: f64) {
    match end {
        RunEnd::Free => lengthen(points, b),
        // Whatever else covers the joint: the end is cut back to it later.
        RunEnd::Meets(node) => points.push((axis.points[node], axis.radii_mm[node])),
    }
}

/// Adds points beyond the last one, r - b further along the axis.
fn lengthen(points: &mut Vec<(Point2, f64)>, b: f64) {
    let count = points.len();
    let Some(&(end, radius)) = points.last() else {
        return;
    };
    let back = points[count.saturating_sub(4)].0;
    let Some(along) = (end - back).try_normalize(1e-12) else {
        return;
    };
    let extra = radius - b;
    let steps = (extra / (0.5 * b)).ceil().max(0.0) as usize;
    for step in 1..=steps {
        points.push((end + along * (extra * step as f64 / steps as f64), radius));
    }
}
