//! The cells of a raster that a placed aperture covers.

use super::aperture::Aperture;
use super::clearance::Configuration;
use super::polygon::Box2;
use super::rounded_polygon::row_range;
use super::{Point2, Vector2};
use rayon::prelude::*;
use std::ops::Range;

/// A raster's place and size; cells are numbered row by row from the lower left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellGrid {
    /// Lower left corner of cell 0.
    pub origin: Point2,
    /// Cell size, mm.
    pub cell_mm: f64,
    /// Cells in x.
    pub columns: usize,
    /// Cells in y.
    pub rows: usize,
}

/// Offset of a grid's start before its contents, cells: fractions that no round dimension has, so
/// that the middles of cells are not on walls or edges of beads, where rounding would decide.
pub const ASIDE: Vector2 = Vector2::new(0.37, 0.61);

impl CellGrid {
    /// A grid over `bounds` with cells of `cell_mm`, larger ones where that would make more than
    /// `cells_max`.
    pub fn over(bounds: &Box2, cell_mm: f64, cells_max: usize) -> CellGrid {
        let size = bounds.max - bounds.min;
        let least_mm = (size.x * size.y / cells_max as f64).sqrt();
        let cell_mm = cell_mm.max(least_mm);
        let cells = |length_mm: f64| (length_mm / cell_mm).ceil() as usize + 1;
        CellGrid {
            origin: bounds.min - ASIDE * cell_mm,
            cell_mm,
            columns: cells(size.x),
            rows: cells(size.y),
        }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// True without cells.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Area of one cell, mm².
    pub fn cell_area_mm2(&self) -> f64 {
        self.cell_mm.powi(2)
    }

    /// All of its cells.
    pub fn window(&self) -> CellWindow {
        CellWindow {
            rows: [0, self.rows - 1],
            columns: [0, self.columns - 1],
        }
    }

    /// The cells that a box may touch, at least one.
    pub fn window_about(&self, area: &Box2) -> CellWindow {
        let cells = |low_mm: f64, high_mm: f64, count: usize| {
            [low_mm, high_mm].map(|mm| ((mm / self.cell_mm).max(0.0) as usize).min(count - 1))
        };
        let (low, high) = (area.min - self.origin, area.max - self.origin);
        CellWindow {
            rows: cells(low.y, high.y, self.rows),
            columns: cells(low.x, high.x, self.columns),
        }
    }

    /// The cells that the aperture may cover at any of the poses, or up to `beyond_mm` from them.
    pub fn window_of<'a>(
        &self,
        aperture: &Aperture,
        poses: impl IntoIterator<Item = &'a Configuration>,
        beyond_mm: f64,
    ) -> CellWindow {
        let centers: Vec<Point2> = poses.into_iter().map(|at| at.center).collect();
        self.window_about(&Box2::of(&centers).grown(aperture.reach_mm() + beyond_mm))
    }

    /// The rows of one band, all columns.
    pub fn band(&self, band: usize) -> CellWindow {
        let first = band * BAND_ROWS;
        CellWindow {
            rows: [first, (first + BAND_ROWS).min(self.rows) - 1],
            ..self.window()
        }
    }

    /// What belongs to all cells, cut into the shares of the bands.
    pub fn bands_of<'a, T: Send>(
        &'a self,
        of_cells: &'a mut [T],
    ) -> impl IndexedParallelIterator<Item = (CellWindow, &'a mut [T])> {
        let shares = of_cells.par_chunks_mut(BAND_ROWS * self.columns);
        shares
            .enumerate()
            .map(|(band, share)| (self.band(band), share))
    }

    /// For each band of rows the numbers of the poses that may cover its cells: bands can be swept
    /// in parallel.
    pub fn poses_of_bands(
        &self,
        aperture: &Aperture,
        poses: impl Iterator<Item = Configuration>,
    ) -> Vec<Vec<u32>> {
        let bands = self.rows.div_ceil(BAND_ROWS);
        let band_mm = BAND_ROWS as f64 * self.cell_mm;
        let reach_mm = aperture.reach_mm();
        let mut of_band: Vec<Vec<u32>> = vec![Vec::new(); bands];
        for (number, at) in poses.enumerate() {
            let y_mm = at.center.y - self.origin.y;
            let low = ((y_mm - reach_mm) / band_mm).max(0.0) as usize;
            let high = ((y_mm + reach_mm) / band_mm).max(0.0) as usize;
            for band in of_band.iter_mut().take((high + 1).min(bands)).skip(low) {
                band.push(number as u32);
            }
        }
        of_band
    }

    /// Visits the rows of cells whose centres are in the placed aperture: row, first and last column.
    pub fn for_rows(
        &self,
        aperture: &Aperture,
        at: Configuration,
        visit: impl FnMut(usize, usize, usize),
    ) {
        self.for_rows_within(&self.window(), aperture, at, visit);
    }

    /// The same for the cells of a window alone.
    pub fn for_rows_within(
        &self,
        window: &CellWindow,
        aperture: &Aperture,
        at: Configuration,
        mut visit: impl FnMut(usize, usize, usize),
    ) {
        // Places in cells from the centre of cell 0.
        let per_mm = 1.0 / self.cell_mm;
        let x = (at.center.x - self.origin.x) * per_mm - 0.5;
        let y = (at.center.y - self.origin.y) * per_mm - 0.5;
        let reach = aperture.reach_mm() * per_mm;
        let [rows, columns] = [window.rows, window.columns].map(|ends| ends.map(whole));
        // One cell more than the reach of the aperture, for rounding.
        let beside = x + reach + 1.0 < columns[0] || x - reach - 1.0 > columns[1];
        if y + reach < rows[0] || y - reach > rows[1] || beside {
            return;
        }
        let shape = RowsOfShape::new(aperture, at.heading_rad);
        let last = y + shape.above_mm * per_mm;
        if last < 0.0 {
            return;
        }
        let first = index_above(not_below_0(y - shape.below_mm * per_mm)).max(window.rows[0]);
        for row in first..=index_below(last).min(window.rows[1]) {
            let Some([low, high]) = shape.range((whole(row) - y) * self.cell_mm) else {
                continue;
            };
            let [low, high] = [x + low * per_mm, x + high * per_mm];
            if high < columns[0] {
                continue;
            }
            // Cut off before they are indices: `max` and `min` of floats are one step each.
            let from = index_above(if low > columns[0] { low } else { columns[0] });
            let to = index_below(if high < columns[1] { high } else { columns[1] });
            if from <= to {
                visit(row, from, to);
            }
        }
    }
}

/// No columns of a row, as first and last.
pub const NO_COLUMNS: [usize; 2] = [usize::MAX, usize::MAX - 1];

/// Visits the columns of a row (first and last) that are not among others, in one or two runs.
#[inline]
pub fn for_beyond([from, to]: [usize; 2], known: [usize; 2], mut visit: impl FnMut(Range<usize>)) {
    for columns in [from..(to + 1).min(known[0]), from.max(known[1] + 1)..to + 1] {
        if !columns.is_empty() {
            visit(columns);
        }
    }
}

/// The last sweep of each row of a window, and its columns: of the cells that a pose shares with the
/// previous one in a row only the first and the last visit count, so that the cost of a step is that
/// of the new cells.
pub struct SweptRows<T> {
    first_row: usize,
    last: Vec<(T, [usize; 2])>,
}

impl<T: Copy> SweptRows<T> {
    /// Nothing swept yet; `none` is a mark with no other use.
    pub fn of(window: &CellWindow, none: T) -> SweptRows<T> {
        SweptRows {
            first_row: window.rows[0],
            last: vec![(none, NO_COLUMNS); window.rows[1] + 1 - window.rows[0]],
        }
    }

    /// Enters columns of a row; returns the previous mark and columns.
    pub fn come(&mut self, row: usize, mark: T, columns: [usize; 2]) -> (T, [usize; 2]) {
        std::mem::replace(&mut self.last[row - self.first_row], (mark, columns))
    }

    /// Enters columns of a row, and visits those that the last sweep of the row did not cover, or
    /// all of them if the sweep does not continue from that mark.
    #[inline]
    pub fn for_new(
        &mut self,
        row: usize,
        mark: T,
        columns: [usize; 2],
        goes_on: impl FnOnce(T) -> bool,
        visit: impl FnMut(Range<usize>),
    ) {
        let (before, known) = self.come(row, mark, columns);
        let known = if goes_on(before) { known } else { NO_COLUMNS };
        for_beyond(columns, known, visit);
    }
}

/// Rows of one band.
const BAND_ROWS: usize = 64;

/// From here to twice this value, an `f64` has only whole numbers: a value added to this is rounded to
/// the nearest and is in the low bits. (`ceil` and `floor` are calls on plain x86-64, and conversions
/// that saturate take several steps.)
const WHOLE: f64 = (1u64 << 52) as f64;

/// An index as a number: from a signed integer, which is one step.
fn whole(index: usize) -> f64 {
    index as i64 as f64
}

/// The whole number nearest to `value`, which is not below 0 and far below 2⁵².
fn nearest(value: f64) -> (usize, f64) {
    let sum = value + WHOLE;
    ((sum.to_bits() - WHOLE.to_bits()) as usize, sum - WHOLE)
}

/// `value`, or 0 for lower values (`max` also tests for values that are not numbers).
fn not_below_0(value: f64) -> f64 {
    if value > 0.0 { value } else { 0.0 }
}

/// The least whole number that is not below `value`, which is not below 0.
fn index_above(value: f64) -> usize {
    let (index, whole) = nearest(value);
    index + usize::from(whole < value)
}

/// The greatest whole number that is not above `value`, which is not below 0.
fn index_below(value: f64) -> usize {
    let (index, whole) = nearest(value);
    index - usize::from(whole > value)
}

/// A rectangle of cells, first and last of each included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellWindow {
    /// Rows.
    pub rows: [usize; 2],
    /// Columns.
    pub columns: [usize; 2],
}

impl CellWindow {
    fn width(&self) -> usize {
        self.columns[1] + 1 - self.columns[0]
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        (self.rows[1] + 1 - self.rows[0]) * self.width()
    }

    /// Never true: a window has at least one cell.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The smallest window that contains this one and another.
    pub fn with(&self, other: &CellWindow) -> CellWindow {
        let both = |[a, b]: [usize; 2], [c, d]: [usize; 2]| [a.min(c), b.max(d)];
        CellWindow {
            rows: both(self.rows, other.rows),
            columns: both(self.columns, other.columns),
        }
    }

    /// Numbers of cells of one row of the window.
    pub fn numbers(&self, row: usize, columns: Range<usize>) -> Range<usize> {
        let first = self.number(row, columns.start);
        first..first + columns.len()
    }

    /// Number of a cell of the window, row by row.
    pub fn number(&self, row: usize, column: usize) -> usize {
        (row - self.rows[0]) * self.width() + column - self.columns[0]
    }
}

/// The rows of a turned aperture about its centre.
struct RowsOfShape {
    /// How far it reaches below its centre, mm.
    below_mm: f64,
    /// How far above, mm.
    above_mm: f64,
    shape: TurnedShape,
}

enum TurnedShape {
    /// x = lean dy +- sqrt(reach - fall dy²).
    Ellipse { lean: f64, reach: f64, fall: f64 },
    /// Corners of the core, radius.
    Rounded(Vec<Vector2>, f64),
}

impl RowsOfShape {
    /// The aperture at one heading.
    fn new(aperture: &Aperture, heading_rad: f64) -> RowsOfShape {
        let (sin, cos) = heading_rad.sin_cos();
        match aperture {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let (ia, ib) = (1.0 / (major_mm * major_mm), 1.0 / (minor_mm * minor_mm));
                // qxx dx² + 2 qxy dx dy + qyy dy² = 1, its determinant 1 / (a b)².
                let qxx = cos * cos * ia + sin * sin * ib;
                let above_mm = ((major_mm * sin).powi(2) + (minor_mm * cos).powi(2)).sqrt();
                RowsOfShape {
                    below_mm: above_mm,
                    above_mm,
                    shape: TurnedShape::Ellipse {
                        lean: -cos * sin * (ia - ib) / qxx,
                        reach: 1.0 / qxx,
                        fall: ia * ib / (qxx * qxx),
                    },
                }
            }
            Aperture::Rounded(shape) => {
                let turned =
                    |c: &Vector2| Vector2::new(c.x * cos - c.y * sin, c.x * sin + c.y * cos);
                let corners = shape.corners().iter().map(turned).collect();
                RowsOfShape {
                    below_mm: aperture.support_mm(heading_rad, -Vector2::y()),
                    above_mm: aperture.support_mm(heading_rad, Vector2::y()),
                    shape: TurnedShape::Rounded(corners, shape.radius_mm()),
                }
            }
        }
    }

    /// Least and greatest x at height `dy`, mm about the centre.
    fn range(&self, dy: f64) -> Option<[f64; 2]> {
        match &self.shape {
            TurnedShape::Ellipse { lean, reach, fall } => {
                let square = reach - fall * dy * dy;
                (square >= 0.0).then(|| {
                    let root = square.sqrt();
                    [lean * dy - root, lean * dy + root]
                })
            }
            TurnedShape::Rounded(corners, radius) => row_range(corners, *radius, dy),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: indices are those of `ceil` and `floor`. Method: whole numbers, halves and their
    /// neighbours on either side.
    #[test]
    fn indices_are_those_of_ceil_and_floor() {
        for i in 0..4_000 {
            let middle = f64::from(i) * 0.5;
            for value in [middle.next_down(), middle, middle.next_up()].map(not_below_0) {
                assert_eq!(index_above(value), value.ceil() as usize, "{value}");
                assert_eq!(index_below(value), value.floor() as usize, "{value}");
            }
        }
        assert_eq!([not_below_0(-7.5), not_below_0(7.5)], [0.0, 7.5]);
    }
}
