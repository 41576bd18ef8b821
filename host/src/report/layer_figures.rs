//! Figures of layers, of layer groups, and of kinds of bead.
//!
//! In and out: parts of [`super::figures::Figures`]; mm, mm², mm³, s, per cent.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Infill inside the walls of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Inside {
    /// Straight lines.
    Lines,
    /// Straight lines along narrow strips.
    LinesAlong,
    /// Loops, where a solid infill has too little room for lines.
    Loops,
    /// Lines in some regions, loops or lines along strips in others.
    LinesAndLoops,
    /// The walls leave no area, or it stays uncovered.
    Nothing,
}

/// An area of a layer, by a point in it; input coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LayerPlace {
    /// Where.
    pub x_mm: f64,
    /// Where.
    pub y_mm: f64,
    /// The layer's top.
    pub z_mm: f64,
    /// How much.
    pub area_mm2: f64,
}

/// What arrives of a layer's passes, of a known material.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LaidLayerFigures {
    /// From 0.
    pub layer: u32,
    /// As planned.
    pub asked_mm3: f64,
    /// As laid.
    pub laid_mm3: f64,
}

/// Figures of the layers of one group; only for jobs with several layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct KindFigures {
    /// The lowest of them, from 0.
    pub first_layer: u32,
    /// How many they are.
    pub layers: u32,
    /// Requested density inside the walls.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub infill_density_pct: Option<f64>,
    /// Direction of the lines there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub infill_angle_deg: Option<f64>,
    /// The infill there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inside: Option<Inside>,
    /// Resulting density.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub infill_covered_pct: Option<f64>,
    /// Share of the outline that is covered.
    pub covered_pct: f64,
    /// Share of the outline that is swept more than once on the layer.
    pub overlap_pct: f64,
    /// Largest depth of a placed aperture outside the outline.
    pub outside_depth_mm: f64,
}

impl KindFigures {
    /// The infill inside the walls, as text; `None` if there are no walls.
    pub fn inside_text(&self) -> Option<String> {
        let (pct, deg) = (self.infill_density_pct?, self.infill_angle_deg?);
        let lines = format!("{pct} % lines at {deg:.0}°");
        Some(match self.inside? {
            Inside::Lines => lines,
            Inside::LinesAlong => format!("{pct} % lines along narrow strips"),
            Inside::Loops => "loops inside".to_string(),
            Inside::LinesAndLoops => format!("{lines}, loops or lines along where it is narrow"),
            Inside::Nothing => "walls alone".to_string(),
        })
    }

    pub(super) fn row(&self) -> (String, String) {
        let what = match self.layers {
            0 | 1 => format!("layer {}", self.first_layer + 1),
            layers => format!("layer {} and {} like it", self.first_layer + 1, layers - 1),
        };
        let mut value = format!(
            "{:.2} % covered, {:.2} % overlap",
            self.covered_pct, self.overlap_pct
        );
        if let Some(inside) = self.inside_text() {
            value += &format!(", {inside}");
        }
        if let Some(pct) = self.infill_covered_pct {
            value += &format!(" ({pct:.1} % came out)");
        }
        (what, value)
    }
}

/// Time and material for one kind of bead, for travel or rests.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct UseFigures {
    /// How long.
    pub seconds: f64,
    /// The deposited volume.
    pub volume_mm3: f64,
    /// Path length of the tip.
    pub way_mm: f64,
}

/// Time and material of a layer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LayerFigures {
    /// Its number, from 0.
    pub layer: u32,
    /// Its top.
    pub z_mm: f64,
    /// From its bottom to its top.
    pub height_mm: f64,
    /// How long.
    pub seconds: f64,
    /// The deposited volume.
    pub volume_mm3: f64,
    /// How long by kind.
    pub seconds_by_kind: BTreeMap<String, f64>,
}
