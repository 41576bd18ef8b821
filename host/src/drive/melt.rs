//! What leaves the nozzle of a known extruder.
//!
//! In: what the motor pushes in each servo tick, mm³, at which rate, the layer. Out: what leaves the nozzle in it. The melt under
//! pressure is a store c with c' = pressed - c / lag: a first-order lag, solved exactly for a flow that is constant in a
//! tick. Below 0 it is what a retract has pulled back, which a prime fills before anything leaves; no pressure, so nothing
//! of that is lost. Leaves out oozing at rest (but for what is still under pressure), temperature and die swell.

use crate::settings::extruder_model::ExtruderModel;
use headway_firmware::configuration::flow_curves::Curve;

/// The melt at a moment.
#[derive(Debug)]
pub(super) struct Melt<'a> {
    model: &'a ExtruderModel,
    arriving: Curve,
    tick_s: f64,
    /// Share of the store that is left after a tick.
    keep: f64,
    /// Under pressure; below 0 pulled back.
    store_mm3: f64,
}

impl<'a> Melt<'a> {
    /// At rest, with so much pulled back.
    pub(super) fn new(model: &'a ExtruderModel, tick_s: f64, pulled_back_mm3: f64) -> Self {
        Self {
            model,
            arriving: model.curves().arriving(),
            tick_s,
            // 0 without a lag.
            keep: (-tick_s / model.lag_s).exp(),
            store_mm3: -pulled_back_mm3,
        }
    }

    /// What leaves the nozzle in a tick in which the motor pushes so much, at so many mm³/s.
    pub(super) fn leaving_mm3(&mut self, [motor_mm3, motor_mm3_s]: [f64; 2], layer: u32) -> f64 {
        let mut pressed_mm3 = motor_mm3;
        if motor_mm3 > 0.0 {
            let filled_mm3 = motor_mm3.min((-self.store_mm3).max(0.0));
            let share = self.arriving_share(motor_mm3_s.max(1e-9), layer);
            pressed_mm3 = filled_mm3 + (motor_mm3 - filled_mm3) * share;
        }
        let all_mm3 = self.store_mm3 + pressed_mm3;
        // From an empty nozzle only what fills it over counts.
        let (before_mm3, pressed_mm3) = match self.store_mm3 > 0.0 {
            true => (self.store_mm3, pressed_mm3),
            false => (0.0, all_mm3),
        };
        let steady_mm3 = pressed_mm3 * self.model.lag_s / self.tick_s;
        let kept_mm3 = steady_mm3 + (before_mm3 - steady_mm3) * self.keep;
        self.store_mm3 = all_mm3.min(kept_mm3.max(0.0));
        all_mm3 - self.store_mm3
    }

    /// Of a flow of the motor, mm³/s above 0.
    fn arriving_share(&self, motor_mm3_s: f64, layer: u32) -> f64 {
        let slipped_mm3_s = self.model.slip.map_or(0.0, |slip| {
            slip.share * (motor_mm3_s - slip.flow_mm3_s).max(0.0)
        });
        let drifted = self.model.drift.map_or(0.0, |drift| {
            drift.share * (f64::from(layer) / f64::from(drift.layers)).min(1.0)
        });
        let arriving_mm3_s = self.arriving.at(motor_mm3_s - slipped_mm3_s)[0];
        (1.0 - drifted) * arriving_mm3_s / motor_mm3_s
    }
}
