//! The verdict within the figures: its lines, and the time with another nozzle.

use serde::{Deserialize, Serialize};

/// The figures in words.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct VerdictFigures {
    /// Every reason not to start the job, one line each; none of a good one.
    pub reasons: Vec<String>,
    /// Time, material, steps, limit, what stays open: a sentence each, of what is known.
    pub lines: Vec<String>,
}

/// The same part with another nozzle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AgainstFigures {
    /// The nozzle.
    pub aperture: String,
    /// Duration of the job with it; nothing where it cannot be printed with it.
    pub print_s: Option<f64>,
}
