//! The shape of what could touch: the nozzle, a cone, and the head above it, a cylinder.
//!
//! Lengths in mm along the tool axis from the tip, angles in rad. Used to look for touches with the table
//! and with what is printed.

use super::check::in_range;
use super::error::SettingsError;
use nalgebra::Vector3;

/// Nozzle and head about the tool axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadShape {
    /// Radius of the nozzle's flat end.
    pub nozzle_tip_radius_mm: f64,
    /// Whole angle between the nozzle's sides.
    pub nozzle_angle_rad: f64,
    /// How far the nozzle sticks out of the head.
    pub nozzle_length_mm: f64,
    /// Radius of the head.
    pub head_radius_mm: f64,
    /// How high the head is.
    pub head_length_mm: f64,
}

/// A circle about the tool axis, an edge of nozzle or head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rim {
    /// Above the tip.
    pub height_mm: f64,
    /// Its radius.
    pub radius_mm: f64,
    /// True for the nozzle's.
    pub is_nozzle: bool,
}

impl Rim {
    /// How far its lowest point is below the tip, mm, of a tool along `axis` (unit).
    pub fn below_tip_mm(&self, axis: &Vector3<f64>) -> f64 {
        self.radius_mm * axis.xy().norm() - self.height_mm * axis.z
    }
}

impl HeadShape {
    /// Radius at a height above the tip, within the head or below it, mm; `None` elsewhere.
    pub fn radius_mm(&self, height_mm: f64) -> Option<f64> {
        if height_mm < 0.0 || height_mm > self.nozzle_length_mm + self.head_length_mm {
            return None;
        }
        Some(if height_mm < self.nozzle_length_mm {
            self.nozzle_tip_radius_mm + height_mm * (0.5 * self.nozzle_angle_rad).tan()
        } else {
            self.head_radius_mm
        })
    }

    /// How deep a point is in nozzle or head, mm, `away` from the tip of a tool along `axis` (unit). Negative
    /// outside, and then no more than its distance from them; it changes by no more than the point moves.
    pub fn depth_mm(&self, away: &Vector3<f64>, axis: &Vector3<f64>) -> f64 {
        let height_mm = away.dot(axis);
        let square = away.norm_squared() - height_mm * height_mm;
        let from_axis_mm = square.max(0.0).sqrt();
        let (sin, cos) = (0.5 * self.nozzle_angle_rad).sin_cos();
        let nozzle_mm = ((self.nozzle_tip_radius_mm - from_axis_mm) * cos + height_mm * sin)
            .min(height_mm)
            .min(self.nozzle_length_mm - height_mm);
        let in_head_mm = height_mm - self.nozzle_length_mm;
        let head_mm = (self.head_radius_mm - from_axis_mm)
            .min(in_head_mm)
            .min(self.head_length_mm - in_head_mm);
        nozzle_mm.max(head_mm)
    }

    /// The rims of nozzle and head: one of them is the lowest, however the tool leans.
    pub fn rims(&self) -> [Rim; 4] {
        let nozzle_mm = self.nozzle_length_mm;
        let wide_mm = nozzle_mm * (0.5 * self.nozzle_angle_rad).tan() + self.nozzle_tip_radius_mm;
        [
            (0.0, self.nozzle_tip_radius_mm, true),
            (nozzle_mm, wide_mm, true),
            (nozzle_mm, self.head_radius_mm, false),
            (nozzle_mm + self.head_length_mm, self.head_radius_mm, false),
        ]
        .map(|(height_mm, radius_mm, is_nozzle)| Rim {
            height_mm,
            radius_mm,
            is_nozzle,
        })
    }

    /// How far the lowest rim is below the tip, mm, of a tool along `axis` (unit).
    pub fn below_tip_mm(&self, axis: &Vector3<f64>) -> f64 {
        let below = self.rims().map(|rim| rim.below_tip_mm(axis));
        below.into_iter().fold(f64::NEG_INFINITY, f64::max)
    }

    /// True where it is the nozzle that is so far above the tip.
    pub fn is_nozzle(&self, height_mm: f64) -> bool {
        height_mm < self.nozzle_length_mm
    }

    /// Nothing is further from the tip, mm.
    pub fn reach_mm(&self) -> f64 {
        let length_mm = self.nozzle_length_mm + self.head_length_mm;
        let nozzle_mm = self.radius_mm(0.999 * self.nozzle_length_mm).unwrap_or(0.0);
        length_mm.hypot(self.head_radius_mm.max(nozzle_mm))
    }

    /// Checks that the numbers can be meant.
    ///
    /// # Errors
    /// [`SettingsError`] with the key.
    pub(super) fn check(&self) -> Result<(), SettingsError> {
        let radius_mm = self.nozzle_tip_radius_mm;
        in_range("head.nozzle_tip_radius_mm", radius_mm, 0.0, 500.0)?;
        let angle_deg = self.nozzle_angle_rad.to_degrees();
        in_range("head.nozzle_angle_deg", angle_deg, 0.0, 170.0)?;
        in_range("head.nozzle_length_mm", self.nozzle_length_mm, 0.1, 1e4)?;
        in_range("head.head_radius_mm", self.head_radius_mm, 0.0, 1e4)?;
        in_range("head.head_length_mm", self.head_length_mm, 0.0, 1e4)
    }
}
