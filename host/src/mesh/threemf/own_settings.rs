//! Settings of placed objects and their volumes that are followed.
//!
//! In: the objects of the build as they are placed (the file's unit), what slicers keep of them. Out: those that have
//! settings of their own, with their volumes that do, if each stands alone.

use super::model::{Model, Object};
use super::ranges::{Ranges, RangesOfObject, numbers};
use super::roles::{KeyValues, Role, Roles};
use crate::mesh::layers::HeightRange;
use crate::mesh::object_settings::{OwnSettings, Zone};
use crate::mesh::raw_mesh::RawObject;
use crate::mesh::{Mesh, Point3};
use std::collections::BTreeSet;

/// An object of the build, once placed.
pub(super) struct PlacedObject {
    pub id: usize,
    name: Option<String>,
    pub low: Point3,
    pub high: Point3,
    own: OwnSettings,
    zones: Vec<Zone>,
    /// Its components that are modifiers.
    pub modifiers: Vec<usize>,
}

impl PlacedObject {
    /// The object with the material, the volumes and the modifiers that are placed of it.
    pub fn new(
        (id, object): (usize, Option<&Object>),
        roles: &Roles,
        (solid, zones, modifiers): (&Mesh, Vec<Zone>, Vec<usize>),
    ) -> PlacedObject {
        let [low, high] = solid.bounds_mm();
        let mut own = OwnSettings::default();
        for settings in of_object(id, object, roles) {
            own.take_all(settings, true);
        }
        let kept = roles.objects.get(&id).and_then(|kept| kept.name.clone());
        let mut placed = PlacedObject {
            id,
            name: kept.or_else(|| object.and_then(|object| object.name.clone())),
            low,
            high,
            own,
            zones,
            modifiers,
        };
        // Material changes nothing before a volume that asks for something.
        let asks = placed.zones.iter().position(|zone| !zone.own.is_empty());
        placed.zones.drain(..asks.unwrap_or(placed.zones.len()));
        placed
    }

    /// As messages call it.
    pub fn called(&self) -> &str {
        self.name.as_deref().unwrap_or("an object")
    }

    /// Adds what the ranges of heights ask for besides layer heights: each a volume as wide as the object and more.
    pub fn add_ranges(&mut self, ranges: &RangesOfObject, unit_mm: f64) {
        for range in &ranges.ranges {
            let mut own = OwnSettings::default();
            own.take_all(&range.settings, false);
            if own.is_empty() {
                continue;
            }
            let [from, to] = [range.from_mm, range.to_mm].map(|mm| self.low.z + mm / unit_mm);
            let wide = self.high - self.low;
            let low = Point3::new(self.low.x - wide.x, self.low.y - wide.y, from);
            let high = Point3::new(self.high.x + wide.x, self.high.y + wide.y, to);
            self.zones.push(Zone {
                name: None,
                mesh: Mesh::cuboid(low, high),
                own,
                is_part: false,
            });
        }
    }

    /// As the reader passes it on.
    pub fn told(self) -> RawObject {
        let box_of = Mesh::cuboid(self.low, self.high);
        RawObject {
            name: self.name,
            corners: box_of.vertices,
            own: self.own,
            zones: self.zones,
        }
    }

    /// True if their boxes share ground.
    fn meets(&self, [low, high]: [Point3; 2]) -> bool {
        (0..2).all(|axis| self.low[axis] < high[axis] && low[axis] < self.high[axis])
    }

    /// True if it has settings of its own.
    pub fn asks(&self) -> bool {
        !self.own.is_empty() || !self.zones.is_empty()
    }
}

/// The settings of an object, and those of its only volume.
fn of_object<'a>(
    id: usize,
    object: Option<&'a Object>,
    roles: &'a Roles,
) -> impl Iterator<Item = &'a KeyValues> {
    let kept = roles.objects.get(&id);
    let mut material = kept.iter().flat_map(|kept| &kept.volumes);
    let first = material.find(|volume| volume.role == Role::Part);
    let only = first.filter(|_| !material.any(|volume| volume.role == Role::Part));
    let own = object.map(|object| &object.settings);
    let own = own.into_iter().chain(kept.map(|kept| &kept.settings));
    own.chain(only.map(|volume| &volume.settings))
}

/// Gives each object the volumes of no object that reach it; a note, if one with settings of its own shares ground with
/// an object of others.
///
/// # Errors
/// The note.
fn alone(placed: &mut [(PlacedObject, Option<usize>)], loose: &[Zone]) -> Result<(), String> {
    for (object, _) in placed.iter_mut() {
        let own = loose
            .iter()
            .filter(|zone| object.meets(zone.mesh.bounds_mm()));
        let own: Vec<Zone> = own.cloned().collect();
        object.zones.extend(own);
    }
    let placed = &*placed;
    let is_entangled = |(number, (object, _)): (usize, &(PlacedObject, Option<usize>))| {
        let mut others = placed.iter().enumerate();
        others.any(|(other_number, (other, _))| {
            let is_alike = other.own == object.own && object.zones.is_empty();
            other_number != number && !is_alike && object.meets([other.low, other.high])
        })
    };
    match placed.iter().enumerate().any(is_entangled) {
        true => Err(
            "objects stand within each other's boxes, and their settings are not followed"
                .to_string(),
        ),
        false => Ok(()),
    }
}

/// What is followed of the settings of a project.
pub(super) struct Asked {
    pub objects: Vec<PlacedObject>,
    /// Objects whose settings are followed, and modifiers of no object.
    pub ids: BTreeSet<usize>,
    /// Layer heights of the job, mm.
    pub heights: Vec<HeightRange>,
    pub entangled: Option<String>,
    pub ranges_notes: Vec<String>,
}

impl Asked {
    /// Of placed objects, and modifiers of no object with the objects that they are.
    pub fn of(
        (placed, loose, loose_ids): (Vec<PlacedObject>, &[Zone], Vec<usize>),
        ranges: &Ranges,
        root: &Model,
        roles: &Roles,
    ) -> Asked {
        let numbers = numbers(root, roles);
        let numbered = placed.into_iter().map(|object| {
            let number = numbers.get(&object.id).copied();
            (object, number)
        });
        let mut placed: Vec<(PlacedObject, Option<usize>)> = numbered.collect();
        let (heights, mut ranges_notes) = ranges.heights(&placed);
        for (object, number) in &mut placed {
            if let Some(own) = ranges.of(*number) {
                object.add_ranges(own, root.unit_mm);
            }
        }
        let alone = alone(&mut placed, loose);
        let entangled = alone.err();
        ranges_notes.extend(ranges.settings_notes(&placed, entangled.is_none()));
        let objects = placed.into_iter().map(|(object, _)| object);
        let objects: Vec<PlacedObject> = match entangled {
            Some(_) => Vec::new(),
            None => objects.filter(PlacedObject::asks).collect(),
        };
        let of_object = |object: &PlacedObject| {
            let modifiers = object.modifiers.iter().copied();
            modifiers.chain([object.id]).collect::<Vec<usize>>()
        };
        let mut ids: BTreeSet<usize> = objects.iter().flat_map(of_object).collect();
        if !objects.is_empty() {
            ids.extend(loose_ids);
        }
        Asked {
            objects,
            ids,
            heights,
            entangled,
            ranges_notes,
        }
    }
}
