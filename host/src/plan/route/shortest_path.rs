//! The shortest path of a point through free area, at a clearance from its boundary.
//!
//! Shortest paths bend only around corners of the boundary that project into the free area. Each
//! such corner, its arc at the clearance replaced by tangents of at most 30°, gives nodes; two
//! nodes are mutually visible if the straight line between them keeps the clearance from every
//! edge. The search is A* over the nodes, with visibility evaluated on demand. The path is longer
//! than the exact one by at most 1 / cos 15° - 1 = 3.5 % of its arcs.
//!
//! Input: rings with the free area on their left. Bounded by [`NODES_MAX`]: for areas that need
//! more nodes there is no router.

use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::{Box2, Ring};
use crate::geometry::{Point2, Vector2};

/// Maximum number of nodes: at worst nine million lines of sight for a complete layer, some 20 s;
/// the search evaluates a small share of them.
pub const NODES_MAX: usize = 3000;
/// Largest turn that one node represents.
const NODE_TURN_RAD: f64 = std::f64::consts::FRAC_PI_6;
/// Nodes are this much farther out than the clearance, lines of sight may be this much closer:
/// rounding.
const ROUNDING_MM: f64 = 1e-7;
/// Length of the parts in which a line of sight is checked, cells of the index.
const PIECE_CELLS: f64 = 4.0;

/// Finds paths through one free area.
#[derive(Clone, Debug)]
pub struct TravelRouter {
    bounds: EdgeIndex,
    /// True if the free area is inside the rings rather than around them.
    inside: bool,
    clearance_mm: f64,
    nodes: Vec<Point2>,
    /// The nodes that each node sees, once computed.
    seen: Vec<Option<Vec<u32>>>,
}

impl TravelRouter {
    /// For the area inside the rings (`inside`) or outside them; `None` if it has too many corners.
    pub fn new<'a>(
        rings: impl Iterator<Item = &'a Ring> + Clone,
        inside: bool,
        clearance_mm: f64,
    ) -> Option<TravelRouter> {
        let mut router = TravelRouter::ground_of(rings.clone(), inside, clearance_mm);
        for ring in rings {
            for node in ring_nodes(ring, clearance_mm * (1.0 + 1e-9) + ROUNDING_MM) {
                if router.is_free(node) {
                    router.nodes.push(node);
                }
            }
            if router.nodes.len() > NODES_MAX {
                return None;
            }
        }
        router.seen = vec![None; router.nodes.len()];
        Some(router)
    }

    /// A router without nodes, which only tests points and lines of sight.
    pub fn ground_of<'a>(
        rings: impl Iterator<Item = &'a Ring>,
        inside: bool,
        clearance_mm: f64,
    ) -> TravelRouter {
        let edges = rings.flat_map(Ring::edges);
        let cell_mm = clearance_mm.max(1.0);
        TravelRouter {
            bounds: EdgeIndex::new(edges.map(|(a, b)| Edge { a, b }).collect(), cell_mm),
            inside,
            clearance_mm,
            nodes: Vec::new(),
            seen: Vec::new(),
        }
    }

    /// True if the point is in the free area at the clearance.
    pub fn is_free(&self, p: Point2) -> bool {
        self.bounds.contains(p) == self.inside && self.sees(p, p)
    }

    /// True if the straight line between two points, one of them in the free area, keeps the
    /// clearance.
    pub fn sees(&self, from: Point2, to: Point2) -> bool {
        let reach_mm = (self.clearance_mm - ROUNDING_MM).max(0.0);
        let way = to - from;
        let piece_mm = PIECE_CELLS * self.bounds.cell_mm();
        let pieces = (way.norm() / piece_mm).ceil().clamp(1.0, 1e6) as usize;
        (0..pieces).all(|piece| {
            let at = |i: usize| from + way * (i as f64 / pieces as f64);
            let (p, q) = (at(piece), at(piece + 1));
            let mut clear = true;
            let area = Box2::of(&[p, q]).grown(reach_mm);
            self.bounds.for_edges_in(area, |number| {
                let edge = &self.bounds.edges()[number];
                clear = clear && apart_by(&Edge { a: p, b: q }, edge, reach_mm);
            });
            clear
        })
    }

    /// The corners of the shortest path, without ends; `None` if there is none, or if either end is
    /// not free.
    pub fn way(&mut self, from: Point2, to: Point2) -> Option<Vec<Point2>> {
        if !self.is_free(from) || !self.is_free(to) {
            return None;
        }
        if self.sees(from, to) {
            return Some(Vec::new());
        }
        let count = self.nodes.len();
        let left_mm: Vec<f64> = self.nodes.iter().map(|node| (node - to).norm()).collect();
        let mut length_mm: Vec<f64> = (0..count)
            .map(|n| {
                if self.sees(from, self.nodes[n]) {
                    (self.nodes[n] - from).norm()
                } else {
                    f64::INFINITY
                }
            })
            .collect();
        let mut before: Vec<Option<usize>> = vec![None; count];
        let mut done = vec![false; count];
        let mut best = None;
        for _ in 0..count {
            // No path over a node is shorter than this.
            let least_mm = |n: usize| length_mm[n] + left_mm[n];
            let open = (0..count).filter(|&n| !done[n] && length_mm[n].is_finite());
            let Some(node) = open.min_by(|&m, &n| least_mm(m).total_cmp(&least_mm(n))) else {
                break;
            };
            done[node] = true;
            if self.sees(self.nodes[node], to) {
                // The least of all open ones: no shorter one follows.
                best = Some(node);
                break;
            }
            for next in self.seen_from(node) {
                let next = next as usize;
                let whole_mm = length_mm[node] + (self.nodes[next] - self.nodes[node]).norm();
                if whole_mm < length_mm[next] {
                    length_mm[next] = whole_mm;
                    before[next] = Some(node);
                }
            }
        }
        let mut node = Some(best?);
        let mut way = Vec::new();
        while let Some(at) = node {
            way.push(self.nodes[at]);
            node = before[at];
        }
        way.reverse();
        Some(way)
    }

    fn seen_from(&mut self, node: usize) -> Vec<u32> {
        if let Some(seen) = &self.seen[node] {
            return seen.clone();
        }
        let own = self.nodes[node];
        let seen: Vec<u32> = (0..self.nodes.len())
            .filter(|&other| other != node && self.sees(own, self.nodes[other]))
            .map(|other| other as u32)
            .collect();
        self.seen[node] = Some(seen.clone());
        seen
    }
}

/// True where two segments are at least `reach_mm` apart, or do not cross for a reach of 0.
fn apart_by(one: &Edge, other: &Edge, reach_mm: f64) -> bool {
    let side = |e: &Edge, p: Point2| (e.b - e.a).perp(&(p - e.a));
    let crosses = side(one, other.a) * side(one, other.b) < 0.0
        && side(other, one.a) * side(other, one.b) < 0.0;
    let far = |p: Point2, e: &Edge| (p - e.foot(p)).norm() >= reach_mm;
    !crosses && far(one.a, other) && far(one.b, other) && far(other.a, one) && far(other.b, one)
}

/// A run of corners that turn to the right by little, which share a node.
struct CornerRun {
    /// The edge before the first corner.
    edge: usize,
    turned_rad: f64,
    length_mm: f64,
}

/// A ring, by edges and corners counted around it.
struct Corners<'a> {
    points: &'a [Point2],
    clearance_mm: f64,
}

impl Corners<'_> {
    fn point(&self, i: usize) -> Point2 {
        self.points[i % self.points.len()]
    }

    /// Left normal of the edge that begins in point `i`.
    fn normal(&self, i: usize) -> Vector2 {
        let (a, b) = (self.point(i), self.point(i + 1));
        Edge { a, b }.normal()
    }

    /// Turn to the right at the end of edge `i`.
    fn turned_rad(&self, i: usize) -> f64 {
        let (m, n) = (self.normal(i), self.normal(i + 1));
        -m.perp(&n).atan2(m.dot(&n))
    }

    /// True where the corner at the end of `edge` can share the run's node.
    fn goes_on(&self, run: &CornerRun, edge: usize, turned_rad: f64) -> bool {
        let step_mm = (self.point(edge + 1) - self.point(edge)).norm();
        let whole_rad = run.turned_rad + turned_rad;
        // The node is farther out than the clearance by about an eighth of this.
        let out_mm = (run.length_mm + step_mm) * whole_rad;
        turned_rad > 0.0 && whole_rad <= NODE_TURN_RAD && out_mm <= 4.0 * self.clearance_mm
    }

    /// The node of a run whose last corner begins edge `next`.
    fn node(&self, run: &CornerRun, next: usize) -> Option<Point2> {
        let normal = self.normal(run.edge);
        let normal_next = turned_by(normal, -run.turned_rad);
        let p = self.point(run.edge + 1) + normal * self.clearance_mm;
        let q = self.point(next) + normal_next * self.clearance_mm;
        let (along, along_next) = (
            turned_by(normal, -QUARTER),
            turned_by(normal_next, -QUARTER),
        );
        let across = along.perp(&along_next);
        // Parallels to the first and the last edge meet there.
        (across.abs() > 1e-9).then(|| p + along * ((q - p).perp(&along_next) / across))
    }

    /// Nodes around one sharp corner, at the end of `edge`.
    fn sharp(&self, edge: usize, turned_rad: f64) -> impl Iterator<Item = Point2> + use<> {
        let (corner, normal) = (self.point(edge + 1), self.normal(edge));
        let count = (turned_rad / NODE_TURN_RAD).ceil().max(1.0) as usize;
        let step_rad = turned_rad / count as f64;
        let out_mm = self.clearance_mm / (0.5 * step_rad).cos();
        (0..count).map(move |k| corner + turned_by(normal, -(k as f64 + 0.5) * step_rad) * out_mm)
    }
}

/// Nodes around the corners of a ring that project into the area on its left.
fn ring_nodes(ring: &Ring, clearance_mm: f64) -> Vec<Point2> {
    let mut nodes = Vec::new();
    let count = ring.points.len();
    if count < 3 {
        return nodes;
    }
    let corners = Corners {
        points: &ring.points,
        clearance_mm,
    };
    let mut run: Option<CornerRun> = None;
    // After a corner to the left no run continues.
    let first = (0..count).find(|&i| corners.turned_rad(i) <= 0.0);
    let first = first.unwrap_or(0);
    for edge in first + 1..=first + count {
        let turned_rad = corners.turned_rad(edge);
        if let Some(open) = &mut run
            && corners.goes_on(open, edge, turned_rad)
        {
            open.turned_rad += turned_rad;
            open.length_mm += (corners.point(edge + 1) - corners.point(edge)).norm();
            continue;
        }
        nodes.extend(run.take().and_then(|run| corners.node(&run, edge)));
        if turned_rad > NODE_TURN_RAD {
            nodes.extend(corners.sharp(edge, turned_rad));
        } else if turned_rad > 0.0 {
            run = Some(CornerRun {
                edge,
                turned_rad,
                length_mm: 0.0,
            });
        }
    }
    nodes.extend(run.and_then(|run| corners.node(&run, first + count + 1)));
    nodes
}

/// A quarter turn.
const QUARTER: f64 = std::f64::consts::FRAC_PI_2;

fn turned_by(v: Vector2, angle_rad: f64) -> Vector2 {
    let (sin, cos) = angle_rad.sin_cos();
    Vector2::new(v.x * cos - v.y * sin, v.x * sin + v.y * cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::ring;

    fn length_mm(from: Point2, way: &[Point2], to: Point2) -> f64 {
        let all: Vec<Point2> = [from]
            .into_iter()
            .chain(way.iter().copied())
            .chain([to])
            .collect();
        all.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
    }

    /// Goal: ways keep their clearance and are hardly longer than any other. Method: a square and a
    /// disk in the way (clockwise: free ground on the left); samples along the way against every
    /// edge, lengths against the taut string's, by hand.
    #[test]
    fn ways_go_around_at_the_clearance() {
        let square = ring(&[[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]]);
        let disk = Ring {
            points: (0..720)
                .map(|i| -f64::from(i) * std::f64::consts::TAU / 720.0)
                .map(|angle| Point2::new(2.0 * angle.cos(), 2.0 * angle.sin()))
                .collect(),
        };
        // Tangents to the corner's arc, and the arc; to the grown disk, and its arc.
        for (shape, exact_mm) in [(square, None), (disk, Some(grown_disk_mm(10.0, 3.0)))] {
            let mut router =
                TravelRouter::new([&shape].into_iter(), false, 1.0).expect("few corners");
            assert!(router.nodes.len() <= 24, "{}", router.nodes.len());
            let (from, to) = (Point2::new(-10.0, 0.0), Point2::new(10.0, 0.0));
            let way = router.way(from, to).expect("a way");
            let all: Vec<Point2> = [from]
                .into_iter()
                .chain(way.iter().copied())
                .chain([to])
                .collect();
            for leg in all.windows(2) {
                for k in 0..=500 {
                    let p = leg[0] + (leg[1] - leg[0]) * (f64::from(k) / 500.0);
                    let far = |(a, b)| (p - Edge { a, b }.foot(p)).norm();
                    let least = shape.edges().map(far).fold(f64::INFINITY, f64::min);
                    assert!(least > 1.0 - 1e-6, "{p}: {least}");
                }
            }
            let found_mm = length_mm(from, &way, to);
            if let Some(exact_mm) = exact_mm {
                assert!(
                    found_mm >= exact_mm && found_mm < 1.01 * exact_mm,
                    "{found_mm}"
                );
            }
            assert!(found_mm < 21.1, "{found_mm}");
            assert_eq!(router.way(Point2::new(1.5, 0.0), to), None, "not free");
        }
    }

    /// Half the taut string around a disk of radius `r` between points at distance `d`, twice.
    fn grown_disk_mm(d: f64, r: f64) -> f64 {
        let tangent = (d * d - r * r).sqrt();
        let arc = std::f64::consts::PI - 2.0 * (r / d).acos();
        2.0 * tangent + r * arc
    }

    /// Goal: inside a U the way goes around its slot, and there is none to an island. Method: the
    /// corners of the way by hand; two separate squares.
    #[test]
    fn ways_stay_inside() {
        let u = ring(&[
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 10.0],
            [6.0, 10.0],
            [6.0, 4.0],
            [4.0, 4.0],
            [4.0, 10.0],
            [0.0, 10.0],
        ]);
        let island = ring(&[[20.0, 0.0], [24.0, 0.0], [24.0, 4.0], [20.0, 4.0]]);
        let mut router =
            TravelRouter::new([&u, &island].into_iter(), true, 0.2).expect("few corners");
        let (left, right) = (Point2::new(2.0, 9.0), Point2::new(8.0, 9.0));
        let way = router.way(left, right).expect("around the slot");
        assert!(way.iter().all(|p| p.y < 4.01 && p.y > 3.7), "{way:?}");
        assert_eq!(router.way(left, Point2::new(2.0, 1.0)), Some(Vec::new()));
        assert_eq!(router.way(left, Point2::new(22.0, 2.0)), None);
    }
}
