//! The curve of a pass in the layer plane: a uniform cubic B-spline in (x, y, heading).
//!
//! Input: control points and a parameter of the curve. Output: the point there, mm and rad. Ends
//! are natural: phantom control points beyond them make the curve begin and end in its outermost
//! ones.

use crate::Point2;
use crate::clearance::Configuration;

/// Control polygon in the layer plane: x, y in mm, heading in rad.
pub type PlaneControl = [f64; 3];

/// Control point `i`, phantom points beyond the ends included (natural ends).
pub fn control_at(control: &[PlaneControl], i: isize) -> PlaneControl {
    let n = control.len() as isize;
    let mirror = |end: PlaneControl, inner: PlaneControl| -> PlaneControl {
        std::array::from_fn(|c| 2.0 * end[c] - inner[c])
    };
    if i < 0 {
        mirror(control[0], control[1.min(n as usize - 1)])
    } else if i >= n {
        mirror(control[n as usize - 1], control[(n - 2).max(0) as usize])
    } else {
        control[i as usize]
    }
}

/// Weights of the four control points of a span at `t`.
pub fn span_weights(t: f64) -> [f64; 4] {
    [
        (1.0 - t).powi(3) / 6.0,
        (3.0 * t.powi(3) - 6.0 * t * t + 4.0) / 6.0,
        (-3.0 * t.powi(3) + 3.0 * t * t + 3.0 * t + 1.0) / 6.0,
        t.powi(3) / 6.0,
    ]
}

/// The curve at parameter i + t of the uniform cubic B-spline.
pub fn curve_at(control: &[PlaneControl], span: usize, t: f64) -> PlaneControl {
    let w = span_weights(t);
    let points: [PlaneControl; 4] =
        std::array::from_fn(|k| control_at(control, span as isize + k as isize - 1));
    std::array::from_fn(|c| (0..4).map(|k| w[k] * points[k][c]).sum())
}

/// The aperture's placement for a curve point.
pub fn configuration(point: PlaneControl) -> Configuration {
    Configuration {
        center: Point2::new(point[0], point[1]),
        heading_rad: point[2],
    }
}
