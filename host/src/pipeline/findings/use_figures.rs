//! Time and material of layers and kinds of bead, and the cost of the material, as figures.

use crate::pipeline::layer_time::SlowedLayers;
use crate::pipeline::layer_uses::LayerUse;
use crate::pipeline::stacked_ground::{OpenCells, stacked};
use crate::report::figures::{Figures, LayerFigures, UseFigures};
use crate::settings::Settings;
use std::collections::BTreeMap;

/// Layers that the figures list.
pub(super) const LAYERS_LISTED: usize = 1000;

/// The figures of a job's uses; `place_mm` is where a layer ends, and its height.
pub(crate) fn use_figures(
    uses: &[LayerUse],
    slowed: SlowedLayers,
    place_mm: impl Fn(u32) -> [f64; 2],
    settings: &Settings,
) -> Figures {
    if uses.is_empty() {
        return Figures::default();
    }
    let mut by_kind: BTreeMap<String, UseFigures> = BTreeMap::new();
    let mut by_layer: BTreeMap<u32, LayerFigures> = BTreeMap::new();
    for used in uses {
        let kind = by_kind.entry(used.what.name().to_string()).or_default();
        kind.seconds += used.seconds;
        kind.volume_mm3 += used.volume_mm3;
        kind.way_mm += used.way_mm;
        let layer = by_layer.entry(used.layer).or_insert_with(|| {
            let [z_mm, height_mm] = place_mm(used.layer);
            LayerFigures {
                layer: used.layer,
                z_mm,
                height_mm,
                ..LayerFigures::default()
            }
        });
        layer.seconds += used.seconds;
        layer.volume_mm3 += used.volume_mm3;
        *layer
            .seconds_by_kind
            .entry(used.what.name().to_string())
            .or_default() += used.seconds;
    }
    let volume_mm3: f64 = uses.iter().map(|used| used.volume_mm3).sum();
    let mut by_layer: Vec<LayerFigures> = by_layer.into_values().collect();
    by_layer.sort_by(|a, b| b.seconds.total_cmp(&a.seconds).then(a.layer.cmp(&b.layer)));
    by_layer.truncate(LAYERS_LISTED);
    let material = settings.material.as_ref();
    let density_g_cm3 = material.and_then(|material| material.density_g_cm3);
    let mass_g = density_g_cm3.map(|density| density * volume_mm3 * 1e-3);
    let price_per_kg = material.and_then(|material| material.price_per_kg);
    let diameter_mm = material.and_then(|material| material.diameter_mm);
    let section_mm2 = diameter_mm.map(|d| 0.25 * std::f64::consts::PI * d * d);
    let asked = settings.layer_time_min_s > 0.0;
    Figures {
        by_kind: Some(by_kind),
        by_layer: Some(by_layer),
        mass_g,
        material_cost: mass_g.zip(price_per_kg).map(|(g, price)| g * 1e-3 * price),
        filament_mm: section_mm2.map(|section| volume_mm3 / section),
        slowed_layers: asked.then_some(u64::from(slowed.layers)),
        short_layers: asked.then_some(u64::from(slowed.still_short)),
        ..Figures::default()
    }
}

/// Stacked uncovered area; none of one layer.
pub(crate) fn stacked_figures((cells, layers): &(OpenCells, u32)) -> Figures {
    if *layers < 2 {
        return Figures::default();
    }
    let (most, area_mm2) = stacked(cells, *layers);
    Figures {
        open_ground_stacked_max_layers: Some(u64::from(most)),
        open_ground_stacked_mm2: Some(area_mm2),
        ..Figures::default()
    }
}

/// The note on layers that are still too short.
pub(crate) fn short_layers_note(slowed: SlowedLayers, settings: &Settings) -> Option<String> {
    (slowed.still_short > 0).then(|| {
        format!(
            "{} layers are over in less than {} s even at {} mm/s: print several parts at a time, or \
             lower slow_speed_min_mm_s",
            slowed.still_short, settings.layer_time_min_s, settings.slow_speed_min_mm_s
        )
    })
}
