//! `[head]` of a machine file: a cone and a cylinder, or a profile.

use super::write::{degrees, number};
use crate::settings::head_shape::wrong_profile;
use crate::settings::head_shape::{ConeAndCylinder, HeadOutline, HeadShape};
use crate::text::refusal::Refusal;
use serde::Deserialize;
use std::fmt::Write;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileHead {
    profile: Option<Vec<[f64; 2]>>,
    nozzle_tip_radius_mm: Option<f64>,
    nozzle_angle_deg: Option<f64>,
    nozzle_length_mm: Option<f64>,
    head_radius_mm: Option<f64>,
    head_length_mm: Option<f64>,
    tip_slack_mm: Option<f64>,
}

impl FileHead {
    pub(super) fn shape(&self) -> Result<HeadShape, Refusal> {
        let cone = [
            ("nozzle_tip_radius_mm", self.nozzle_tip_radius_mm),
            ("nozzle_angle_deg", self.nozzle_angle_deg),
            ("nozzle_length_mm", self.nozzle_length_mm),
            ("head_radius_mm", self.head_radius_mm),
            ("head_length_mm", self.head_length_mm),
        ];
        let refused = |reason: String| Err(wrong_profile(&reason));
        let outline = match &self.profile {
            Some(_) if cone.iter().any(|(_, given)| given.is_some()) => {
                return refused(
                    "it replaces all other lengths of [head] but tip_slack_mm".to_string(),
                );
            }
            Some(knots) => HeadOutline::Profile(knots.clone()),
            None => {
                if let Some((key, _)) = cone.iter().find(|(_, given)| given.is_none()) {
                    return refused(format!("neither it nor head.{key} is given"));
                }
                let [tip, angle_deg, nozzle, radius, length] =
                    cone.map(|(_, given)| given.unwrap_or_default());
                HeadOutline::Cone(ConeAndCylinder {
                    nozzle_tip_radius_mm: tip,
                    nozzle_angle_rad: angle_deg.to_radians(),
                    nozzle_length_mm: nozzle,
                    head_radius_mm: radius,
                    head_length_mm: length,
                })
            }
        };
        Ok(HeadShape {
            outline,
            tip_slack_mm: self.tip_slack_mm,
        })
    }
}

pub(super) fn write_head(text: &mut String, head: &HeadShape) -> std::fmt::Result {
    match &head.outline {
        HeadOutline::Cone(cone) => write_cone(text, cone)?,
        HeadOutline::Profile(knots) => {
            writeln!(
                text,
                "\n# What could touch the table or the print, about the tool's axis: height above the tip and radius\n\
                 # there, two of one height for a step.\n[head]"
            )?;
            let pairs = knots.iter();
            let pairs = pairs.map(|knot| format!("[{}, {}]", number(knot[0]), number(knot[1])));
            let pairs: Vec<String> = pairs.collect();
            writeln!(text, "profile = [{}]", pairs.join(", "))?;
        }
    }
    match head.tip_slack_mm {
        Some(slack_mm) => {
            writeln!(
                text,
                "# How far the tip's flat end may dip into what is printed."
            )?;
            writeln!(text, "tip_slack_mm = {}", number(slack_mm))
        }
        None => Ok(()),
    }
}

fn write_cone(text: &mut String, head: &ConeAndCylinder) -> std::fmt::Result {
    writeln!(
        text,
        "\n# What could touch the table or the print: the nozzle, a cone from its flat end up, and the head\n\
         # above it, a cylinder about the tool's axis.\n[head]"
    )?;
    let tip_mm = number(head.nozzle_tip_radius_mm);
    writeln!(text, "nozzle_tip_radius_mm = {tip_mm}")?;
    writeln!(text, "# Between the nozzle's sides.")?;
    writeln!(
        text,
        "nozzle_angle_deg = {}",
        degrees(head.nozzle_angle_rad)
    )?;
    writeln!(text, "nozzle_length_mm = {}", number(head.nozzle_length_mm))?;
    writeln!(text, "head_radius_mm = {}", number(head.head_radius_mm))?;
    writeln!(text, "head_length_mm = {}", number(head.head_length_mm))
}
