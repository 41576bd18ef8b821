//! The regions of a part that are filled alike, on all layers: what is inside their walls, and what hangs.
//!
//! In: the outlines of all layers (mm, input coordinates), settings. Out: [`PartBodies`], which know the inside of each
//! layer, one for each object with settings of its own and one for the rest. Leaves out how regions are filled.

use crate::geometry::Point2;
use crate::geometry::polygon::{Box2, Region};
use crate::mesh::layers::SlicedPart;
use crate::mesh::object_settings::PartObject;
use crate::pipeline::roofs::Roofs;
use crate::plan::layers::bridge_ground::Bridge;
use crate::plan::layers::hollow::{Hollow, bridges_of, shell_layers, wide_spans};
use crate::plan::layers::inside::{Inside, has_middle};
use crate::plan::layers::shells::solid_ground;
use crate::settings::Settings;
use rayon::prelude::*;
use std::ops::Range;

/// Regions of the layers that have the same settings.
struct PartBody<'a> {
    outlines: &'a [&'a [Region]],
    settings: Settings,
    hollow: Option<Hollow<'a>>,
    /// Of each wanted layer.
    bridges: Vec<Vec<Bridge>>,
    /// What spans much.
    roofs: Roofs,
}

impl<'a> PartBody<'a> {
    /// The body of these outlines, with the bridges of the wanted layers.
    fn new(outlines: &'a [&'a [Region]], wanted: &Range<u32>, settings: &Settings) -> PartBody<'a> {
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
    fn inside(&self, layer: u32) -> Inside {
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
    fn bridged(&self, layer: usize) -> Vec<Region> {
        let bridges = self.bridges[layer].iter();
        bridges.flat_map(|bridge| bridge.ground.clone()).collect()
    }

    /// What of a solid layer lies over an inside that does not hold it.
    fn unheld(&self, layer: usize) -> Vec<Region> {
        let hollow = self.hollow.as_ref();
        hollow.map_or(Vec::new(), |hollow| hollow.unheld(layer))
    }
}

/// The outlines of an object with settings of its own, or of what belongs to none.
pub struct Share {
    bounds: Option<Box2>,
    layers: Vec<Vec<Region>>,
    settings: Settings,
}

impl Share {
    /// Its outlines by layer.
    pub fn outlines(&self) -> Vec<&[Region]> {
        self.layers.iter().map(Vec::as_slice).collect()
    }
}

/// The shares of a part in which objects have settings of their own, the rest first; none if there are no such objects.
/// Also a note on objects whose settings cannot be followed.
pub fn shares(part: &SlicedPart, settings: &Settings) -> (Vec<Share>, Option<String>) {
    let widest_mm = 2.0 * settings.aperture.major_mm();
    let mut without_walls: Vec<&str> = Vec::new();
    let mut of_objects: Vec<(Box2, Settings)> = Vec::new();
    for PartObject {
        name,
        bounds_mm,
        infill,
    } in &part.objects
    {
        let Some(infill) = infill.over(settings.infill, widest_mm) else {
            without_walls.push(name.as_deref().unwrap_or("an object"));
            continue;
        };
        let [min, max] = bounds_mm.map(|corner| Point2::new(corner.x, corner.y));
        let own = Settings {
            infill: Some(infill),
            ..settings.clone()
        };
        of_objects.push((Box2 { min, max }, own));
    }
    let note = (!without_walls.is_empty()).then(|| {
        format!(
            "settings of {} are not followed without walls: give --walls",
            without_walls.join(", ")
        )
    });
    if of_objects.is_empty() {
        return (Vec::new(), note);
    }
    let owner = |region: &Region| {
        let mut objects = of_objects.iter();
        objects.position(|(around, _)| has_middle(*around, region.bounds()))
    };
    let of_owner = |wanted: Option<usize>| -> Vec<Vec<Region>> {
        let layers = part.layers.iter().map(|layer| {
            let own = layer
                .regions
                .iter()
                .filter(|region| owner(region) == wanted);
            own.cloned().collect()
        });
        layers.collect()
    };
    let rest = Share {
        bounds: None,
        layers: of_owner(None),
        settings: settings.clone(),
    };
    let objects = of_objects.iter().enumerate();
    let objects = objects.map(|(number, (around, own))| Share {
        bounds: Some(*around),
        layers: of_owner(Some(number)),
        settings: own.clone(),
    });
    (std::iter::once(rest).chain(objects).collect(), note)
}

/// The bodies of a part.
pub struct PartBodies<'a> {
    rest: PartBody<'a>,
    objects: Vec<(Box2, PartBody<'a>)>,
}

impl<'a> PartBodies<'a> {
    /// Of a part without shares, or of its shares with their outlines.
    pub fn new(
        whole: &'a [&'a [Region]],
        shares: &'a [(&'a Share, Vec<&'a [Region]>)],
        wanted: &Range<u32>,
        settings: &Settings,
    ) -> PartBodies<'a> {
        let rest = shares.first().map_or(whole, |(_, outlines)| outlines);
        let objects = shares.iter().filter_map(|(share, outlines)| {
            let body = PartBody::new(outlines, wanted, &share.settings);
            Some((share.bounds?, body))
        });
        PartBodies {
            rest: PartBody::new(rest, wanted, settings),
            objects: objects.collect(),
        }
    }

    fn all(&self) -> impl Iterator<Item = &PartBody<'a>> {
        std::iter::once(&self.rest).chain(self.objects.iter().map(|(_, body)| body))
    }

    /// What is inside the walls on a layer: of the rest, and of each object within its box.
    pub fn inside(&self, layer: u32) -> (Inside, Vec<(Box2, Inside)>) {
        let objects = self.objects.iter();
        let objects = objects.map(|(around, body)| (*around, body.inside(layer)));
        (self.rest.inside(layer), objects.collect())
    }

    /// Where a layer is bridged.
    pub fn bridged(&self, layer: usize) -> Vec<Region> {
        self.all().flat_map(|body| body.bridged(layer)).collect()
    }

    /// What of a solid layer lies over an inside that does not hold it.
    pub fn unheld(&self, layer: usize) -> Vec<Region> {
        self.all().flat_map(|body| body.unheld(layer)).collect()
    }

    /// What spans much.
    pub fn roofs(&self) -> Roofs {
        let mut roofs = Roofs::default();
        self.all().for_each(|body| roofs.add(body.roofs.clone()));
        roofs
    }
}
