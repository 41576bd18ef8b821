//! A known extruder with its material, for simulations: TOML text -> [`ExtruderModel`].
//!
//! Motor's flow --slip--> driven --flow_loss--> melt --drift by layer--> pressed --lag--> leaves the nozzle.
//! Units: mm³/s, s, shares of the flow. Not covered: what it does with a job's steps (`drive/laid_beads.rs`), temperature.

use super::LAYERS_MAX;
use super::check::{check_flow_curves, in_range, sensible};
use super::groups::MELT_SPEED_RANGE;
use super::machine_file::toml_words::toml_problem;
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::flow_curves::{CurvePoints, FlowCurves};
use serde::Deserialize;

/// Slowest material, s: pumps of concrete with long hoses follow in some seconds.
const LAG_MAX_S: f64 = 30.0;

/// What becomes of the extruder's steps.
#[derive(Clone, Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct ExtruderModel {
    /// By the flow that is driven, mm³/s: the share that does not arrive.
    pub flow_loss: CurvePoints,
    /// Time constant, first order, by which what leaves the nozzle follows what is pressed into it.
    pub lag_s: f64,
    /// Change by layer.
    pub drift: Option<Drift>,
    /// Where the drive slips.
    pub slip: Option<Slip>,
}

/// A share of the flow that is lost more and more: nothing on the first layer, all of it from `layers` later on.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Drift {
    /// In the end; below 0 more arrives.
    pub share: f64,
    /// Until then.
    pub layers: u32,
}

/// A drive that slips above a flow.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Slip {
    /// Up to here it holds.
    pub flow_mm3_s: f64,
    /// Of the flow above that: 1 lets none of it through.
    pub share: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: u32,
    extruder: ExtruderModel,
}

impl ExtruderModel {
    /// Reads and checks a material's file.
    ///
    /// # Errors
    /// A `Refusal` with the line of what cannot be read, or with the key that is out of range.
    pub fn from_toml(text: &str) -> Result<ExtruderModel, Refusal> {
        let file = toml::from_str(text);
        let file: File = file.map_err(|error| Refusal(toml_problem(text, &error)))?;
        match file.format {
            1 => file.extruder.check().map(|()| file.extruder),
            other => Err(refusal!(
                "format: {other} is not one that this program reads; it reads 1"
            )),
        }
    }

    fn check(&self) -> Result<(), Refusal> {
        check_flow_curves(&self.curves())?;
        in_range("extruder.lag_s", self.lag_s, 0.0, LAG_MAX_S)?;
        if let Some(Drift { share, layers }) = self.drift {
            in_range("extruder.drift.share", share, -0.5, 0.9)?;
            let most = f64::from(LAYERS_MAX);
            in_range("extruder.drift.layers", f64::from(layers), 1.0, most)?;
        }
        if let Some(slip) = self.slip {
            sensible(
                "extruder.slip.flow_mm3_s",
                slip.flow_mm3_s,
                MELT_SPEED_RANGE,
            )?;
            in_range("extruder.slip.share", slip.share, 0.0, 1.0)?;
        }
        Ok(())
    }

    /// Its curve, as a machine file has it.
    pub fn curves(&self) -> FlowCurves {
        FlowCurves {
            loss: self.flow_loss.clone(),
            ..FlowCurves::NONE
        }
    }
}

#[cfg(test)]
#[path = "extruder_model_tests.rs"]
mod tests;
