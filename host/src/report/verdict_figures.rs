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
