//! The pump of a machine whose own controller switches it: the output, its scale, and by how much it is ahead of the flow.

use super::Settings;
pub use super::choices::PumpKind;
use super::groups::PumpKeys;
use crate::text::refusal::{Refusal, refusal};

/// `[pump]` of a machine file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PumpOutput {
    /// Name of the signal, or number of the output, on the controller.
    pub output: String,
    /// Whether it has levels.
    pub kind: PumpKind,
    /// Flow at one unit of an analog output, as its controller counts them, mm³/s.
    pub mm3_s_per_unit: Option<f64>,
    /// The flow changes so long after the output, s.
    pub lag_s: f64,
    /// The same of a start, s.
    pub start_lead_s: f64,
    /// The same of a stop, s.
    pub stop_lead_s: f64,
    /// Least flow that the pump has while it runs, mm³/s.
    pub rate_min_mm3_s: f64,
    /// Greatest, mm³/s.
    pub rate_max_mm3_s: Option<f64>,
}

impl Settings {
    /// Every number of `[pump]`, if it is there.
    pub(super) fn check_pump(&self) -> Result<(), Refusal> {
        let Some(pump) = &self.pump else {
            return Ok(());
        };
        PumpKeys::check(pump)?;
        if pump.kind == PumpKind::Analog && pump.mm3_s_per_unit.is_none() {
            return Err(refusal!(
                "pump.mm3_s_per_unit: an analog output needs its scale: mm³/s at one unit of it (a volt of RAPID and Sinumerik, \
                 the whole range of KRL and URScript)"
            ));
        }
        match pump.rate_max_mm3_s {
            Some(most) if most <= pump.rate_min_mm3_s => Err(refusal!(
                "pump.rate_max_mm3_s is not above pump.rate_min_mm3_s: raise the one or lower the other"
            )),
            _ => Ok(()),
        }
    }
}
