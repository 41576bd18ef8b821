//! Machines of linear axes and rotary ones, as a machine file and the wire describe them.
//!
//! In: directions and offsets. Out: which joints there are, and whether they can point a nozzle at all. The
//! equations are in [`crate::kinematics::axes`]. Left out: limits of the joints, which are the configuration's.

use serde::{Deserialize, Serialize};

/// A rotary axis in the head or under the part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RotaryAxis {
    /// It turns the part; otherwise the head.
    pub on_table: bool,
    /// Its direction with all joints at 0, a unit vector in machine axes; angles count by the right hand.
    pub axis: [f64; 3],
    /// A point on it with all joints at 0: under the part in machine coordinates, in the head from the nozzle's
    /// tip.
    pub offset_mm: [f64; 3],
}

/// Linear axes and one or two rotary ones, see [`crate::kinematics::axes`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisFamily {
    /// The one nearer to the base, where both are on one side.
    pub first: RotaryAxis,
    /// The one that it carries.
    pub second: Option<RotaryAxis>,
    /// The nozzle's own axis with all joints at 0, a unit vector in the plane of X and Z.
    pub tool_axis: [f64; 3],
    /// A polar table: there is no Y, and `first` turns about Z.
    pub polar: bool,
}

impl AxisFamily {
    /// The nozzle's axis that leans from Z towards X by an angle.
    pub fn leaning(tilt_rad: f64) -> [f64; 3] {
        let (sine, cosine) = libm::sincos(tilt_rad);
        [sine, 0.0, cosine]
    }
}

/// Z of a unit axis that is upright: as the equations have it.
pub(crate) const UPRIGHT_MIN: f64 = 1.0 - 1e-6;
/// Cosine between two axes that are too near to parallel: within 8°.
const PARALLEL_COSINE: f64 = 0.99;

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
    /// Every axis is in the head.
    pub const fn is_in_head(&self) -> bool {
        let second_on_table = match &self.second {
            Some(second) => second.on_table,
            None => false,
        };
        !self.first.on_table && !second_on_table
    }

    /// A single axis in the head: its tool axes lie on a cone.
    pub const fn is_cone(&self) -> bool {
        self.second.is_none() && !self.polar
    }

    /// An upright tool axis has joints of its own: none of the axes turns about it, and it is reached.
    pub fn is_determined_upright(&self) -> bool {
        let turns = |[_, _, z]: [f64; 3]| z.abs() >= UPRIGHT_MIN;
        !self.is_cone() && !self.singular_axis().is_some_and(turns)
    }

    /// See [`crate::kinematics::joint_channels`].
    pub const fn joint_channels(&self) -> &'static [Option<usize>] {
        use crate::kinematics::axes::{ONE_IN_HEAD, POLAR, TWO_IN_HEAD, TWO_WITH_TABLE};
        if self.polar {
            &POLAR
        } else if self.second.is_none() {
            &ONE_IN_HEAD
        } else if self.is_in_head() {
            &TWO_IN_HEAD
        } else {
            &TWO_WITH_TABLE
        }
    }

    /// The direction of the tool axis in which two rotary axes line up: that of the one that turns with it. None with
    /// a single one.
    pub fn singular_axis(&self) -> Option<[f64; 3]> {
        let (first, second) = (&self.first, self.second.as_ref()?);
        let turns_with_it = match (first.on_table, second.on_table) {
            (true, true) | (false, true) => second,
            (false, false) | (true, false) => first,
        };
        Some(turns_with_it.axis)
    }

    /// The axes can point the nozzle in more than a direction: each moves what the other leaves to it.
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
