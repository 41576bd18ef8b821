//! Sensors of heaters: their curve and their pull-up.
//!
//! In: resistances in ohm. Out: a [`Sensor`], used by `heat/sensor.rs`. Thermistors by the three coefficients of
//! Steinhart and Hart (1968), 1/T = a + b ln R + c (ln R)³, T in K; `beta` is the same with c = 0.

use serde::{Deserialize, Serialize};

/// 0 °C, K.
pub(crate) const KELVIN: f32 = 273.15;
/// What boards pull sensors up with, ohm.
pub(crate) const PULL_UP_OHM: f32 = 4700.0;

/// How resistance follows temperature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum SensorCurve {
    /// 1/T = a + b ln R + c (ln R)³.
    SteinhartHart([f32; 3]),
    /// A platinum resistor with this resistance at 0 °C, ohms.
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
}
