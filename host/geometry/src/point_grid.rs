//! Items by position: finds those around a point without searching all of them.

use crate::Point2;
use crate::polygon::Box2;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// What belongs to square cells, by column and row.
pub type ByCell<T> = HashMap<(i32, i32), T, BuildHasherDefault<CellHasher>>;

/// Mixes two small numbers: the standard hash would take most of the time of a query.
#[derive(Clone, Copy, Debug, Default)]
pub struct CellHasher(u64);

impl Hasher for CellHasher {
    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.write_i32(i32::from(byte));
        }
    }

    fn write_i32(&mut self, number: i32) {
        // 2⁶⁴ by the golden ratio (Knuth, "Sorting and Searching", 6.4).
        let mixed = self.0.rotate_left(32) ^ u64::from(number as u32);
        self.0 = mixed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }

    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 32)
    }
}

/// Items in square cells with the reach of queries as their side.
#[derive(Debug)]
pub struct PointGrid<T> {
    reach_mm: f64,
    cells: ByCell<Vec<T>>,
}

impl<T> PointGrid<T> {
    /// Stores each item at its position.
    pub fn of(reach_mm: f64, things: impl Iterator<Item = (Point2, T)>) -> PointGrid<T> {
        let cells = ByCell::default();
        let mut grid = PointGrid { reach_mm, cells };
        for (place, thing) in things {
            grid.add(place, thing);
        }
        grid
    }

    /// Stores one more item.
    pub fn add(&mut self, place: Point2, thing: T) {
        let cell = self.cells.entry(cell_of(place, self.reach_mm)).or_default();
        cell.push(thing);
    }

    /// All items within the reach of a point, and some more; always in the same order.
    pub fn around(&self, place: Point2) -> impl Iterator<Item = &T> {
        let (column, row) = cell_of(place, self.reach_mm);
        let around = (-1..=1).flat_map(move |r| (-1..=1).map(move |c| (column + c, row + r)));
        around.filter_map(|at| self.cells.get(&at)).flatten()
    }

    /// All items in a box, and some more; always in the same order.
    pub fn within(&self, area: &Box2) -> impl Iterator<Item = &T> {
        let [low, high] = [area.min, area.max].map(|corner| cell_of(corner, self.reach_mm));
        let cells = (low.1..=high.1).flat_map(move |r| (low.0..=high.0).map(move |c| (c, r)));
        cells.filter_map(|at| self.cells.get(&at)).flatten()
    }
}

/// Column and row of the cell of a point. They are kept away from the ends of the range, so that
/// there is a cell on each side: points that far off the grid share one, which is slow, not wrong.
pub fn cell_of(place: Point2, cell_mm: f64) -> (i32, i32) {
    let number = |x: f64| (x / cell_mm).floor().clamp(-CELL_MAX, CELL_MAX) as i32;
    (number(place.x), number(place.y))
}

/// Largest number of a cell, in either direction.
const CELL_MAX: f64 = 1e9;

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: whatever lies within the reach, or in a box, is found. Method: a grid of points
    /// against a search of all of them.
    #[test]
    fn all_within_the_reach_are_found() {
        let points: Vec<Point2> = (0..400)
            .map(|i| {
                Point2::new(
                    0.37 * f64::from(i % 20) - 3.0,
                    0.41 * f64::from(i / 20) - 4.0,
                )
            })
            .collect();
        let index = PointGrid::of(1.0, points.iter().map(|p| (*p, *p)));
        for p in &points {
            let near = |q: &&Point2| (*q - p).norm() <= 1.0;
            let found = index.around(*p).filter(near).count();
            assert_eq!(found, points.iter().filter(near).count());
            let area = Box2 { min: *p, max: *p }.grown(0.7);
            let inside = |q: &&Point2| (*q - p).amax() <= 0.7;
            let found = index.within(&area).filter(inside).count();
            assert_eq!(found, points.iter().filter(inside).count());
        }
    }
}
