//! Figures of layers, of layer groups, and of kinds of bead.
//!
//! In and out: parts of [`super::figures::Figures`]; mm, mm², mm³, s, per cent.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What was laid inside the walls of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Inside {
    /// Straight lines.
    Lines,
    /// Loops, where a solid infill has too little room for lines.
    Loops,
    /// Lines in some regions and loops in others.
    LinesAndLoops,
    /// The walls leave no ground, or it stays open.
    Nothing,
}

/// Ground of a layer, by a place in it; input coordinates.
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

/// What the layers of one kind came to; only of jobs with several layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct KindFigures {
    /// The lowest of them, from 0.
    pub first_layer: u32,
    /// How many they are.
    pub layers: u32,
    /// Density that was asked for inside the walls.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub infill_density_pct: Option<f64>,
    /// Direction of the lines there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub infill_angle_deg: Option<f64>,
    /// What was laid there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inside: Option<Inside>,
    /// Density that came out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub infill_covered_pct: Option<f64>,
    /// Share of the outline that is covered.
    pub covered_pct: f64,
    /// Share of the outline that is swept more than once on the layer.
    pub overlap_pct: f64,
    /// How far any placed aperture leaves the outline.
    pub outside_depth_mm: f64,
}

impl KindFigures {
    /// What was laid inside the walls, for the eye; `None` where there are no walls.
    pub fn inside_text(&self) -> Option<String> {
        let (pct, deg) = (self.infill_density_pct?, self.infill_angle_deg?);
        let lines = format!("{pct} % lines at {deg:.0}°");
        Some(match self.inside? {
            Inside::Lines => lines,
            Inside::Loops => "loops inside".to_string(),
            Inside::LinesAndLoops => format!("{lines}, loops where it is narrow"),
            Inside::Nothing => "walls alone".to_string(),
        })
    }

    pub(super) fn row(&self) -> (String, Option<String>) {
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
        (what, Some(value))
    }
}

/// What is spent on one kind of bead, on travel or on standing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct UseFigures {
    /// How long.
    pub seconds: f64,
    /// What is deposited.
    pub volume_mm3: f64,
    /// Way of the tip.
    pub way_mm: f64,
}

/// What a layer takes.
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
    /// What is deposited.
    pub volume_mm3: f64,
    /// How long by kind.
    pub seconds_by_kind: BTreeMap<String, f64>,
}
