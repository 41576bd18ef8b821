//! Machines with linear and rotary axes, as described in a machine file and on the wire.
//!
//! In: directions and offsets. Out: an [`AxisFamily`], for `kinematics/axes.rs`, which has its equations. Not
//! covered: limits of the joints, which belong to the machine.

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

/// Linear axes and one or two rotary ones, see `kinematics/axes.rs`.
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
    /// The nozzle's axis, tilted from Z towards X by an angle.
    pub fn leaning(tilt_rad: f64) -> [f64; 3] {
        let (sine, cosine) = libm::sincos(tilt_rad);
        [sine, 0.0, cosine]
    }
}

/// Z of a unit axis that is upright: as the equations have it.
pub(crate) const UPRIGHT_MIN: f64 = 1.0 - 1e-6;

impl AxisFamily {
    /// Every axis is in the head.
    pub const fn is_in_head(&self) -> bool {
        let second_on_table = match &self.second {
            Some(second) => second.on_table,
            None => false,
        };
        !self.first.on_table && !second_on_table
    }

    /// A single axis in the head: its tool axes form a cone.
    pub const fn is_cone(&self) -> bool {
        self.second.is_none() && !self.polar
    }

    /// An upright tool axis has unique joints: none of the axes turns about it, and it is reachable.
    pub fn is_determined_upright(&self) -> bool {
        let turns = |[_, _, z]: [f64; 3]| z.abs() >= UPRIGHT_MIN;
        !self.is_cone() && !self.singular_axis().is_some_and(turns)
    }

    /// The direction of the tool axis in which two rotary axes line up: that of the one that turns with it. `None`
    /// with a single one.
    pub fn singular_axis(&self) -> Option<[f64; 3]> {
        let (first, second) = (&self.first, self.second.as_ref()?);
        let turns_with_it = match (first.on_table, second.on_table) {
            (true, true) | (false, true) => second,
            (false, false) | (true, false) => first,
        };
        Some(turns_with_it.axis)
    }
}
