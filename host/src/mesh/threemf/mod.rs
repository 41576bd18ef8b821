//! 3MF: the objects that the build names, placed by their transforms and interpreted as in the slicer
//! that wrote the project.
//!
//! ```text
//! bytes --package--> [Model], Roles, Unfollowed --Placing--> material, what is cut from it --> RawMesh
//! ```
//! Slicers store objects in separate model files next to the one with the build: a component names the
//! file; otherwise an object that is missing in its own model is searched for in the others. Volumes that
//! are not material (modifiers, support blockers and enforcers) are omitted, negative ones are subtracted
//! from their object. Settings of a project are not applied, and reported. Where a region of the mesh is asked for, its
//! triangles keep the names of the objects and volumes they are of, and their colours.
//! Not covered: materials and textures.

mod model;
mod package;
mod roles;
#[cfg(test)]
mod tests;
mod transform;
mod unfollowed;
mod xml;

use super::Mesh;
use super::read::{RawMesh, TRIANGLES_MAX, no_vertex, syntax, too_many};
use crate::text::refusal::{Refusal, refusal};
use model::{Item, Model, Object, Transform, UNMOVED};
use package::{Files, files};
use roles::{Role, Roles};
use std::collections::BTreeMap;
use std::ops::Range;
use transform::{append, chained};
use unfollowed::Aside;

const FORMAT: &str = "3MF";
/// Components within components.
const DEPTH_MAX: usize = 16;
/// Most objects and components that are declared, and most that are placed, repetitions included:
/// components repeat objects that are stored once, so that a few lines may name any number of them.
const PARTS_MAX: usize = 100_000;

/// Reads what the build places, with names and colours of its triangles or without.
pub(super) fn read(bytes: &[u8], with_names: bool) -> Result<RawMesh, Refusal> {
    let files = files(bytes)?;
    let Files {
        models,
        roles,
        unfollowed,
    } = &files;
    let mut builds = models.iter().filter(|model| !model.items.is_empty());
    let root = builds.next().ok_or_else(|| {
        refusal!("its build has no item: place at least one object on the plate before the export")
    })?;
    let mut placing = Placing {
        models,
        roles,
        only_counts: true,
        with_names,
        names: Vec::new(),
        triangles: 0,
        parts: 0,
        item: Body::default(),
        aside: Aside::default(),
        placed: Vec::new(),
    };
    let items: Vec<&Item> = root.items.iter().filter(|item| item.is_printable).collect();
    // Counted before anything is made of it.
    for item in &items {
        placing.add(item, root, &Place::of(item.object))?;
    }
    placing.only_counts = false;
    placing.placed.clear();
    let Built {
        mesh,
        carved,
        groups,
        colours,
    } = placing.built(root, &items)?;
    if mesh.triangles.is_empty() && carved.is_empty() && !placing.is_all_printed(root, &items) {
        return Err(refusal!(
            "nothing in it is printed: its items are switched off, or are modifiers, supports or negative \
             volumes: switch one on, or make one a part, and export it again"
        ));
    }
    let mut notes = Vec::new();
    if items.len() > 1 {
        notes.push(format!("{} build items", items.len()));
    }
    placing.aside.switched_off = root.items.len() - items.len();
    let objects = placing.placed_objects();
    notes.extend(unfollowed::notes(
        unfollowed,
        &placing.aside,
        roles,
        &objects,
    ));
    let named = root.objects.iter().find_map(|o| o.name.clone());
    Ok(RawMesh {
        mesh,
        carved,
        name: named.filter(|_| items.len() == 1),
        unit_mm: root.unit_mm,
        notes,
        groups: owned(groups),
        triangle_colours: colours,
        ..RawMesh::default()
    })
}

/// What all items come to.
#[derive(Default)]
struct Built<'a> {
    mesh: Mesh,
    /// Items from which volumes are cut, with these.
    carved: Vec<(Mesh, Mesh)>,
    /// Runs of the mesh's triangles by name.
    groups: BTreeMap<&'a str, Vec<Range<usize>>>,
    colours: Vec<Option<[u8; 3]>>,
}

impl<'a> Placing<'a> {
    /// Places the items one by one.
    fn built(&mut self, root: &'a Model, items: &[&'a Item]) -> Result<Built<'a>, Refusal> {
        let mut built = Built::default();
        for item in items {
            self.add(item, root, &Place::of(self.kept(item, root)))?;
            let body = std::mem::take(&mut self.item);
            let Body { solid, cut, .. } = body;
            if !cut.triangles.is_empty() && !solid.triangles.is_empty() {
                built.carved.push((solid, cut));
                continue;
            }
            let first = built.mesh.triangles.len();
            for (name, own) in body.named {
                let own = first + own.start..first + own.end;
                built.groups.entry(name).or_default().push(own);
            }
            built.colours.extend(body.colours);
            built.mesh.append(&solid);
        }
        Ok(built)
    }
}

fn owned(groups: BTreeMap<&str, Vec<Range<usize>>>) -> Vec<(String, Vec<Range<usize>>)> {
    let groups = groups.into_iter();
    groups
        .map(|(name, triangles)| (name.to_string(), triangles))
        .collect()
}

fn no_object(id: usize) -> Refusal {
    refusal!(
        "an item or component names object {id}, which the file does not have: export it again"
    )
}

/// Objects and components that place each other any number of times.
fn too_many_parts(max: usize) -> Refusal {
    refusal!(
        "its objects and components are placed more than {max} times: export them as one object"
    )
}

fn problem(what: &str) -> Refusal {
    syntax(FORMAT, format!("{what}; export it again"))
}

/// The material of an item, and the volumes cut from it.
#[derive(Default)]
struct Body<'a> {
    solid: Mesh,
    cut: Mesh,
    /// Runs of the solid's triangles by the names of what they are of.
    named: Vec<(&'a str, Range<usize>)>,
    /// Colours of the solid's triangles.
    colours: Vec<Option<[u8; 3]>>,
}

/// Where an object is placed.
#[derive(Clone, Copy)]
struct Place {
    /// The object of the build that it is part of.
    top: usize,
    transform: Transform,
    /// What the objects around it are.
    role: Role,
    depth: usize,
}

impl Place {
    fn of(top: usize) -> Place {
        Place {
            top,
            transform: UNMOVED,
            role: Role::Part,
            depth: 0,
        }
    }
}

/// Places objects and what they consist of.
struct Placing<'a> {
    models: &'a [Model],
    roles: &'a Roles,
    only_counts: bool,
    with_names: bool,
    /// Of the object that is being placed, and of those that it is part of.
    names: Vec<&'a str>,
    /// Counted so far.
    triangles: usize,
    parts: usize,
    /// Of the item that is being placed.
    item: Body<'a>,
    aside: Aside,
    placed: Vec<&'a Object>,
}

impl<'a> Placing<'a> {
    /// The object that an item or component of a model names, and the model that has it.
    fn object(&self, item: &Item, model: &'a Model) -> Option<(&'a Object, &'a Model)> {
        let id = item.object;
        let in_model = |model: &'a Model| {
            let mut objects = model.objects.iter();
            Some((objects.find(|object| object.id == id)?, model))
        };
        if let Some(path) = &item.path {
            let path = path.trim_start_matches('/');
            let named = self.models.iter().find(|model| model.path == path);
            if let Some(found) = named.and_then(in_model) {
                return Some(found);
            }
        }
        let others = self.models.iter().filter(|m| !std::ptr::eq(*m, model));
        std::iter::once(model).chain(others).find_map(in_model)
    }

    /// The number under which volumes of an item's object are kept. A further instance may be an object that has the first
    /// one as its only component.
    fn kept(&self, item: &Item, root: &'a Model) -> usize {
        let object = self.object(item, root).map(|(object, _)| object);
        match object.and_then(Object::first_instance) {
            Some(first) if !self.roles.objects.contains_key(&item.object) => first.object,
            _ => item.object,
        }
    }

    fn add(&mut self, item: &Item, model: &'a Model, outer: &Place) -> Result<(), Refusal> {
        let (id, max) = (item.object, DEPTH_MAX);
        if outer.depth > max {
            return Err(refusal!(
                "the components of object {id} nest deeper than {max}: export them as one object"
            ));
        }
        // One that names itself would be found in another model.
        let Some((object, model)) = self.object(item, model) else {
            return Err(no_object(id));
        };
        let volume = self.roles.component(outer.top, id);
        let own_role = match outer.role {
            Role::Part => volume.map_or(Role::Part, |volume| volume.role),
            role => role,
        };
        let place = Place {
            transform: chained(&item.transform, &outer.transform),
            role: match own_role {
                Role::Part => object.role(),
                role => role,
            },
            ..*outer
        };
        let name = volume.and_then(|volume| volume.name.as_ref());
        let around = self.names.len();
        let slicer = self.roles.objects.get(&id).filter(|_| outer.depth == 0);
        let slicer = slicer.and_then(|notes| notes.name.as_ref());
        for own in [name, object.name.as_ref(), slicer].into_iter().flatten() {
            if self.with_names && !self.names.contains(&own.as_str()) {
                self.names.push(own);
            }
        }
        self.add_object(object, &place, name.or(object.name.as_ref()))?;
        for component in &object.components {
            // A component of the same number is another model's.
            let from = match component.object == id && component.path.is_none() {
                true => self.models.iter().find(|m| !std::ptr::eq(*m, model)),
                false => Some(model),
            };
            let id = component.object;
            let from = from.ok_or_else(|| no_object(id))?;
            let depth = place.depth + 1;
            self.add(component, from, &Place { depth, ..place })?;
        }
        self.names.truncate(around);
        Ok(())
    }

    /// What an object itself has of triangles.
    fn add_object(
        &mut self,
        object: &'a Object,
        place: &Place,
        name: Option<&'a String>,
    ) -> Result<(), Refusal> {
        if self.only_counts {
            return self.count(object);
        }
        check_corners(object)?;
        self.placed.push(object);
        let all = 0..object.triangles.len();
        let volumes = self.roles.by_triangles(object.id);
        if volumes.is_empty() || place.role != Role::Part {
            if !all.is_empty() {
                self.add_triangles(object, all, place, name);
            }
            return Ok(());
        }
        // Triangles of no volume are material.
        let mut next = 0;
        for ([first, last], volume) in volumes {
            let [first, end] = [first, last.saturating_add(1)].map(|end| end.min(all.end));
            let first = first.max(next);
            let name = volume.name.as_ref();
            let role = volume.role;
            self.add_triangles(object, next..first, place, None);
            self.add_triangles(object, first..end, &Place { role, ..*place }, name);
            next = end.max(next);
        }
        self.add_triangles(object, next..all.end, place, None);
        Ok(())
    }

    fn count(&mut self, object: &Object) -> Result<(), Refusal> {
        self.triangles += object.triangles.len();
        if self.triangles > TRIANGLES_MAX {
            return Err(too_many(self.triangles));
        }
        self.parts += 1;
        match self.parts > PARTS_MAX {
            true => Err(too_many_parts(PARTS_MAX)),
            false => Ok(()),
        }
    }

    /// Some of an object's triangles, by their role.
    fn add_triangles(
        &mut self,
        object: &'a Object,
        triangles: Range<usize>,
        place: &Place,
        name: Option<&'a String>,
    ) {
        if triangles.is_empty() {
            return;
        }
        if self.with_names && place.role == Role::Part {
            let Body {
                solid,
                named,
                colours,
                ..
            } = &mut self.item;
            let first = solid.triangles.len();
            let own = first..first + triangles.len();
            let names = self.names.iter().copied();
            let own_name = name.map(String::as_str);
            let own_name = own_name.filter(|name| !self.names.contains(name));
            named.extend(names.chain(own_name).map(|name| (name, own.clone())));
            let colour = |triangle: usize| object.colours.get(triangle).copied().flatten();
            colours.extend(triangles.clone().map(colour));
        }
        let mesh = match place.role {
            Role::Part => &mut self.item.solid,
            Role::Negative => &mut self.item.cut,
            _ => {
                self.aside.push(place.role, name);
                return;
            }
        };
        append(mesh, object, triangles, &place.transform);
        if place.role == Role::Negative {
            self.aside.push(place.role, name);
        }
    }

    /// The objects that were placed, each once.
    fn placed_objects(&self) -> Vec<&'a Object> {
        let mut objects = self.placed.clone();
        objects.sort_by_key(|object| (object.id, std::ptr::from_ref(*object) as usize));
        objects.dedup_by(|p, q| std::ptr::eq(*p, *q));
        objects
    }

    /// True where nothing was left out: a mesh without triangles is then just empty.
    fn is_all_printed(&self, root: &Model, items: &[&Item]) -> bool {
        self.aside.is_empty() && root.items.len() == items.len()
    }
}

/// Triangles of vertices that are there.
fn check_corners(object: &Object) -> Result<(), Refusal> {
    let vertices = object.vertices.len();
    for (triangle, corners) in object.triangles.iter().enumerate() {
        let is_beyond = |&&vertex: &&u32| vertex as usize >= vertices;
        if let Some(&vertex) = corners.iter().find(is_beyond) {
            let vertex = vertex as usize;
            return Err(no_vertex(triangle, vertex, vertices));
        }
    }
    Ok(())
}
