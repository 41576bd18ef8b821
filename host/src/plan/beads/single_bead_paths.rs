//! Single-bead paths: divides the axis of single beads into as few paths as its junctions allow.
//!
//! At a junction of three or more branches, pairs of them are connected, the straightest first, so
//! that one branch at most ends there: half as many single-bead paths as there are junctions and
//! ends of odd degree (L. Euler, 1736), wherever the walk begins. A pair that would close a loop is
//! considered after the others: a loop at which a branch ends is better followed by that branch.
//!
//! In: axis, its neighbours, the nodes that may be used, the reach over which directions are taken
//! (mm). Out: paths as lists of nodes, each link in one of them.

use crate::geometry::Vector2;
use crate::geometry::union_find::root;
use crate::plan::axis::pruned_axis::Axis;
use std::collections::{HashMap, HashSet};

/// One path along the axis.
#[derive(Clone, Debug, PartialEq)]
pub struct SingleBeadPath {
    /// Nodes in order; of a closed single-bead path the first is not repeated.
    pub nodes: Vec<usize>,
    /// The junctions at its ends, not among the nodes: other single-bead paths pass there.
    pub joints: [Option<usize>; 2],
    /// True where the last node is linked with the first.
    pub closed: bool,
}

/// A branch where it leaves a joint: the joint and the next node.
type Leg = (usize, usize);

/// The single-bead paths of the graph of the `usable` nodes of the axis, each link in one of them.
/// Directions at junctions are measured over `reach_mm`. Nodes without a usable neighbour are
/// omitted.
pub fn single_bead_paths(
    axis: &Axis,
    neighbours: &[Vec<u32>],
    usable: &[bool],
    reach_mm: f64,
) -> Vec<SingleBeadPath> {
    let graph = Graph::new(axis, neighbours, usable);
    let branches = graph.branches();
    let partners = graph.partners(&branches, reach_mm);
    let mut paths = graph.traced(&branches, &partners);
    paths.extend(graph.rings(&branches));
    paths
}

/// The usable part of an axis.
struct Graph<'a> {
    axis: &'a Axis,
    /// Usable neighbours of usable nodes.
    neighbours: Vec<Vec<usize>>,
}

/// A chain of nodes between two joints or leaves, both included.
struct Branch {
    nodes: Vec<usize>,
}

impl Branch {
    /// The node at its start (0) or end (1) and the next one inwards.
    fn leg(&self, end: usize) -> Leg {
        let last = self.nodes.len() - 1;
        match end {
            0 => (self.nodes[0], self.nodes[1]),
            _ => (self.nodes[last], self.nodes[last - 1]),
        }
    }
}

/// An end of a branch: its number, and 0 for the start or 1 for the end.
type End = (usize, usize);

impl Graph<'_> {
    fn new<'a>(axis: &'a Axis, neighbours: &[Vec<u32>], usable: &[bool]) -> Graph<'a> {
        let usable_of = |(node, near): (usize, &Vec<u32>)| {
            let near = near.iter().map(|&n| n as usize);
            near.filter(|&n| usable[node] && usable[n]).collect()
        };
        Graph {
            axis,
            neighbours: neighbours.iter().enumerate().map(usable_of).collect(),
        }
    }

    /// The branches between joints and leaves, each once.
    fn branches(&self) -> Vec<Branch> {
        let mut branches: Vec<Branch> = Vec::new();
        let mut known: HashSet<Leg> = HashSet::new();
        for (start, near) in self.neighbours.iter().enumerate() {
            if near.len() == 2 {
                continue;
            }
            for &next in near {
                if known.contains(&(start, next)) {
                    continue;
                }
                let mut nodes = vec![start, next];
                while let [p, q] = self.neighbours[nodes[nodes.len() - 1]][..] {
                    let before = nodes[nodes.len() - 2];
                    nodes.push(if p == before { q } else { p });
                }
                let branch = Branch { nodes };
                known.extend([branch.leg(0), branch.leg(1)]);
                branches.push(branch);
            }
        }
        branches
    }

    /// Continuations at the junctions.
    fn partners(&self, branches: &[Branch], reach_mm: f64) -> HashMap<End, End> {
        let mut at_joint: HashMap<usize, Vec<End>> = HashMap::new();
        for (number, branch) in branches.iter().enumerate() {
            for end in [0, 1] {
                let (node, _) = branch.leg(end);
                if self.neighbours[node].len() > 2 {
                    at_joint.entry(node).or_default().push((number, end));
                }
            }
        }
        let mut pairs: Vec<(f64, End, End)> = Vec::new();
        for ends in at_joint.values() {
            let ways: Vec<Vector2> = ends
                .iter()
                .map(|&end| self.direction(branches, end, reach_mm))
                .collect();
            for (i, first) in ends.iter().enumerate() {
                for (j, second) in ends.iter().enumerate().skip(i + 1) {
                    pairs.push((ways[i].dot(&ways[j]), *first, *second));
                }
            }
        }
        pairs.sort_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
        let mut partners = HashMap::new();
        let mut path_of: Vec<usize> = (0..branches.len()).collect();
        for may_close in [false, true] {
            for &(_, first, second) in &pairs {
                let [x, y] = [first.0, second.0].map(|branch| root(&mut path_of, branch));
                let is_free = |end| !partners.contains_key(end);
                if is_free(&first) && is_free(&second) && (may_close || x != y) {
                    partners.insert(first, second);
                    partners.insert(second, first);
                    path_of[x.max(y)] = x.min(y);
                }
            }
        }
        partners
    }

    /// The direction of a branch away from its end.
    fn direction(&self, branches: &[Branch], (branch, end): End, reach_mm: f64) -> Vector2 {
        let nodes = &branches[branch].nodes;
        let at = |step: usize| {
            let node = match end {
                0 => nodes[step],
                _ => nodes[nodes.len() - 1 - step],
            };
            self.axis.points[node]
        };
        let (mut step, mut way_mm) = (0, 0.0);
        while step + 1 < nodes.len() && way_mm < reach_mm {
            way_mm += (at(step + 1) - at(step)).norm();
            step += 1;
        }
        let way = at(step) - at(0);
        way.try_normalize(1e-12).unwrap_or(Vector2::zeros())
    }

    /// Consecutive branches: open single-bead paths from their free ends, then loops.
    fn traced(&self, branches: &[Branch], partners: &HashMap<End, End>) -> Vec<SingleBeadPath> {
        let mut taken = vec![false; branches.len()];
        let mut found = Vec::new();
        for from_free in [true, false] {
            for start in (0..branches.len()).flat_map(|branch| [(branch, 0), (branch, 1)]) {
                if !taken[start.0] && (!from_free || !partners.contains_key(&start)) {
                    found.push(self.path(branches, partners, start, &mut taken));
                }
            }
        }
        found
    }

    /// The single-bead path that enters the branch `start.0` at its end `start.1`.
    fn path(
        &self,
        branches: &[Branch],
        partners: &HashMap<End, End>,
        start: End,
        taken: &mut [bool],
    ) -> SingleBeadPath {
        let mut nodes = Vec::new();
        let mut entered = start;
        let closed = loop {
            let (number, end) = entered;
            taken[number] = true;
            nodes.pop();
            let branch = branches[number].nodes.iter();
            match end {
                0 => nodes.extend(branch),
                _ => nodes.extend(branch.rev()),
            }
            match partners.get(&(number, 1 - end)) {
                Some(&next) if next == start => break true,
                Some(&next) => entered = next,
                None => break false,
            }
        };
        if closed {
            nodes.pop();
        }
        let is_joint = |node: usize| !closed && self.neighbours[node].len() > 2;
        let last = nodes.pop_if(|node| is_joint(*node));
        let first = nodes.first().copied().filter(|&node| is_joint(node));
        if first.is_some() {
            nodes.remove(0);
        }
        SingleBeadPath {
            nodes,
            joints: [first, last],
            closed,
        }
    }

    /// Loops without a joint.
    fn rings(&self, branches: &[Branch]) -> Vec<SingleBeadPath> {
        let mut seen: Vec<bool> = self.neighbours.iter().map(|n| n.len() != 2).collect();
        for &node in branches.iter().flat_map(|branch| &branch.nodes) {
            seen[node] = true;
        }
        let mut rings = Vec::new();
        for start in 0..seen.len() {
            if seen[start] {
                continue;
            }
            let mut nodes = vec![start];
            seen[start] = true;
            let onward = |at: usize, seen: &[bool]| {
                let near = self.neighbours[at].iter().copied();
                near.into_iter().find(|&n| !seen[n])
            };
            while let Some(next) = onward(nodes[nodes.len() - 1], &seen) {
                seen[next] = true;
                nodes.push(next);
            }
            rings.push(SingleBeadPath {
                nodes,
                joints: [None, None],
                closed: true,
            });
        }
        rings
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;

    fn axis(points: &[[f64; 2]], links: &[[u32; 2]]) -> Axis {
        let axis = Axis {
            points: points.iter().map(|p| Point2::new(p[0], p[1])).collect(),
            radii_mm: vec![0.3; points.len()],
            links: links.to_vec(),
        };
        axis.densified(0.1)
    }

    fn all(axis: &Axis) -> Vec<SingleBeadPath> {
        let usable = vec![true; axis.points.len()];
        single_bead_paths(axis, &axis.neighbours(), &usable, 0.6)
    }

    /// Every link lies in one single-bead path, once.
    fn assert_each_link_once(axis: &Axis, paths: &[SingleBeadPath]) {
        let mut count: HashMap<[usize; 2], usize> = HashMap::new();
        for path in paths {
            let mut nodes: Vec<usize> = path.joints[0].into_iter().collect();
            nodes.extend(&path.nodes);
            nodes.extend(path.joints[1]);
            if path.closed {
                nodes.push(nodes[0]);
            }
            for pair in nodes.windows(2) {
                let key = [pair[0].min(pair[1]), pair[0].max(pair[1])];
                *count.entry(key).or_default() += 1;
            }
        }
        for &[a, b] in &axis.links {
            let key = [a.min(b) as usize, a.max(b) as usize];
            assert_eq!(count.remove(&key), Some(1), "{key:?}");
        }
        assert!(count.is_empty(), "ways beside the links: {count:?}");
    }

    /// Goal: a strut between two joints is one single-bead path whatever its nodes' numbers are (a
    /// walk that begins in its middle and goes the one way alone falls into dozens of pieces).
    /// Method: a wheel of a ring and four spokes without any free end, its nodes numbered in 20
    /// ways.
    #[test]
    fn the_numbers_of_the_nodes_do_not_matter() {
        let points = [[0.0, 0.0], [5.0, 0.0], [0.0, 5.0], [-5.0, 0.0], [0.0, -5.0]];
        let links = [
            [0, 1],
            [0, 2],
            [0, 3],
            [0, 4],
            [1, 2],
            [2, 3],
            [3, 4],
            [4, 1],
        ];
        let whole = axis(&points, &links);
        let count = whole.points.len();
        for shift in 0..20 {
            let renumbered = |node: u32| (node as usize * 41 + shift * 11) % count;
            assert_ne!(count % 41, 0);
            let mut points = whole.points.clone();
            for node in 0..count {
                points[renumbered(node as u32)] = whole.points[node];
            }
            let links = whole.links.iter();
            let links = links.map(|link| link.map(|node| renumbered(node) as u32));
            let renumbered = Axis {
                points,
                radii_mm: whole.radii_mm.clone(),
                links: links.collect(),
            };
            let paths = all(&renumbered);
            assert_each_link_once(&renumbered, &paths);
            // Four joints of three branches: two single-bead paths.
            assert_eq!(paths.len(), 2, "{shift}");
        }
    }

    /// Goal: as few single-bead paths as Euler's count allows on honeycombs and ladders, closed or
    /// with free ends. Method: half the number of nodes of odd degree, counted here.
    #[test]
    fn there_are_half_as_many_paths_as_odd_nodes() {
        for (columns, rows, spurs) in [(2, 2, 0), (3, 5, 0), (6, 4, 3), (7, 7, 11), (1, 9, 1)] {
            let mut points = Vec::new();
            let mut links = Vec::new();
            for row in 0..=rows {
                for column in 0..=columns {
                    let number = points.len() as u32;
                    points.push([2.0 * f64::from(column), 2.0 * f64::from(row)]);
                    if column > 0 {
                        links.push([number - 1, number]);
                    }
                    if row > 0 && (row + column) % 2 == 0 {
                        links.push([number - columns as u32 - 1, number]);
                    }
                }
            }
            for spur in 0..spurs {
                let at = (7 * spur) % points.len();
                points.push([points[at][0] + 0.7, points[at][1] + 0.9]);
                links.push([at as u32, points.len() as u32 - 1]);
            }
            let axis = axis(&points, &links);
            let (paths, near) = (all(&axis), axis.neighbours());
            assert_each_link_once(&axis, &paths);
            let odd = near.iter().filter(|n| n.len() % 2 == 1).count();
            let components = components(&near);
            assert!(paths.len() >= odd / 2);
            assert!(
                paths.len() < odd / 2 + components,
                "{columns} {rows}: {} paths, {odd} odd nodes, {components} parts",
                paths.len()
            );
        }
    }

    fn components(near: &[Vec<u32>]) -> usize {
        let mut seen = vec![false; near.len()];
        let mut count = 0;
        for seed in 0..near.len() {
            let mut stack = vec![seed];
            count += usize::from(!seen[seed]);
            while let Some(node) = stack.pop() {
                if !std::mem::replace(&mut seen[node], true) {
                    stack.extend(near[node].iter().map(|&n| n as usize));
                }
            }
        }
        count
    }

    /// Goal: of a ring on a stem one single-bead path comes, which goes around; a ring alone is
    /// closed.
    #[test]
    fn a_loop_is_gone_around_by_what_ends_there() {
        let ring = [[0.0, 0.0], [2.0, 2.0], [0.0, 4.0], [-2.0, 2.0]];
        let links = [[0, 1], [1, 2], [2, 3], [3, 0]];
        let alone = axis(&ring, &links);
        let paths = all(&alone);
        assert_each_link_once(&alone, &paths);
        assert_eq!(paths.len(), 1);
        assert!(paths[0].closed);
        let mut points = ring.to_vec();
        points.push([0.0, -3.0]);
        let mut links = links.to_vec();
        links.push([0, 4]);
        let lollipop = axis(&points, &links);
        let paths = all(&lollipop);
        assert_each_link_once(&lollipop, &paths);
        assert_eq!(paths.len(), 1);
        assert_eq!(paths[0].joints.iter().flatten().count(), 1);
    }
}
