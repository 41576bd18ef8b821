//! Closed mesh and layer heights -> the regions of every layer.
//!
//! Layers are counted up from the mesh's lowest point; the first may have a height of its own. Each
//! is the section at half its height, so that what a slope gains on one half it loses on the
//! other. The last layer is the last one whose middle lies in the part: up to half a
//! layer is lost or gained at the top.

use super::slice::{Section, Slicer};
use super::{Mesh, MeshError};
use crate::geometry::polygon::Region;
use crate::settings::LAYERS_MAX;
use std::ops::Range;

/// A middle that is this near below the top cuts nothing but rounding, mm.
const HAIR_MM: f64 = 1e-5;

/// How a part is divided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerHeights {
    /// Of the first layer, mm.
    pub first_mm: f64,
    /// Of the others, mm.
    pub layer_mm: f64,
    /// First and last layer that are wanted, counted from 1; `None` for all.
    pub range: Option<[u32; 2]>,
}

/// One layer of a part.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetLayer {
    /// Number in the part, from 0.
    pub number: u32,
    /// From its bottom to its top, mm.
    pub height_mm: f64,
    /// Its top in input coordinates, mm.
    pub top_mm: f64,
    /// What is printed; nothing where the part is interrupted.
    pub regions: Vec<Region>,
}

/// A part by layers.
#[derive(Clone, Debug, PartialEq)]
pub struct SlicedPart {
    /// All of them, upwards.
    pub layers: Vec<TargetLayer>,
    /// The numbers of those that are wanted.
    pub wanted: Range<u32>,
    /// Where shells overlap.
    pub notes: Vec<String>,
}

impl TargetLayer {
    /// Area of its regions, mm².
    pub fn area_mm2(&self) -> f64 {
        self.regions.iter().map(Region::area_mm2).sum::<f64>() + 0.0
    }
}

impl SlicedPart {
    /// The layers of the range that was asked for.
    pub fn wanted_layers(&self) -> &[TargetLayer] {
        &self.layers[self.wanted.start as usize..self.wanted.end as usize]
    }

    /// Areas times heights of these, mm³.
    pub fn volume_mm3(&self) -> f64 {
        let layers = self.wanted_layers().iter();
        layers.map(|layer| layer.area_mm2() * layer.height_mm).sum()
    }
}

impl LayerHeights {
    /// Bottom and top of a layer above the part's lowest point, mm.
    fn of_layer_mm(&self, number: u32) -> [f64; 2] {
        let top_mm = |number: u32| self.first_mm + f64::from(number) * self.layer_mm;
        match number.checked_sub(1) {
            None => [0.0, self.first_mm],
            Some(below) => [top_mm(below), top_mm(number)],
        }
    }

    /// How many layers have their middle in a part of this height.
    fn count(&self, height_mm: f64) -> f64 {
        let beyond_mm = height_mm - HAIR_MM - self.first_mm;
        if height_mm - HAIR_MM <= self.first_mm / 2.0 {
            return 0.0;
        }
        1.0 + (beyond_mm / self.layer_mm - 0.5).ceil().max(0.0)
    }
}

/// Cuts a part into layers.
///
/// # Errors
/// Where it has no layer, too many, or none in the range.
pub fn sliced(mesh: &Mesh, heights: &LayerHeights) -> Result<SlicedPart, MeshError> {
    let [low, high] = mesh.bounds_mm();
    let height_mm = high.z - low.z;
    let layers = heights.count(height_mm);
    if layers < 1.0 {
        let first_mm = heights.first_mm;
        return Err(MeshError::NoLayer {
            height_mm,
            first_mm,
        });
    }
    if layers > f64::from(LAYERS_MAX) {
        let layer_mm = heights.layer_mm;
        return Err(MeshError::TooManyLayers { layers, layer_mm });
    }
    let layers = layers as u32;
    let [from, to] = heights.range.unwrap_or([1, layers]);
    if from < 1 || from > to || from > layers {
        return Err(MeshError::NoSuchLayer { from, to, layers });
    }
    let wanted = (from - 1)..to.min(layers);
    let middles: Vec<f64> = (0..layers)
        .map(|number| {
            let [bottom, top] = heights.of_layer_mm(number);
            low.z + 0.5 * (bottom + top)
        })
        .collect();
    let sections = Slicer::new(mesh).sections(&middles);
    let notes = overlap_note(&sections, &middles).into_iter().collect();
    let layers = (0..layers).zip(sections);
    let layers: Vec<TargetLayer> = layers
        .map(|(number, section)| {
            let [bottom_mm, top_mm] = heights.of_layer_mm(number);
            TargetLayer {
                number,
                height_mm: top_mm - bottom_mm,
                top_mm: low.z + top_mm,
                regions: section.regions,
            }
        })
        .collect();
    let part = SlicedPart {
        layers,
        wanted,
        notes,
    };
    let is_empty = |layer: &TargetLayer| layer.regions.is_empty();
    if part.wanted_layers().iter().all(is_empty) {
        return Err(MeshError::NothingInside { from, to });
    }
    Ok(part)
}

/// Tells of the worst overlap of all.
fn overlap_note(sections: &[Section], middles_mm: &[f64]) -> Option<String> {
    let found = sections.iter().zip(middles_mm);
    let found = found.filter_map(|(section, z_mm)| Some((section.overlap?, z_mm)));
    let count = found.clone().count();
    let ((mm2, at), z_mm) = found.max_by(|p, q| p.0.0.total_cmp(&q.0.0))?;
    Some(format!(
        "shells overlap or cross themselves on {count} layer{}, most at z = {z_mm:.3} mm near \
         ({:.3}, {:.3}): {mm2:.3} mm² wound around more than once, printed once",
        if count == 1 { "" } else { "s" },
        at.x,
        at.y
    ))
}
