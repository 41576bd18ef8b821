//! What the page is given of a layer beside its pictures, and of the whole job.

use super::layer_path::LayerPath;
use super::track::Track;
use crate::geometry::polygon::Region;
use serde::Serialize;

/// The motion of a layer.
#[derive(Clone, Debug, Default)]
pub struct LayerMotion {
    /// Speeds and limits at even times.
    pub track: Track,
    /// Places and headings.
    pub path: LayerPath,
    /// What is laid of what was asked for, at the track's times; empty where no material is known.
    pub laid: Vec<f32>,
}

/// A layer without pictures of its own.
#[derive(Clone, Debug)]
pub struct PageLayer<'a> {
    /// Layer from 0.
    pub layer: u32,
    /// Which layer that is.
    pub label: String,
    /// The layer with pictures that is planned alike, from 0.
    pub like: Option<u32>,
    /// Its outline; nothing where it is not known.
    pub outline: &'a [Region],
    /// Its motion.
    pub motion: LayerMotion,
}

/// What a heater or the fan is set to from a moment on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HeatStep {
    /// When, in the job.
    pub at_s: f64,
    /// Which, with its unit.
    pub name: String,
    /// To what.
    pub to: f64,
}

/// What is the same for all layers of the page.
#[derive(Clone, Debug, Default, Serialize)]
pub struct PageFacts {
    /// How long the job takes.
    pub duration_s: f64,
    /// Height of a bead.
    pub bead_mm: f64,
    /// Distance of the lines of a sparse infill; `None` where there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sparse_pitch_mm: Option<f64>,
    /// Nothing is laid inside the walls but on solid layers.
    pub is_hollow: bool,
    /// What lines of the path are numbered by.
    pub line_name: &'static str,
    /// Lowest and highest corner of the work area, input coordinates; `None` where the table moves the part.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bed_mm: Option<[[f64; 3]; 2]>,
    /// In order of time.
    pub heat: Vec<HeatStep>,
}
