//! What is asked of a kind of bead where it differs from the rest: the `[kinds]` groups of a machine file.
//!
//! Input: speeds (mm/s), accelerations (mm/s²) and factors of the volume by kind. Output: what holds for a
//! pass. Speeds and accelerations of a kind lie below those of `[print]`, which are the ceiling.

use super::Settings;
use super::check::in_range;
use crate::text::refusal::Refusal;
use serde::Deserialize;

/// What one kind asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct KindSettings {
    /// Tip speed.
    pub speed_mm_s: Option<f64>,
    /// Tip acceleration.
    pub acceleration_mm_s2: Option<f64>,
    /// Multiplier of the deposited volume.
    pub flow_factor: Option<f64>,
}

impl KindSettings {
    /// Both: the slower of each, flows multiplied.
    pub fn with(self, other: KindSettings) -> KindSettings {
        let least = |a: Option<f64>, b: Option<f64>| match (a, b) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
        let flow = |kind: KindSettings| kind.flow_factor.unwrap_or(1.0);
        KindSettings {
            speed_mm_s: least(self.speed_mm_s, other.speed_mm_s),
            acceleration_mm_s2: least(self.acceleration_mm_s2, other.acceleration_mm_s2),
            flow_factor: Some(flow(self) * flow(other)),
        }
    }
}

/// What all kinds ask for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Kinds {
    /// Loops along the outline; without `[infill]` all of a layer.
    pub walls: KindSettings,
    /// Lines of filled ground.
    pub solid: KindSettings,
    /// Lines of a sparse infill.
    pub sparse: KindSettings,
    /// Lines over open space.
    pub bridge: KindSettings,
    /// Skirt and brim.
    pub skirt: KindSettings,
    /// The lowest layer, whatever is printed.
    pub first_layer: KindSettings,
}

impl Kinds {
    /// All of them by their names in a machine file.
    pub fn named(&self) -> [(&'static str, &KindSettings); 6] {
        [
            ("walls", &self.walls),
            ("solid", &self.solid),
            ("sparse", &self.sparse),
            ("bridge", &self.bridge),
            ("skirt", &self.skirt),
            ("first_layer", &self.first_layer),
        ]
    }
}

/// Speed and acceleration of `[print]` are the ceiling of every kind's.
pub(super) fn check(settings: &Settings) -> Result<(), Refusal> {
    let (speed_mm_s, bend_mm_s2) = (settings.speed_mm_s, settings.tip_acceleration_mm_s2);
    for (name, kind) in settings.kinds.named() {
        let checked = |key: &str, value: Option<f64>, low: f64, high: f64| {
            in_range(
                &format!("kinds.{name}.{key}"),
                value.unwrap_or(high),
                low,
                high,
            )
        };
        checked("speed_mm_s", kind.speed_mm_s, 0.01, speed_mm_s)?;
        checked(
            "acceleration_mm_s2",
            kind.acceleration_mm_s2,
            1.0,
            bend_mm_s2,
        )?;
        checked("flow_factor", kind.flow_factor, 0.1, 3.0)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slower_of_two_holds_and_flows_multiply() {
        let first = KindSettings {
            speed_mm_s: Some(20.0),
            acceleration_mm_s2: None,
            flow_factor: Some(1.1),
        };
        let walls = KindSettings {
            speed_mm_s: Some(30.0),
            acceleration_mm_s2: Some(500.0),
            flow_factor: Some(0.9),
        };
        let both = walls.with(first);
        assert_eq!(both.speed_mm_s, Some(20.0));
        assert_eq!(both.acceleration_mm_s2, Some(500.0));
        assert!((both.flow_factor.unwrap_or(0.0) - 0.99).abs() < 1e-12);
    }
}
