//! The regions of a part, on all layers: what is inside their walls, and what hangs.
//!
//! In: the outlines of all layers (mm, input coordinates), settings. Out: a [`PartBody`], which knows the inside of each
//! layer. Leaves out how regions are filled.

use crate::geometry::polygon::Region;
use crate::pipeline::roofs::Roofs;
use crate::plan::layers::bridge_ground::Bridge;
use crate::plan::layers::hollow::{Hollow, bridges_of, shell_layers, wide_spans};
use crate::plan::layers::inside::Inside;
use crate::plan::layers::shells::solid_ground;
use crate::settings::Settings;
use rayon::prelude::*;
use std::ops::Range;

/// Regions of the layers.
pub struct PartBody<'a> {
    outlines: &'a [&'a [Region]],
    settings: Settings,
    hollow: Option<Hollow<'a>>,
    /// Of each wanted layer.
    bridges: Vec<Vec<Bridge>>,
    /// What spans much.
    pub roofs: Roofs,
}

impl<'a> PartBody<'a> {
    /// The body of these outlines, with the bridges of the wanted layers.
    pub fn new(
        outlines: &'a [&'a [Region]],
        wanted: &Range<u32>,
        settings: &Settings,
    ) -> PartBody<'a> {
        let (settings, mut roofs) = Roofs::settled(outlines, settings);
        let hollow = Hollow::of(outlines, &settings);
        let bridges = (0..outlines.len()).into_par_iter();
        let bridges: Vec<Vec<Bridge>> = bridges
            .map(|layer| match wanted.contains(&(layer as u32)) {
                true => bridges_of(hollow.as_ref(), outlines, layer, &settings),
                false => Vec::new(),
            })
            .collect();
        let numbered = (0u32..).zip(&bridges);
        let numbered = numbered.flat_map(|(layer, own)| own.iter().map(move |one| (layer, one)));
        roofs.wide = wide_spans(outlines, numbered, &settings);
        PartBody {
            outlines,
            settings,
            hollow,
            bridges,
            roofs,
        }
    }

    /// What is inside the walls on a layer. Between the solid areas the only solid layers are those of the shells.
    pub fn inside(&self, layer: u32) -> Inside {
        let infill = self.settings.infill;
        let solid = match &infill {
            Some(infill) if !infill.is_solid() => match &self.hollow {
                Some(hollow) => hollow.solid(layer as usize).to_vec(),
                None => solid_ground(self.outlines, layer as usize, shell_layers(infill)),
            },
            _ => Vec::new(),
        };
        Inside {
            infill: infill.map(|infill| infill.inside(layer)),
            solid,
            bridges: self.bridges[layer as usize].clone(),
        }
    }

    /// Where a layer is bridged.
    pub fn bridged(&self, layer: usize) -> Vec<Region> {
        let bridges = self.bridges[layer].iter();
        bridges.flat_map(|bridge| bridge.ground.clone()).collect()
    }

    /// What of a solid layer lies over an inside that does not hold it.
    pub fn unheld(&self, layer: usize) -> Vec<Region> {
        let hollow = self.hollow.as_ref();
        hollow.map_or(Vec::new(), |hollow| hollow.unheld(layer))
    }
}
