//! Temperature -> duty: the heat balance, and a PID for the rest.
//!
//! In: target and reading, °C; part fan (0 to 1) and flow, mm³/s; every [`PERIOD_S`]. Out: duty, 0 to 1.
//! Feed-forward after the heat balance of [`Plant`] as Marlin's model predictive control: a step of flow
//! gets its power at once, before any sensor can react. The derivative is that of the reading, so a new
//! target gives no kick; the integral is held where the output is at its limit and would exceed it
//! (conditional integration, as Klipper's `ControlPID`), and far from the target.

use super::unit_share;
use crate::configuration::heat::{Gains, PERIOD_S, Plant};

/// Air around the machine, °C, as Klipper's `AMBIENT_TEMP`. A warmer room costs the integral 3 %.
pub const AMBIENT_C: f32 = 25.0;
/// Time over which the reading's slope is measured, s, Klipper's `smooth_time`.
const SLOPE_S: f32 = 1.0;
/// The integral works this close to the target: further away it would only gather overshoot.
const INTEGRAL_BAND_K: f32 = 10.0;
/// The most that the integral may add or take of full duty: what a heat balance can be wrong by.
const INTEGRAL_MAX: f32 = 0.5;

/// Heat losses of a hot end.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeatLoad {
    /// Part fan, 0 to 1.
    pub fan: f32,
    /// Melt that flows, mm³/s.
    pub flow_mm3_s: f32,
}

impl Plant {
    /// Duty that holds a temperature.
    pub fn holding_duty(&self, target_c: f32, load: &HeatLoad) -> f32 {
        let loss_w_k = self.loss_w_k
            + self.fan_loss_w_k * load.fan
            + self.melt_j_mm3_k * load.flow_mm3_s.max(0.0);
        ((target_c - AMBIENT_C) * loss_w_k / self.power_w).max(0.0)
    }
}

/// State of a heater's regulator.
#[derive(Clone, Copy, Debug, Default)]
pub struct Regulator {
    integral: f32,
    last_c: Option<f32>,
    slope_k_s: f32,
}

impl Regulator {
    /// Follows the reading while the heater is off.
    pub fn rest(&mut self, reading_c: f32) {
        self.follow(reading_c);
        self.integral = 0.0;
    }

    fn follow(&mut self, reading_c: f32) {
        let slope = (reading_c - self.last_c.unwrap_or(reading_c)) / PERIOD_S;
        self.slope_k_s += (slope - self.slope_k_s) * (PERIOD_S / SLOPE_S);
        self.last_c = Some(reading_c);
    }

    /// Slope of the reading, K/s.
    pub fn slope_k_s(&self) -> f32 {
        self.slope_k_s
    }

    /// Duty of the next period.
    pub fn duty(
        &mut self,
        gains: &Gains,
        plant: &Plant,
        target_c: f32,
        reading_c: f32,
        load: &HeatLoad,
    ) -> f32 {
        self.follow(reading_c);
        let error_k = target_c - reading_c;
        let asked =
            plant.holding_duty(target_c, load) + gains.proportional * error_k + self.integral
                - gains.derivative * self.slope_k_s;
        let duty = unit_share(asked);
        let further = (asked > duty && error_k > 0.0) || (asked < duty && error_k < 0.0);
        if !further && error_k.abs() < INTEGRAL_BAND_K {
            let integral = self.integral + gains.integral * error_k * PERIOD_S;
            self.integral = integral.clamp(-INTEGRAL_MAX, INTEGRAL_MAX);
        }
        duty
    }
}
