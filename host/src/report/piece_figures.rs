//! Figures on pieces with build directions of their own.

use serde::{Deserialize, Serialize};

/// A piece.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PieceFigures {
    /// Its layers' normal, from the tip into the head, unit.
    pub direction: [f64; 3],
    /// A place on the plane that cuts it off, below it, as a file of directions has it; of the rest none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_mm: Option<[f64; 3]>,
    /// From Z.
    pub tilt_deg: f64,
    /// How many layers.
    pub layers: u64,
    /// Of all of them.
    pub height_mm: f64,
    /// Of all of them.
    pub volume_mm3: f64,
    /// Surface that hangs more than the material supports itself, were it printed upright.
    pub overhang_upright_mm2: f64,
    /// The same as planned.
    pub overhang_mm2: f64,
}

impl PieceFigures {
    /// Those of a part in one line.
    pub fn text(pieces: &[PieceFigures]) -> String {
        let sum = |of: fn(&PieceFigures) -> f64| pieces.iter().map(of).sum::<f64>();
        let tilts: Vec<String> = pieces
            .iter()
            .map(|of| format!("{:.0}°", of.tilt_deg))
            .collect();
        format!(
            "{} along {}; {:.2} mm² hang instead of {:.2}",
            pieces.len(),
            tilts.join(", "),
            sum(|of| of.overhang_mm2),
            sum(|of| of.overhang_upright_mm2)
        )
    }
}
