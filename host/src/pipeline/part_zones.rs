//! An object whose volumes have settings of their own, layer by layer: what has walls of its own, and what is filled alike.
//!
//! In: the outlines of an object (mm, input coordinates), the sections of its volumes, settings. Out: [`ZonedLayer`]s. Where
//! a volume asks for another number of walls, or for speeds, the layer is divided at its border, and both sides have walls
//! along it; otherwise the walls of the object go around all of it, and only what is inside them is divided. Leaves out
//! seams of volumes.

use crate::geometry::boolean::{difference, filled, intersection};
use crate::geometry::polygon::Region;
use crate::geometry::repair::FillRule;
use crate::mesh::layers::TargetLayer;
use crate::mesh::object_settings::{OwnSettings, Zone};
use crate::mesh::slice::Slicer;
use crate::plan::layers::bridge_ground::is_wide;
use crate::plan::layers::hollow::{Hollow, MixedLayer, inside_walls, shell_layers};
use crate::plan::layers::shells::solid_ground;
use crate::settings::kinds::Kinds;
use crate::settings::{Infill, Settings};
use rayon::prelude::*;

/// What regions are printed with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fill {
    /// Walls and lines.
    pub infill: Infill,
    /// Speeds and flows by kind.
    pub kinds: Kinds,
}

/// A layer of an object, divided. Each of both covers all of it.
#[derive(Clone, Debug, Default)]
pub struct ZonedLayer {
    /// What has walls of its own; of its infill only their number counts.
    pub walled: Vec<(Fill, Vec<Region>)>,
    /// What is filled alike.
    pub areas: Vec<(Infill, Vec<Region>)>,
    /// Filled: by its density, or as one of the solid layers that close the part.
    pub solid: Vec<Region>,
}

/// The layers of an object with these outlines and settings; `None` if it has no walls.
pub fn zoned_layers(
    outlines: &[Vec<Region>],
    zones: &[Zone],
    layers: &[TargetLayer],
    settings: &Settings,
) -> Option<Vec<ZonedLayer>> {
    let base = Fill {
        infill: settings.infill?,
        kinds: settings.kinds,
    };
    let middles = layers
        .iter()
        .map(|layer| layer.top_mm - 0.5 * layer.height_mm);
    let middles: Vec<f64> = middles.collect();
    let sections = zones.iter().map(|zone| {
        let sections = Slicer::new(&zone.mesh).sections(&middles);
        let sections = sections.into_iter().map(|section| section.regions);
        sections.collect::<Vec<Vec<Region>>>()
    });
    let sections: Vec<Vec<Vec<Region>>> = sections.collect();
    let all: Vec<&[Region]> = outlines.iter().map(Vec::as_slice).collect();
    let layers = (0..outlines.len()).into_par_iter().map(|layer| {
        let of_layer = |of: fn(&OwnSettings) -> OwnSettings| {
            let zones = zones.iter().zip(&sections);
            let cuts = zones.map(|(zone, sections)| Cut {
                own: of(&zone.own),
                is_part: zone.is_part,
                section: &sections[layer],
            });
            divided(&outlines[layer], base, cuts, settings)
        };
        let areas = of_layer(OwnSettings::of_lines);
        let areas: Vec<(Infill, Vec<Region>)> = areas
            .into_iter()
            .map(|(fill, area)| (fill.infill, area))
            .collect();
        let solid = areas
            .iter()
            .flat_map(|(infill, area)| match infill.is_solid() {
                true => area.clone(),
                false => intersection(area, &solid_ground(&all, layer, shell_layers(infill))),
            });
        ZonedLayer {
            walled: of_layer(OwnSettings::of_walls),
            solid: solid.collect(),
            areas,
        }
    });
    Some(layers.collect())
}

/// A volume on a layer.
struct Cut<'a> {
    own: OwnSettings,
    is_part: bool,
    section: &'a [Region],
}

/// An outline divided by volumes, of which the last one counts where several are. What is thinner than a bead belongs to
/// what is beside it.
fn divided<'a>(
    outline: &[Region],
    base: Fill,
    cuts: impl Iterator<Item = Cut<'a>>,
    settings: &Settings,
) -> Vec<(Fill, Vec<Region>)> {
    let bead_mm = 2.0 * settings.aperture.major_mm();
    let mut cells = vec![(base, outline.to_vec())];
    for cut in cuts.filter(|cut| !cut.section.is_empty()) {
        let mut next: Vec<(Fill, Vec<Region>)> = Vec::with_capacity(cells.len() + 1);
        let mut push = |fill: Fill, ground: Vec<Region>| match next
            .iter_mut()
            .find(|(known, _)| *known == fill)
        {
            Some((_, known)) => known.extend(ground),
            None if ground.is_empty() => {}
            None => next.push((fill, ground)),
        };
        for (fill, ground) in cells {
            let own = cut.over(if cut.is_part { base } else { fill }, settings);
            if own == fill {
                push(fill, ground);
                continue;
            }
            let [inside, outside] = halves(&ground, cut.section, bead_mm);
            push(fill, outside);
            push(own, inside);
        }
        cells = next;
    }
    if let [(_, ground)] = &mut cells[..] {
        *ground = outline.to_vec();
    }
    for (_, ground) in cells.iter_mut().filter(|(_, ground)| ground.len() > 1) {
        *ground = filled(ground.iter().flat_map(Region::rings), FillRule::Positive);
    }
    cells
}

impl Cut<'_> {
    fn over(&self, fill: Fill, settings: &Settings) -> Fill {
        let around = Settings {
            infill: Some(fill.infill),
            kinds: fill.kinds,
            ..settings.clone()
        };
        let own = self.own.over(&around);
        own.map_or(fill, |own| Fill {
            infill: own.infill.unwrap_or(fill.infill),
            kinds: own.kinds,
        })
    }
}

/// The ground inside and outside of a section.
fn halves(ground: &[Region], section: &[Region], bead_mm: f64) -> [Vec<Region>; 2] {
    let mut inside = intersection(ground, section);
    inside.retain(|piece| is_wide(piece, bead_mm));
    if inside.is_empty() {
        return [inside, ground.to_vec()];
    }
    let outside = difference(ground, &inside);
    let (wide, thin): (Vec<Region>, Vec<Region>) = outside
        .into_iter()
        .partition(|piece| is_wide(piece, bead_mm));
    if wide.is_empty() {
        return [ground.to_vec(), wide];
    }
    match thin.is_empty() {
        true => [inside, wide],
        false => [difference(ground, &wide), wide],
    }
}

/// The inside of such layers, where it has to be spanned.
pub fn mixed_hollow<'a>(
    outlines: &'a [&'a [Region]],
    layers: &[ZonedLayer],
    settings: &Settings,
) -> Option<Hollow<'a>> {
    let bead_mm = 2.0 * settings.aperture.major_mm();
    let mixed = layers.par_iter().map(|layer| {
        let walled = layer.walled.iter();
        let inside = walled.flat_map(|(fill, ground)| {
            inside_walls(ground, f64::from(fill.infill.walls) * bead_mm, bead_mm)
        });
        let (sparse, dense): (Vec<_>, Vec<_>) = layer
            .areas
            .iter()
            .partition(|(infill, _)| Hollow::is_sparse(infill.density_pct));
        let dense = dense.into_iter().flat_map(|(_, area)| area.clone());
        let sparse = sparse.into_iter();
        MixedLayer {
            inside: inside.collect(),
            dense: layer.solid.iter().cloned().chain(dense).collect(),
            sparse: sparse
                .map(|(infill, area)| (infill.density_pct, area.clone()))
                .collect(),
        }
    });
    Hollow::of_mixed(outlines, mixed.collect(), settings)
}
