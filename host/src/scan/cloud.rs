//! Points of a scan, averaged in cells as they come, so that memory is bounded for any number of them.
//!
//! In: points, mm, in any order. Out: one mean point for each cell that has any. Cells double whenever there are too many.

use crate::text::refusal::{Refusal, refusal};
use std::collections::BTreeMap;

/// A point in mm.
pub type Point = [f32; 3];
/// Cells along a side of a tile.
const TILE: i32 = 32;
/// Most tiles: 134 MB of cells.
const TILES_MAX: usize = 8_192;
/// A scan that is larger has another unit, mm.
const SIZE_MAX_MM: f64 = 20_000.0;

#[derive(Clone, Copy, Default)]
struct Cell {
    points: u32,
    /// From the first point of the scan, mm.
    mean_mm: [f32; 3],
}

/// A scan while it is read.
pub struct Cloud {
    cell_mm: f64,
    first_mm: Option<[f64; 3]>,
    tiles: BTreeMap<[i32; 2], Vec<Cell>>,
    /// Rows that were points.
    pub points: u64,
    /// Rows that were none.
    pub dropped: u64,
}

impl Cloud {
    /// An empty one of cells of this size.
    pub fn new(cell_mm: f64) -> Cloud {
        Cloud {
            cell_mm,
            first_mm: None,
            tiles: BTreeMap::new(),
            points: 0,
            dropped: 0,
        }
    }

    /// Adds a point; one that is not finite is counted as dropped.
    ///
    /// # Errors
    /// A `Refusal` for a scan of more than 20 m.
    pub fn add(&mut self, point_mm: [f64; 3]) -> Result<(), Refusal> {
        if !point_mm.iter().all(|x| x.is_finite()) {
            self.dropped += 1;
            return Ok(());
        }
        let first = *self.first_mm.get_or_insert(point_mm);
        let from: [f64; 3] = std::array::from_fn(|k| point_mm[k] - first[k]);
        if from.iter().any(|x| x.abs() > SIZE_MAX_MM) {
            return Err(refusal!(
                "point {} of the scan is more than {SIZE_MAX_MM} mm from its first: is its unit mm (--units)?",
                self.points + 1
            ));
        }
        self.points += 1;
        self.put(from.map(|x| x as f32), 1);
        if self.tiles.len() > TILES_MAX {
            self.coarsen();
        }
        Ok(())
    }

    fn put(&mut self, at_mm: [f32; 3], points: u32) {
        let [column, row] = [0, 1].map(|k| (f64::from(at_mm[k]) / self.cell_mm).floor() as i32);
        let tile = [column.div_euclid(TILE), row.div_euclid(TILE)];
        let inside = row.rem_euclid(TILE) * TILE + column.rem_euclid(TILE);
        let empty = || vec![Cell::default(); (TILE * TILE) as usize];
        let cell = &mut self.tiles.entry(tile).or_insert_with(empty)[inside as usize];
        cell.points = cell.points.saturating_add(points);
        let share = points as f32 / cell.points as f32;
        for (mean, at) in cell.mean_mm.iter_mut().zip(at_mm) {
            *mean += share * (at - *mean);
        }
    }

    fn coarsen(&mut self) {
        self.cell_mm *= 2.0;
        for cell in std::mem::take(&mut self.tiles).into_values().flatten() {
            if cell.points > 0 {
                self.put(cell.mean_mm, cell.points);
            }
        }
    }

    /// The mean points, from the scan's first one, and that.
    ///
    /// # Errors
    /// A `Refusal` if there are none, or if most rows were none.
    pub fn into_points(self) -> Result<(Vec<Point>, [f64; 3]), Refusal> {
        let Some(first_mm) = self.first_mm else {
            return Err(refusal!(
                "the scan has no points ({} rows without three numbers): give rows of x, y, z in mm",
                self.dropped
            ));
        };
        if self.dropped > self.points {
            return Err(refusal!(
                "{} of the scan's {} rows have no point: most of the layer was not seen; scan it again",
                self.dropped,
                self.dropped + self.points
            ));
        }
        let cells = self.tiles.into_values().flatten();
        let cells = cells.filter(|cell| cell.points > 0);
        Ok((cells.map(|cell| cell.mean_mm).collect(), first_mm))
    }
}

#[cfg(test)]
mod tests {
    //! Goal: more points than there is room for become fewer, coarser means. Method: points on a plane, far apart.
    use super::*;

    #[test]
    fn cells_double_when_there_are_too_many() {
        let mut cloud = Cloud::new(0.01);
        let side = 200;
        for k in 0..side * side {
            let [x, y] = [k % side, k / side].map(|at| f64::from(at) * 0.4);
            cloud.add([x, y, 0.5 * x]).expect("in range");
        }
        assert!(cloud.cell_mm > 0.01 && cloud.tiles.len() <= TILES_MAX);
        let (points, first_mm) = cloud.into_points().expect("points");
        assert_eq!(first_mm, [0.0; 3]);
        assert!(points.len() <= (side * side) as usize && points.len() > 1000);
        assert!(points.iter().all(|[x, _, z]| (z - 0.5 * x).abs() < 1e-3));
    }
}
