//! Closed mesh and layer heights -> the regions of every layer.
//!
//! Layers are counted up from the mesh's lowest point; the first may have a height of its own, and so may
//! ranges of z. Each is the section at half its height, so that the errors of a slope on both halves
//! cancel. A range begins and ends with a layer: its layers are made thinner until a whole number of them
//! fits, and so are those between ranges. The last layer is the last one whose middle is in the part: up
//! to half a layer is lost or gained at the top.

use super::read::bounds_mm;
use super::slice::{Section, Slicer};
use super::{Carved, Mesh};
use crate::geometry::boolean::{difference, filled};
use crate::geometry::polygon::Region;
use crate::geometry::repair::FillRule;
use crate::settings::LAYERS_MAX;
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;
use rayon::prelude::*;
use std::ops::Range;

/// A middle that is this near below the top cuts nothing but rounding, mm.
const HAIR_MM: f64 = 1e-5;

/// Least and greatest height of a layer, mm, as in machine files.
pub const LAYER_MM: [f64; 2] = [0.001, 500.0];

/// How a part is divided.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerHeights {
    /// Of the first layer, mm.
    pub first_mm: f64,
    /// Of the others, mm.
    pub layer_mm: f64,
    /// Ranges with their own heights, upwards, without overlap.
    pub ranges: Vec<HeightRange>,
    /// First and last requested layer, counted from 1; `None` for all.
    pub range: Option<[u32; 2]>,
}

impl LayerHeights {
    /// Heights of a part's layers, checked. A first layer without a height of its own has that of the range that begins
    /// with it.
    ///
    /// # Errors
    /// A `Refusal` with the option.
    pub fn of(
        layer_mm: f64,
        first_mm: Option<f64>,
        ranges: Vec<HeightRange>,
        range: Option<[u32; 2]>,
    ) -> Result<LayerHeights, Refusal> {
        check_height("--layer-height", layer_mm)?;
        let lowest = ranges.first().filter(|range| range.from_mm <= 0.0);
        let of_others_mm = lowest.map_or(layer_mm, |range| range.fitted_mm(range.to_mm));
        let first_mm = first_mm.unwrap_or(of_others_mm);
        check_height("--first-layer-height", first_mm)?;
        if let Some(range) = ranges.first().filter(|range| range.to_mm <= first_mm) {
            let to_mm = range.to_mm;
            return Err(refusal!(
                "--layer-heights: the range up to {to_mm} mm lies in the first layer, which is {first_mm} mm high: leave it \
                 out or give a smaller --first-layer-height"
            ));
        }
        Ok(LayerHeights {
            first_mm,
            layer_mm,
            ranges,
            range,
        })
    }
}

/// Refuses a height that layers cannot have.
///
/// # Errors
/// A `Refusal` with the option.
pub fn check_height(option: &'static str, height_mm: f64) -> Result<(), Refusal> {
    match (LAYER_MM[0]..=LAYER_MM[1]).contains(&height_mm) {
        true => Ok(()),
        false => Err(refusal!(
            "{option} {height_mm}: write a height of {} to {} mm",
            LAYER_MM[0],
            LAYER_MM[1]
        )),
    }
}

/// Ranges and bands that are reported one by one.
const BANDS_TOLD: usize = 12;

/// Layers of a height of their own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeightRange {
    /// Where they begin above the part's lowest point, mm.
    pub from_mm: f64,
    /// Where they end.
    pub to_mm: f64,
    /// How high they are at most.
    pub layer_mm: f64,
}

/// Layers of one height, over each other.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Band {
    from_mm: f64,
    layer_mm: f64,
    /// How many there are; infinite above the last range.
    layers: f64,
    is_range: bool,
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
    /// The regions to print; none where the part is interrupted.
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
    /// The layers of the requested range.
    pub fn wanted_layers(&self) -> &[TargetLayer] {
        &self.layers[self.wanted.start as usize..self.wanted.end as usize]
    }

    /// Areas times heights of these, mm³.
    pub fn volume_mm3(&self) -> f64 {
        let layers = self.wanted_layers().iter();
        layers.map(|layer| layer.area_mm2() * layer.height_mm).sum()
    }
}

/// Share of a layer that a range may be longer than a whole number of them.
const FIT_SHARE: f64 = 1e-6;

impl HeightRange {
    /// The height of its layers in the remaining part: the requested one if it fits.
    pub fn fitted_mm(&self, left_mm: f64) -> f64 {
        left_mm / fitting(left_mm, self.layer_mm)
    }
}

/// How many layers of at most this height make up a stretch.
fn fitting(stretch_mm: f64, layer_mm: f64) -> f64 {
    (stretch_mm / layer_mm - FIT_SHARE).ceil().max(1.0)
}

impl Band {
    fn between(from_mm: f64, to_mm: f64, layer_mm: f64, is_range: bool) -> Band {
        let layers = fitting(to_mm - from_mm, layer_mm);
        Band {
            from_mm,
            layer_mm: (to_mm - from_mm) / layers,
            layers,
            is_range,
        }
    }

    fn top_mm(&self) -> f64 {
        self.from_mm + self.layers * self.layer_mm
    }

    /// Bottom and top of one of its layers above the part's lowest point, mm.
    fn layer_mm(&self, number: u32) -> [f64; 2] {
        [number, number + 1].map(|below| self.from_mm + f64::from(below) * self.layer_mm)
    }
}

impl LayerHeights {
    /// The layers of a part of this height: their middles are in it. Of each band as many as that are.
    fn bands(&self, height_mm: f64) -> Vec<Band> {
        let first = Band {
            from_mm: 0.0,
            layer_mm: self.first_mm,
            layers: 1.0,
            is_range: false,
        };
        let (mut bands, mut top_mm) = (vec![first], self.first_mm);
        for range in &self.ranges {
            if range.from_mm > top_mm + FIT_SHARE * self.layer_mm {
                bands.push(Band::between(top_mm, range.from_mm, self.layer_mm, false));
                top_mm = range.from_mm;
            }
            if range.to_mm > top_mm {
                bands.push(Band::between(top_mm, range.to_mm, range.layer_mm, true));
                top_mm = range.to_mm;
            }
        }
        bands.push(Band {
            from_mm: top_mm,
            layer_mm: self.layer_mm,
            layers: f64::INFINITY,
            is_range: false,
        });
        for band in &mut bands {
            let inside_mm = height_mm - HAIR_MM - band.from_mm;
            let inside = (inside_mm / band.layer_mm - 0.5).ceil().max(0.0);
            band.layers = band.layers.min(inside);
        }
        bands.retain(|band| band.layers > 0.0);
        bands
    }

    /// The note on ranges: their layers, and the layers between them.
    fn note(&self, bands: &[Band]) -> Option<String> {
        let mut told: Vec<Band> = bands.to_vec();
        if let [first, second, ..] = *bands
            && (first.layer_mm - second.layer_mm).abs() < FIT_SHARE * first.layer_mm
        {
            told.remove(0);
            told[0].from_mm = 0.0;
            told[0].layers += 1.0;
        }
        let top_mm = told.last()?.top_mm();
        let more = match told.len().saturating_sub(BANDS_TOLD) {
            0 => String::new(),
            more => format!(", and {more} more up to {top_mm:.3} mm"),
        };
        let lines = told.iter().take(BANDS_TOLD).map(|band| {
            let mm = |mm: f64| Short((mm * 1e4).round() / 1e4);
            let is_first = band.layers == 1.0 && band.from_mm == 0.0;
            format!(
                "{} of {} mm from {} to {} mm{}",
                band.layers,
                mm(band.layer_mm),
                mm(band.from_mm),
                mm(band.top_mm()),
                match band.is_range || is_first {
                    true => "",
                    false => " (no range: --layer-height)",
                }
            )
        });
        let lines = lines.collect::<Vec<_>>().join(", ");
        let beyond = self.ranges.iter();
        let beyond = match beyond.filter(|range| range.from_mm >= top_mm).count() {
            0 => String::new(),
            count => format!("; {count} of the ranges lie above the part"),
        };
        (!self.ranges.is_empty()).then(|| format!("layers: {lines}{more}{beyond}"))
    }
}

/// Cuts a part into layers.
///
/// # Errors
/// If it has no layer, too many, or none in the range.
pub fn sliced(mesh: &Mesh, heights: &LayerHeights) -> Result<SlicedPart, Refusal> {
    sliced_carved(mesh, &[], heights)
}

/// The same for a part with volumes subtracted from some of its objects.
///
/// # Errors
/// Also if nothing of the first layer remains.
pub fn sliced_carved(
    mesh: &Mesh,
    carved: &[Carved],
    heights: &LayerHeights,
) -> Result<SlicedPart, Refusal> {
    let solids = carved.iter().map(|carved| &carved.solid);
    let [low, high] = bounds_mm(std::iter::once(mesh).chain(solids));
    let height_mm = high.z - low.z;
    let bands = heights.bands(height_mm);
    let layers: f64 = bands.iter().map(|band| band.layers).sum();
    if height_mm - HAIR_MM <= heights.first_mm / 2.0 || layers < 1.0 {
        let first_mm = heights.first_mm;
        return Err(refusal!(
            "the part is {height_mm:.4} mm high, less than half of its first layer of {first_mm} mm: \
             turn it (--rotate), or give a smaller --layer-height"
        ));
    }
    if layers > f64::from(LAYERS_MAX) {
        let layer_mm = bands.iter().map(|band| band.layer_mm);
        let layer_mm = layer_mm.fold(heights.layer_mm, f64::min);
        return Err(refusal!(
            "{layers:.0} layers of {layer_mm} mm, more than {LAYERS_MAX}: give a larger --layer-height, \
             or check the units (--units)"
        ));
    }
    let layers = layers as u32;
    let [from, to] = heights.range.unwrap_or([1, layers]);
    if from < 1 || from > to || from > layers {
        return Err(refusal!(
            "--layer-range {from}-{to}: the part has layers 1 to {layers}"
        ));
    }
    let wanted = (from - 1)..to.min(layers);
    let layers_mm = bands.iter();
    let layers_mm: Vec<[f64; 2]> = layers_mm
        .flat_map(|band| (0..band.layers as u32).map(|number| band.layer_mm(number)))
        .collect();
    let middles = layers_mm.iter();
    let middles: Vec<f64> = middles
        .map(|[bottom, top]| low.z + 0.5 * (bottom + top))
        .collect();
    let sections = carved_sections(mesh, carved, &middles);
    if !carved.is_empty() && sections[0].regions.is_empty() {
        let first_mm = layers_mm[0][1];
        return Err(refusal!(
            "the negative volumes leave nothing of the first layer, {first_mm} mm high, at the part's lowest \
             point: move them up, or cut the part there and lay it on the bed before the export"
        ));
    }
    let notes = heights.note(&bands).into_iter();
    let notes = notes.chain(overlap_note(&sections, &middles)).collect();
    let layers = (0..layers).zip(layers_mm).zip(sections);
    let layers: Vec<TargetLayer> = layers
        .map(|((number, [bottom_mm, top_mm]), section)| TargetLayer {
            number,
            height_mm: top_mm - bottom_mm,
            top_mm: low.z + top_mm,
            regions: section.regions,
        })
        .collect();
    let part = SlicedPart {
        layers,
        wanted,
        notes,
    };
    let is_empty = |layer: &TargetLayer| layer.regions.is_empty();
    if part.wanted_layers().iter().all(is_empty) {
        return Err(refusal!(
            "there is nothing inside the mesh on layers {from} to {to}: choose other ones"
        ));
    }
    Ok(part)
}

/// The sections of the remaining part. Overlaps of its bodies are printed once.
fn carved_sections(mesh: &Mesh, carved: &[Carved], middles_mm: &[f64]) -> Vec<Section> {
    let mut sections = Slicer::new(mesh).sections(middles_mm);
    for Carved { solid, cut } in carved {
        let solid = Slicer::new(solid).sections(middles_mm);
        let cut = Slicer::new(cut).sections(middles_mm);
        let own = solid.into_par_iter().zip(cut);
        let own = own.map(|(solid, cut)| Section {
            regions: difference(&solid.regions, &cut.regions),
            overlap: solid.overlap,
        });
        let own: Vec<Section> = own.collect();
        for (all, own) in sections.iter_mut().zip(own) {
            if all.regions.is_empty() {
                all.regions = own.regions;
            } else if !own.regions.is_empty() {
                let both = [&all.regions[..], &own.regions].concat();
                let rings = both.iter().flat_map(Region::rings);
                all.regions = filled(rings, FillRule::Positive);
            }
            all.overlap = all.overlap.or(own.overlap);
        }
    }
    sections
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
