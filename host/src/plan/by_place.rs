//! Things by where they are: those about a place are found without looking at all.

use crate::geometry::Point2;
use crate::geometry::polygon::Box2;
use std::collections::HashMap;

/// Things in square cells as long as the reach they are asked for with.
pub struct ByPlace<T> {
    reach_mm: f64,
    cells: HashMap<[i64; 2], Vec<T>>,
}

impl<T> ByPlace<T> {
    /// Puts each thing where it is.
    pub fn of(reach_mm: f64, things: impl Iterator<Item = (Point2, T)>) -> ByPlace<T> {
        let mut cells: HashMap<[i64; 2], Vec<T>> = HashMap::new();
        for (place, thing) in things {
            let cell = cells.entry(cell(place, reach_mm)).or_default();
            cell.push(thing);
        }
        ByPlace { reach_mm, cells }
    }

    /// All things within the reach of a place, and some more; always in the same order.
    pub fn around(&self, place: Point2) -> impl Iterator<Item = &T> {
        let [column, row] = cell(place, self.reach_mm);
        let around = (-1..=1).flat_map(move |r| (-1..=1).map(move |c| [column + c, row + r]));
        around.filter_map(|at| self.cells.get(&at)).flatten()
    }

    /// All things in a box, and some more; always in the same order.
    pub fn within(&self, area: &Box2) -> impl Iterator<Item = &T> {
        let [low, high] = [area.min, area.max].map(|corner| cell(corner, self.reach_mm));
        let cells = (low[1]..=high[1]).flat_map(move |r| (low[0]..=high[0]).map(move |c| [c, r]));
        cells.filter_map(|at| self.cells.get(&at)).flatten()
    }
}

fn cell(place: Point2, reach_mm: f64) -> [i64; 2] {
    [place.x, place.y].map(|x| (x / reach_mm).floor() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: whatever lies within the reach, or in a box, is found. Method: a grid of points against
    /// a search of all of them.
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
        let index = ByPlace::of(1.0, points.iter().map(|p| (*p, *p)));
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
