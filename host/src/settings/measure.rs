//! Corrections of the flow while a job prints (`headway stream --sensor`): the controller, its bounds and its gains.

use super::Settings;
pub use super::choices::FlowController;
use super::groups::MeasureKeys;
use crate::text::refusal::{Refusal, refusal};

/// `[measure]` of a machine file.
#[derive(Clone, Debug, PartialEq)]
pub struct Measure {
    /// What the flow follows.
    pub controller: FlowController,
    /// Least and greatest correction, shares of the planned flow.
    pub flow_range: [f64; 2],
    /// Fastest change of the correction, share of the planned flow a second.
    pub flow_change_per_s: f64,
    /// Silence after which the flow returns to the plan's, s; of scans it is counted in layers.
    pub silent_s: f64,
    /// Standard deviation of a layer's mean height as it is scanned, mm.
    pub height_noise_mm: f64,
    /// Layers in which a height error falls to about a third.
    pub recovery_layers: f64,
    /// Pressure to keep to, in the sensor's own unit.
    pub pressure: Option<f64>,
    /// Change of the flow, share a second, where the pressure is off by all of [`Measure::pressure`].
    pub pressure_gain_per_s: f64,
}

impl Default for Measure {
    fn default() -> Self {
        Measure {
            controller: FlowController::default(),
            flow_range: [0.8, 1.2],
            flow_change_per_s: 0.02,
            silent_s: 10.0,
            height_noise_mm: 0.03,
            recovery_layers: 3.0,
            pressure: None,
            pressure_gain_per_s: 0.01,
        }
    }
}

impl Settings {
    /// Every number of `[measure]`, if it is there.
    pub(super) fn check_measure(&self) -> Result<(), Refusal> {
        let Some(measure) = &self.measure else {
            return Ok(());
        };
        MeasureKeys::check(measure)?;
        if measure.controller == FlowController::Pressure && measure.pressure.is_none() {
            return Err(refusal!(
                "measure.pressure: this controller needs the pressure to keep to, in the sensor's unit"
            ));
        }
        Ok(())
    }
}
