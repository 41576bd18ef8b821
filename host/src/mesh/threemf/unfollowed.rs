//! Settings of a slicer's project that are not applied: one message for each kind, so that nothing is
//! dropped silently.

use super::model::{Object, Painted, paint_names};
use super::roles::{Role, Roles};
use super::xml::{Part, read};
use crate::text::refusal::Refusal;
use std::collections::BTreeSet;

/// Entries of a list that are reported one by one.
const TOLD_MAX: usize = 8;
/// Longest list, characters.
const CHARS_MAX: usize = 600;

/// Heights of an object, and the settings there.
const RANGES: [&str; 3] = [
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
const PROFILES: [&str; 2] = [
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
    /// Something is set by height.
    has_heights: bool,
}

/// True for files that [`Unfollowed::read`] knows.
pub(super) fn is_known(name: &str) -> bool {
    let is_cura = name.starts_with("Cura/");
    let is_heights = RANGES.contains(&name) || PROFILES.contains(&name);
    is_cura || is_heights || CODES.contains(&name) || PROJECTS.contains(&name)
}

impl Unfollowed {
    /// Reads a file that [`is_known`].
    pub fn read(&mut self, name: &str, text: &[u8]) -> Result<(), Refusal> {
        if CODES.contains(&name) {
            self.read_codes(text)?;
        } else if RANGES.contains(&name) {
            read(text, |part| {
                self.has_heights |= matches!(part, Part::Open(tag) if tag.name() == "range");
                Ok(())
            })?;
        } else if PROFILES.contains(&name) {
            self.has_heights |= text.contains(&b'|');
        } else {
            self.has_project = true;
        }
        Ok(())
    }

    fn read_codes(&mut self, text: &[u8]) -> Result<(), Refusal> {
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
fn told(entries: impl Iterator<Item = String>, between: &str) -> String {
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

/// The note on settings of objects, of their volumes and of ranges of heights, if there are any.
fn own_settings(roles: &Roles, objects: &[&Object], has_heights: bool) -> Option<String> {
    let kept = roles.objects.values();
    let kept = kept.flat_map(|object| {
        let volumes = object.volumes.iter().map(|volume| volume.has_settings);
        volumes.chain([object.has_settings])
    });
    let is_setting = |key: &str| {
        let is_role = key.ends_with("_mesh");
        !is_role && !matches!(key, "drop_to_buildplate" | "print_order" | "extruder_nr")
    };
    // Cura's.
    let of_meshes = objects
        .iter()
        .map(|object| object.settings.iter().any(|(key, _)| is_setting(key)));
    let count = kept.chain(of_meshes).filter(|has| *has).count();
    let own = match count {
        0 => None,
        1 => Some("1 object or modifier".to_string()),
        count => Some(format!("{count} objects and modifiers")),
    };
    let by_height = has_heights.then(|| "height ranges".to_string());
    let whose: Vec<String> = own.into_iter().chain(by_height).collect();
    (!whose.is_empty()).then(|| {
        format!(
            "settings of {} are not followed: give layer heights, walls, infill and speeds as options",
            whose.join(" and of ")
        )
    })
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
    objects: &[&Object],
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
    notes.extend(own_settings(roles, objects, unfollowed.has_heights));
    notes.extend(painted(&all));
    notes.extend(unfollowed.notes());
    notes
}
