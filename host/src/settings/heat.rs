//! What is melted, and what melts it: the `[material]` and `[heaters]` groups of a machine file.

use headway_firmware::heat::HeatConfiguration;

/// Temperatures that a job is printed with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Hot end, °C.
    pub hot_end_c: f64,
    /// Bed, °C; 0 leaves it off.
    pub bed_c: f64,
    /// Part fan, per cent.
    pub fan_pct: f64,
}

/// Names of the heaters in the order of their numbers, as machine files have them.
pub const HEATER_KEYS: [&str; headway_firmware::heat::HEATERS_MAX] =
    ["hot_end", "bed", "hot_end_2"];

/// The first heater with a number out of its range: its key.
pub(super) fn wrong_heater(heaters: &HeatConfiguration) -> Option<&'static str> {
    let wrong = heaters.check().err()?;
    HEATER_KEYS.get(wrong.0).copied()
}
