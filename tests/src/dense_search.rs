//! The published way to F(p): a dense grid of configurations, and which of them hold the point
//! (D) and lie inside (P); F = D ∩ P. An oracle for the exact query, and what its speed is measured
//! against.
//!
//! On a grid nothing touches exactly, so D asks of the aperture grown, and P of it shrunk, by what
//! lies between neighbours of the grid. Shares no code with the planner: containment by ray
//! casting, the ellipse by its equation in the scaled plane.

use crate::layer_oracle::Rings;

/// Points of the grid along x, y and heading: 8 million configurations.
pub const SIDE: usize = 200;

/// The grid over a square part of the plane and the half turn.
pub struct DenseSearch {
    /// Lower left configuration.
    low_mm: [f64; 2],
    step_mm: f64,
    axes_mm: [f64; 2],
    /// What a neighbour of the grid can be off by, mm: half a diagonal and half a turn.
    pub slack_mm: f64,
    /// P, heading by heading.
    inside: Vec<bool>,
}

impl DenseSearch {
    /// Finds P over the square of `size_mm` about `center_mm`.
    pub fn new(rings: &Rings, axes_mm: [f64; 2], center_mm: [f64; 2], size_mm: f64) -> DenseSearch {
        let step_mm = size_mm / SIDE as f64;
        let turn_rad = std::f64::consts::PI / SIDE as f64;
        let mut search = DenseSearch {
            low_mm: center_mm.map(|c| c - size_mm / 2.0 + step_mm / 2.0),
            step_mm,
            axes_mm,
            slack_mm: step_mm * std::f64::consts::FRAC_1_SQRT_2 + axes_mm[0] * turn_rad / 2.0,
            inside: Vec::with_capacity(SIDE * SIDE * SIDE),
        };
        let reach = size_mm / 2.0 * std::f64::consts::SQRT_2 + axes_mm[0];
        let edges: Vec<[[f64; 2]; 2]> = rings
            .iter()
            .flat_map(|ring| (0..ring.len()).map(|i| [ring[i], ring[(i + 1) % ring.len()]]))
            .filter(|e| distance2(center_mm, *e) <= reach * reach)
            .collect();
        let odd: Vec<bool> = (0..SIDE * SIDE)
            .map(|at| holds(rings, search.center(at)))
            .collect();
        for heading in 0..SIDE {
            search.find_inside(heading, &edges, &odd);
        }
        search
    }

    /// P at one heading: in the plane scaled by the shrunk aperture, no edge within 1.
    fn find_inside(&mut self, heading: usize, edges: &[[[f64; 2]; 2]], odd: &[bool]) {
        let (sin, cos) = self.heading_rad(heading).sin_cos();
        let [a, b] = self.axes_mm.map(|axis| axis * (1.0 - self.slack_share()));
        let scale = |p: [f64; 2]| [(p[0] * cos + p[1] * sin) / a, (p[1] * cos - p[0] * sin) / b];
        let scaled: Vec<[[f64; 2]; 2]> = edges.iter().map(|e| e.map(scale)).collect();
        for (at, odd) in odd.iter().enumerate() {
            let center = scale(self.center(at));
            let clear = *odd && scaled.iter().all(|e| distance2(center, *e) >= 1.0);
            self.inside.push(clear);
        }
    }

    /// The slack as a share of the aperture: shrunk by it, an aperture keeps the slack's distance
    /// from its own outline all round.
    pub fn slack_share(&self) -> f64 {
        self.slack_mm / self.axes_mm[1]
    }

    fn center(&self, at: usize) -> [f64; 2] {
        [
            self.low_mm[0] + (at % SIDE) as f64 * self.step_mm,
            self.low_mm[1] + (at / SIDE) as f64 * self.step_mm,
        ]
    }

    /// Heading of a layer of the grid.
    pub fn heading_rad(&self, heading: usize) -> f64 {
        (heading as f64 + 0.5) * std::f64::consts::PI / SIDE as f64
    }

    /// The headings of F(p), all 8 million configurations looked at: number of configurations
    /// found at each heading.
    pub fn headings_at(&self, p: [f64; 2]) -> Vec<usize> {
        let [a, b] = self.axes_mm.map(|axis| axis * (1.0 + self.slack_share()));
        let mut found = vec![0; SIDE];
        for (heading, count) in found.iter_mut().enumerate() {
            let (sin, cos) = self.heading_rad(heading).sin_cos();
            let layer = &self.inside[heading * SIDE * SIDE..(heading + 1) * SIDE * SIDE];
            for (at, inside) in layer.iter().enumerate() {
                let center = self.center(at);
                let d = [p[0] - center[0], p[1] - center[1]];
                let (u, v) = ((d[0] * cos + d[1] * sin) / a, (d[1] * cos - d[0] * sin) / b);
                *count += usize::from(*inside && u * u + v * v <= 1.0);
            }
        }
        found
    }
}

/// Even-odd containment.
pub fn holds(rings: &Rings, p: [f64; 2]) -> bool {
    let mut odd = false;
    for ring in rings {
        for i in 0..ring.len() {
            let (q, r) = (ring[i], ring[(i + 1) % ring.len()]);
            if (q[1] > p[1]) != (r[1] > p[1]) {
                odd ^= p[0] < q[0] + (p[1] - q[1]) / (r[1] - q[1]) * (r[0] - q[0]);
            }
        }
    }
    odd
}

/// Square of the distance from a segment.
fn distance2(p: [f64; 2], [q, r]: [[f64; 2]; 2]) -> f64 {
    let d = [r[0] - q[0], r[1] - q[1]];
    let w = [p[0] - q[0], p[1] - q[1]];
    let length2 = d[0] * d[0] + d[1] * d[1];
    let t = if length2 > 0.0 {
        ((w[0] * d[0] + w[1] * d[1]) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (w[0] - t * d[0]).powi(2) + (w[1] - t * d[1]).powi(2)
}
