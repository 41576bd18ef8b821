//! Settings of placed objects that are followed.
//!
//! In: the objects of the build as they are placed (the file's unit), what slicers keep of them. Out: those that have
//! settings of their own, if each stands alone. Leaves out modifiers: their settings hold within a volume, not an object.

use super::model::Object;
use super::roles::{KeyValues, Role, Roles};
use crate::mesh::object_settings::ObjectInfill;
use crate::mesh::{Mesh, Point3};

/// An object of the build, once placed.
pub(super) struct PlacedObject {
    pub id: usize,
    name: Option<String>,
    low: Point3,
    high: Point3,
    infill: ObjectInfill,
}

impl PlacedObject {
    /// The object with the material that is placed of it.
    pub fn new(id: usize, object: Option<&Object>, roles: &Roles, solid: &Mesh) -> PlacedObject {
        let [low, high] = solid.bounds_mm();
        let mut infill = ObjectInfill::default();
        for settings in of_object(id, object, roles) {
            for (key, value) in settings {
                infill.take(key, value);
            }
        }
        let kept = roles.objects.get(&id).and_then(|kept| kept.name.clone());
        PlacedObject {
            id,
            name: kept.or_else(|| object.and_then(|object| object.name.clone())),
            low,
            high,
            infill,
        }
    }

    /// As the reader passes it on.
    pub fn told(self) -> (Option<String>, Vec<Point3>, ObjectInfill) {
        let [low, high] = [self.low, self.high];
        let corner = |i: usize| {
            let of = |axis: usize| {
                if i >> axis & 1 == 0 {
                    low[axis]
                } else {
                    high[axis]
                }
            };
            Point3::new(of(0), of(1), of(2))
        };
        (self.name, (0..8).map(corner).collect(), self.infill)
    }

    /// True if their boxes share ground.
    fn meets(&self, other: &PlacedObject) -> bool {
        (0..2).all(|axis| self.low[axis] < other.high[axis] && other.low[axis] < self.high[axis])
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

/// The objects with settings of their own; none, and a note, if one shares ground with an object of other settings.
pub(super) fn followed(mut placed: Vec<PlacedObject>) -> (Vec<PlacedObject>, Option<String>) {
    let is_entangled = |object: &PlacedObject| {
        let mut others = placed.iter();
        others.any(|other| other.infill != object.infill && other.meets(object))
    };
    if placed.iter().any(is_entangled) {
        let note = "objects stand within each other's boxes, and their settings are not followed";
        return (Vec::new(), Some(note.to_string()));
    }
    placed.retain(|object| !object.infill.is_empty());
    (placed, None)
}
