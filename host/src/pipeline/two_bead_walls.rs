//! Walls that take two beads, and one of a wider nozzle.
//!
//! In: the medial axes of the planned regions (mm). Out: how long such walls are and how wide, and a note with the nozzle
//! that lays them in one bead. Leaves out regions with infill, whose walls are as many as they were asked for.

use crate::geometry::aperture::Aperture;
use crate::pipeline::Plan;
use crate::plan::beads::division::{SPANNED_SLACK, WIDEST_SINGLE_SHARE};
use crate::plan::layers::region_plan::RegionPlan;
use crate::settings::{PassMode, Settings};
use crate::text::short_number::Short;
use serde::{Deserialize, Serialize};

/// Share of a part's axis from which it is a part of such walls.
const WALLS_SHARE: f64 = 0.8;
/// Widest wall of two beads, in widest beads.
const BEADS_MAX: f64 = 2.0;
/// Steps of the nozzle that is named, in long semi-axes of the one in use.
const NOZZLE_STEP: f64 = 1.0 / 12.0;

/// Lengths and widths of the walls of all layers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TwoBeadWalls {
    /// Length of the medial axis where two beads lie side by side.
    pub two_mm: f64,
    /// Length of the medial axis with any bead.
    pub all_mm: f64,
    /// Least and largest width there; the former is the larger one if there is none.
    pub widths_mm: [f64; 2],
}

impl Default for TwoBeadWalls {
    fn default() -> TwoBeadWalls {
        TwoBeadWalls {
            two_mm: 0.0,
            all_mm: 0.0,
            widths_mm: [f64::MAX, 0.0],
        }
    }
}

impl TwoBeadWalls {
    /// Those of a plan.
    pub fn of(plan: &Plan, settings: &Settings) -> TwoBeadWalls {
        let mut all = TwoBeadWalls::default();
        for kind in &plan.kinds {
            for region in kind.regions.iter().filter(|region| region.open.is_empty()) {
                all.add_region(region, f64::from(kind.layers), settings);
            }
        }
        all
    }

    fn add_region(&mut self, region: &RegionPlan, layers: f64, settings: &Settings) {
        let (a, b) = (settings.aperture.major_mm(), settings.aperture.minor_mm());
        let one_mm = match region.pass_mode {
            PassMode::Two => WIDEST_SINGLE_SHARE * a,
            PassMode::One => (1.0 + SPANNED_SLACK) * a,
        };
        let links = region.axis.lengths_and_radii_mm();
        for (link_mm, half_mm) in links.filter(|(_, half_mm)| *half_mm >= b) {
            let length_mm = layers * link_mm;
            self.all_mm += length_mm;
            if half_mm > one_mm && half_mm <= BEADS_MAX * a {
                self.two_mm += length_mm;
                let [least, most] = self.widths_mm;
                self.widths_mm = [least.min(2.0 * half_mm), most.max(2.0 * half_mm)];
            }
        }
    }

    /// Adds those of other layers.
    pub fn add(&mut self, other: TwoBeadWalls) {
        self.two_mm += other.two_mm;
        self.all_mm += other.all_mm;
        let [least, most] = self.widths_mm;
        self.widths_mm = [least.min(other.widths_mm[0]), most.max(other.widths_mm[1])];
    }

    /// The note, if most of the part is such walls.
    pub fn note(&self, settings: &Settings) -> Option<String> {
        let Aperture::Ellipse { major_mm, minor_mm } = settings.aperture else {
            return None;
        };
        if self.two_mm <= 0.0 || self.two_mm < WALLS_SHARE * self.all_mm {
            return None;
        }
        let [least, most] = self.widths_mm;
        let step_mm = NOZZLE_STEP * major_mm;
        let wider_mm = (0.5 * most / WIDEST_SINGLE_SHARE / step_mm).ceil() * step_mm;
        let short = |mm: f64| Short((mm * 1000.0).round() / 1000.0);
        // Its widest bead lies as well in a straight wall, but for what rounding adds.
        let is_spanned =
            settings.pass_mode == PassMode::Two && most <= (1.0 + SPANNED_SLACK) * 2.0 * major_mm;
        let by_option = if is_spanned { "--pass one or " } else { "" };
        Some(format!(
            "walls of {} to {} mm take two beads of this nozzle: {by_option}an ellipse of {} x {} mm lays them in one",
            short(least),
            short(most),
            short(2.0 * wider_mm),
            short(2.0 * minor_mm)
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: walls that the nozzle spans name the option, wider ones the nozzle alone.
    #[test]
    fn walls_that_the_nozzle_spans_name_the_option() {
        let mut settings = Settings {
            aperture: Aperture::Ellipse {
                major_mm: 1.0,
                minor_mm: 0.3,
            },
            ..Settings::default()
        };
        let note = |most_mm: f64, settings: &Settings| {
            let walls = TwoBeadWalls {
                two_mm: 10.0,
                all_mm: 10.0,
                widths_mm: [1.9, most_mm],
            };
            walls.note(settings).expect("a note")
        };
        assert_eq!(
            note(2.0, &settings),
            "walls of 1.9 to 2 mm take two beads of this nozzle: --pass one or an ellipse of 2.333 x 0.6 mm lays them in one"
        );
        assert!(note(2.2, &settings).contains("nozzle: an ellipse of 2.5 x 0.6 mm"));
        settings.pass_mode = PassMode::One;
        assert!(!note(2.0, &settings).contains("--pass one"));
    }
}
