//! The interior medial axis of a region, with its radial function.
//!
//! Input: the edges of a valid region, mm, about a local origin
//! ([`crate::plan::outline::contour`]). Output: a graph of vertices and edges; every point of it
//! carries the radius of the largest disk inside the region about it and the two feet where that
//! disk touches the boundary.
//!
//! Source: H. Blum's medial axis, taken from the segment Voronoi diagram (see `voronoi`); pruned by
//! object angle and branch length into the *pruned axis* on which passes are planned (see `prune`).
//! Not covered: the exterior axis.

mod grid;
mod parabola;
mod prune;
mod voronoi;

use crate::text::refusal::Refusal;
pub use prune::PruneOptions;
pub use voronoi::AxisOptions;

use crate::geometry::Point2;
use crate::geometry::edge_index::{Edge, EdgeIndex};

/// What an axis edge is equally far from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Generator {
    /// The boundary edge of this number ([`EdgeIndex::edges`]).
    Edge(usize),
    /// A reflex vertex of the boundary.
    Vertex(Point2),
}

/// A point of the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisPoint {
    /// Where it is.
    pub point: Point2,
    /// Distance to the boundary.
    pub radius_mm: f64,
    /// Angle between its two feet, seen from it: 180° in a straight passage, 180° less the
    /// corner's own angle on a corner's bisector.
    pub object_angle_rad: f64,
    /// The boundary points nearest to it, one for each generator of its edge.
    pub feet: [Point2; 2],
}

/// A vertex of the axis graph.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisVertex {
    /// Where it is.
    pub point: Point2,
    /// Distance to the boundary; 0 at a convex corner.
    pub radius_mm: f64,
    /// Distinct nearest boundary points, of all edges that meet here.
    pub feet: Vec<Point2>,
}

/// An edge of the axis graph: a straight line or a flattened parabola.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisEdge {
    /// Vertex at the first point.
    pub v0: usize,
    /// Vertex at the last point.
    pub v1: usize,
    /// Polyline, at least two points; radii may be interpolated linearly within the tolerance.
    pub points: Vec<AxisPoint>,
    /// The two generators from which it is equidistant; `feet` of the points are in this order.
    pub generators: [Generator; 2],
}

/// The axis as a graph.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MedialAxis {
    /// Vertices; one without edges represents an area without a pruned axis of its own (a square).
    pub vertices: Vec<AxisVertex>,
    /// Edges.
    pub edges: Vec<AxisEdge>,
    /// Numbers of the edges at each vertex, ascending; a loop edge is listed twice.
    pub adjacency: Vec<Vec<usize>>,
    /// Edges omitted because their radius did not agree with the boundary at any tried angle.
    pub dropped_edges: usize,
}

/// A run of edges between junctions or ends.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisChain {
    /// Its start vertex.
    pub v0: usize,
    /// Its end vertex; equal to `v0` if it is closed.
    pub v1: usize,
    /// Its points in order.
    pub points: Vec<AxisPoint>,
    /// Numbers of its edges in order.
    pub edges: Vec<usize>,
    /// True if it returns to its own start.
    pub closed: bool,
}

impl Generator {
    /// The nearest point of the generator.
    pub fn foot(&self, edges: &[Edge], p: Point2) -> Point2 {
        match *self {
            Generator::Edge(number) => edges[number].foot(p),
            Generator::Vertex(q) => q,
        }
    }
}

impl AxisEdge {
    /// Length of the polyline, mm.
    pub fn length_mm(&self) -> f64 {
        polyline_length_mm(&self.points)
    }
}

impl AxisChain {
    /// Length of the polyline, mm.
    pub fn length_mm(&self) -> f64 {
        polyline_length_mm(&self.points)
    }
}

fn polyline_length_mm(points: &[AxisPoint]) -> f64 {
    points
        .windows(2)
        .map(|w| (w[1].point - w[0].point).norm())
        .sum()
}

impl MedialAxis {
    /// The complete interior axis, unpruned.
    pub fn of_edges(index: &EdgeIndex, options: &AxisOptions) -> Result<MedialAxis, Refusal> {
        voronoi::interior_axis(index, options)
    }

    /// The pruned axis: see [`PruneOptions`].
    pub fn pruned(&self, options: &PruneOptions) -> MedialAxis {
        prune::pruned(self, options)
    }

    /// Edges that meet at the vertex (a loop counts twice).
    pub fn degree(&self, vertex: usize) -> usize {
        self.adjacency[vertex].len()
    }

    /// Fills `adjacency` from the edges.
    pub(crate) fn link(&mut self) {
        self.adjacency = vec![Vec::new(); self.vertices.len()];
        for (number, edge) in self.edges.iter().enumerate() {
            self.adjacency[edge.v0].push(number);
            self.adjacency[edge.v1].push(number);
        }
    }

    /// All straight segments, for distance queries: an index whose edge numbers follow the
    /// polylines in order, then a zero-length edge for each vertex without edges; and the radii at
    /// both ends of each.
    pub fn segment_index(&self, cell_mm: f64) -> (EdgeIndex, Vec<[f64; 2]>) {
        let mut segments = Vec::new();
        let mut radii_mm = Vec::new();
        for edge in &self.edges {
            for pair in edge.points.windows(2) {
                segments.push(Edge {
                    a: pair[0].point,
                    b: pair[1].point,
                });
                radii_mm.push([pair[0].radius_mm, pair[1].radius_mm]);
            }
        }
        for (number, vertex) in self.vertices.iter().enumerate() {
            if self.adjacency[number].is_empty() {
                segments.push(Edge {
                    a: vertex.point,
                    b: vertex.point,
                });
                radii_mm.push([vertex.radius_mm; 2]);
            }
        }
        (EdgeIndex::new(segments, cell_mm), radii_mm)
    }

    /// Maximal runs of edges through vertices of degree 2: first those between junctions and ends
    /// (by vertex number), then closed ones.
    pub fn chains(&self) -> Vec<AxisChain> {
        let mut used = vec![false; self.edges.len()];
        let mut chains = Vec::new();
        for vertex in 0..self.vertices.len() {
            if self.degree(vertex) == 2 {
                continue;
            }
            for &edge in &self.adjacency[vertex] {
                if !used[edge] {
                    chains.push(self.walk(vertex, edge, &mut used));
                }
            }
        }
        for edge in 0..self.edges.len() {
            if !used[edge] {
                chains.push(self.walk(self.edges[edge].v0, edge, &mut used));
            }
        }
        chains
    }

    /// Follows edges from `start` until a vertex of another degree than 2, or back to the start.
    fn walk(&self, start: usize, first: usize, used: &mut [bool]) -> AxisChain {
        let mut points: Vec<AxisPoint> = Vec::new();
        let mut edges = Vec::new();
        let (mut vertex, mut next) = (start, Some(first));
        while let Some(number) = next {
            used[number] = true;
            edges.push(number);
            let edge = &self.edges[number];
            let forward = edge.v0 == vertex;
            let skip = usize::from(!points.is_empty());
            if forward {
                points.extend(edge.points.iter().skip(skip));
            } else {
                let flipped = edge.points.iter().rev().map(|p| AxisPoint {
                    feet: [p.feet[1], p.feet[0]],
                    ..*p
                });
                points.extend(flipped.skip(skip));
            }
            vertex = if forward { edge.v1 } else { edge.v0 };
            next = if vertex == start || self.degree(vertex) != 2 {
                None
            } else {
                self.adjacency[vertex].iter().copied().find(|&e| !used[e])
            };
        }
        AxisChain {
            v0: start,
            v1: vertex,
            points,
            edges,
            closed: vertex == start,
        }
    }
}

#[cfg(test)]
mod tests;
