//! The shape of what could touch: the nozzle, a cone, and the head above it, a cylinder, or any profile.
//!
//! Lengths in mm along the tool axis from the tip, angles in rad. Used to look for touches with the table
//! and with what is printed.

use super::check::in_range;
use crate::text::refusal::{Refusal, refusal};
use headway_reach::profile::{HeadProfile, ProfileError};

/// Most knots of a profile: each query goes through them.
pub const PROFILE_KNOTS_MAX: usize = 32;
/// Farthest knot, mm.
const KNOT_MAX_MM: f64 = 1e4;

/// Nozzle and head about the tool axis.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadShape {
    /// How it is described.
    pub outline: HeadOutline,
    /// How far the tip's flat end may dip into what is printed; `None` for half a layer.
    pub tip_slack_mm: Option<f64>,
}

/// The outline of nozzle and head in a plane through the tool axis.
#[derive(Clone, Debug, PartialEq)]
pub enum HeadOutline {
    /// A cone with a flat end, and a cylinder above it.
    Cone(ConeAndCylinder),
    /// Height and radius, mm, from the tip upwards; the first at height 0.
    Profile(Vec<[f64; 2]>),
}

/// The common head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConeAndCylinder {
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

impl ConeAndCylinder {
    fn knots(&self) -> [[f64; 2]; 4] {
        let nozzle_mm = self.nozzle_length_mm;
        let wide_mm = nozzle_mm * (0.5 * self.nozzle_angle_rad).tan() + self.nozzle_tip_radius_mm;
        let top_mm = nozzle_mm + self.head_length_mm;
        [
            [0.0, self.nozzle_tip_radius_mm],
            [nozzle_mm, wide_mm],
            [nozzle_mm, self.head_radius_mm],
            [top_mm, self.head_radius_mm],
        ]
    }
}

impl HeadShape {
    /// Heights and radii of its edges, mm, as they are given.
    pub fn knots(&self) -> Vec<[f64; 2]> {
        match &self.outline {
            HeadOutline::Cone(cone) => cone.knots().to_vec(),
            HeadOutline::Profile(knots) => knots.clone(),
        }
    }

    /// The solid; a line where the knots are none (settings that were not checked).
    pub fn profile(&self) -> HeadProfile {
        HeadProfile::new(&self.knots()).unwrap_or_else(|_| HeadProfile::line())
    }

    /// Where the nozzle ends and the head begins, mm above the tip: the first step of a profile.
    pub fn nozzle_length_mm(&self) -> f64 {
        match &self.outline {
            HeadOutline::Cone(cone) => cone.nozzle_length_mm,
            HeadOutline::Profile(knots) => {
                let mut steps = knots.windows(2).filter(|pair| pair[0][0] == pair[1][0]);
                let step_mm = steps.next().map(|pair| pair[0][0]);
                step_mm.unwrap_or_else(|| knots.last().map_or(0.0, |top| top[0]))
            }
        }
    }

    /// How far the head may lean so that no part of it but the flat end comes below its tip's level: what is printed level by
    /// level is free of it then, in whatever order a level is printed.
    pub fn free_tilt_rad(&self) -> f64 {
        let above = self
            .knots()
            .into_iter()
            .filter(|[height_mm, _]| *height_mm > 0.0);
        let leans = above.map(|[height_mm, radius_mm]| height_mm.atan2(radius_mm));
        leans.fold(std::f64::consts::FRAC_PI_2, f64::min)
    }

    /// How far the tip's flat end may dip, mm.
    pub fn tip_slack_mm(&self, layer_height_mm: f64) -> f64 {
        self.tip_slack_mm.unwrap_or(0.5 * layer_height_mm)
    }

    /// Nothing is further from the tip, mm.
    pub fn reach_mm(&self) -> f64 {
        self.profile().reach_mm()
    }

    /// Checks that the numbers can be meant.
    ///
    /// # Errors
    /// A `Refusal` with the key.
    pub(super) fn check(&self) -> Result<(), Refusal> {
        if let Some(slack_mm) = self.tip_slack_mm {
            in_range("head.tip_slack_mm", slack_mm, 0.0, 100.0)?;
        }
        match &self.outline {
            HeadOutline::Cone(cone) => cone.check(),
            HeadOutline::Profile(knots) => check_knots(knots),
        }
    }
}

impl ConeAndCylinder {
    fn check(&self) -> Result<(), Refusal> {
        let radius_mm = self.nozzle_tip_radius_mm;
        in_range("head.nozzle_tip_radius_mm", radius_mm, 0.0, 500.0)?;
        let angle_deg = self.nozzle_angle_rad.to_degrees();
        in_range("head.nozzle_angle_deg", angle_deg, 0.0, 170.0)?;
        in_range("head.nozzle_length_mm", self.nozzle_length_mm, 0.1, 1e4)?;
        in_range("head.head_radius_mm", self.head_radius_mm, 0.0, 1e4)?;
        in_range("head.head_length_mm", self.head_length_mm, 0.0, 1e4)
    }
}

pub(super) fn wrong_profile(reason: &str) -> Refusal {
    refusal!("head.profile: {reason}; give [height_mm, radius_mm] pairs from the tip upwards")
}

fn check_knots(knots: &[[f64; 2]]) -> Result<(), Refusal> {
    let refused = |reason: String| Err(wrong_profile(&reason));
    if knots.len() > PROFILE_KNOTS_MAX {
        let count = knots.len();
        return refused(format!("{count} pairs, at most {PROFILE_KNOTS_MAX}"));
    }
    let is_far = |knot: &&[f64; 2]| knot.iter().any(|mm| *mm > KNOT_MAX_MM);
    if let Some([height_mm, radius_mm]) = knots.iter().find(is_far) {
        return refused(format!(
            "[{height_mm}, {radius_mm}] is farther than {KNOT_MAX_MM} mm"
        ));
    }
    match HeadProfile::new(knots) {
        Ok(profile) if profile.top_mm() > 0.0 => Ok(()),
        Ok(_) => refused("all its heights are 0".to_string()),
        Err(ProfileError::TooFew) => refused("it needs two pairs or more".to_string()),
        Err(ProfileError::NotAtTip) => refused("its first height must be 0, the tip".to_string()),
        Err(ProfileError::Knot(index)) => {
            let [height_mm, radius_mm] = knots[index];
            refused(format!(
                "pair {} is [{height_mm}, {radius_mm}]: heights rise from one to the next, and neither is negative",
                index + 1
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: the free tilt is that of the lowest edge. Method: the gantry's head, 22 mm wide 20 mm above the tip.
    #[test]
    fn the_lowest_edge_says_how_far_a_head_may_lean() {
        let head = HeadShape {
            outline: HeadOutline::Cone(ConeAndCylinder {
                nozzle_tip_radius_mm: 0.8,
                nozzle_angle_rad: 60f64.to_radians(),
                nozzle_length_mm: 20.0,
                head_radius_mm: 22.0,
                head_length_mm: 60.0,
            }),
            tip_slack_mm: None,
        };
        assert!((head.free_tilt_rad().to_degrees() - 42.27).abs() < 0.01);
    }
}
