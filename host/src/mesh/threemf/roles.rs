//! Roles of an object's volumes, which slicers store outside the model, and which of them have settings.
//!
//! PrusaSlicer divides an object's triangles into volumes (`Metadata/Slic3r_PE_model.config`), Bambu Studio
//! and OrcaSlicer name the components of an object (`Metadata/model_settings.config`), Cura gives settings
//! to an object, some of which declare that it is not material.

use super::xml::{Part, read};
use crate::text::refusal::Refusal;
use std::collections::HashMap;

/// Settings by name.
pub(super) type KeyValues = Vec<(String, String)>;

/// What a volume is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    /// Material.
    #[default]
    Part,
    /// Cut away from the material of its object.
    Negative,
    /// Other settings within it.
    Modifier,
    /// No supports within it.
    SupportBlocker,
    /// Supports within it.
    SupportEnforcer,
    /// Supports by hand.
    Support,
    /// An object of type `other`.
    Other,
}

impl Role {
    /// As messages call it, of one and of several.
    pub fn names(self) -> [&'static str; 2] {
        match self {
            Role::Part => ["part", "parts"],
            Role::Negative => ["negative volume", "negative volumes"],
            Role::Modifier => ["modifier", "modifiers"],
            Role::SupportBlocker => ["support blocker", "support blockers"],
            Role::SupportEnforcer => ["support enforcer", "support enforcers"],
            Role::Support => ["support object", "support objects"],
            Role::Other => ["object of type `other`", "objects of type `other`"],
        }
    }

    /// By the words of PrusaSlicer, Bambu Studio and OrcaSlicer; all others are material.
    fn of_word(word: &str) -> Role {
        match word {
            "NegativeVolume" | "negative_part" => Role::Negative,
            "ParameterModifier" | "modifier_part" => Role::Modifier,
            "SupportBlocker" | "support_blocker" => Role::SupportBlocker,
            "SupportEnforcer" | "support_enforcer" => Role::SupportEnforcer,
            _ => Role::Part,
        }
    }

    /// From the settings that Cura gives an object. A cutting mesh prints only where other ones
    /// are.
    pub fn of_cura(settings: &[(String, String)]) -> Role {
        let is_on = |name: &str| {
            let mut given = settings.iter().filter(|(key, _)| key == name);
            given.any(|(_, value)| value.eq_ignore_ascii_case("true"))
        };
        if is_on("anti_overhang_mesh") {
            Role::SupportBlocker
        } else if is_on("support_mesh") {
            Role::Support
        } else if is_on("infill_mesh") || is_on("cutting_mesh") {
            Role::Modifier
        } else {
            Role::Part
        }
    }
}

/// A volume of an object.
#[derive(Debug, Default)]
pub(super) struct Volume {
    /// Its component, if it is one.
    pub component: Option<usize>,
    /// The first and last of its triangles in the object, if it is a range.
    pub triangles: Option<[usize; 2]>,
    pub role: Role,
    pub name: Option<String>,
    /// Something differs from the print's settings.
    pub has_settings: bool,
}

/// The stored data of an object.
#[derive(Debug, Default)]
pub(super) struct ObjectNotes {
    pub name: Option<String>,
    pub has_settings: bool,
    pub volumes: Vec<Volume>,
}

/// The stored data of all objects, by their numbers, and the plates with objects.
#[derive(Debug, Default)]
pub(super) struct Roles {
    pub objects: HashMap<usize, ObjectNotes>,
    pub plates: usize,
}

impl Roles {
    /// The volume that a component of an object of the build is.
    pub fn component(&self, object: usize, component: usize) -> Option<&Volume> {
        let mut volumes = self.objects.get(&object)?.volumes.iter();
        volumes.find(|volume| volume.component == Some(component))
    }

    /// The volumes that an object's triangles are divided into, by their first one.
    pub fn by_triangles(&self, object: usize) -> Vec<([usize; 2], &Volume)> {
        let volumes = self.objects.get(&object).into_iter();
        let volumes = volumes.flat_map(|object| &object.volumes);
        let mut ranges: Vec<_> = volumes
            .filter_map(|volume| Some((volume.triangles?, volume)))
            .collect();
        ranges.sort_by_key(|(range, _)| *range);
        ranges
    }
}

/// Keys with the origin of a volume, without effect on printing.
fn is_setting(key: &str, value: &str) -> bool {
    match key {
        "name" | "volume_type" | "modifier" | "matrix" | "mesh_shared" | "part_type" => false,
        // The first one, or that of the object.
        "extruder" => !matches!(value, "0" | "1"),
        _ => !key.starts_with("source_") && !key.is_empty(),
    }
}

/// Where in the text the reader is.
#[derive(Default)]
struct Reading {
    roles: Roles,
    object: Option<(usize, ObjectNotes)>,
    volume: Option<Volume>,
    plate_has_objects: bool,
}

/// Reads the object settings of PrusaSlicer, Bambu Studio or OrcaSlicer.
///
/// # Errors
/// Text that is not XML.
pub(super) fn read_roles(text: &[u8]) -> Result<Roles, Refusal> {
    let mut reading = Reading::default();
    read(text, |part| {
        reading.take(part);
        Ok(())
    })?;
    Ok(reading.roles)
}

impl Reading {
    fn take(&mut self, part: Part) {
        match part {
            Part::Open(tag) => match tag.name().as_ref() {
                "object" => {
                    let id = tag.number("id").unwrap_or_default();
                    self.object = Some((id, ObjectNotes::default()));
                }
                "volume" | "part" => {
                    let triangles: Option<[usize; 2]> = tag.numbers(["firstid", "lastid"]).ok();
                    let subtype = tag.get("subtype").unwrap_or_default();
                    self.volume = Some(Volume {
                        component: tag.number("id").ok().filter(|_| triangles.is_none()),
                        triangles,
                        role: Role::of_word(&subtype),
                        ..Volume::default()
                    });
                }
                "metadata" => self.metadata(
                    tag.get("key").unwrap_or_default(),
                    tag.get("value").unwrap_or_default(),
                ),
                "plate" => self.plate_has_objects = false,
                "model_instance" => self.plate_has_objects = true,
                _ => {}
            },
            Part::Close(name) => match name.as_ref() {
                "object" => self.roles.objects.extend(self.object.take()),
                "volume" | "part" => {
                    if let (Some((_, object)), Some(volume)) =
                        (&mut self.object, self.volume.take())
                    {
                        object.volumes.push(volume);
                    }
                }
                "plate" => self.roles.plates += usize::from(self.plate_has_objects),
                _ => {}
            },
            Part::Text(_) => {}
        }
    }

    fn metadata(&mut self, key: String, value: String) {
        let (name, has_settings) = match (&mut self.volume, &mut self.object) {
            (Some(volume), _) => {
                match key.as_str() {
                    "volume_type" => volume.role = Role::of_word(&value),
                    // Before there were types.
                    "modifier" if value == "1" && volume.role == Role::Part => {
                        volume.role = Role::Modifier;
                    }
                    _ => {}
                }
                (&mut volume.name, &mut volume.has_settings)
            }
            (None, Some((_, object))) => (&mut object.name, &mut object.has_settings),
            (None, None) => return,
        };
        if key == "name" {
            *name = Some(value);
        } else {
            *has_settings |= is_setting(&key, &value);
        }
    }
}
