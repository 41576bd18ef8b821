//! A skin: flat layers, and so many curved ones over them that follow the top.
//!
//! In: the mesh, which stands on z = 0 (mm), and its top. Out: layers in the order that they are printed in. The curved
//! ones lie a layer height below each other, the last one on the top itself; the lowest of them takes what the flat ones
//! below leave, half a layer to one and a half. Each piece of the top has a skin of its own. It reaches beyond the piece
//! as far as the top is within half a layer of where the piece leads, and ends there as a flat layer does: where the part
//! ends at the layer's middle.

use super::Job;
use super::layer_shape::{Below, LevelSurface, PartLayer, Shape};
use super::sections::{above, sections};
use super::smooth_top::FollowedTop;
use super::top_grid::TopGrid;
use crate::geometry::boolean::{difference, intersection};
use crate::geometry::polygon::Region;
use crate::mesh::Point3;
use crate::mesh::slice::Slicer;
use crate::text::refusal::{Refusal, refusal};
use std::sync::Arc;

/// How far a skin may reach beyond its piece, of the nozzle's half length.
const BEYOND: f64 = 4.0;

/// A piece with its ground.
struct Skin {
    /// The top, continued beyond the piece.
    top: LevelSurface,
    /// Where the piece's skin may lie.
    zone: Vec<Region>,
    /// Grid and heights of the lowest curved layer's underside, for where flat layers end.
    under: (TopGrid, Vec<f64>),
    rank_mm: f64,
}

/// The layers of a part with a skin of so many.
///
/// # Errors
/// Where the part is too low for it.
pub fn layers_with_skin(
    job: &Job,
    tops: &[FollowedTop],
    skin_layers: u32,
) -> Result<Vec<PartLayer>, Refusal> {
    let layer_mm = job.layer_mm;
    check_height(job, tops, skin_layers)?;
    let mut taken: Vec<Region> = Vec::new();
    let mut skins = Vec::new();
    for top in tops {
        let skin = Skin::of(job, top, skin_layers, &taken);
        taken.extend(skin.zone.iter().cloned());
        skins.push(skin);
    }
    let flat = flat_layers(job, &skins);
    let curved = skins.iter().flat_map(|skin| skin.layers(job, skin_layers));
    let mut layers: Vec<PartLayer> = flat.into_iter().chain(curved).collect();
    layers.retain(|layer| !layer.regions.is_empty());
    // Rounding does not decide between a flat layer and one that ends at the same height.
    let rank = |layer: &PartLayer| (layer.rank_mm / layer_mm * 1e6).round();
    layers.sort_by(|a, b| rank(a).total_cmp(&rank(b)));
    Ok(layers)
}

/// How many curved layers fit over the lowest place of pieces, and that place.
fn layers_max(job: &Job, tops: &[FollowedTop]) -> (u32, usize) {
    let cells = tops.iter().flat_map(|top| top.piece.cells.iter().copied());
    let height_mm = |cell: usize| job.grid.z_mm[cell];
    let lowest = cells.min_by(|&a, &b| height_mm(a).total_cmp(&height_mm(b)));
    let lowest = lowest.unwrap_or_default();
    let most = (height_mm(lowest) / job.layer_mm + 0.5).floor().max(0.0) as u32;
    (most, lowest)
}

fn check_height(job: &Job, tops: &[FollowedTop], skin_layers: u32) -> Result<(), Refusal> {
    let (layers_max, lowest) = layers_max(job, tops);
    if skin_layers <= layers_max {
        return Ok(());
    }
    let at = job.grid.place(lowest);
    Err(refusal!(
        "--curved-layers skin:{skin_layers}: the top near ({:.2}, {:.2}) mm is {:.2} mm high, too low for {skin_layers} \
         curved layers: at most skin:{layers_max} fits, or thinner layers (--layer-height)",
        at.x,
        at.y,
        job.grid.z_mm[lowest]
    ))
}

impl Skin {
    fn of(job: &Job, followed: &FollowedTop, skin_layers: u32, taken: &[Region]) -> Skin {
        let piece = &followed.piece;
        let grid = &job.grid;
        let beyond_mm = BEYOND * job.settings.aperture.major_mm();
        let margin = (beyond_mm / grid.step_mm).ceil() as usize + 2;
        let top = LevelSurface {
            base: Arc::clone(&followed.surface),
            offset_mm: 0.0,
        };
        let (grown, away) = grid.distances_mm(piece, margin);
        let near: Vec<f64> = away.iter().map(|away_mm| beyond_mm - away_mm).collect();
        let zone = above(&grown, &near, &[0.0]).remove(0);
        let height = |p: &Point3| p.z - top.z_mm(p.xy());
        let higher = sections(&job.mesh, &height, &[0.5 * job.layer_mm], job.layer_mm).remove(0);
        let zone = difference(&difference(&zone, &higher), taken);
        let skin_mm = f64::from(skin_layers) * job.layer_mm;
        let cells = 0..grown.count[0] * grown.count[1];
        let under = cells.map(|cell| top.z_mm(grown.place(cell)) - skin_mm);
        let heights = piece.cells.iter().map(|&cell| grid.z_mm[cell]);
        Skin {
            rank_mm: heights.fold(0.0, f64::max),
            zone,
            under: (grown.clone(), under.collect()),
            top,
        }
    }

    /// Its curved layers, upwards.
    fn layers(&self, job: &Job, skin_layers: u32) -> Vec<PartLayer> {
        let layer_mm = job.layer_mm;
        let below_top_mm: Vec<f64> = (0..skin_layers)
            .map(|number| layer_mm * f64::from(skin_layers - 1 - number))
            .collect();
        let middles: Vec<f64> = below_top_mm
            .iter()
            .map(|below| -below - 0.5 * layer_mm)
            .collect();
        let height = |p: &Point3| p.z - self.top.z_mm(p.xy());
        let sections = sections(&job.mesh, &height, &middles, layer_mm);
        let surface = |below_mm: f64| LevelSurface {
            offset_mm: -below_mm,
            ..self.top.clone()
        };
        let layers = sections.iter().zip(&below_top_mm).enumerate();
        layers
            .map(|(number, (section, &below_mm))| PartLayer {
                shape: Shape::Curved {
                    top: surface(below_mm),
                    below: match number {
                        0 => Below::Flat {
                            surface: surface(below_mm + layer_mm),
                            layer_mm,
                        },
                        _ => Below::Surface(surface(below_mm + layer_mm)),
                    },
                },
                regions: intersection(section, &self.zone),
                rank_mm: self.rank_mm - below_mm,
            })
            .collect()
    }
}

/// The flat layers without the ground of skins.
fn flat_layers(job: &Job, skins: &[Skin]) -> Vec<PartLayer> {
    let layer_mm = job.layer_mm;
    let count = (job.grid.highest_mm() / layer_mm + 0.5).floor() as u32;
    let middles: Vec<f64> = (0..count)
        .map(|number| layer_mm * (f64::from(number) + 0.5))
        .collect();
    let mut sections: Vec<Vec<Region>> = Slicer::new(&job.mesh)
        .sections(&middles)
        .into_iter()
        .map(|section| section.regions)
        .collect();
    for skin in skins {
        let under = above(&skin.under.0, &skin.under.1, &middles);
        for (section, under) in sections.iter_mut().zip(&under) {
            let of_skin = difference(&skin.zone, under);
            if !of_skin.is_empty() {
                *section = difference(section, &of_skin);
            }
        }
    }
    let layers = (1u32..).zip(sections);
    layers
        .map(|(number, regions)| PartLayer {
            shape: Shape::Flat {
                top_mm: layer_mm * f64::from(number),
            },
            regions,
            rank_mm: layer_mm * f64::from(number),
        })
        .collect()
}
