//! The integer grid of the segment Voronoi diagram, and the preparation of segments for it.
//!
//! The diagram is only correct for segments that meet at their ends only. Rounding to a grid can
//! make close ones touch or cross, so they are cut there repeatedly until none do.
//!
//! In: boundary edges (mm) and an angle (rad). Out: segments in whole grid units of 100 nm that
//! meet at their ends only, each with its edge's number. Not covered: the displacement by a cut, at
//! most a grid unit.

use crate::geometry::Point2;
use crate::geometry::Vector2;
use crate::geometry::edge_index::{Edge, EdgeIndex};

/// Grid unit: with 1 nm the diagram gave silently wrong vertices, with 100 nm it did not.
const UNIT_MM: f64 = 1e-4;
/// Largest coordinate in grid units, well inside an i32 with room for the diagram's own sums.
const COORDINATE_MAX: f64 = (1 << 29) as f64;
/// Cutting rounds: each rounds the cuts to the grid, which can make new touches, ever fewer.
const ROUNDS_MAX: usize = 6;

/// Turns and scales the plane onto the grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    center: Point2,
    sin: f64,
    cos: f64,
    unit_mm: f64,
}

/// A segment on the grid and the boundary edge it is a piece of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct GridSegment {
    pub a: [i32; 2],
    pub b: [i32; 2],
    pub source: usize,
}

impl Grid {
    pub fn new(index: &EdgeIndex, angle_rad: f64) -> Grid {
        let bounds = index.bounds();
        let half_diagonal_mm = bounds.size().norm() / 2.0;
        let (sin, cos) = angle_rad.sin_cos();
        Grid {
            center: bounds.min + bounds.size() / 2.0,
            sin,
            cos,
            unit_mm: UNIT_MM.max(half_diagonal_mm / COORDINATE_MAX),
        }
    }

    fn to_grid(self, p: Point2) -> [i32; 2] {
        let d = (p - self.center) / self.unit_mm;
        let turned = [
            d.x * self.cos - d.y * self.sin,
            d.x * self.sin + d.y * self.cos,
        ];
        turned.map(|v| v.round() as i32)
    }

    pub fn to_plane(self, g: [f64; 2]) -> Point2 {
        let turned = [
            g[0] * self.cos + g[1] * self.sin,
            g[1] * self.cos - g[0] * self.sin,
        ];
        self.center + Vector2::new(turned[0], turned[1]) * self.unit_mm
    }

    pub fn unit_mm(self) -> f64 {
        self.unit_mm
    }

    /// The edges on the grid, meeting at ends only; identical ones once.
    pub fn segments(self, edges: &[Edge]) -> Vec<GridSegment> {
        let mut segments: Vec<GridSegment> = edges
            .iter()
            .enumerate()
            .map(|(source, e)| GridSegment {
                a: self.to_grid(e.a),
                b: self.to_grid(e.b),
                source,
            })
            .collect();
        tidy(&mut segments);
        for _ in 0..ROUNDS_MAX {
            let cuts = find_cuts(&segments);
            if cuts.is_empty() {
                break;
            }
            segments = cut(&segments, cuts);
            tidy(&mut segments);
        }
        segments
    }
}

/// Drops segments without length and all but the first of identical ones; keeps the order.
fn tidy(segments: &mut Vec<GridSegment>) {
    segments.retain(|s| s.a != s.b);
    let key = |s: &GridSegment| (s.a.min(s.b), s.a.max(s.b));
    let mut order: Vec<usize> = (0..segments.len()).collect();
    order.sort_by_key(|&i| (key(&segments[i]), i));
    let mut keep = vec![true; segments.len()];
    for pair in order.windows(2) {
        if key(&segments[pair[0]]) == key(&segments[pair[1]]) {
            keep[pair[1]] = false;
        }
    }
    let mut number = 0;
    segments.retain(|_| {
        number += 1;
        keep[number - 1]
    });
}

/// Twice the signed area of a-b-c, exact.
fn orient(a: [i32; 2], b: [i32; 2], c: [i32; 2]) -> i128 {
    let d = |p: [i32; 2], k: usize| i128::from(p[k]) - i128::from(a[k]);
    d(b, 0) * d(c, 1) - d(b, 1) * d(c, 0)
}

/// Where segments must be cut: (segment, point), each point strictly between the ends.
fn find_cuts(segments: &[GridSegment]) -> Vec<(usize, [i32; 2])> {
    let point = |p: [i32; 2]| Point2::new(f64::from(p[0]), f64::from(p[1]));
    let edges: Vec<Edge> = segments
        .iter()
        .map(|s| Edge {
            a: point(s.a),
            b: point(s.b),
        })
        .collect();
    if edges.is_empty() {
        return Vec::new();
    }
    let total: f64 = edges.iter().map(Edge::length_mm).sum();
    let index = EdgeIndex::new(edges, (total / segments.len() as f64).max(1.0));
    let mut cuts = Vec::new();
    index.for_pairs(|i, j| cuts_of_pair(segments, i, j, &mut cuts));
    cuts.sort_unstable();
    cuts.dedup();
    cuts
}

fn cuts_of_pair(segments: &[GridSegment], i: usize, j: usize, cuts: &mut Vec<(usize, [i32; 2])>) {
    let (s, t) = (segments[i], segments[j]);
    let (c, d) = (orient(s.a, s.b, t.a), orient(s.a, s.b, t.b));
    let (e, f) = (orient(t.a, t.b, s.a), orient(t.a, t.b, s.b));
    let mut touch = |number: usize, of: GridSegment, side: i128, p: [i32; 2]| {
        let within = (0..2).all(|k| of.a[k].min(of.b[k]) <= p[k] && p[k] <= of.a[k].max(of.b[k]));
        if side == 0 && within && p != of.a && p != of.b {
            cuts.push((number, p));
        }
    };
    touch(i, s, c, t.a);
    touch(i, s, d, t.b);
    touch(j, t, e, s.a);
    touch(j, t, f, s.b);
    let opposite = |x: i128, y: i128| (x > 0 && y < 0) || (x < 0 && y > 0);
    if opposite(c, d) && opposite(e, f) {
        let share = e as f64 / (e - f) as f64;
        let at = |k: usize| {
            (f64::from(s.a[k]) + share * (f64::from(s.b[k]) - f64::from(s.a[k]))).round() as i32
        };
        let p = [at(0), at(1)];
        for (number, of) in [(i, s), (j, t)] {
            if p != of.a && p != of.b {
                cuts.push((number, p));
            }
        }
    }
}

fn cut(segments: &[GridSegment], cuts: Vec<(usize, [i32; 2])>) -> Vec<GridSegment> {
    let mut result = Vec::with_capacity(segments.len() + cuts.len());
    let mut cuts = cuts.into_iter().peekable();
    for (number, &segment) in segments.iter().enumerate() {
        let along = |p: &[i32; 2]| {
            (0..2)
                .map(|k| {
                    let total = i128::from(segment.b[k]) - i128::from(segment.a[k]);
                    total * (i128::from(p[k]) - i128::from(segment.a[k]))
                })
                .sum::<i128>()
        };
        let mut points = Vec::new();
        while let Some((_, p)) = cuts.next_if(|c| c.0 == number) {
            points.push(p);
        }
        points.sort_by_key(along);
        let mut from = segment.a;
        for p in points.into_iter().chain([segment.b]) {
            result.push(GridSegment {
                a: from,
                b: p,
                source: segment.source,
            });
            from = p;
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: crossing, touching and doubled segments end up meeting at ends only. Method: a cross,
    /// a T and a copy; then no further cut is found.
    #[test]
    fn segments_meet_at_ends_only() {
        let edge = |x0: f64, y0: f64, x1: f64, y1: f64| Edge {
            a: Point2::new(x0, y0),
            b: Point2::new(x1, y1),
        };
        let edges = vec![
            edge(0.0, 0.0, 10.0, 10.0),
            edge(0.0, 10.0, 10.0, 0.0),
            edge(0.0, 0.0, 10.0, 0.0),
            edge(5.0, 0.0, 5.0, -3.0),
            edge(10.0, 0.0, 0.0, 0.0),
        ];
        let index = EdgeIndex::new(edges.clone(), 1.0);
        let segments = Grid::new(&index, 0.0).segments(&edges);
        assert_eq!(segments.len(), 7);
        assert!(find_cuts(&segments).is_empty());
    }
}
