//! Settings of a slicer's project that are not applied: one message for each kind, so that nothing is
//! dropped silently.

use super::model::{Object, Painted, paint_names};
use super::roles::{KeyValues, ObjectNotes, Role, Roles};
use super::xml::{Part, read};
use crate::mesh::MeshError;
use crate::mesh::object_settings::OwnSettings;
use std::collections::BTreeSet;

/// Entries of a list that are reported one by one.
const TOLD_MAX: usize = 8;
/// Longest list, characters.
const CHARS_MAX: usize = 600;

/// Heights of an object, and the settings there.
pub(super) const RANGES: [&str; 3] = [
    "Metadata/Slic3r_PE_layer_config_ranges.xml",
    "Metadata/Prusa_Slicer_layer_config_ranges.xml",
    "Metadata/layer_config_ranges.xml",
];
/// Pauses, colours and G-code at heights of the print.
const CODES: [&str; 2] = [
    "Metadata/Prusa_Slicer_custom_gcode_per_print_z.xml",
    "Metadata/custom_gcode_per_layer.xml",
];
/// Layer heights that change steadily.
pub(super) const PROFILES: [&str; 2] = [
    "Metadata/Slic3r_PE_layer_heights_profile.txt",
    "Metadata/layer_heights_profile.txt",
];
/// The settings of the whole print.
const PROJECTS: [&str; 2] = [
    "Metadata/Slic3r_PE.config",
    "Metadata/project_settings.config",
];

/// Settings of the files other than the models.
#[derive(Debug, Default)]
pub(super) struct Unfollowed {
    /// What, and at which height, mm.
    codes: Vec<(String, String)>,
    has_project: bool,
}

/// True for files that [`Unfollowed::read`] knows.
pub(super) fn is_known(name: &str) -> bool {
    let is_cura = name.starts_with("Cura/");
    is_cura || CODES.contains(&name) || PROJECTS.contains(&name)
}

impl Unfollowed {
    /// Reads a file that [`is_known`].
    pub fn read(&mut self, name: &str, text: &[u8]) -> Result<(), MeshError> {
        if CODES.contains(&name) {
            self.read_codes(text)?;
        } else {
            self.has_project = true;
        }
        Ok(())
    }

    fn read_codes(&mut self, text: &[u8]) -> Result<(), MeshError> {
        read(text, |part| {
            let Part::Open(tag) = part else {
                return Ok(());
            };
            let height = match tag.name().as_ref() {
                "code" => tag.get("print_z"),
                "layer" => tag.get("top_z"),
                _ => None,
            };
            if let Some(height) = height {
                let kind = tag.get("type").unwrap_or_default();
                let what = match (kind.as_str(), tag.get("gcode").as_deref()) {
                    ("0", _) | ("", Some("M600")) => "colour change",
                    ("1", _) | ("", Some("M601")) => "pause",
                    ("2", _) | ("", Some("tool_change")) => "tool change",
                    _ => "G-code",
                };
                self.codes.push((what.to_string(), height));
            }
            Ok(())
        })
    }

    /// One line for each kind of data that is not followed.
    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.has_project {
            notes.push(
                "the slicer's settings of the project are not followed: give layer heights, walls, infill \
                 and speeds as options"
                    .to_string(),
            );
        }
        if !self.codes.is_empty() {
            let codes = self
                .codes
                .iter()
                .map(|(what, at)| format!("{what} at {at} mm"));
            let codes = told(codes, ", ");
            notes.push(format!("not followed at heights of the print: {codes}"));
        }
        notes
    }
}

/// Entries of a list, up to a bound, and the number of others.
pub(super) fn told(entries: impl Iterator<Item = String>, between: &str) -> String {
    let mut entries: Vec<String> = entries.collect();
    let more = entries.len().saturating_sub(TOLD_MAX);
    if more > 0 {
        entries.truncate(TOLD_MAX);
        entries.push(format!("and {more} more"));
    }
    let text = entries.join(between);
    match text.char_indices().nth(CHARS_MAX) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

pub(super) fn settings_text(settings: &[(String, String)]) -> String {
    let settings = settings.iter().map(|(key, value)| format!("{key} {value}"));
    told(settings, ", ")
}

/// Volumes that are no material, and items that are switched off, each time that one is placed.
#[derive(Debug, Default)]
pub(super) struct Aside {
    volumes: Vec<(Role, Option<String>)>,
    pub switched_off: usize,
}

impl Aside {
    pub fn push(&mut self, role: Role, name: Option<&String>) {
        self.volumes.push((role, name.cloned()));
    }

    pub fn is_empty(&self) -> bool {
        self.volumes.is_empty()
    }

    fn of(&self, is_it: impl Fn(Role) -> bool) -> Option<String> {
        let roles: BTreeSet<Role> = self.volumes.iter().map(|(role, _)| *role).collect();
        let roles = roles.into_iter().filter(|&role| is_it(role));
        let parts: Vec<String> = roles
            .map(|role| {
                let own = self.volumes.iter().filter(|(other, _)| *other == role);
                let [one, several] = role.names();
                let count = own.clone().count();
                let what = if count == 1 { one } else { several };
                let names: BTreeSet<&String> = own.filter_map(|(_, name)| name.as_ref()).collect();
                match names.is_empty() {
                    true => format!("{count} {what}"),
                    false => {
                        let names = told(names.into_iter().cloned(), ", ");
                        format!("{count} {what} ({names})")
                    }
                }
            })
            .collect();
        (!parts.is_empty()).then(|| parts.join(", "))
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some(cut) = self.of(|role| role == Role::Negative) {
            notes.push(format!("cut away from their objects: {cut}"));
        }
        if let Some(aside) = self.of(|role| role != Role::Negative) {
            notes.push(format!("left out, since they are no material: {aside}"));
        }
        match self.switched_off {
            0 => {}
            1 => notes.push("1 item that is switched off is left out".to_string()),
            items => notes.push(format!("{items} items that are switched off are left out")),
        }
        notes
    }
}

/// What settings are kept with.
#[derive(Clone, Copy)]
enum Whose {
    /// An object, or its only volume.
    Object,
    /// A modifier, or one of several volumes of material.
    Volume(Role),
    /// What has no settings of its own to follow.
    Aside(Role),
}

impl Whose {
    fn of(role: Role) -> Whose {
        match role {
            Role::Part => Whose::Object,
            Role::Modifier => Whose::Volume(role),
            role => Whose::Aside(role),
        }
    }
}

/// Settings of objects and volumes, each with its name: those that are followed, and the others. `followed` are the
/// objects whose settings are, where they can be.
fn object_settings(roles: &Roles, objects: &[&Object], followed: &BTreeSet<usize>) -> Vec<String> {
    let mut ids: Vec<&usize> = roles.objects.keys().collect();
    ids.sort();
    let mut found: [Vec<String>; 2] = Default::default();
    let mut push = |id: usize, of: Whose, name: Option<&String>, settings: &[(String, String)]| {
        let can = followed.contains(&id) && !matches!(of, Whose::Aside(_));
        let is_object = matches!(of, Whose::Object);
        let settings = settings.iter().cloned();
        let (own, others): (KeyValues, KeyValues) =
            settings.partition(|(key, value)| can && OwnSettings::follows(key, value, is_object));
        let what = match of {
            Whose::Object => "an object",
            Whose::Volume(role) | Whose::Aside(role) => role.names()[0],
        };
        let name = name.map_or(what, String::as_str);
        for (found, settings) in found.iter_mut().zip([own, others]) {
            if !settings.is_empty() {
                found.push(format!("{name}: {}", settings_text(&settings)));
            }
        }
    };
    for id in ids {
        let ObjectNotes {
            name,
            settings,
            volumes,
        } = &roles.objects[id];
        push(*id, Whose::Object, name.as_ref(), settings);
        let parts = volumes.iter().filter(|volume| volume.role == Role::Part);
        let is_alone = parts.count() == 1;
        for volume in volumes {
            let whose = match Whose::of(volume.role) {
                Whose::Object if !is_alone => Whose::Volume(volume.role),
                whose => whose,
            };
            push(*id, whose, volume.name.as_ref(), &volume.settings);
        }
    }
    for object in objects {
        let is_setting = |key: &str| {
            let is_role = key.ends_with("_mesh");
            !is_role && !matches!(key, "drop_to_buildplate" | "print_order" | "extruder_nr")
        };
        let settings: Vec<(String, String)> = object
            .settings
            .iter()
            .filter(|(key, _)| is_setting(key))
            .cloned()
            .collect();
        let whose = Whose::of(object.role());
        push(object.id, whose, object.name.as_ref(), &settings);
    }
    let [own, others] =
        found.map(|found| (!found.is_empty()).then(|| told(found.into_iter(), "; ")));
    let own = own.map(|own| format!("settings of objects and modifiers that are followed: {own}"));
    let others = others
        .map(|others| format!("settings of objects and modifiers are not followed: {others}"));
    own.into_iter().chain(others).collect()
}

fn painted(painted: &Painted) -> Option<String> {
    let kinds = paint_names().zip(painted).filter(|(_, count)| **count > 0);
    let kinds: Vec<String> = kinds
        .map(|(name, count)| match count {
            1 => format!("{name} on 1 triangle"),
            _ => format!("{name} on {count} triangles"),
        })
        .collect();
    (!kinds.is_empty()).then(|| format!("painted and not followed: {}", kinds.join(", ")))
}

/// Notes on a package: one line for each kind of thing.
pub(super) fn notes(
    unfollowed: &Unfollowed,
    aside: &Aside,
    roles: &Roles,
    (objects, followed): (&[&Object], &BTreeSet<usize>),
) -> Vec<String> {
    let mut all: Painted = Painted::default();
    for object in objects {
        for (all, own) in all.iter_mut().zip(object.painted) {
            *all += own;
        }
    }
    let mut notes = aside.notes();
    if roles.plates > 1 {
        notes.push(format!(
            "the project has {} plates, which are read as one",
            roles.plates
        ));
    }
    notes.extend(object_settings(roles, objects, followed));
    notes.extend(painted(&all));
    notes.extend(unfollowed.notes());
    notes
}
