//! Data in a job file in addition to the stream: the settings and the outline, so that a job can be
//! drawn and checked without its input.

use crate::geometry::Point2;
use crate::geometry::polygon::{Region, Ring};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Key of the machine file's text among a job's texts.
pub const SETTINGS_TEXT: &str = "settings";
/// Key of the outline's JSON among a job's texts.
pub const OUTLINE_TEXT: &str = "outline";
/// Key of the part's name among a job's texts.
pub const NAME_TEXT: &str = "name";

/// Key of the outlines of a part's layers among a job's texts.
pub const LAYER_OUTLINES_TEXT: &str = "layer_outlines";

/// Key of the kinds of the passes, a letter each, among a job's texts.
pub const PASS_KINDS_TEXT: &str = "pass_kinds";
/// Key of the passes that change their kind on their way: number, servo ticks from the start and letter of each change.
pub const LATER_KINDS_TEXT: &str = "later_kinds";

/// Longest text of the outlines of layers, bytes: those of layers beyond it are left out.
const LAYER_OUTLINES_MAX: usize = 1 << 20;

/// The outlines of a part whose layers differ.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LayerOutlines {
    /// The different ones, input coordinates.
    outlines: Vec<Vec<Region>>,
    /// Which of them each layer has.
    of_layer: BTreeMap<u32, usize>,
}

#[derive(Deserialize, Serialize)]
struct LayerOutlinesText {
    outlines: Vec<Vec<RegionText>>,
    of_layer: BTreeMap<u32, usize>,
}

impl LayerOutlines {
    /// From layers with their numbers; empty if all have the same outline.
    pub fn of<'a>(layers: impl Iterator<Item = (u32, &'a [Region])>) -> LayerOutlines {
        let mut all = LayerOutlines::default();
        for (number, regions) in layers.filter(|(_, regions)| !regions.is_empty()) {
            let known = all.outlines.iter().rposition(|known| known == regions);
            let outline = known.unwrap_or(all.outlines.len());
            if known.is_none() {
                all.outlines.push(regions.to_vec());
            }
            all.of_layer.insert(number, outline);
        }
        match all.outlines.len() {
            0 | 1 => LayerOutlines::default(),
            _ => all,
        }
    }

    /// True if the layers have one outline, or none is known.
    pub fn is_empty(&self) -> bool {
        self.of_layer.is_empty()
    }

    /// The outline of a layer; empty if it is not known.
    pub fn of_layer(&self, layer: u32) -> &[Region] {
        let outline = self.of_layer.get(&layer);
        let outline = outline.and_then(|&outline| self.outlines.get(outline));
        outline.map_or(&[], Vec::as_slice)
    }

    /// As JSON, as many of the lowest layers as fit.
    pub fn to_json(&self) -> String {
        let mut bytes = 0;
        let kept = self.outlines.iter().take_while(|regions| {
            bytes += outline_to_json(regions).len();
            bytes <= LAYER_OUTLINES_MAX
        });
        let outlines: Vec<Vec<RegionText>> = kept.map(|regions| region_texts(regions)).collect();
        let text = LayerOutlinesText {
            // Those without one are listed as well: they are known to have another one.
            of_layer: self.of_layer.clone(),
            outlines,
        };
        serde_json::to_string(&text).unwrap_or_default()
    }

    /// The output of [`LayerOutlines::to_json`]; `None` if it is something else.
    pub fn from_json(text: &str) -> Option<LayerOutlines> {
        let text: LayerOutlinesText = serde_json::from_str(text).ok()?;
        Some(LayerOutlines {
            outlines: text.outlines.into_iter().map(regions_of).collect(),
            of_layer: text.of_layer,
        })
    }
}

#[derive(Deserialize, Serialize)]
struct RegionText {
    exterior: Vec<[f64; 2]>,
    holes: Vec<Vec<[f64; 2]>>,
}

/// The regions as JSON, mm, input coordinates.
pub fn outline_to_json(regions: &[Region]) -> String {
    serde_json::to_string(&region_texts(regions)).unwrap_or_else(|_| "[]".to_string())
}

fn region_texts(regions: &[Region]) -> Vec<RegionText> {
    let ring = |ring: &Ring| ring.points.iter().map(|p| [p.x, p.y]).collect();
    let regions = regions.iter().map(|region| RegionText {
        exterior: ring(&region.exterior),
        holes: region.holes.iter().map(ring).collect(),
    });
    regions.collect()
}

/// The output of [`outline_to_json`]; `None` if it is something else.
pub fn outline_from_json(text: &str) -> Option<Vec<Region>> {
    Some(regions_of(serde_json::from_str(text).ok()?))
}

fn regions_of(regions: Vec<RegionText>) -> Vec<Region> {
    let ring = |points: Vec<[f64; 2]>| Ring {
        points: points.iter().map(|p| Point2::new(p[0], p[1])).collect(),
    };
    let regions = regions.into_iter().map(|region| Region {
        exterior: ring(region.exterior),
        holes: region.holes.into_iter().map(ring).collect(),
    });
    regions.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlines_come_back_bit_for_bit() {
        let ring = |offset: f64| Ring {
            points: (0..5)
                .map(|k| Point2::new(0.1 * f64::from(k) + offset, 1.0 / 3.0 + offset))
                .collect(),
        };
        let regions = vec![Region {
            exterior: ring(1000.7),
            holes: vec![ring(0.3), ring(-7e-7)],
        }];
        let text = outline_to_json(&regions);
        assert_eq!(outline_from_json(&text), Some(regions));
        assert_eq!(outline_from_json("{}"), None);
    }

    /// Goal: each layer of a part has its own outline, those that are the same once, a prism's none, and what
    /// does not fit is nothing rather than another layer's. Method: three layers of two outlines; one of a million points.
    #[test]
    fn layers_have_outlines_of_their_own() {
        let square = |size: f64, points: usize| {
            let along = (0..points).map(|k| Point2::new(size * k as f64 / points as f64, 0.0));
            let ring = Ring {
                points: along.chain([Point2::new(0.5 * size, size)]).collect(),
            };
            vec![Region {
                exterior: ring,
                holes: Vec::new(),
            }]
        };
        let (one, other, huge) = (square(1.0, 5), square(2.0, 5), square(3.0, 100_000));
        let layers = [(4, &one[..]), (5, &other), (6, &one), (7, &huge), (8, &[])];
        let outlines = LayerOutlines::of(layers.into_iter());
        assert_eq!(outlines.of_layer(7), huge);
        let text = outlines.to_json();
        assert!(text.len() < LAYER_OUTLINES_MAX);
        let read = LayerOutlines::from_json(&text).expect("outlines");
        let found = [4, 5, 6, 7, 8].map(|layer| read.of_layer(layer));
        assert_eq!(found, [&one[..], &other, &one, &[], &[]]);
        let prism = [(0, &one[..]), (1, &one)];
        assert!(LayerOutlines::of(prism.into_iter()).is_empty());
    }
}
