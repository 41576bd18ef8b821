//! Figures on curved layers.

use serde::{Deserialize, Serialize};

/// Layers that follow the top, and the stairs that are left.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CurvedLayerFigures {
    /// Flat layers.
    pub flat_layers: u64,
    /// Curved layers; each connected part of the top has its own.
    pub curved_layers: u64,
    /// Volume between the printed top and the part's, were all layers flat.
    pub stair_error_flat_mm3: f64,
    /// The same as planned.
    pub stair_error_mm3: f64,
    /// Least thickness of a curved layer, of the layer height.
    pub thickness_min: f64,
    /// Greatest one.
    pub thickness_max: f64,
    /// Steepest slope of a curved layer.
    pub slope_max_deg: f64,
    /// How deep the nozzle's edge gets below the top of the layer that it prints, where the head stays upright.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub edge_depth_mm: Option<f64>,
}

impl CurvedLayerFigures {
    /// In one line.
    pub fn text(&self) -> String {
        let edge = self.edge_depth_mm;
        let edge = edge.map(|mm| format!("; the upright nozzle's edge {mm:.3} mm in the layer"));
        format!(
            "{} over {} flat ones, {:.2} to {:.2} layers thick, up to {:.1}° steep; stairs {:.2} mm³ instead of {:.2}{}",
            self.curved_layers,
            self.flat_layers,
            self.thickness_min,
            self.thickness_max,
            self.slope_max_deg,
            self.stair_error_mm3,
            self.stair_error_flat_mm3,
            edge.unwrap_or_default()
        )
    }
}
