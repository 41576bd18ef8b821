//! A uniform grid over the edges of a region: nearest edge, edges in a box, containment.
//!
//! A grid instead of a tree because queries are local (a few aperture lengths) and it is built in
//! one scan; cells contain edge numbers in compressed rows. Memory is bounded by [`CELLS_MAX`].

use super::polygon::{Box2, Region};
use super::{Point2, Vector2};
use std::sync::OnceLock;

/// Most cells of the grid; beyond that the cells grow.
pub const CELLS_MAX: usize = 4_000_000;

/// One directed edge, inside on its left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Start.
    pub a: Point2,
    /// End.
    pub b: Point2,
}

impl Edge {
    /// Start and end.
    pub fn ends(&self) -> (Point2, Point2) {
        (self.a, self.b)
    }
}

/// Result of a nearest-edge query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Number of the edge (order of [`Region::edges`]).
    pub edge: usize,
    /// Distance, mm, never negative.
    pub distance_mm: f64,
    /// Foot point on the edge.
    pub foot: Point2,
}

/// Grid over the edges of one region (or of any set of edges).
#[derive(Clone, Debug)]
pub struct EdgeIndex {
    edges: Vec<Edge>,
    bounds: Box2,
    cell_mm: f64,
    columns: usize,
    rows: usize,
    first: Vec<u32>,
    items: Vec<u32>,
    /// Whether each cell's reference point is inside; found on first use.
    reference_inside: OnceLock<Vec<bool>>,
}

/// Place of the reference point in its cell: not on a line along which outlines are usually drawn.
const REFERENCE: [f64; 2] = [0.414_213_562, 0.618_033_989];

impl Edge {
    /// Foot of the perpendicular from `p`, clamped to the edge.
    pub fn foot(&self, p: Point2) -> Point2 {
        let d = self.b - self.a;
        let length2 = d.norm_squared();
        if length2 <= 0.0 {
            return self.a;
        }
        self.a + d * ((p - self.a).dot(&d) / length2).clamp(0.0, 1.0)
    }

    /// Inward unit normal (left of the direction); zero for a degenerate edge.
    pub fn normal(&self) -> Vector2 {
        let d = self.b - self.a;
        let length = d.norm();
        if length <= 0.0 {
            Vector2::zeros()
        } else {
            Vector2::new(-d.y, d.x) / length
        }
    }

    /// Length, mm.
    pub fn length_mm(&self) -> f64 {
        (self.b - self.a).norm()
    }

    /// False where the edge's own box certainly misses the area.
    pub fn may_meet(&self, area: &Box2) -> bool {
        let (a, b) = (self.a, self.b);
        !((a.x < area.min.x && b.x < area.min.x)
            || (a.x > area.max.x && b.x > area.max.x)
            || (a.y < area.min.y && b.y < area.min.y)
            || (a.y > area.max.y && b.y > area.max.y))
    }
}

/// The cell wished for, down to a tenth of it where edges are so short that one would hold many.
fn cell_of(edges: &[Edge], wish_mm: f64) -> f64 {
    let total_mm: f64 = edges.iter().map(Edge::length_mm).sum();
    let few_mm = EDGES_PER_CELL * total_mm / edges.len().max(1) as f64;
    if few_mm.is_finite() {
        few_mm.min(wish_mm).max(wish_mm / 10.0)
    } else {
        wish_mm
    }
}

/// Edges in a row that a cell should hold at most.
const EDGES_PER_CELL: f64 = 6.0;

impl EdgeIndex {
    /// Builds the index over all edges of a region; `cell_mm` is a wish (about an aperture length).
    pub fn of_region(region: &Region, cell_mm: f64) -> EdgeIndex {
        EdgeIndex::new(
            region.edges().map(|(a, b)| Edge { a, b }).collect(),
            cell_mm,
        )
    }

    /// Builds the index over any edges.
    pub fn new(edges: Vec<Edge>, cell_mm: f64) -> EdgeIndex {
        let ends: Vec<Point2> = edges.iter().flat_map(|e| [e.a, e.b]).collect();
        let bounds = Box2::of(&ends).grown(1e-6);
        let size = bounds.size();
        let mut cell_mm = cell_of(&edges, cell_mm).max(1e-3);
        if !(size.x.is_finite() && size.y.is_finite()) {
            // Coordinates beyond all sense still get an answer: one cell that holds everything.
            cell_mm = f64::INFINITY;
        }
        while (size.x / cell_mm + 1.0) * (size.y / cell_mm + 1.0) > CELLS_MAX as f64 {
            cell_mm *= 1.5;
        }
        let columns = (size.x / cell_mm) as usize + 1;
        let rows = (size.y / cell_mm) as usize + 1;
        let mut index = EdgeIndex {
            edges,
            bounds,
            cell_mm,
            columns,
            rows,
            first: Vec::new(),
            items: Vec::new(),
            reference_inside: OnceLock::new(),
        };
        index.fill();
        index
    }

    /// Counts, then places, the edges of each cell (two passes, no reallocation).
    fn fill(&mut self) {
        let cells = self.columns * self.rows;
        let mut first = vec![0u32; cells + 1];
        for number in 0..self.edges.len() {
            self.for_cells(number, |cell| first[cell] += 1);
        }
        // The end of each cell's items, which moves to its beginning while they are placed, the last
        // edge first.
        for cell in 0..cells {
            first[cell + 1] += first[cell];
        }
        let mut items = vec![0u32; first[cells] as usize];
        for number in (0..self.edges.len()).rev() {
            self.for_cells(number, |cell| {
                first[cell] -= 1;
                items[first[cell] as usize] = number as u32;
            });
        }
        self.first = first;
        self.items = items;
    }

    /// Calls `visit` for each cell that edge `number` passes through (row by row, clipped).
    fn for_cells(&self, number: usize, mut visit: impl FnMut(usize)) {
        let Edge { a, b } = self.edges[number];
        let row_of = |y: f64| self.clamp_row((y - self.bounds.min.y) / self.cell_mm);
        let column_of = |x: f64| self.clamp_column((x - self.bounds.min.x) / self.cell_mm);
        let (low, high) = if a.y <= b.y { (a, b) } else { (b, a) };
        for row in row_of(low.y)..=row_of(high.y) {
            // The edge's x range inside this row's strip, padded by rounding.
            let y0 = self.bounds.min.y + row as f64 * self.cell_mm;
            let x_at = |y: f64| {
                if high.y - low.y < 1e-12 {
                    return low.x;
                }
                low.x + ((y - low.y) / (high.y - low.y)).clamp(0.0, 1.0) * (high.x - low.x)
            };
            let (mut x0, mut x1) = (x_at(y0), x_at(y0 + self.cell_mm));
            if high.y - low.y < 1e-12 {
                (x0, x1) = (low.x, high.x);
            }
            let pad = 1e-9 * (1.0 + self.cell_mm);
            for column in column_of(x0.min(x1) - pad)..=column_of(x0.max(x1) + pad) {
                visit(row * self.columns + column);
            }
        }
    }

    fn clamp_row(&self, row: f64) -> usize {
        (row.max(0.0) as usize).min(self.rows - 1)
    }

    fn clamp_column(&self, column: f64) -> usize {
        (column.max(0.0) as usize).min(self.columns - 1)
    }

    /// All edges, in the order given.
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// Bounding box of the edges.
    pub fn bounds(&self) -> Box2 {
        self.bounds
    }

    /// Size of a grid cell, mm: the scale at which queries are cheap.
    pub fn cell_mm(&self) -> f64 {
        self.cell_mm
    }

    /// Number of pairs that [`EdgeIndex::for_pairs`] visits: where edges are closer than the smallest cell, it
    /// grows with the square of their number.
    pub fn pairs(&self) -> u64 {
        let counts = self
            .first
            .windows(2)
            .map(|cell| u64::from(cell[1] - cell[0]));
        counts
            .map(|count| count * count.saturating_sub(1) / 2)
            .sum()
    }

    /// Calls `visit(i, j)`, i < j, for every two edges that share a cell, so at least for all that
    /// touch; a pair may be visited more than once.
    pub fn for_pairs(&self, mut visit: impl FnMut(usize, usize)) {
        for cell in self.first.windows(2) {
            let items = &self.items[cell[0] as usize..cell[1] as usize];
            for (k, &i) in items.iter().enumerate() {
                for &j in &items[k + 1..] {
                    if i != j {
                        visit(i.min(j) as usize, i.max(j) as usize);
                    }
                }
            }
        }
    }

    /// Calls `visit` with each edge number near the box; an edge may be visited more than once.
    pub fn for_edges_in(&self, area: Box2, mut visit: impl FnMut(usize)) {
        if area.max.x < self.bounds.min.x
            || area.max.y < self.bounds.min.y
            || area.min.x > self.bounds.max.x
            || area.min.y > self.bounds.max.y
        {
            return;
        }
        let row0 = self.clamp_row((area.min.y - self.bounds.min.y) / self.cell_mm);
        let row1 = self.clamp_row((area.max.y - self.bounds.min.y) / self.cell_mm);
        let column0 = self.clamp_column((area.min.x - self.bounds.min.x) / self.cell_mm);
        let column1 = self.clamp_column((area.max.x - self.bounds.min.x) / self.cell_mm);
        for row in row0..=row1 {
            let cells = row * self.columns;
            let items =
                self.first[cells + column0] as usize..self.first[cells + column1 + 1] as usize;
            for &number in &self.items[items] {
                visit(number as usize);
            }
        }
    }

    /// The nearest edge within `reach_mm`, by growing boxes; ties go to the lowest number, so the
    /// answer does not depend on the grid.
    pub fn nearest_within(&self, p: Point2, reach_mm: f64) -> Option<Nearest> {
        let mut reach = self.cell_mm.min(reach_mm);
        loop {
            let mut best: Option<Nearest> = None;
            let area = Box2 { min: p, max: p }.grown(reach);
            self.for_edges_in(area, |number| {
                let foot = self.edges[number].foot(p);
                let distance_mm = (p - foot).norm();
                let better = match best {
                    None => true,
                    Some(n) => {
                        distance_mm < n.distance_mm
                            || (distance_mm == n.distance_mm && number < n.edge)
                    }
                };
                if better {
                    best = Some(Nearest {
                        edge: number,
                        distance_mm,
                        foot,
                    });
                }
            });
            match best {
                Some(n) if n.distance_mm <= reach => return Some(n),
                _ if reach >= reach_mm => return best.filter(|n| n.distance_mm <= reach_mm),
                // What was found in a corner of the box bounds how far to look.
                Some(n) => reach = n.distance_mm.min(reach_mm),
                None => reach = (reach * 2.0).min(reach_mm),
            }
        }
    }

    /// The nearest edge at any distance; `None` only if there are no edges.
    pub fn nearest(&self, p: Point2) -> Option<Nearest> {
        let size = self.bounds.size();
        let to_box = (p - self.bounds.min)
            .norm()
            .max((p - self.bounds.max).norm());
        self.nearest_within(p, to_box + size.norm())
    }

    /// Even-odd containment: the reference point of the cell of `p` is known to be inside or not;
    /// from there to `p` the edges of that one cell are counted.
    pub fn contains(&self, p: Point2) -> bool {
        if !self.cell_mm.is_finite() {
            let mut crossings = 0usize;
            self.for_crossings(p, |_| crossings += 1);
            return crossings % 2 == 1;
        }
        let (low, high) = (self.bounds.min, self.bounds.max);
        if !(p.x >= low.x && p.y >= low.y && p.x <= high.x && p.y <= high.y) {
            return false;
        }
        let row = self.clamp_row((p.y - low.y) / self.cell_mm);
        self.contains_in_row(p, row, self.references())
    }

    /// [`EdgeIndex::contains`] of the points `at(0)` to `at(count - 1)`, all at the same y: the numbers of those inside.
    pub fn for_contained(
        &self,
        y: f64,
        count: usize,
        at: impl Fn(usize) -> Point2,
        mut found: impl FnMut(usize),
    ) {
        let (low, high) = (self.bounds.min, self.bounds.max);
        if !self.cell_mm.is_finite() {
            (0..count)
                .filter(|&number| self.contains(at(number)))
                .for_each(found);
            return;
        }
        if !(y >= low.y && y <= high.y) {
            return;
        }
        let row = self.clamp_row((y - low.y) / self.cell_mm);
        let references = self.references();
        for number in 0..count {
            let p = at(number);
            if p.x >= low.x && p.x <= high.x && self.contains_in_row(p, row, references) {
                found(number);
            }
        }
    }

    fn references(&self) -> &[bool] {
        self.reference_inside
            .get_or_init(|| self.references_inside())
    }

    /// Of a point within the bounds, in this row of cells.
    #[inline]
    fn contains_in_row(&self, p: Point2, row: usize, references: &[bool]) -> bool {
        let column = self.clamp_column((p.x - self.bounds.min.x) / self.cell_mm);
        let cell = row * self.columns + column;
        let mut inside = references[cell];
        let (from, to) = (self.first[cell] as usize, self.first[cell + 1] as usize);
        if from == to {
            return inside;
        }
        let reference = self.reference(column, row);
        let way = reference - p;
        for &number in &self.items[from..to] {
            let Edge { a, b } = self.edges[number as usize];
            if (way.perp(&(a - p)) > 0.0) != (way.perp(&(b - p)) > 0.0) {
                let along = b - a;
                inside ^= (along.perp(&(p - a)) > 0.0) != (along.perp(&(reference - a)) > 0.0);
            }
        }
        inside
    }

    fn reference(&self, column: usize, row: usize) -> Point2 {
        let shift = Vector2::new(
            (column as f64 + REFERENCE[0]) * self.cell_mm,
            (row as f64 + REFERENCE[1]) * self.cell_mm,
        );
        self.bounds.min + shift
    }

    /// Row by row: where the edges cross the height of the row's reference points.
    fn references_inside(&self) -> Vec<bool> {
        let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); self.rows];
        for &Edge { a, b } in &self.edges {
            let row_of = |y: f64| self.clamp_row((y - self.bounds.min.y) / self.cell_mm);
            let (low, high) = (row_of(a.y.min(b.y)), row_of(a.y.max(b.y)));
            for (row, xs) in crossings.iter_mut().enumerate().take(high + 1).skip(low) {
                let y = self.reference(0, row).y;
                if (a.y > y) != (b.y > y) {
                    xs.push(a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
                }
            }
        }
        let mut inside = Vec::with_capacity(self.columns * self.rows);
        for (row, xs) in crossings.iter_mut().enumerate() {
            xs.sort_by(f64::total_cmp);
            let mut passed = 0;
            for column in 0..self.columns {
                let x = self.reference(column, row).x;
                while passed < xs.len() && xs[passed] < x {
                    passed += 1;
                }
                inside.push(passed % 2 == 1);
            }
        }
        inside
    }

    /// Calls `visit` once with each edge that the ray from `p` towards +x crosses.
    pub fn for_crossings(&self, p: Point2, mut visit: impl FnMut(usize)) {
        if p.y < self.bounds.min.y || p.y > self.bounds.max.y || p.x > self.bounds.max.x {
            return;
        }
        let row = self.clamp_row((p.y - self.bounds.min.y) / self.cell_mm);
        let column = self.clamp_column((p.x - self.bounds.min.x) / self.cell_mm);
        for cell in column..self.columns {
            let at = row * self.columns + cell;
            for &number in &self.items[self.first[at] as usize..self.first[at + 1] as usize] {
                let Edge { a, b } = self.edges[number as usize];
                if super::polygon::crosses_ray(a, b, p) {
                    // An edge is in several cells: count it in the cell of its crossing only.
                    let x = a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x);
                    let home = self
                        .clamp_column((x - self.bounds.min.x) / self.cell_mm)
                        .max(column);
                    if home == cell {
                        visit(number as usize);
                    }
                }
            }
        }
    }

    /// Distance to the boundary: positive inside, negative outside.
    pub fn signed_distance_mm(&self, p: Point2) -> f64 {
        let distance = self.nearest(p).map_or(f64::INFINITY, |n| n.distance_mm);
        if self.contains(p) {
            distance
        } else {
            -distance
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::{random_numbers, region, star};

    fn random_edges(count: usize, far: f64) -> Vec<Edge> {
        let mut random = random_numbers(9);
        let points = star(count, |_| 3.0 + 20.0 * random());
        let points: Vec<[f64; 2]> = points.iter().map(|p| [far + p[0], far - p[1]]).collect();
        let region = region(&[&points]);
        region.edges().map(|(a, b)| Edge { a, b }).collect()
    }

    /// Goal: rows of points are told from outside as each point alone is. Method: rows within and beside the bounds, along
    /// an edge too, for cells of any size.
    #[test]
    fn rows_agree_with_points() {
        let square = [[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]];
        let square = region(&[&square]);
        let square = square.edges().map(|(a, b)| Edge { a, b }).collect();
        for edges in [random_edges(150, 0.0), square] {
            for cell_mm in [0.05, 0.6, 7.0, 500.0, f64::INFINITY] {
                let index = EdgeIndex::new(edges.clone(), cell_mm);
                let mut count = 0;
                for y in (-60..=60).map(|row| 0.5 * f64::from(row)) {
                    let at = |number: usize| Point2::new(-30.0 + 0.25 * number as f64, y);
                    let mut found = Vec::new();
                    index.for_contained(y, 240, at, |number| found.push(number));
                    let each = (0..240).filter(|&number| index.contains(at(number)));
                    assert_eq!(found, each.collect::<Vec<_>>(), "y {y}, cells of {cell_mm}");
                    count += found.len();
                }
                // The square alone has 8 x 6 mm at 8 places a mm².
                assert!(count > 300, "{count}");
            }
        }
    }

    /// Goal: the grid changes nothing but the time. Method: nearest edge, containment and edges in
    /// a box against loops over all edges, for cells from far too small to far too large.
    #[test]
    fn queries_agree_with_loops() {
        for (cell_mm, far) in [(0.05, 0.0), (0.6, 5000.0), (7.0, -300.0), (500.0, 0.0)] {
            let edges = random_edges(150, far);
            let index = EdgeIndex::new(edges.clone(), cell_mm);
            let (mut inside, mut outside) = (0, 0);
            for i in 0..40 {
                for j in 0..40 {
                    let p = Point2::new(
                        far - 26.0 + 1.3001 * f64::from(i),
                        far - 26.0 + 1.2999 * f64::from(j),
                    );
                    let least = edges
                        .iter()
                        .map(|e| (e.foot(p) - p).norm())
                        .fold(f64::MAX, f64::min);
                    assert_eq!(index.nearest(p).unwrap().distance_mm, least);
                    assert_eq!(index.nearest_within(p, 1.0).is_some(), least <= 1.0);
                    let crossings = edges
                        .iter()
                        .filter(|e| super::super::polygon::crosses_ray(e.a, e.b, p))
                        .count();
                    assert_eq!(index.contains(p), crossings % 2 == 1);
                    inside += crossings % 2;
                    outside += 1 - crossings % 2;
                    let area = Box2 { min: p, max: p }.grown(0.9);
                    let mut seen = vec![false; edges.len()];
                    index.for_edges_in(area, |n| seen[n] = true);
                    for (number, edge) in edges.iter().enumerate() {
                        assert!(seen[number] || (edge.foot(p) - p).norm() > 0.9);
                    }
                }
            }
            assert!(inside > 100 && outside > 100);
        }
    }

    /// Goal: senseless coordinates neither hang nor exhaust memory.
    #[test]
    fn senseless_coordinates() {
        for far in [1e300, f64::MAX] {
            let p = |x: f64, y: f64| Point2::new(x, y);
            let edges = vec![
                Edge {
                    a: p(-far, 0.0),
                    b: p(far, 0.0),
                },
                Edge {
                    a: p(far, 0.0),
                    b: p(0.0, far),
                },
                Edge {
                    a: p(0.0, far),
                    b: p(-far, 0.0),
                },
            ];
            assert_eq!(EdgeIndex::new(edges, 0.6).edges().len(), 3);
        }
    }
}
