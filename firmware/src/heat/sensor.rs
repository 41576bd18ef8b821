//! Temperature from a divider: pull-up to the reference, sensor to ground.
//!
//! In: the reading's share of the reference (0 to 1). Out: °C, or that the sensor is open or shorted.
//! Thermistors after Steinhart and Hart (1968), 1/T = a + b ln R + c (ln R)³, T in K; `beta` is the same
//! with c = 0. Platinum after IEC 60751 (Callendar, Van Dusen), R = R0 (1 + A t + B t²); the third term,
//! for below 0 °C, is left out. The named curves pass through the three points of the data sheets that
//! Klipper's `temperature_sensors.cfg` names; a test holds them to those.

use super::guard::HeatCause;
use serde::{Deserialize, Serialize};

const KELVIN: f32 = 273.15;
/// Pull-up that Klipper takes where nothing else is said, and the Octopus has.
const PULL_UP_OHM: f32 = 4700.0;
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

/// How resistance follows temperature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum SensorCurve {
    /// 1/T = a + b ln R + c (ln R)³.
    SteinhartHart([f32; 3]),
    /// A platinum resistor of so many ohms at 0 °C.
    Platinum(f32),
}

/// A sensor and its pull-up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensor {
    /// Its curve.
    pub curve: SensorCurve,
    /// Pull-up to the reference, ohm.
    pub pull_up_ohm: f32,
}

impl Sensor {
    /// The usual 100 kOhm thermistor, "Generic 3950".
    pub const GENERIC_3950: Self =
        Self::steinhart_hart([7.934_721_5e-4, 2.007_632_5e-4, 1.632_834_1e-7]);
    /// ATC Semitec 104NT-4-R025H42G.
    pub const SEMITEC_104NT4: Self =
        Self::steinhart_hart([7.958_246e-4, 2.136_086_6e-4, 6.483_002_6e-8]);
    /// Platinum, 1 kOhm at 0 °C.
    pub const PT1000: Self = Self {
        curve: SensorCurve::Platinum(1000.0),
        pull_up_ohm: PULL_UP_OHM,
    };
    /// The named ones.
    pub const NAMED: [(&str, Self); 3] = [
        ("generic_3950", Self::GENERIC_3950),
        ("atc_semitec_104nt4", Self::SEMITEC_104NT4),
        ("pt1000", Self::PT1000),
    ];

    /// With the usual pull-up.
    pub const fn steinhart_hart(coefficients: [f32; 3]) -> Self {
        Self {
            curve: SensorCurve::SteinhartHart(coefficients),
            pull_up_ohm: PULL_UP_OHM,
        }
    }

    /// A thermistor by its resistance at 25 °C, ohm, and its beta, K.
    pub fn beta(ohm_25: f32, beta_k: f32) -> Self {
        let a = 1.0 / (25.0 + KELVIN) - libm::logf(ohm_25) / beta_k;
        Self::steinhart_hart([a, 1.0 / beta_k, 0.0])
    }

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

    pub(super) fn is_right(&self) -> bool {
        let numbers = match self.curve {
            SensorCurve::SteinhartHart([a, b, c]) => {
                a.is_finite() && b > 0.0 && b.is_finite() && c >= 0.0 && c.is_finite()
            }
            SensorCurve::Platinum(ohm_0) => ohm_0 > 0.0 && ohm_0.is_finite(),
        };
        numbers && self.pull_up_ohm > 0.0 && self.pull_up_ohm.is_finite()
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
