//! The verdict within the figures: its lines, and the time with another nozzle.

use serde::{Deserialize, Serialize};

/// The figures in words.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct VerdictFigures {
    /// Every reason not to start the job, one line each; empty for a good one.
    pub reasons: Vec<String>,
    /// Time, material, steps, limit, uncovered area: a sentence for each, as far as known.
    pub lines: Vec<String>,
}

/// The same part with another nozzle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AgainstFigures {
    /// The nozzle.
    pub aperture: String,
    /// Duration of the job with it; `None` if it cannot be printed with it.
    pub print_s: Option<f64>,
}

/// The places where finished beads are uneven in one way.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct UnevenFigures {
    /// `spin`, `thin`, `swollen`, `slow` or, of a known material, `area`.
    pub what: String,
    /// How many pieces of beads, each as long as the narrowest bead is wide.
    pub places: u64,
    /// Degrees beyond the turn of the path, per cent of an area, of the others a ratio to the bead before and behind.
    pub worst: f64,
    /// Where the worst is.
    pub x_mm: f64,
    /// Where the worst is.
    pub y_mm: f64,
    /// Where the worst is.
    pub z_mm: f64,
    /// Its layer from 0.
    pub layer: u32,
}
