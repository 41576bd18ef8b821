//! The regions of a part that are filled alike, on all layers: what is inside their walls, and what hangs.
//!
//! In: the outlines of all layers (mm, input coordinates), settings. Out: [`PartBodies`], which know the inside of each
//! layer, one for each object with settings of its own and one for the rest; an object's own volumes divide its layers
//! further (`part_zones`). Leaves out how regions are filled.

use crate::geometry::Point2;
use crate::geometry::polygon::{Box2, Region};
use crate::mesh::layers::SlicedPart;
use crate::mesh::object_settings::Zone;
use crate::pipeline::part_zones::{ZonedLayer, mixed_hollow, zoned_layers};
use crate::pipeline::roofs::Roofs;
use crate::plan::layers::bridge_ground::Bridge;
use crate::plan::layers::hollow::{Hollow, bridges_of, shell_layers, wide_spans};
use crate::plan::layers::inside::{Inside, OwnInside, has_middle};
use crate::plan::layers::shells::solid_ground;
use crate::settings::kinds::Kinds;
use crate::settings::{Infill, Settings};
use rayon::prelude::*;
use std::ops::Range;

/// Regions of the layers that have the same settings.
struct PartBody<'a> {
    outlines: &'a [&'a [Region]],
    settings: Settings,
    hollow: Option<Hollow<'a>>,
    /// Its layers, if its volumes have settings of their own.
    zoned: &'a [ZonedLayer],
    /// Of each wanted layer.
    bridges: Vec<Vec<Bridge>>,
    /// What spans much.
    roofs: Roofs,
}

impl<'a> PartBody<'a> {
    /// The body of these outlines, with the bridges of the wanted layers.
    fn new(
        outlines: &'a [&'a [Region]],
        zoned: &'a [ZonedLayer],
        wanted: &Range<u32>,
        settings: &Settings,
    ) -> PartBody<'a> {
        let (settings, mut roofs) = match zoned.is_empty() {
            true => Roofs::settled(outlines, settings),
            false => (settings.clone(), Roofs::default()),
        };
        let hollow = match zoned.is_empty() {
            true => Hollow::of(outlines, &settings),
            false => mixed_hollow(outlines, zoned, &settings),
        };
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
            zoned,
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
            ..Inside::default()
        }
    }

    /// The same of an object with settings of its own, within its box, of each part that has walls of its own.
    fn own_insides(&self, layer: u32, around: Box2, job: &Settings) -> Vec<OwnInside> {
        let own = |kinds: Kinds, inside: Inside, ground: Vec<Region>| OwnInside {
            around,
            ground,
            inside: Inside {
                kinds: (kinds != job.kinds).then_some(kinds),
                seam: (self.settings.seam != job.seam).then_some(self.settings.seam),
                ..inside
            },
        };
        let Some(ZonedLayer {
            walled,
            areas,
            solid,
        }) = self.zoned.get(layer as usize)
        else {
            return vec![own(self.settings.kinds, self.inside(layer), Vec::new())];
        };
        let areas = areas
            .iter()
            .map(|(infill, area)| (infill.inside(layer), area.clone()));
        let areas: Vec<(Infill, Vec<Region>)> = areas.collect();
        let insides = walled.iter().map(|(fill, ground)| {
            let inside = Inside {
                infill: Some(fill.infill.inside(layer)),
                solid: solid.clone(),
                bridges: self.bridges[layer as usize].clone(),
                areas: areas.clone(),
                ..Inside::default()
            };
            own(fill.kinds, inside, ground.clone())
        });
        insides.collect()
    }

    /// The regions of a layer, if some of them have walls of their own.
    fn walled(&self, layer: usize) -> Option<Vec<Region>> {
        let walled = &self.zoned.get(layer)?.walled;
        let regions = walled.iter().flat_map(|(_, ground)| ground.clone());
        (walled.len() > 1).then(|| regions.collect())
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
    /// The same divided by its volumes, if they have settings of their own.
    zoned: Vec<ZonedLayer>,
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
    let mut without_walls: Vec<&str> = Vec::new();
    let mut of_objects: Vec<(Box2, Settings, &[Zone])> = Vec::new();
    for object in &part.objects {
        let own = object.own.over(settings);
        let has_walls = |own: &Settings| own.infill.is_some() || object.zones.is_empty();
        let Some(own) = own.filter(has_walls) else {
            without_walls.push(object.name.as_deref().unwrap_or("an object"));
            continue;
        };
        let [min, max] = object
            .bounds_mm
            .map(|corner| Point2::new(corner.x, corner.y));
        of_objects.push((Box2 { min, max }, own, &object.zones));
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
        objects.position(|(around, ..)| has_middle(*around, region.bounds()))
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
        zoned: Vec::new(),
        settings: settings.clone(),
    };
    let objects = of_objects.iter().enumerate();
    let objects = objects.map(|(number, (around, own, zones))| {
        let layers = of_owner(Some(number));
        let zoned = (!zones.is_empty()).then(|| zoned_layers(&layers, zones, &part.layers, own));
        Share {
            bounds: Some(*around),
            zoned: zoned.flatten().unwrap_or_default(),
            layers,
            settings: own.clone(),
        }
    });
    (std::iter::once(rest).chain(objects).collect(), note)
}

/// The bodies of a part.
pub struct PartBodies<'a> {
    rest: PartBody<'a>,
    objects: Vec<(Box2, PartBody<'a>)>,
    /// Of each layer its regions, where some of them have walls of their own.
    walled: Vec<Option<Vec<Region>>>,
    job: &'a Settings,
}

impl<'a> PartBodies<'a> {
    /// Of a part without shares, or of its shares with their outlines.
    pub fn new(
        whole: &'a [&'a [Region]],
        shares: &'a [(&'a Share, Vec<&'a [Region]>)],
        wanted: &Range<u32>,
        settings: &'a Settings,
    ) -> PartBodies<'a> {
        let rest = shares.first().map_or(whole, |(_, outlines)| outlines);
        let objects = shares.iter().filter_map(|(share, outlines)| {
            let body = PartBody::new(outlines, &share.zoned, wanted, &share.settings);
            Some((share.bounds?, body))
        });
        let mut bodies = PartBodies {
            rest: PartBody::new(rest, &[], wanted, settings),
            objects: objects.collect(),
            walled: Vec::new(),
            job: settings,
        };
        bodies.walled = (0..whole.len())
            .map(|layer| bodies.walled_of(layer))
            .collect();
        bodies
    }

    fn all(&self) -> impl Iterator<Item = &PartBody<'a>> {
        std::iter::once(&self.rest).chain(self.objects.iter().map(|(_, body)| body))
    }

    /// What is inside the walls on a layer: of the rest, and of each object with settings of its own.
    pub fn inside(&self, layer: u32) -> (Inside, Vec<OwnInside>) {
        let objects = self.objects.iter();
        let objects = objects.flat_map(|(around, body)| body.own_insides(layer, *around, self.job));
        (self.rest.inside(layer), objects.collect())
    }

    /// The regions of a layer, if some of them have walls of their own: those of the rest, and of each object.
    fn walled_of(&self, layer: usize) -> Option<Vec<Region>> {
        let of_objects: Vec<Option<Vec<Region>>> = self
            .objects
            .iter()
            .map(|(_, body)| body.walled(layer))
            .collect();
        if of_objects.iter().all(Option::is_none) {
            return None;
        }
        let objects = self.objects.iter().zip(of_objects);
        let objects = objects
            .map(|((_, body), walled)| walled.unwrap_or_else(|| body.outlines[layer].to_vec()));
        let rest = self.rest.outlines[layer].to_vec();
        Some(std::iter::once(rest).chain(objects).flatten().collect())
    }

    /// The regions of a layer, divided where some of them have walls of their own; `None` where none have.
    pub fn walled(&self, layer: u32) -> Option<&[Region]> {
        self.walled.get(layer as usize)?.as_deref()
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
