//! The upper side of a part by places of an even grid, and the pieces of it that layers can follow.
//!
//! In: a mesh that stands on z = 0 (mm) and the steepest slope that is followed. Out: [`TopGrid`], heights of the topmost
//! triangles, and [`Piece`]s: connected places between which the top rises by no more than that slope. A step, a wall, a steep
//! flank parts pieces. Pieces that are flat at a whole layer are left to flat layers.

use crate::geometry::{Point2, Vector2};
use crate::mesh::Mesh;
use crate::mesh::height_map::HeightMap;

/// Step of the grid, of the aperture's unit, as long as there are no more than this along an axis.
const STEP: f64 = 0.25;
const STEPS_MAX: f64 = 240.0;
/// Least mean distance of a piece from whole layers, of a layer: nearer to them flat layers are as good.
const OFF_LAYERS: f64 = 0.02;

/// Heights over a grid; not a number where there is no material.
#[derive(Clone, Debug)]
pub struct TopGrid {
    /// Place of the first cell's middle.
    pub low: Point2,
    /// From one cell to the next, mm.
    pub step_mm: f64,
    /// Cells along x and y.
    pub count: [usize; 2],
    /// Heights, x fastest, mm above the bed.
    pub z_mm: Vec<f64>,
}

/// A connected part of the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Its cells.
    pub cells: Vec<usize>,
}

impl TopGrid {
    /// Looks at a mesh from above; `unit_mm` is the aperture's.
    pub fn of(mesh: &Mesh, unit_mm: f64) -> TopGrid {
        let map = HeightMap::of(mesh);
        let bounds = map.bounds();
        let size = bounds.size();
        let step_mm = (size.x.max(size.y) / STEPS_MAX).max(STEP * unit_mm);
        let count = [size.x, size.y].map(|side| (side / step_mm).ceil().max(1.0) as usize);
        // Middles of cells, the grid in the middle of the box: no wall along the axes lies under a row of them.
        let spare = Vector2::new(
            size.x - step_mm * (count[0] - 1) as f64,
            size.y - step_mm * (count[1] - 1) as f64,
        );
        let mut grid = TopGrid {
            low: bounds.min + 0.5 * spare,
            step_mm,
            count,
            z_mm: Vec::new(),
        };
        let cells = 0..count[0] * count[1];
        grid.z_mm = cells
            .map(|cell| map.top_mm(grid.place(cell)).unwrap_or(f64::NAN))
            .collect();
        grid
    }

    /// The middle of a cell.
    pub fn place(&self, cell: usize) -> Point2 {
        let (i, j) = (cell % self.count[0], cell / self.count[0]);
        self.low + self.step_mm * Vector2::new(i as f64, j as f64)
    }

    /// The area of a cell, mm².
    pub fn cell_mm2(&self) -> f64 {
        self.step_mm * self.step_mm
    }

    /// The greatest height, mm.
    pub fn highest_mm(&self) -> f64 {
        self.z_mm.iter().copied().fold(0.0, f64::max)
    }

    /// The cells beside one, with their distance in steps.
    pub fn beside(&self, cell: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let (i, j) = (
            (cell % self.count[0]) as isize,
            (cell / self.count[0]) as isize,
        );
        let [columns, rows] = self.count.map(|count| count as isize);
        let around = (-1..=1).flat_map(move |dj| (-1..=1).map(move |di| (di, dj)));
        around.filter_map(move |(di, dj): (isize, isize)| {
            let (k, l) = (i + di, j + dj);
            let is_inside = (0..columns).contains(&k) && (0..rows).contains(&l);
            let is_other = (di, dj) != (0, 0);
            (is_inside && is_other)
                .then(|| ((l * columns + k) as usize, f64::hypot(di as f64, dj as f64)))
        })
    }

    /// The pieces that rise by at most this slope from cell to cell and have this area, but for those that are flat at
    /// whole layers. In the order of their first cells.
    pub fn pieces(&self, slope_max: f64, area_min_mm2: f64, layer_mm: f64) -> Vec<Piece> {
        let is_even = |cell: usize| {
            let z_mm = self.z_mm[cell];
            !z_mm.is_nan()
                && self.beside(cell).all(|(other, steps)| {
                    let rise_mm = (self.z_mm[other] - z_mm).abs();
                    rise_mm.is_nan() || rise_mm <= slope_max * steps * self.step_mm
                })
        };
        let is_free: Vec<bool> = (0..self.z_mm.len()).map(is_even).collect();
        let mut pieces = self.connected(is_free);
        pieces.retain(|piece| {
            let area_mm2 = piece.cells.len() as f64 * self.cell_mm2();
            let off = piece.cells.iter().map(|&cell| {
                let layers = self.z_mm[cell] / layer_mm;
                (layers - layers.round()).abs()
            });
            let off = off.sum::<f64>() / piece.cells.len() as f64;
            area_mm2 >= area_min_mm2 && off > OFF_LAYERS
        });
        pieces
    }

    /// Cells that hang together.
    fn connected(&self, mut is_free: Vec<bool>) -> Vec<Piece> {
        let mut pieces = Vec::new();
        for first in 0..is_free.len() {
            if !is_free[first] {
                continue;
            }
            is_free[first] = false;
            let mut cells = vec![first];
            let mut looked_at = 0;
            while let Some(&cell) = cells.get(looked_at) {
                looked_at += 1;
                for (other, steps) in self.beside(cell) {
                    if steps < 1.1 && is_free[other] {
                        is_free[other] = false;
                        cells.push(other);
                    }
                }
            }
            cells.sort_unstable();
            pieces.push(Piece { cells });
        }
        pieces
    }

    /// How far every cell of a grid grown by `margin` cells to each side is from a piece, about (by steps to the side and
    /// across), mm; with the place of its first cell and its counts.
    pub fn distances_mm(&self, piece: &Piece, margin: usize) -> (TopGrid, Vec<f64>) {
        let count = self.count.map(|count| count + 2 * margin);
        let low = self.low - self.step_mm * Vector2::repeat(margin as f64);
        let mut grown = TopGrid {
            low,
            step_mm: self.step_mm,
            count,
            z_mm: vec![f64::INFINITY; count[0] * count[1]],
        };
        for &cell in &piece.cells {
            let (i, j) = (cell % self.count[0], cell / self.count[0]);
            grown.z_mm[(j + margin) * count[0] + i + margin] = 0.0;
        }
        let mut away = std::mem::take(&mut grown.z_mm);
        let cells = 0..away.len();
        // Two sweeps with the distances of neighbours that were swept before (Borgefors 1986).
        let mut sweep = |cell: usize, is_before: bool| {
            let near = grown
                .beside(cell)
                .filter(|(other, _)| (*other < cell) == is_before);
            let least = near.map(|(other, steps)| away[other] + steps * self.step_mm);
            away[cell] = least.fold(away[cell], f64::min);
        };
        cells.clone().for_each(|cell| sweep(cell, true));
        cells.rev().for_each(|cell| sweep(cell, false));
        (grown, away)
    }
}
