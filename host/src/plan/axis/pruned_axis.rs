//! The axis that passes are planned on: the medial axis without the branches that only lead into
//! corners, as a graph of short links.
//!
//! Branches are removed from their free ends only: a part with a small object angle between two
//! others stays, because the bead channels of both sides have to meet across it. Cutting it out
//! would leave places that belong to no axis, and gaps there.
//!
//! In: the interior medial axis, the aperture. Out: nodes with radius (mm) and links between them.
//! Why here: passes need a graph with short links, the medial axis has curves.

use crate::geometry::aperture::Aperture;
use crate::geometry::{Point2, Vector2};
use crate::plan::axis::medial_axis::MedialAxis;

/// A free end goes while its object angle is below this: 115° tiled best in trials on real slices.
/// It also goes while the passage is too narrow for the aperture: nothing is laid there, and the
/// teeth of fine noise are as sharp as any corner, so that their angle alone would keep a branch
/// from each of them to the middle.
pub(super) const OBJECT_ANGLE_MIN_RAD: f64 = 115.0 * std::f64::consts::PI / 180.0;
/// A branch shorter than this many times the radius at its base goes.
pub(super) const BRANCH_RATIO: f64 = 0.6;
/// Rounds of branch pruning; each shortens every subtree by one branch.
const ROUNDS_MAX: usize = 64;

/// The pruned medial axis as a graph of short links.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Axis {
    /// Positions.
    pub points: Vec<Point2>,
    /// Radius of the largest disk there, mm.
    pub radii_mm: Vec<f64>,
    /// Node pairs.
    pub links: Vec<[u32; 2]>,
}

impl Axis {
    /// Neighbours of every node.
    pub fn neighbours(&self) -> Vec<Vec<u32>> {
        let mut neighbours = vec![Vec::new(); self.points.len()];
        for &[a, b] in &self.links {
            neighbours[a as usize].push(b);
            neighbours[b as usize].push(a);
        }
        neighbours
    }

    /// Each link's length and the larger radius of its two ends, mm.
    pub fn lengths_and_radii_mm(&self) -> impl Iterator<Item = (f64, f64)> {
        self.links.iter().map(|nodes| {
            let [p, q] = nodes.map(|node| node as usize);
            let length_mm = (self.points[p] - self.points[q]).norm();
            (length_mm, self.radii_mm[p].max(self.radii_mm[q]))
        })
    }

    /// The axis with no link longer than `step_mm`, radii interpolated linearly.
    pub fn densified(&self, step_mm: f64) -> Axis {
        self.divided(|delta, [rp, rq]| {
            let pieces = ((delta.norm() / step_mm).ceil() as usize).max(1);
            let shares = (1..pieces).map(move |piece| piece as f64 / pieces as f64);
            shares.map(move |t| (t, rp + (rq - rp) * t))
        })
    }

    /// The axis with a node wherever a link's radius, interpolated linearly, passes `radius_mm`:
    /// where a passage becomes too narrow must not depend on how finely its walls are divided.
    pub fn split_at_radius(&self, radius_mm: f64) -> Axis {
        self.divided(|delta, radii_mm| {
            let [from, to] = radii_mm.map(|r| r - radius_mm);
            let t = from / (from - to);
            let is_inside = t.min(1.0 - t) * delta.norm() > SPLIT_MIN_MM;
            (from * to < 0.0 && is_inside).then_some((t, radius_mm))
        })
    }

    /// The axis with nodes on its links: `nodes` gets the length of a link and the radii at its
    /// ends, and returns the share of the length of each node, increasing, and its radius.
    fn divided<Nodes>(&self, nodes: impl Fn(Vector2, [f64; 2]) -> Nodes) -> Axis
    where
        Nodes: IntoIterator<Item = (f64, f64)>,
    {
        let mut divided = Axis {
            points: self.points.clone(),
            radii_mm: self.radii_mm.clone(),
            links: Vec::new(),
        };
        for &[a, b] in &self.links {
            let [p, q] = [a, b].map(|node| self.points[node as usize]);
            let radii_mm = [a, b].map(|node| self.radii_mm[node as usize]);
            let mut last = a;
            for (t, radius_mm) in nodes(q - p, radii_mm) {
                let next = divided.points.len() as u32;
                divided.points.push(p + (q - p) * t);
                divided.radii_mm.push(radius_mm);
                divided.links.push([last, next]);
                last = next;
            }
            divided.links.push([last, b]);
        }
        divided
    }
}

/// Least length of a link that is split off.
const SPLIT_MIN_MM: f64 = 1e-6;

/// The nodes connected with `seed` through nodes that `keep` accepts, marked as seen.
pub fn flood(
    seed: usize,
    neighbours: &[Vec<u32>],
    seen: &mut [bool],
    keep: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let mut found = vec![seed];
    seen[seed] = true;
    let mut head = 0;
    while head < found.len() {
        for &next in &neighbours[found[head]] {
            let next = next as usize;
            if !seen[next] && keep(next) {
                seen[next] = true;
                found.push(next);
            }
        }
        head += 1;
    }
    found
}

/// The graph while it is pruned.
struct Subtree {
    points: Vec<Point2>,
    radii_mm: Vec<f64>,
    /// Neighbour and object angle of the link.
    links: Vec<Vec<(usize, f64)>>,
}

impl Axis {
    /// Prunes the complete interior medial axis. If nothing of a component would remain (a square),
    /// its widest point is kept, if the aperture fits there.
    pub fn of_medial_axis(axis: &MedialAxis, aperture: &Aperture) -> Axis {
        let mut subtree = Subtree::of(axis);
        let widest = subtree.widest_of_branch_tips(aperture.minor_mm());
        subtree.drop_flat_ends(aperture.minor_mm(), &widest);
        for _ in 0..ROUNDS_MAX {
            if !subtree.drop_short_branches() {
                break;
            }
        }
        subtree.into_axis(&widest)
    }
}

impl Subtree {
    fn of(axis: &MedialAxis) -> Subtree {
        let mut subtree = Subtree {
            points: axis.vertices.iter().map(|v| v.point).collect(),
            radii_mm: axis.vertices.iter().map(|v| v.radius_mm).collect(),
            links: vec![Vec::new(); axis.vertices.len()],
        };
        for edge in &axis.edges {
            let count = edge.points.len();
            let mut last = edge.v0;
            for i in 1..count {
                let (p, q) = (&edge.points[i - 1], &edge.points[i]);
                let next = if i + 1 == count {
                    edge.v1
                } else {
                    subtree.points.push(q.point);
                    subtree.radii_mm.push(q.radius_mm);
                    subtree.links.push(Vec::new());
                    subtree.points.len() - 1
                };
                let angle = 0.5 * (p.object_angle_rad + q.object_angle_rad);
                if next != last {
                    subtree.links[last].push((next, angle));
                    subtree.links[next].push((last, angle));
                }
                last = next;
            }
        }
        subtree
    }

    fn unlink(&mut self, a: usize, b: usize) {
        self.links[a].retain(|l| l.0 != b);
        self.links[b].retain(|l| l.0 != a);
    }

    /// The widest node of each part of the axis that holds together where the aperture fits.
    fn widest_of_branch_tips(&self, narrowest_mm: f64) -> Vec<usize> {
        let fits = |node: usize| self.radii_mm[node] >= narrowest_mm;
        let mut seen = vec![false; self.points.len()];
        let mut found = Vec::new();
        for seed in 0..self.points.len() {
            if seen[seed] || !fits(seed) {
                continue;
            }
            seen[seed] = true;
            let (mut widest, mut stack) = (seed, vec![seed]);
            while let Some(node) = stack.pop() {
                if self.radii_mm[node] > self.radii_mm[widest] {
                    widest = node;
                }
                for &(next, _) in &self.links[node] {
                    if !seen[next] && fits(next) {
                        seen[next] = true;
                        stack.push(next);
                    }
                }
            }
            found.push(widest);
        }
        found
    }

    /// Eats free ends while they see their feet under a small angle or are narrower than the
    /// aperture, but not beyond the widest node of a branch tip: beyond a neck is a separate area.
    fn drop_flat_ends(&mut self, narrowest_mm: f64, widest: &[usize]) {
        let mut stays = vec![false; self.points.len()];
        for &node in widest {
            stays[node] = true;
        }
        let mut ends: Vec<usize> = (0..self.links.len())
            .filter(|&n| self.links[n].len() == 1)
            .collect();
        while let Some(end) = ends.pop() {
            if let [(next, angle)] = self.links[end][..]
                && !stays[end]
                && (angle < OBJECT_ANGLE_MIN_RAD || self.radii_mm[next] < narrowest_mm)
            {
                self.unlink(end, next);
                if self.links[next].len() == 1 {
                    ends.push(next);
                }
            }
        }
    }

    /// Removes branches from a free end to a junction that are short relative to the radius there.
    fn drop_short_branches(&mut self) -> bool {
        let mut doomed: Vec<Vec<usize>> = Vec::new();
        for end in 0..self.links.len() {
            if self.links[end].len() != 1 {
                continue;
            }
            let mut branch = vec![end, self.links[end][0].0];
            let mut length = (self.points[branch[1]] - self.points[end]).norm();
            while let [(p, _), (q, _)] = self.links[branch[branch.len() - 1]][..] {
                let (at, before) = (branch[branch.len() - 1], branch[branch.len() - 2]);
                let next = if p == before { q } else { p };
                length += (self.points[next] - self.points[at]).norm();
                branch.push(next);
            }
            let base = branch[branch.len() - 1];
            if self.links[base].len() > 2 && length < BRANCH_RATIO * self.radii_mm[base] {
                doomed.push(branch);
            }
        }
        for branch in &doomed {
            // The last two branches of a junction stay for now: they are one path through it.
            let base = branch[branch.len() - 1];
            if self.links[base].len() > 2 {
                for pair in branch.windows(2) {
                    self.unlink(pair[0], pair[1]);
                }
            }
        }
        !doomed.is_empty()
    }

    /// The linked nodes, and the widest node of each component that lost all its links.
    fn into_axis(self, widest: &[usize]) -> Axis {
        let mut number = vec![u32::MAX; self.points.len()];
        let mut axis = Axis::default();
        let mut keep: Vec<bool> = self.links.iter().map(|l| !l.is_empty()).collect();
        let mut seen = vec![false; self.points.len()];
        for &w in widest {
            // A component whose widest node lost its links may still have others further out.
            let near = |n: usize| (self.points[n] - self.points[w]).norm() <= self.radii_mm[w];
            if !keep[w] && !(0..keep.len()).any(|n| keep[n] && near(n)) {
                seen[w] = true;
            }
        }
        for (flag, lone) in keep.iter_mut().zip(&seen) {
            *flag |= lone;
        }
        for node in 0..self.points.len() {
            if keep[node] {
                number[node] = axis.points.len() as u32;
                axis.points.push(self.points[node]);
                axis.radii_mm.push(self.radii_mm[node]);
            }
        }
        for (node, links) in self.links.iter().enumerate() {
            for &(next, _) in links {
                if node < next {
                    axis.links.push([number[node], number[next]]);
                }
            }
        }
        axis
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: there is a node where a passage gets too narrow, once; links that do not reach there
    /// stay. Method: a link from 0.5 to 0.1 mm over 4 mm, split at 0.2 mm, and again; one that
    /// begins there.
    #[test]
    fn links_are_split_where_the_radius_passes() {
        let axis = Axis {
            points: [0.0, 4.0, 5.0].map(|x| Point2::new(x, 0.0)).to_vec(),
            radii_mm: vec![0.5, 0.1, 0.1],
            links: vec![[0, 1], [1, 2]],
        };
        let split = axis.split_at_radius(0.2);
        assert_eq!(split.links, vec![[0, 3], [3, 1], [1, 2]]);
        assert_eq!(split.radii_mm[3], 0.2);
        assert!((split.points[3] - Point2::new(3.0, 0.0)).norm() < 1e-12);
        assert_eq!(split.split_at_radius(0.2), split);
    }
}
