//! Figures on the corners of a run of waypoints.

use serde::{Deserialize, Serialize};

/// Corners that were rounded, and those that were not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CornerFigures {
    /// Corners of the path that are rounded.
    pub path: u64,
    /// Largest distance of the tip from the curve through the waypoints there.
    pub path_off_mm: f64,
    /// Corners of the tool axis that are rounded.
    pub axis: u64,
    /// Largest angle between the tool axis and that of the waypoints there.
    pub axis_off_deg: f64,
    /// Largest angle between a heading that is given and that of the print.
    pub heading_off_deg: f64,
    /// Corners of the path where the head still comes to rest.
    pub rests: u64,
}

impl CornerFigures {
    /// In one line.
    pub fn text(&self) -> String {
        format!(
            "{} of the path ({:.3} mm), {} of the axis ({:.3}°), {} left",
            self.path, self.path_off_mm, self.axis, self.axis_off_deg, self.rests
        )
    }
}
