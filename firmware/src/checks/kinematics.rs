//! The kinematics: lengths, frames, and axes that can point a nozzle.

use super::is_positive;
use crate::configuration::axis_family::{AxisFamily, RotaryAxis};
use crate::configuration::{Arm, Frame};

/// Cosine between two axes that are too near to parallel: within 8°.
const PARALLEL_COSINE: f64 = 0.99;

impl Frame {
    fn is_right(&self) -> bool {
        let [x, y, z] = &self.rotation;
        let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let off = |value: f64, meant: f64| (value - meant).abs() < 1e-9;
        let [across, along] = [[x, y], [x, z]].map(|[a, b]| dot(a, b));
        let cross = [
            x[1] * y[2] - x[2] * y[1],
            x[2] * y[0] - x[0] * y[2],
            x[0] * y[1] - x[1] * y[0],
        ];
        // With two unit rows at right angles and the third their cross product all is right.
        self.origin_mm.iter().all(|value| value.is_finite())
            && off(across, 0.0)
            && off(along, 0.0)
            && off(dot(x, x), 1.0)
            && off(dot(y, y), 1.0)
            && off(dot(&cross, z), 1.0)
            && off(dot(z, z), 1.0)
    }
}

impl Arm {
    pub(super) fn is_right(&self) -> bool {
        let lengths = [self.a1_mm, self.a2_mm, self.b_mm, self.c1_mm, self.c4_mm];
        let [upper, fore] = [self.c2_mm, self.c3_mm];
        lengths
            .iter()
            .chain(&self.offset_rad)
            .all(|v| v.is_finite())
            && is_positive(&upper)
            && is_positive(&fore)
            && self.base.is_right()
            && self.tool.is_right()
    }
}

impl RotaryAxis {
    fn is_right(&self) -> bool {
        let [x, y, z] = self.axis;
        let off = x * x + y * y + z * z - 1.0;
        off.abs() < 1e-9 && self.offset_mm.iter().all(|value| value.is_finite())
    }

    fn cosine_to(&self, other: &[f64; 3]) -> f64 {
        let products = self.axis.iter().zip(other).map(|(a, b)| a * b);
        products.sum::<f64>().abs()
    }
}

impl AxisFamily {
    /// The axes can point the nozzle in more than one direction: each contributes a rotation that the
    /// other does not.
    pub fn is_right(&self) -> bool {
        let axes = [Some(&self.first), self.second.as_ref()];
        let are_right = axes.into_iter().flatten().all(RotaryAxis::is_right);
        let [x, y, z] = self.tool_axis;
        let off = x * x + z * z - 1.0;
        let leans = y == 0.0 && z >= 0.0 && off.abs() < 1e-9;
        let tool = self.tool_axis;
        let moves = |axis: &RotaryAxis| axis.cosine_to(&tool) < PARALLEL_COSINE;
        let first = &self.first;
        let fits = match &self.second {
            _ if self.polar => {
                let is_upright = first.axis == [0.0, 0.0, 1.0];
                is_upright && first.on_table && self.second.is_none() && tool == first.axis
            }
            None => !first.on_table && moves(first),
            Some(second) => {
                let are_apart = first.cosine_to(&second.axis) < PARALLEL_COSINE;
                // Of axes on one side the one that is nearer to the nozzle must move it.
                let moves_it = match (first.on_table, second.on_table) {
                    (true, true) => moves(first),
                    (false, true) => moves(first),
                    (_, false) => moves(second),
                };
                are_apart && moves_it
            }
        };
        are_right && leans && fits
    }
}
