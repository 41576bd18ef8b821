//! What is melted, and what melts it: the `[material]` and `[heaters]` groups of a machine file.

use headway_firmware::configuration::heat::HeatConfiguration;

/// Longest pause that may keep its heat, min: as long as a host waits for the end of a pause.
pub const PAUSE_HEAT_MAX_MIN_MOST: f64 = 720.0;

/// Temperatures that a job is printed with.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Material {
    /// Hot end, °C.
    pub hot_end_c: f64,
    /// Bed, °C; 0 leaves it off.
    pub bed_c: f64,
    /// Part fan, per cent.
    pub fan_pct: f64,
    /// Hot end while the first layer is printed, °C, where it differs.
    pub first_layer_hot_end_c: Option<f64>,
    /// Bed while the first layer is printed, °C, where it differs.
    pub first_layer_bed_c: Option<f64>,
    /// Layer, from 1, with which the fan comes on; `None` is the second.
    pub fan_from_layer: Option<u32>,
    /// How long a pause keeps its heat, min; `None` is the host's own 120.
    pub pause_heat_max_min: Option<f64>,
    /// Density, g/cm³: the figures tell the mass.
    pub density_g_cm3: Option<f64>,
    /// Price of a kilogram, in whatever money: the figures tell what the material costs.
    pub price_per_kg: Option<f64>,
    /// Flow that the hot end melts, mm³/s: a plan with more is reported.
    pub melt_max_mm3_s: Option<f64>,
    /// Diameter of the filament: the figures tell its length.
    pub diameter_mm: Option<f64>,
    /// How far a bead may lean off what supports it, from the tool axis; `None` is 45.
    pub self_support_deg: Option<f64>,
}

/// Names of the heaters in the order of their numbers, as machine files have them.
pub const HEATER_KEYS: [&str; headway_firmware::configuration::heat::HEATERS_MAX] =
    ["hot_end", "bed", "hot_end_2"];

/// The first heater with a number out of its range: its key.
pub(super) fn wrong_heater(heaters: &HeatConfiguration) -> Option<&'static str> {
    let wrong = heaters.check().err()?;
    HEATER_KEYS.get(wrong.0).copied()
}
