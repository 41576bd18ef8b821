//! What a known material lays, as figures.

use super::use_figures::LAYERS_LISTED;
use crate::drive::laid_beads::{LaidBeads, LaidPiece};
use crate::report::figures::{Figures, LaidLayerFigures, UnevenFigures};
use std::collections::BTreeMap;

/// Beads of less than this share of the job's mean cross-section have none that could be off by a share: ground that is
/// covered already.
const AREA_MIN_SHARE: f64 = 0.1;

/// The figures of a simulated job's beads.
pub fn laid_figures<'a>(beads: &'a LaidBeads) -> Figures {
    let sum = |of: fn(&LaidPiece) -> f64| beads.pieces.iter().map(of).sum::<f64>();
    let asked_mm3 = sum(|piece| piece.asked_mm3);
    let laid_mm3 = sum(|piece| piece.laid_mm3);
    let area_min_mm2 = AREA_MIN_SHARE * asked_mm3 / sum(|piece| piece.length_mm);
    let is_bead = |piece: &&LaidPiece| piece.asked_mm3 > area_min_mm2 * piece.length_mm;
    let all = beads.pieces.iter().filter(is_bead);
    let (ends, middle): (Vec<&LaidPiece>, Vec<&LaidPiece>) = all.partition(|of| of.is_end);
    let off_pct = |piece: &LaidPiece| 100.0 * piece.error().abs();
    let worst = |of: &[&'a LaidPiece]| {
        let worst = of.iter().copied();
        worst.max_by(|a, b| off_pct(a).total_cmp(&off_pct(b)))
    };
    let long_mm: f64 = middle.iter().map(|of| of.length_mm).sum();
    let off_mm: f64 = middle.iter().map(|of| off_pct(of) * of.length_mm).sum();
    Figures {
        laid_mm3: Some(laid_mm3),
        laid_error_pct: (asked_mm3 > 0.0).then(|| 100.0 * (laid_mm3 / asked_mm3 - 1.0)),
        laid_off_passes_mm3: Some(beads.off_passes_mm3),
        bead_area_error_pct_mean: (long_mm > 0.0).then(|| off_mm / long_mm),
        bead_area_error_pct_max: worst(&middle).map(off_pct),
        bead_area_error_ends_pct_max: worst(&ends).map(off_pct),
        bead_area_worst: worst(&middle).map(place),
        laid_by_layer: Some(layers(&beads.pieces)),
        ..Figures::default()
    }
}

fn place(piece: &LaidPiece) -> UnevenFigures {
    let [x_mm, y_mm, z_mm] = piece.at_mm;
    UnevenFigures {
        what: "area".to_string(),
        places: 1,
        worst: 100.0 * piece.error(),
        x_mm,
        y_mm,
        z_mm,
        layer: piece.layer,
    }
}

fn layers(pieces: &[LaidPiece]) -> Vec<LaidLayerFigures> {
    let mut layers: BTreeMap<u32, LaidLayerFigures> = BTreeMap::new();
    for piece in pieces {
        let layer = layers.entry(piece.layer).or_default();
        layer.layer = piece.layer;
        layer.asked_mm3 += piece.asked_mm3;
        layer.laid_mm3 += piece.laid_mm3;
    }
    layers.into_values().take(LAYERS_LISTED).collect()
}
