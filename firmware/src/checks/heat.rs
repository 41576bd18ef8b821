//! Heaters: limits, heat balances, gains, sensors.

use super::first_wrong;
use crate::configuration::WrongNumber;
use crate::configuration::heat::{HeatConfiguration, HeaterConfiguration, HeaterRange};
use crate::configuration::sensor::{Sensor, SensorCurve};

/// Highest that can be given for it, °C: as for limits.
const TEMPERATURE_MAX_C: f32 = 500.0;

impl HeaterConfiguration {
    /// The first number that cannot be.
    pub fn wrong(&self) -> Option<WrongNumber> {
        let (plant, gains) = (&self.plant, &self.gains);
        let positive = |item, v: f32| (v > 0.0 && v.is_finite(), item, f64::from(v));
        let not_negative = |item, v: f32| (v >= 0.0 && v.is_finite(), item, f64::from(v));
        first_wrong(&[
            positive(1, self.limit_c),
            // No usual hot end holds more.
            (
                self.limit_c <= TEMPERATURE_MAX_C,
                1,
                f64::from(self.limit_c),
            ),
            (self.sensor.is_right(), 2, 0.0),
            positive(3, plant.power_w),
            positive(4, plant.loss_w_k),
            not_negative(5, plant.fan_loss_w_k),
            not_negative(6, plant.melt_j_mm3_k),
            not_negative(7, gains.proportional),
            not_negative(8, gains.integral),
            not_negative(9, gains.derivative),
            not_negative(10, self.extrude_min_c),
            (
                self.extrude_min_c <= TEMPERATURE_MAX_C,
                10,
                f64::from(self.extrude_min_c),
            ),
        ])
    }
}

impl HeatConfiguration {
    /// Checks every number.
    ///
    /// # Errors
    /// [`HeaterRange`], the first heater with a number that cannot be.
    pub fn check(&self) -> Result<(), HeaterRange> {
        let wrong = self
            .heaters
            .iter()
            .position(|heater| heater.wrong().is_some());
        wrong.map_or(Ok(()), |heater| Err(HeaterRange(heater)))
    }
}

impl Sensor {
    fn is_right(&self) -> bool {
        let numbers = match self.curve {
            SensorCurve::SteinhartHart([a, b, c]) => {
                a.is_finite() && b > 0.0 && b.is_finite() && c >= 0.0 && c.is_finite()
            }
            SensorCurve::Platinum(ohm_0) => ohm_0 > 0.0 && ohm_0.is_finite(),
        };
        numbers && self.pull_up_ohm > 0.0 && self.pull_up_ohm.is_finite()
    }
}
