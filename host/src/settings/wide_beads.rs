//! What wide beads of clay, concrete and pellets ask for: even beads in curves, warm joints, a pump that runs on.
//!
//! In: keys of `[print]` and `[flow]`. Out: [`WideBeads`], checked. All are off by default. Leaves out how they are
//! kept: the optimiser, the findings and the route do that.

use super::check::in_range;
use super::{PrimeRetract, Settings};
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;

/// What wide beads ask for; 0 asks for nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WideBeads {
    /// Most that a bead may lay on the outside of a curve against the inside: (R + w/2) / (R - w/2), with the bead's
    /// width w and the path's radius R. Above 1.20 concrete tears (Liu et al., 2020).
    pub outer_inner_ratio_max: f64,
    /// Most time from the begin of a layer to that of the next one: the joint is cold after it, s.
    pub layer_time_max_s: f64,
    /// Path that the bead falls short of where the pump starts with the head: so much is pumped before it moves, mm.
    pub pump_start_mm: f64,
    /// Path on which the pump, switched off, still lays a bead: it stops so far before a pass's end, mm.
    pub pump_stop_mm: f64,
    /// Layers of one closed bead rise along it and follow each other without a rest (vase mode).
    pub continuous_z: bool,
}

/// Bounds of the keys: a ratio closer to 1 than this leaves no curve.
pub(super) const RATIO_RANGE: [f64; 2] = [1.01, 100.0];
pub(super) const LAYER_TIME_MAX_S: f64 = 86_400.0;
/// Starts and stops, shares of the nozzle's length: longer ones are no start or stop any more.
const PUMP_SHARE_MAX: f64 = 50.0;

impl WideBeads {
    /// The curvature that the ratio allows a bead of width 1: w / R = 2 (ratio - 1) / (ratio + 1). `None` where no
    /// ratio is asked for.
    pub fn width_by_radius_max(&self) -> Option<f64> {
        let ratio = self.outer_inner_ratio_max;
        (ratio > 0.0).then(|| 2.0 * (ratio - 1.0) / (ratio + 1.0))
    }
}

impl Settings {
    /// Prime and retract around a pass of `volume_mm3` over `length_mm`; of a pump that starts slowly the prime is the
    /// bead of `pump_start_mm`, of half of the pass at most.
    pub fn starts_and_ends(&self, volume_mm3: f64, length_mm: f64) -> PrimeRetract {
        let mut starts = self.prime_retract;
        if self.wide_beads.pump_start_mm > 0.0 && length_mm > 0.0 {
            let share = (self.wide_beads.pump_start_mm / length_mm).min(0.5);
            starts.prime_mm3 = share * volume_mm3;
        }
        starts
    }
}

/// Checks the ranges of the keys, and that a pump that starts slowly has no prime beside it.
pub(super) fn check(settings: &Settings) -> Result<(), Refusal> {
    let wide = &settings.wide_beads;
    let late_s = wide.layer_time_max_s;
    if late_s > 0.0 && late_s < settings.layer_time_min_s {
        return Err(refusal!(
            "print.layer_time_max_s is {}, below print.layer_time_min_s = {}: raise the one or lower the other",
            Short(late_s),
            Short(settings.layer_time_min_s)
        ));
    }
    let longest_mm = PUMP_SHARE_MAX * settings.aperture.major_mm();
    in_range("flow.pump_start_mm", wide.pump_start_mm, 0.0, longest_mm)?;
    let section_mm2 = 2.0 * settings.aperture.major_mm() * settings.layer_height_mm;
    let most_mm3 = settings.push_max_mm3();
    let start_mm3 = wide.pump_start_mm * section_mm2 * settings.flow_factor;
    in_range(
        "flow.pump_start_mm (its volume, mm³)",
        start_mm3,
        0.0,
        most_mm3,
    )?;
    in_range("flow.pump_stop_mm", wide.pump_stop_mm, 0.0, longest_mm)?;
    let pr = &settings.prime_retract;
    let pumps = wide.pump_start_mm > 0.0 || wide.pump_stop_mm > 0.0;
    if pumps && (pr.prime_mm3 > 0.0 || pr.retract_mm3 > 0.0) {
        return Err(refusal!(
            "flow.pump_start_mm and flow.pump_stop_mm are of pumps that start and stop slowly and do not run backwards: \
             set flow.prime_mm3 and flow.retract_mm3 to 0 beside them"
        ));
    }
    Ok(())
}
