//! Which division of a part into layers is printed: by the stairs that are left and the seconds that it takes.
//!
//! In: divisions (mm, mm³). Out: [`Compared`] for each, and which of them costs least. Seconds are those of one
//! layer of a kind, planned by itself for this machine, a mm², times the area of all layers of that kind: planning all layers of
//! both would take as long as two jobs. Where a layer cannot be planned by itself, its area at the nominal speed stands for it.

use super::Division;
use super::layer_shape::PartLayer;
use super::one_job::seconds_of;
use crate::geometry::polygon::Region;
use crate::settings::curved_layers::CurvedLayers;
use crate::settings::{Quality, Settings};

/// What is left of the stairs, as a share of those of flat layers, that is worth this share of the printing time.
const STAIRS_SHARE: f64 = 0.03;
const TIME_SHARE: f64 = 0.05;

/// A division that was compared with another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compared {
    /// Its layers.
    pub layers: CurvedLayers,
    /// Volume between its top and the part's, mm³.
    pub stair_error_mm3: f64,
    /// Printing time, estimated, s.
    pub seconds: f64,
}

/// Printing times of layers by kind.
pub struct Seconds<'a> {
    settings: &'a Settings,
    /// A mm² of a flat layer, s.
    flat_s_mm2: Option<f64>,
}

impl<'a> Seconds<'a> {
    /// For a machine.
    pub fn on(settings: &'a Settings) -> Seconds<'a> {
        Seconds {
            settings,
            flat_s_mm2: None,
        }
    }

    /// Of all layers of a division, about.
    pub fn of(&mut self, layers: &[PartLayer]) -> f64 {
        let (curved, flat): (Vec<&PartLayer>, Vec<&PartLayer>) =
            layers.iter().partition(|layer| layer.is_curved());
        let mut seconds = 0.0;
        if !flat.is_empty() {
            let known = self.flat_s_mm2.unwrap_or_else(|| self.s_mm2(&flat));
            self.flat_s_mm2 = Some(known);
            seconds += known * area_mm2(&flat);
        }
        if !curved.is_empty() {
            seconds += self.s_mm2(&curved) * area_mm2(&curved);
        }
        seconds
    }

    /// Of the middle one of layers, by area: the smallest are not worth much, the largest may be the only one of its kind.
    fn s_mm2(&self, layers: &[&PartLayer]) -> f64 {
        let mut by_area: Vec<&&PartLayer> = layers.iter().collect();
        by_area.sort_by(|a, b| area_mm2(&[**a]).total_cmp(&area_mm2(&[**b])));
        let sample = by_area[by_area.len() / 2];
        let own_mm2 = area_mm2(&[*sample]);
        let settings = Settings {
            quality: Quality::Fast,
            ..self.settings.clone()
        };
        let aperture = &settings.aperture;
        let usual_mm2_s = settings.speed_mm_s * (aperture.major_mm() + aperture.minor_mm());
        let planned = seconds_of(sample, &settings).ok();
        let planned = planned.filter(|seconds| *seconds > 0.0 && own_mm2 > 0.0);
        planned.map_or(1.0 / usual_mm2_s, |seconds| seconds / own_mm2)
    }
}

fn area_mm2(layers: &[&PartLayer]) -> f64 {
    let regions = layers.iter().flat_map(|layer| &layer.regions);
    regions.map(Region::area_mm2).sum()
}

/// Compares a skin with layers that are all curved; true where all of them are curved.
pub fn compared(
    (skin_layers, skin): (u32, &Division),
    all: &Division,
    flat_mm3: f64,
    settings: &Settings,
) -> ([Compared; 2], bool) {
    let mut seconds = Seconds::on(settings);
    let mut of = |layers: CurvedLayers, division: &Division| Compared {
        layers,
        stair_error_mm3: division.stair_error_mm3,
        seconds: seconds.of(&division.layers),
    };
    let both = [
        of(CurvedLayers::Skin(skin_layers), skin),
        of(CurvedLayers::All, all),
    ];
    (both, is_second_better(&both, flat_mm3))
}

fn is_second_better([one, other]: &[Compared; 2], flat_mm3: f64) -> bool {
    let stairs = (other.stair_error_mm3 - one.stair_error_mm3) / flat_mm3.max(1e-12);
    let time = (other.seconds - one.seconds) / one.seconds.max(1e-12);
    stairs / STAIRS_SHARE + time / TIME_SHARE < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: the better of two is that which is better in one and no worse in the other, and a little of the stairs is not
    /// bought with a lot of time, nor the other way round. Method: numbers whose answer is plain.
    #[test]
    fn stairs_and_seconds_both_count() {
        let of = |stair_error_mm3: f64, seconds: f64| Compared {
            layers: CurvedLayers::All,
            stair_error_mm3,
            seconds,
        };
        let skin = of(2.0, 1000.0);
        for (all, is_better) in [
            (of(2.0, 900.0), true),
            (of(2.0, 1100.0), false),
            (of(1.0, 1000.0), true),
            (of(3.0, 1000.0), false),
            // 2 % of the stairs for half as much time again; a tenth of the time for 2 % of the stairs.
            (of(1.0, 1500.0), false),
            (of(3.0, 900.0), true),
            // A fifth of the stairs for a tenth of the time.
            (of(12.0, 900.0), false),
        ] {
            assert_eq!(is_second_better(&[skin, all], 50.0), is_better, "{all:?}");
        }
        assert!(!is_second_better(&[skin, skin], 50.0));
    }
}
