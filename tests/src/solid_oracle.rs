//! What of a part should be solid, and what of that the finished motion leaves open, layer by layer on a raster.
//!
//! Shares no code with the planner: sections by ray casting, distances by the exact transform of Felzenszwalb and
//! Huttenlocher (2012), solid layers from the sections of the layers above and below, poses of [`crate::layer_oracle`]. In:
//! sections (mm), poses. Out: connected open areas.

use crate::layer_oracle::{OraclePose, Rings};

/// Cells over a part.
#[derive(Clone, Copy, Debug)]
pub struct Raster {
    low_mm: [f64; 2],
    cell_mm: f64,
    columns: usize,
    rows: usize,
}

/// What should be solid of a part.
#[derive(Clone, Copy, Debug)]
pub struct SolidRule {
    /// Loops around each layer; `None` where all of it is filled.
    pub walls: Option<u32>,
    /// Solid layers from the bottom up, and from the top down.
    pub shells: [usize; 2],
    /// The widest bead and the narrowest one, mm.
    pub beads_mm: [f64; 2],
}

/// How much farther ground is grown than it was eroded, so that it is in right corners again.
const GROWN_BACK: f64 = 1.5;

/// A connected open area.
#[derive(Clone, Debug)]
pub struct OpenArea {
    pub area_mm2: f64,
    /// Centres of its cells, mm.
    cells_mm: Vec<[f64; 2]>,
}

impl OpenArea {
    /// A place in it.
    pub fn at_mm(&self) -> [f64; 2] {
        self.cells_mm[self.cells_mm.len() / 2]
    }

    /// From a place to the nearest of its cells, mm.
    pub fn away_mm(&self, [x, y]: [f64; 2]) -> f64 {
        let away = |p: &[f64; 2]| (p[0] - x).hypot(p[1] - y);
        self.cells_mm.iter().map(away).fold(f64::MAX, f64::min)
    }
}

impl Raster {
    /// Around all sections, and a margin.
    pub fn around(sections: &[Rings], cell_mm: f64) -> Raster {
        const MARGIN_MM: f64 = 0.5;
        let points = sections.iter().flatten().flatten();
        let ends = |axis: usize| {
            let all = points.clone().map(|p| p[axis]);
            let low = all.clone().fold(f64::MAX, f64::min);
            [low - MARGIN_MM, all.fold(f64::MIN, f64::max) + MARGIN_MM]
        };
        let [x, y] = [ends(0), ends(1)];
        let cells = |[low, high]: [f64; 2]| ((high - low) / cell_mm).ceil() as usize;
        Raster {
            low_mm: [x[0], y[0]],
            cell_mm,
            columns: cells(x),
            rows: cells(y),
        }
    }

    /// Cells from one place along an axis to another.
    fn span(&self, axis: usize, from_mm: f64, to_mm: f64) -> std::ops::Range<usize> {
        let most = [self.columns, self.rows][axis];
        // The first whose centre is not before it.
        let first = |mm: f64| {
            let cell = ((mm - self.low_mm[axis]) / self.cell_mm - 0.5).ceil();
            (cell.max(0.0) as usize).min(most)
        };
        first(from_mm)..first(to_mm)
    }

    fn middle_mm(&self, axis: usize, cell: usize) -> f64 {
        self.low_mm[axis] + (cell as f64 + 0.5) * self.cell_mm
    }

    /// Cells within a section, by the even-odd rule.
    pub fn filled(&self, rings: &Rings) -> Vec<bool> {
        let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); self.rows];
        for ring in rings {
            for (i, p) in ring.iter().enumerate() {
                let q = ring[(i + 1) % ring.len()];
                let (low, high) = if p[1] < q[1] { (*p, q) } else { (q, *p) };
                for row in self.span(1, low[1], high[1]) {
                    let share = (self.middle_mm(1, row) - low[1]) / (high[1] - low[1]);
                    crossings[row].push(low[0] + share * (high[0] - low[0]));
                }
            }
        }
        let mut cells = vec![false; self.columns * self.rows];
        for (row, mut found) in crossings.into_iter().enumerate() {
            found.sort_by(f64::total_cmp);
            for pair in found.chunks_exact(2) {
                let columns = self.span(0, pair[0], pair[1]);
                cells[row * self.columns..][columns].fill(true);
            }
        }
        cells
    }

    /// Cells that an ellipse (semi-axes) covers from one of the poses.
    pub fn swept<'a>(
        &self,
        poses: impl Iterator<Item = &'a OraclePose>,
        axes_mm: [f64; 2],
    ) -> Vec<bool> {
        let [a, b] = axes_mm;
        let mut cells = vec![false; self.columns * self.rows];
        for pose in poses {
            let (sin, cos) = pose.heading_rad.sin_cos();
            // The ellipse as p x² + 2 q x y + r y² = 1.
            let [p, q, r] = [
                (cos / a).powi(2) + (sin / b).powi(2),
                sin * cos * (a.powi(-2) - b.powi(-2)),
                (sin / a).powi(2) + (cos / b).powi(2),
            ];
            let high_mm = (p / (p * r - q * q)).sqrt();
            for row in self.span(1, pose.y_mm - high_mm, pose.y_mm + high_mm) {
                let y = self.middle_mm(1, row) - pose.y_mm;
                let root = (q * y).powi(2) - p * (r * y * y - 1.0);
                if root < 0.0 {
                    continue;
                }
                let [from, to] =
                    [-1.0, 1.0].map(|sign| pose.x_mm + (sign * root.sqrt() - q * y) / p);
                let columns = self.span(0, from, to);
                cells[row * self.columns..][columns].fill(true);
            }
        }
        cells
    }

    /// Cells no farther than this from one of these, centre to centre.
    fn near(&self, cells: &[bool], reach_mm: f64) -> Vec<bool> {
        let (columns, rows) = (self.columns, self.rows);
        let far = (columns + rows) as f32;
        // Down and up each column, then the lower envelope of parabolas along each row.
        let mut up_to = vec![far; columns * rows];
        for column in 0..columns {
            let mut since = far;
            for row in 0..rows {
                since = if cells[row * columns + column] {
                    0.0
                } else {
                    since + 1.0
                };
                up_to[row * columns + column] = since;
            }
            since = far;
            for row in (0..rows).rev() {
                let own = &mut up_to[row * columns + column];
                since = if *own == 0.0 { 0.0 } else { since + 1.0 };
                *own = own.min(since);
            }
        }
        let reach = (reach_mm / self.cell_mm) as f32;
        let mut near = vec![false; columns * rows];
        let (mut at, mut from) = (vec![0usize; columns], vec![0.0f32; columns + 1]);
        for row in 0..rows {
            let heights = &up_to[row * columns..][..columns];
            let height2 = |column: usize| heights[column] * heights[column];
            let mut count = 0;
            for (column, height) in heights.iter().enumerate() {
                if *height >= far {
                    continue;
                }
                let own = height2(column) + (column * column) as f32;
                let mut begin = f32::NEG_INFINITY;
                while count > 0 {
                    let last = at[count - 1];
                    let other = height2(last) + (last * last) as f32;
                    begin = (own - other) / (2.0 * (column - last) as f32);
                    if begin > from[count - 1] {
                        break;
                    }
                    count -= 1;
                    begin = f32::NEG_INFINITY;
                }
                (at[count], from[count]) = (column, begin);
                count += 1;
            }
            let mut number = 0;
            for column in 0..columns {
                if count == 0 {
                    break;
                }
                while number + 1 < count && from[number + 1] < column as f32 {
                    number += 1;
                }
                let across = column.abs_diff(at[number]) as f32;
                near[row * columns + column] =
                    across * across + height2(at[number]) <= reach * reach;
            }
        }
        near
    }

    /// What of a layer should be solid: the walls, and what one of the layers next to it does not have. Walls are as wide as
    /// the widest beads, but around ground that may be open they may share their width with one bead more. Left out are
    /// cells that the outline may cut; strips beside walls that are thinner than the narrowest bead; and what is nearer than
    /// half of that bead to ground that may be open, since beads vary.
    pub fn solid(&self, layers: &[Vec<bool>], layer: usize, rule: &SolidRule) -> Vec<bool> {
        let own = &layers[layer];
        let outside: Vec<bool> = own.iter().map(|inside| !inside).collect();
        let on_edge = self.near(&outside, self.cell_mm);
        let cells = 0..own.len();
        let Some(walls) = rule.walls else {
            return cells.map(|cell| own[cell] && !on_edge[cell]).collect();
        };
        let [widest_mm, narrowest_mm] = rule.beads_mm;
        let walls_mm = f64::from(walls) * widest_mm;
        let shared_mm = walls_mm * f64::from(walls) / f64::from(walls + 1);
        let [nominal, shared] = [walls_mm, shared_mm].map(|reach_mm| self.near(&outside, reach_mm));
        let [bottom, top] = rule.shells;
        let beside: Vec<Option<&Vec<bool>>> = (1..=bottom)
            .map(|step| layers.get(layer.checked_sub(step)?))
            .chain((1..=top).map(|step| layers.get(layer + step)))
            .collect();
        let is_exposed = |cell: usize| {
            let mut beside = beside.iter();
            own[cell] && !shared[cell] && beside.any(|other| other.is_none_or(|other| !other[cell]))
        };
        let closed: Vec<bool> = cells.clone().map(|cell| !is_exposed(cell)).collect();
        let half_mm = 0.5 * narrowest_mm;
        // Eroded and grown again, into corners too: without strips.
        let near_closed = self.near(&closed, half_mm);
        let deep: Vec<bool> = near_closed.iter().map(|near| !near).collect();
        let wide = self.near(&deep, GROWN_BACK * half_mm);
        let is_filled = |cell: usize| !closed[cell] && wide[cell];
        let core: Vec<bool> = cells
            .clone()
            .map(|cell| own[cell] && !nominal[cell] && !is_filled(cell))
            .collect();
        let around_core = self.near(&core, walls_mm);
        let is_open = |cell: usize| {
            let may_share = own[cell] && !shared[cell] && around_core[cell];
            core[cell] || may_share && !is_filled(cell)
        };
        let open: Vec<bool> = cells.clone().map(is_open).collect();
        let beside_open = self.near(&open, half_mm);
        cells
            .map(|cell| own[cell] && !beside_open[cell] && !on_edge[cell])
            .collect()
    }

    /// Connected areas, through sides of cells, of what should be solid and is not covered, from this area on.
    pub fn open(&self, solid: &[bool], covered: &[bool], least_mm2: f64) -> Vec<OpenArea> {
        let mut is_left: Vec<bool> = solid
            .iter()
            .zip(covered)
            .map(|(solid, covered)| *solid && !covered)
            .collect();
        let mut found = Vec::new();
        for first in 0..is_left.len() {
            if !is_left[first] {
                continue;
            }
            is_left[first] = false;
            let (mut cells, mut next) = (vec![first], 0);
            while let Some(&cell) = cells.get(next) {
                next += 1;
                let column = cell % self.columns;
                let beside = [
                    (column > 0).then(|| cell - 1),
                    (column + 1 < self.columns).then_some(cell + 1),
                    cell.checked_sub(self.columns),
                    Some(cell + self.columns).filter(|&other| other < is_left.len()),
                ];
                for other in beside.into_iter().flatten() {
                    if std::mem::take(&mut is_left[other]) {
                        cells.push(other);
                    }
                }
            }
            let area_mm2 = cells.len() as f64 * self.cell_mm * self.cell_mm;
            if area_mm2 >= least_mm2 {
                let place = |cell: &usize| {
                    [
                        self.middle_mm(0, cell % self.columns),
                        self.middle_mm(1, cell / self.columns),
                    ]
                };
                let cells_mm = cells.iter().map(place).collect();
                found.push(OpenArea { area_mm2, cells_mm });
            }
        }
        found
    }

    /// Area of these cells, mm².
    pub fn area_mm2(&self, cells: &[bool]) -> f64 {
        cells.iter().filter(|is_in| **is_in).count() as f64 * self.cell_mm * self.cell_mm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(from: f64, to: f64) -> Rings {
        vec![vec![[from, from], [to, from], [to, to], [from, to]]]
    }

    /// Goal: the oracle finds what is open, and nothing else. Method: a square of 10 mm under one of 4 mm, areas by hand; a
    /// pose that covers an ellipse; a rule of one wall of 1.2 mm and one solid layer on top.
    #[test]
    fn areas_are_those_by_hand() {
        let sections = [square(0.0, 10.0), square(0.0, 10.0), square(3.0, 7.0)];
        let raster = Raster::around(&sections, 0.02);
        let layers: Vec<Vec<bool>> = sections.iter().map(|rings| raster.filled(rings)).collect();
        assert!((raster.area_mm2(&layers[0]) - 100.0).abs() < 0.5);
        let rule = SolidRule {
            walls: Some(1),
            shells: [0, 1],
            beads_mm: [1.2, 0.4],
        };
        // Of the wall half, less 0.2 mm, and the cells at the outline.
        let walls_mm2 = (10.0f64 - 0.04).powi(2) - (10.0f64 - 0.8).powi(2);
        let found_mm2 = raster.area_mm2(&raster.solid(&layers, 0, &rule));
        assert!(
            (found_mm2 - walls_mm2).abs() < 0.8,
            "{found_mm2} {walls_mm2}"
        );
        // The step, and nothing of what the upper square covers but for 0.2 mm.
        let step_mm2 = 100.0 - 4.4f64.powi(2) + (4.0 - std::f64::consts::PI) * 0.04;
        let found_mm2 = raster.area_mm2(&raster.solid(&layers, 1, &rule));
        assert!((found_mm2 - step_mm2).abs() < 0.8, "{found_mm2} {step_mm2}");
        let pose = OraclePose {
            x_mm: 4.0,
            y_mm: 5.0,
            heading_rad: 0.7,
            pass: 0,
            layer: 0,
            path_mm: 0.0,
        };
        let swept = raster.swept([pose].iter(), [0.6, 0.2]);
        let ellipse_mm2 = std::f64::consts::PI * 0.12;
        assert!((raster.area_mm2(&swept) - ellipse_mm2).abs() < 0.01);
        let all = SolidRule {
            walls: None,
            ..rule
        };
        let solid = raster.solid(&layers, 2, &all);
        let open = raster.open(&solid, &swept, 0.1);
        assert_eq!(open.len(), 1);
        let found_mm2 = open[0].area_mm2;
        assert!(
            (found_mm2 - (3.96 * 3.96 - ellipse_mm2)).abs() < 0.1,
            "{found_mm2}"
        );
        assert!(open[0].away_mm([4.0, 5.0]) > 0.19 && open[0].away_mm([4.0, 5.5]) < 0.02);
    }
}
