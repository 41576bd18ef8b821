//! Several poses of a span against one wall, computed together.
//!
//! In: poses and a segment, in a. Out: squared distances in the frame in which the ellipse of each pose is the unit circle:
//! most walls near a span are far from most of its poses, and the exact clearance is found for the others only.

use super::containment::Placed;
use super::sweep::Segment;

/// Poses of a span that are evaluated together.
pub const LANES: usize = 8;

/// Poses of some places of a span, by coordinate, and the semi-axes of their tool's ellipse.
#[derive(Clone, Debug, Default)]
pub struct Lanes {
    x: [f64; LANES],
    y: [f64; LANES],
    cos: [f64; LANES],
    sin: [f64; LANES],
    /// One over the semi-axes.
    along: [f64; LANES],
    across: [f64; LANES],
}

impl Lanes {
    /// Sets one of them; `minor` is the ellipse's b.
    pub fn set(&mut self, k: usize, pose: &Placed, minor: f64) {
        [self.x[k], self.y[k]] = pose.tool.center;
        (self.cos[k], self.sin[k]) = (pose.cos, pose.sin);
        self.along[k] = pose.tool.inverse;
        self.across[k] = pose.tool.inverse / minor;
    }

    /// Squared distance of a segment from each centre, in the frame in which the ellipse is the unit circle. Kept apart from
    /// its caller, so that the compiler computes the lanes together.
    #[inline(never)]
    pub fn distances2(&self, [p, q]: &Segment, found: &mut [f64; LANES]) {
        for (k, found) in found.iter_mut().enumerate() {
            let (px, py) = (p[0] - self.x[k], p[1] - self.y[k]);
            let (qx, qy) = (q[0] - self.x[k], q[1] - self.y[k]);
            let (cos, sin) = (self.cos[k], self.sin[k]);
            let x0 = (cos * px + sin * py) * self.along[k];
            let y0 = (cos * py - sin * px) * self.across[k];
            let dx = (cos * qx + sin * qy) * self.along[k] - x0;
            let dy = (cos * qy - sin * qx) * self.across[k] - y0;
            let t = -(x0 * dx + y0 * dy) / (dx * dx + dy * dy + 1e-30);
            let t = if t > 0.0 { t } else { 0.0 };
            let t = if t < 1.0 { t } else { 1.0 };
            let (x, y) = (x0 + t * dx, y0 + t * dy);
            *found = x * x + y * y;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Units;
    use crate::tool_scale::ToolScale;
    use headway_geometry::Point2;
    use headway_geometry::test_shapes::random_numbers;

    /// Goal: the lanes are the distances of their poses. Method: the least of many points of the segment, by the quadratic
    /// form of the ellipse; with 1000 points it is at most a few 1e-5 too large here.
    #[test]
    fn lanes_are_distances() {
        let units = Units {
            length_mm: 0.6,
            time_s: 1.0,
            origin: Point2::origin(),
        };
        let scale = ToolScale::new(None, units);
        let mut random = random_numbers(7);
        let minor = 1.0 / 3.0;
        for _ in 0..50 {
            let mut lanes = Lanes::default();
            let knots: [[f64; 4]; LANES] =
                std::array::from_fn(|_| std::array::from_fn(|_| 2.0 * random()));
            for (k, knot) in knots.iter().enumerate() {
                lanes.set(k, &Placed::at(knot, &scale), minor);
            }
            let ends: Segment = std::array::from_fn(|_| [3.0 * random(), 3.0 * random()]);
            let mut found = [0.0; LANES];
            lanes.distances2(&ends, &mut found);
            for (&[x, y, heading, _], found) in knots.iter().zip(found) {
                let gauge2 = |t: f64| {
                    let at = [0, 1].map(|c| ends[0][c] + t * (ends[1][c] - ends[0][c]));
                    let (dx, dy) = (at[0] - x, at[1] - y);
                    let angle = dy.atan2(dx) - heading;
                    dx.hypot(dy).powi(2) * (angle.cos().powi(2) + (angle.sin() / minor).powi(2))
                };
                let least = (0..=1000).map(|k| gauge2(f64::from(k) / 1000.0));
                let least = least.fold(f64::INFINITY, f64::min);
                assert!(found <= least + 1e-9, "{found} {least}");
                assert!(found >= least - 1e-4, "{found} {least}");
            }
        }
    }
}
