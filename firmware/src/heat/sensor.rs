//! Temperature from a divider: pull-up to the reference, sensor to ground.
//!
//! In: the reading's share of the reference (0 to 1), the [`Sensor`]. Out: °C, or an error if the sensor is open or
//! shorted. Thermistors after Steinhart and Hart (1968), platinum after IEC 60751 (Callendar, Van Dusen), R = R0 (1 +
//! A t + B t²); the third term, for below 0 °C, is omitted. The named curves go through the three points of the data
//! sheets that Klipper's `temperature_sensors.cfg` names; a test checks this.

use super::guard::HeatCause;
use crate::configuration::sensor::{KELVIN, Sensor, SensorCurve};

/// A thermistor above it is open: below -35 °C with either named curve, and five counts of twelve bits
/// from the end of the scale.
const THERMISTOR_OPEN_OHM: f32 = 2.0e6;
/// Below it, it is shorted: above 400 °C.
const THERMISTOR_SHORT_OHM: f32 = 24.0;
/// The same for platinum by its share of R0: 900 °C, and -50 °C.
const PLATINUM_OPEN: f32 = 4.0;
const PLATINUM_SHORT: f32 = 0.8;
/// IEC 60751.
const PLATINUM_A: f32 = 3.9083e-3;
const PLATINUM_B: f32 = -5.775e-7;

impl Sensor {
    /// Temperature, °C, of a share of the reference.
    ///
    /// # Errors
    /// [`HeatCause::SensorOpen`] or [`HeatCause::SensorShorted`].
    pub fn celsius(&self, share: f32) -> Result<f32, HeatCause> {
        let ohm = self.pull_up_ohm * share / (1.0 - share).max(1e-6);
        match self.curve {
            SensorCurve::SteinhartHart([a, b, c]) => {
                within(ohm, THERMISTOR_SHORT_OHM, THERMISTOR_OPEN_OHM)?;
                let ln = libm::logf(ohm);
                Ok(1.0 / (a + ln * (b + c * ln * ln)) - KELVIN)
            }
            SensorCurve::Platinum(ohm_0) => {
                let ratio = ohm / ohm_0;
                within(ratio, PLATINUM_SHORT, PLATINUM_OPEN)?;
                let root = PLATINUM_A * PLATINUM_A - 4.0 * PLATINUM_B * (1.0 - ratio);
                Ok((libm::sqrtf(root) - PLATINUM_A) / (2.0 * PLATINUM_B))
            }
        }
    }
}

fn within(value: f32, short: f32, open: f32) -> Result<(), HeatCause> {
    if value >= open {
        Err(HeatCause::SensorOpen)
    } else if value <= short {
        Err(HeatCause::SensorShorted)
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::configuration::sensor::PULL_UP_OHM;

    fn share(ohm: f32) -> f32 {
        ohm / (ohm + PULL_UP_OHM)
    }

    #[test]
    fn named_curves_pass_through_the_points_of_their_data_sheets() {
        let generic = [(25.0, 100_000.0), (150.0, 1770.0), (250.0, 230.0)];
        let semitec = [(25.0, 100_000.0), (160.0, 1074.0), (300.0, 82.78)];
        // IEC 60751, table of Pt1000.
        let platinum = [(0.0, 1000.0), (100.0, 1385.06), (300.0, 2120.52)];
        for (points, (name, sensor)) in [generic, semitec, platinum].iter().zip(Sensor::NAMED) {
            for &(celsius, ohm) in points {
                let read = sensor.celsius(share(ohm)).unwrap();
                // f32 of a logarithm, and two digits of a data sheet.
                assert!(
                    (read - celsius).abs() < 0.05,
                    "{name}: {read} for {celsius}"
                );
            }
        }
        let beta = Sensor::beta(100_000.0, 3950.0);
        assert!((beta.celsius(share(100_000.0)).unwrap() - 25.0).abs() < 0.05);
        // R = 100k exp(3950 (1/T - 1/298.15)) at 200 °C.
        assert!((beta.celsius(share(745.0)).unwrap() - 200.0).abs() < 0.5);
    }

    #[test]
    fn a_broken_or_shorted_wire_is_no_temperature() {
        for (name, sensor) in Sensor::NAMED {
            for (share, cause) in [
                (1.0, HeatCause::SensorOpen),
                (4094.0 / 4095.0, HeatCause::SensorOpen),
                (0.0, HeatCause::SensorShorted),
                (1.0 / 4095.0, HeatCause::SensorShorted),
            ] {
                assert_eq!(sensor.celsius(share), Err(cause), "{name} at {share}");
            }
        }
    }
}
