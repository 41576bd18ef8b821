//! Settings of a slicer's project that are not applied: one message for each kind, so that nothing is
//! dropped silently.

use super::model::{Object, Painted, paint_names};
use super::roles::{KeyValues, ObjectNotes, Role, Roles};
use super::xml::{Part, read};
use crate::mesh::MeshError;
use crate::mesh::object_settings::ObjectInfill;
use std::collections::BTreeSet;

/// Entries of a list that are reported one by one.
const TOLD_MAX: usize = 8;
/// Longest list, characters.
const CHARS_MAX: usize = 600;

/// Heights of an object, and the settings there.
const RANGES: [&str; 2] = [
    "Metadata/Slic3r_PE_layer_config_ranges.xml",
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
    /// From and to, mm, and the settings there.
    ranges: Vec<([String; 2], KeyValues)>,
    /// What, and at which height, mm.
    codes: Vec<(String, String)>,
    has_profile: bool,
    has_project: bool,
}

/// True for files that [`Unfollowed::read`] knows.
pub(super) fn is_known(name: &str) -> bool {
    let is_cura = name.starts_with("Cura/");
    let known = [RANGES, CODES, PROFILES, PROJECTS].concat();
    is_cura || known.contains(&name)
}

impl Unfollowed {
    /// Reads a file that [`is_known`].
    pub fn read(&mut self, name: &str, text: &[u8]) -> Result<(), MeshError> {
        if RANGES.contains(&name) {
            self.read_ranges(text)?;
        } else if CODES.contains(&name) {
            self.read_codes(text)?;
        } else if PROFILES.contains(&name) {
            self.has_profile |= text.contains(&b';');
        } else {
            self.has_project = true;
        }
        Ok(())
    }

    fn read_ranges(&mut self, text: &[u8]) -> Result<(), MeshError> {
        let mut key = None;
        read(text, |part| {
            match part {
                Part::Open(tag) if tag.name() == "range" => {
                    let end = |name: &str| tag.get(name).unwrap_or_default();
                    self.ranges.push(([end("min_z"), end("max_z")], Vec::new()));
                }
                Part::Open(tag) if tag.name() == "option" => key = tag.get("opt_key"),
                Part::Text(value) => {
                    if let (Some((_, settings)), Some(key)) = (self.ranges.last_mut(), key.take()) {
                        settings.push((key, value.trim().to_string()));
                    }
                }
                _ => {}
            }
            Ok(())
        })
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
        if !self.ranges.is_empty() {
            let ranges = self.ranges.iter().map(|([from, to], settings)| {
                format!("{from} to {to} mm: {}", settings_text(settings))
            });
            let option = self.heights_option();
            let option = option.map_or(String::new(), |option| {
                format!("; --layer-heights {option} gives all of the print these heights")
            });
            let ranges = told(ranges, "; ");
            notes.push(format!("height ranges are not followed: {ranges}{option}"));
        }
        if self.has_profile {
            let what = "layer heights that change over an object are not followed: --layer-heights gives \
                        ranges of their own";
            notes.push(what.to_string());
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

    /// The height ranges that have a layer height, as the option takes them.
    fn heights_option(&self) -> Option<String> {
        let mut ranges: Vec<([f64; 2], f64)> = Vec::new();
        for (ends, settings) in &self.ranges {
            let height = settings.iter().find(|(key, _)| key == "layer_height");
            if let Some((_, height)) = height {
                let number = |text: &String| text.parse::<f64>().ok();
                ranges.push(([number(&ends[0])?, number(&ends[1])?], number(height)?));
            }
        }
        ranges.sort_by(|p, q| p.0[0].total_cmp(&q.0[0]));
        ranges.dedup();
        let is_apart = ranges.windows(2).all(|pair| pair[0].0[1] <= pair[1].0[0]);
        let ranges: Vec<String> = ranges
            .iter()
            .map(|([from, to], height)| format!("{from}-{to}:{height}"))
            .collect();
        (is_apart && !ranges.is_empty()).then(|| ranges.join(","))
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

fn settings_text(settings: &[(String, String)]) -> String {
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
            notes.push(format!(
                "left out, since they are no material: {aside}; what they ask for is not followed"
            ));
        }
        match self.switched_off {
            0 => {}
            1 => notes.push("1 item that is switched off is left out".to_string()),
            items => notes.push(format!("{items} items that are switched off are left out")),
        }
        notes
    }
}

/// Settings of objects and volumes, each with its name: those that are followed, and the others. `followed` are the
/// objects whose settings are, where they can be.
fn object_settings(roles: &Roles, objects: &[&Object], followed: &BTreeSet<usize>) -> Vec<String> {
    let mut ids: Vec<&usize> = roles.objects.keys().collect();
    ids.sort();
    let mut found: [Vec<String>; 2] = Default::default();
    let mut push =
        |id: Option<usize>, name: Option<&String>, what: &str, settings: &[(String, String)]| {
            let can = id.is_some_and(|id| followed.contains(&id));
            let settings = settings.iter().cloned();
            let (own, others): (KeyValues, KeyValues) =
                settings.partition(|(key, value)| can && ObjectInfill::follows(key, value));
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
        push(Some(*id), name.as_ref(), "an object", settings);
        let parts = volumes.iter().filter(|volume| volume.role == Role::Part);
        let is_alone = parts.count() == 1;
        for volume in volumes {
            let what = volume.role.names()[0];
            let object = Some(*id).filter(|_| is_alone && volume.role == Role::Part);
            push(object, volume.name.as_ref(), what, &volume.settings);
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
        let what = object.role().names()[0];
        push(Some(object.id), object.name.as_ref(), what, &settings);
    }
    let [own, others] =
        found.map(|found| (!found.is_empty()).then(|| told(found.into_iter(), "; ")));
    let own = own.map(|own| format!("settings of objects that are followed: {own}"));
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
