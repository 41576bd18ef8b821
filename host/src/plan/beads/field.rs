//! The channel field: v = k d / (d + m) on a grid, and its level curves.
//!
//! d is the distance to the wall, m to the medial axis, k the bead count of the nearest piece of
//! axis. v is 0 on the wall and k on the axis; channel j is where j - 1 <= v <= j. Level curves of
//! such a field stay smooth where peeling by the real sweep would amplify every jitter.
//!
//! In: walls, axis, k at its nodes, step of the grid (mm). Out: v at any point, and rings (mm) at a
//! level. Source for the curves: W. Lorensen and H. Cline, "Marching cubes" (1987), in the plane.
//! Not covered: detail below a step.

use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::{Box2, Ring};
use crate::geometry::{Point2, Vector2};
use crate::plan::axis::pruned_axis::Axis;
use rayon::prelude::*;

/// Most grid nodes; the step grows beyond that.
const NODES_MAX: f64 = 16e6;

/// A grid of v over one region. Outside the region v is negative.
#[derive(Clone, Debug)]
pub struct Field {
    origin: Point2,
    step_mm: f64,
    columns: usize,
    rows: usize,
    values: Vec<f32>,
}

/// No edge.
const NONE: u32 = u32::MAX;

/// Steps of the grid beyond the region: more than two, and fractions that no round dimension has,
/// so that nodes are not on walls or lines of symmetry, where rounding would decide.
const MARGIN: Vector2 = Vector2::new(2.37, 2.61);

impl Field {
    /// Computes the field over the region that `walls` bounds; `beads` is k at the axis nodes. No
    /// bead channel is wider than `widest_mm`: where several arms of the axis meet, the distance from
    /// the wall to the axis is longer than r at its foot.
    pub fn new(
        walls: &EdgeIndex,
        axis: &Axis,
        beads: &[f64],
        widest_mm: f64,
        step_mm: f64,
    ) -> Field {
        let mut step_mm = step_mm;
        let bounds = walls.bounds().grown(MARGIN.max() * step_mm);
        let size = bounds.size();
        while size.x / step_mm * size.y / step_mm > NODES_MAX {
            step_mm *= 1.25;
        }
        let columns = (size.x / step_mm).ceil() as usize + 2;
        let rows = (size.y / step_mm).ceil() as usize + 2;
        let mut field = Field {
            origin: walls.bounds().min - MARGIN * step_mm,
            step_mm,
            columns,
            rows,
            values: Vec::new(),
        };
        let inside = field.inside_mask(walls.edges());
        let axis_edges = axis_edges(axis);
        let (wall_of, axis_of) = rayon::join(
            || field.nearest_of(walls.edges(), &inside),
            || field.nearest_of(&axis_edges, &inside),
        );
        field.values = (0..rows * columns)
            .into_par_iter()
            .map(|at| {
                let p = field.node(at % columns, at / columns);
                if !inside[at] || wall_of[at] == NONE || axis_of[at] == NONE {
                    return -1.0;
                }
                let d = (p - walls.edges()[wall_of[at] as usize].foot(p)).norm();
                let (m, k) = axis_at(p, axis_of[at] as usize, &axis_edges, axis, beads);
                let across_mm = (d + m).max(1e-9);
                (k.max(across_mm / widest_mm) * d / across_mm) as f32
            })
            .collect();
        field
    }

    /// Position of a grid node.
    fn node(&self, column: usize, row: usize) -> Point2 {
        self.origin + Vector2::new(column as f64, row as f64) * self.step_mm
    }

    /// The largest v of the grid.
    pub fn max(&self) -> f64 {
        self.values.iter().copied().fold(0.0, f32::max) as f64
    }

    /// v at any point, bilinear; -1 off the grid.
    pub fn at(&self, p: Point2) -> f64 {
        let x = (p.x - self.origin.x) / self.step_mm;
        let y = (p.y - self.origin.y) / self.step_mm;
        if x < 0.0 || y < 0.0 || x >= (self.columns - 1) as f64 || y >= (self.rows - 1) as f64 {
            return -1.0;
        }
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f64, y - row as f64);
        let at = row * self.columns + column;
        let v = |i: usize| self.values[i] as f64;
        let low = v(at) * (1.0 - fx) + v(at + 1) * fx;
        let high = v(at + self.columns) * (1.0 - fx) + v(at + self.columns + 1) * fx;
        low * (1.0 - fy) + high * fy
    }

    /// Even-odd scanline fill of the grid nodes.
    fn inside_mask(&self, edges: &[Edge]) -> Vec<bool> {
        let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); self.rows];
        for edge in edges {
            let (low, high) = if edge.a.y <= edge.b.y {
                (edge.a, edge.b)
            } else {
                (edge.b, edge.a)
            };
            let first = ((low.y - self.origin.y) / self.step_mm).ceil().max(0.0) as usize;
            for (row, xs) in crossings.iter_mut().enumerate().skip(first) {
                let y = self.origin.y + row as f64 * self.step_mm;
                if y >= high.y {
                    break;
                }
                xs.push(low.x + (y - low.y) / (high.y - low.y) * (high.x - low.x));
            }
        }
        let mut inside = vec![false; self.rows * self.columns];
        for (row, xs) in crossings.iter_mut().enumerate() {
            xs.sort_by(f64::total_cmp);
            for pair in xs.chunks_exact(2) {
                let first = ((pair[0] - self.origin.x) / self.step_mm).ceil().max(0.0) as usize;
                let last = ((pair[1] - self.origin.x) / self.step_mm).floor().max(0.0) as usize;
                for column in first..=last.min(self.columns - 1) {
                    inside[row * self.columns + column] = true;
                }
            }
        }
        inside
    }

    /// For each inside node the number of the nearest edge: stamped around the edges, then spread
    /// through the inside by two rounds of four sweeps with exact distances.
    fn nearest_of(&self, edges: &[Edge], inside: &[bool]) -> Vec<u32> {
        let mut nearest = vec![NONE; self.rows * self.columns];
        let mut distance2 = vec![f64::INFINITY; self.rows * self.columns];
        for (number, edge) in edges.iter().enumerate() {
            let pieces = (edge.length_mm() / (0.5 * self.step_mm)).ceil().max(1.0) as usize;
            for piece in 0..=pieces {
                let p = edge.a + (edge.b - edge.a) * (piece as f64 / pieces as f64);
                self.stamp(p, number, edges, inside, &mut nearest, &mut distance2);
            }
        }
        for _ in 0..2 {
            self.sweep(edges, inside, &mut nearest, &mut distance2, false);
            self.sweep(edges, inside, &mut nearest, &mut distance2, true);
        }
        nearest
    }

    /// Offers edge `number` to the nodes around a point of it.
    fn stamp(
        &self,
        p: Point2,
        number: usize,
        edges: &[Edge],
        inside: &[bool],
        nearest: &mut [u32],
        distance2: &mut [f64],
    ) {
        let column = ((p.x - self.origin.x) / self.step_mm) as usize;
        let row = ((p.y - self.origin.y) / self.step_mm) as usize;
        for r in row.saturating_sub(1)..(row + 3).min(self.rows) {
            for c in column.saturating_sub(1)..(column + 3).min(self.columns) {
                let at = r * self.columns + c;
                if inside[at] {
                    let q = self.node(c, r);
                    let found = (q - edges[number].foot(q)).norm_squared();
                    if found < distance2[at] {
                        distance2[at] = found;
                        nearest[at] = number as u32;
                    }
                }
            }
        }
    }

    /// One raster sweep, forward or backward: each node tries its eight neighbours' edges.
    fn sweep(
        &self,
        edges: &[Edge],
        inside: &[bool],
        nearest: &mut [u32],
        distance2: &mut [f64],
        backward: bool,
    ) {
        let columns = self.columns as isize;
        let offsets = [
            -columns - 1,
            -columns,
            -columns + 1,
            -1,
            1,
            columns - 1,
            columns,
            columns + 1,
        ];
        for step in 0..nearest.len() {
            let at = if backward {
                nearest.len() - 1 - step
            } else {
                step
            };
            if !inside[at] {
                continue;
            }
            let q = self.node(at % self.columns, at / self.columns);
            for offset in offsets {
                // Inside nodes have a margin of two nodes all around, so this stays in range.
                let from = nearest[(at as isize + offset) as usize];
                if from != NONE && from != nearest[at] {
                    let found = (q - edges[from as usize].foot(q)).norm_squared();
                    if found < distance2[at] {
                        distance2[at] = found;
                        nearest[at] = from;
                    }
                }
            }
        }
    }

    /// Closed level curves v = `level`, the higher side on the left, by marching squares with the
    /// ambiguous case decided by the mean.
    pub fn level_rings(&self, level: f64) -> Vec<Ring> {
        // Each cell edge is crossed at most once; a crossing is named by its lower grid node and
        // direction. next[crossing] leads around the ring.
        let above = |at: usize| self.values[at] as f64 >= level;
        let horizontal = |column: usize, row: usize| 2 * (row * self.columns + column);
        let vertical = |column: usize, row: usize| 2 * (row * self.columns + column) + 1;
        let mut next: std::collections::BTreeMap<usize, usize> = std::collections::BTreeMap::new();
        for row in 0..self.rows - 1 {
            for column in 0..self.columns - 1 {
                let at = row * self.columns + column;
                let corners = [at, at + 1, at + self.columns + 1, at + self.columns];
                let code = (0..4).fold(0, |code, i| code | (usize::from(above(corners[i])) << i));
                if code == 0 || code == 15 {
                    continue;
                }
                // Sides: 0 bottom, 1 right, 2 top, 3 left.
                let sides = [
                    horizontal(column, row),
                    vertical(column + 1, row),
                    horizontal(column, row + 1),
                    vertical(column, row),
                ];
                let mean: f64 = corners.iter().map(|&c| self.values[c] as f64).sum::<f64>() / 4.0;
                for &(from, to) in cell_lines(code, mean >= level) {
                    next.insert(sides[from], sides[to]);
                }
            }
        }
        let mut rings = Vec::new();
        while let Some((&start, _)) = next.first_key_value() {
            let mut points = Vec::new();
            let mut at = start;
            while let Some(to) = next.remove(&at) {
                points.push(self.crossing(at, level));
                at = to;
            }
            if points.len() >= 3 && at == start {
                rings.push(Ring { points });
            }
        }
        rings
    }

    /// Where the level crosses a grid edge.
    fn crossing(&self, name: usize, level: f64) -> Point2 {
        let at = name / 2;
        let other = if name.is_multiple_of(2) {
            at + 1
        } else {
            at + self.columns
        };
        let (v0, v1) = (self.values[at] as f64, self.values[other] as f64);
        let t = if (v1 - v0).abs() < 1e-12 {
            0.5
        } else {
            ((level - v0) / (v1 - v0)).clamp(0.0, 1.0)
        };
        let p = self.node(at % self.columns, at / self.columns);
        let q = self.node(other % self.columns, other / self.columns);
        p + (q - p) * t
    }

    /// Bounding box of the grid.
    pub fn bounds(&self) -> Box2 {
        Box2 {
            min: self.origin,
            max: self.node(self.columns - 1, self.rows - 1),
        }
    }
}

/// Directed lines of a marching-squares cell, the higher corner on the left. Bits of `code`:
/// 0 lower left, 1 lower right, 2 upper right, 3 upper left; sides 0 bottom, 1 right, 2 top, 3 left.
fn cell_lines(code: usize, mean_above: bool) -> &'static [(usize, usize)] {
    match code {
        1 => &[(0, 3)],
        2 => &[(1, 0)],
        3 => &[(1, 3)],
        4 => &[(2, 1)],
        5 if mean_above => &[(0, 1), (2, 3)],
        5 => &[(0, 3), (2, 1)],
        6 => &[(2, 0)],
        7 => &[(2, 3)],
        8 => &[(3, 2)],
        9 => &[(0, 2)],
        10 if mean_above => &[(3, 0), (1, 2)],
        10 => &[(1, 0), (3, 2)],
        11 => &[(1, 2)],
        12 => &[(3, 1)],
        13 => &[(0, 1)],
        14 => &[(3, 0)],
        _ => &[],
    }
}

fn axis_edges(axis: &Axis) -> Vec<Edge> {
    if axis.links.is_empty() {
        // A square's pruned axis is one point: a degenerate edge has a foot all the same.
        return axis.points.iter().map(|&p| Edge { a: p, b: p }).collect();
    }
    axis.links
        .iter()
        .map(|&[a, b]| Edge {
            a: axis.points[a as usize],
            b: axis.points[b as usize],
        })
        .collect()
}

/// Distance to an axis link and k at its foot.
fn axis_at(p: Point2, link: usize, edges: &[Edge], axis: &Axis, beads: &[f64]) -> (f64, f64) {
    let edge = edges[link];
    let foot = edge.foot(p);
    let m = (p - foot).norm();
    let Some(&[a, b]) = axis.links.get(link) else {
        return (m, beads[link]);
    };
    let length = edge.length_mm();
    let t = if length > 0.0 {
        (foot - edge.a).norm() / length
    } else {
        0.0
    };
    (m, beads[a as usize] * (1.0 - t) + beads[b as usize] * t)
}
