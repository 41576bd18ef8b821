//! The height of a bed between the points of its grid.
//!
//! Bicubic by Catmull and Rom (1974), as cubic convolution of Keys (1981, a = -1/2): it interpolates every
//! point, is once differentiable and of third order for smooth beds. In the cells at the edge a row is
//! extended by the parabola through its last three points (Keys' boundary condition); beyond the grid the
//! height is that of its edge.

use super::BedMesh;

/// Fewest points along a side: a parabola's.
pub const POINTS_MIN: usize = 3;

impl BedMesh {
    /// Z at which the nozzle touches the bed there, mm.
    pub fn height_mm(&self, x_mm: f64, y_mm: f64) -> f64 {
        let columns = self.heights_mm.first().map_or(0, Vec::len);
        let place = |at: f64, axis: usize, points: usize| {
            let cells = points.saturating_sub(1) as f64;
            let share = (at - self.min_mm[axis]) / (self.max_mm[axis] - self.min_mm[axis]);
            share.clamp(0.0, 1.0) * cells
        };
        let along_x = place(x_mm, 0, columns);
        let along_y = place(y_mm, 1, self.heights_mm.len());
        let row = |number: usize| match self.heights_mm.get(number) {
            Some(row) => cubic(along_x, columns, |column| row.get(column).copied()),
            None => 0.0,
        };
        cubic(along_y, self.heights_mm.len(), |number| Some(row(number)))
    }

    /// Mean of the grid's points: the remaining offset above the blend.
    pub fn mean_mm(&self) -> f64 {
        let points = self.heights_mm.iter().flatten();
        let (sum, count) = points.fold((0.0, 0u32), |(sum, count), h| (sum + h, count + 1));
        sum / f64::from(count.max(1))
    }

    /// Lowest and highest point of the grid, mm.
    pub fn range_mm(&self) -> [f64; 2] {
        let points = self.heights_mm.iter().flatten();
        points.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], h| {
            [low.min(*h), high.max(*h)]
        })
    }

    /// Largest distance of a point from the mean, mm.
    pub fn deviation_mm(&self) -> f64 {
        let (mean, [low, high]) = (self.mean_mm(), self.range_mm());
        (mean - low).max(high - mean)
    }

    /// Offset of the plan's tip in Z, mm: the bed's height below `fade_start_mm`, the mean from
    /// `fade_height_mm` on, interpolated between them.
    pub fn shift_mm(&self, [x_mm, y_mm, z_mm]: [f64; 3]) -> f64 {
        let mean = self.mean_mm();
        let left = self.fade_height_mm - z_mm;
        let share = (left / (self.fade_height_mm - self.fade_start_mm)).clamp(0.0, 1.0);
        if share == 0.0 {
            return mean;
        }
        mean + share * (self.height_mm(x_mm, y_mm) - mean)
    }
}

/// Cubic convolution at a place counted in points.
fn cubic(at: f64, points: usize, value: impl Fn(usize) -> Option<f64>) -> f64 {
    let cell = (at as usize).min(points.saturating_sub(2));
    let t = at - cell as f64;
    let inside = |number: usize| value(number).unwrap_or(0.0);
    let beyond = |a: usize, b: usize, c: usize| 3.0 * inside(a) - 3.0 * inside(b) + inside(c);
    let before = match cell.checked_sub(1) {
        Some(number) => inside(number),
        None => beyond(0, 1, 2),
    };
    let after = if cell + 2 < points {
        inside(cell + 2)
    } else {
        beyond(cell + 1, cell, cell.saturating_sub(1))
    };
    let (t2, t3) = (t * t, t * t * t);
    0.5 * ((-t3 + 2.0 * t2 - t) * before
        + (3.0 * t3 - 5.0 * t2 + 2.0) * inside(cell)
        + (-3.0 * t3 + 4.0 * t2 + t) * inside(cell + 1)
        + (t3 - t2) * after)
}
