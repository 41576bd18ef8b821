//! Layer heights and other settings by height that slicers keep for each object.
//!
//! In: `layer_config_ranges.xml` and `layer_heights_profile.txt` of PrusaSlicer, OrcaSlicer and Bambu Studio, which number
//! objects in the order of the build. Out: ranges of heights above an object's lowest point (mm) with their settings; the
//! layer heights of the job, where all of its objects ask for the same. Leaves out whether the job can follow them.

use super::model::{Item, Model};
use super::own_settings::PlacedObject;
use super::roles::{KeyValues, Roles};
use super::unfollowed::{settings_text, told};
use super::xml::{Part, read};
use crate::mesh::MeshError;
use crate::mesh::layers::HeightRange;
use crate::mesh::object_settings::OwnSettings;
use std::collections::{BTreeMap, HashMap};

/// Layer heights that differ by less are the same, mm: profiles are text of six digits.
const SAME_MM: f64 = 1e-4;
/// Most layers of a profile.
const PROFILE_LAYERS_MAX: usize = 10_000;

/// A range of heights, and the settings there.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RangeOfObject {
    pub from_mm: f64,
    pub to_mm: f64,
    pub settings: KeyValues,
}

/// What is kept of an object.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct RangesOfObject {
    pub ranges: Vec<RangeOfObject>,
    /// Heights and the layer heights there, between which it changes steadily, mm.
    profile: Vec<[f64; 2]>,
}

/// What is kept of all objects, by their numbers in the build, from 1.
#[derive(Debug, Default)]
pub(super) struct Ranges(BTreeMap<usize, RangesOfObject>);

impl Ranges {
    /// Reads ranges of heights; those whose ends are no numbers are none.
    pub fn read(&mut self, text: &[u8]) -> Result<(), MeshError> {
        let (mut number, mut key, mut is_range) = (None, None, false);
        read(text, |part| {
            match part {
                Part::Open(tag) => match tag.name().as_ref() {
                    "object" => number = tag.number("id").ok(),
                    "range" => {
                        let ends: Option<[f64; 2]> = tag.numbers(["min_z", "max_z"]).ok();
                        let own = number.map(|number| self.0.entry(number).or_default());
                        is_range = false;
                        if let (Some([from_mm, to_mm]), Some(own)) = (ends, own) {
                            is_range = from_mm.is_finite() && to_mm.is_finite();
                            own.ranges.extend(is_range.then(|| RangeOfObject {
                                from_mm,
                                to_mm,
                                settings: Vec::new(),
                            }));
                        }
                    }
                    "option" => key = tag.get("opt_key"),
                    _ => {}
                },
                Part::Text(value) => {
                    let own = number.and_then(|number| self.0.get_mut(&number));
                    let range = own.and_then(|own| own.ranges.last_mut());
                    if let (Some(range), Some(key), true) = (range, key.take(), is_range) {
                        // The extruder of the object.
                        if key != "extruder" {
                            range.settings.push((key, value.trim().to_string()));
                        }
                    }
                }
                Part::Close(_) => {}
            }
            Ok(())
        })
    }

    /// Reads layer heights that change steadily: `object_id=1|height;layer height;height;...`.
    pub fn read_profiles(&mut self, text: &[u8]) {
        for line in String::from_utf8_lossy(text).lines() {
            let Some((id, numbers)) = line.split_once('|') else {
                continue;
            };
            let id = id.trim().strip_prefix("object_id=").unwrap_or_default();
            let numbers: Result<Vec<f64>, _> = numbers
                .split(';')
                .map(str::trim)
                .filter(|number| !number.is_empty())
                .map(str::parse)
                .collect();
            if let (Ok(number), Ok(numbers)) = (id.parse(), numbers) {
                let pairs = numbers.chunks_exact(2).map(|pair| [pair[0], pair[1]]);
                self.0.entry(number).or_default().profile = pairs.collect();
            }
        }
    }

    /// The ranges of an object of the build.
    pub fn of(&self, number: Option<usize>) -> Option<&RangesOfObject> {
        self.0.get(&number?)
    }

    /// Layer heights that all placed objects ask for, which stand at one height; or what they ask for, if it is followed
    /// nowhere.
    pub fn heights(
        &self,
        placed: &[(PlacedObject, Option<usize>)],
    ) -> (Vec<HeightRange>, Vec<String>) {
        let of_each: Vec<Vec<HeightRange>> = placed
            .iter()
            .map(|(_, number)| self.of(*number).map_or(Vec::new(), RangesOfObject::heights))
            .collect();
        let unplaced = self
            .0
            .keys()
            .filter(|number| placed.iter().all(|(_, own)| own != &Some(**number)));
        let unplaced = unplaced.map(|number| {
            format!("height ranges of object {number}, which is not printed, are not followed")
        });
        let mut notes: Vec<String> = unplaced.collect();
        let lowest = |(object, _): &(PlacedObject, Option<usize>)| object.low.z;
        let is_level = |pair: &[(PlacedObject, Option<usize>)]| {
            (lowest(&pair[0]) - lowest(&pair[1])).abs() < SAME_MM
        };
        let is_one = of_each.windows(2).all(|pair| is_same(&pair[0], &pair[1]));
        if is_one && placed.windows(2).all(is_level) {
            return (of_each.into_iter().next().unwrap_or_default(), notes);
        }
        let objects = placed.iter().zip(&of_each);
        let asked = objects.map(|((object, _), heights)| match heights.is_empty() {
            true => format!("{}: none", object.called()),
            false => format!("{}: {}", object.called(), heights_text(heights)),
        });
        notes.push(format!(
            "layer heights of objects differ, or their lowest points do, and are not followed: {}; --layer-heights \
             gives all of the print the same",
            told(asked, "; ")
        ));
        (Vec::new(), notes)
    }

    /// Settings of ranges that are followed, and those that are not; layer heights have a note of their own.
    pub fn settings_notes(
        &self,
        placed: &[(PlacedObject, Option<usize>)],
        is_followed: bool,
    ) -> Vec<String> {
        let mut found: [Vec<String>; 2] = Default::default();
        let own = placed
            .iter()
            .filter_map(|(object, number)| Some((object, self.of(*number)?)));
        for (object, range) in
            own.flat_map(|(object, own)| own.ranges.iter().map(move |r| (object, r)))
        {
            let settings = range
                .settings
                .iter()
                .filter(|(key, _)| key != "layer_height")
                .cloned();
            let (own, others): (KeyValues, KeyValues) = settings
                .partition(|(key, value)| is_followed && OwnSettings::follows(key, value, false));
            for (found, settings) in found.iter_mut().zip([own, others]) {
                if !settings.is_empty() {
                    let (name, text) = (object.called(), settings_text(&settings));
                    found.push(format!(
                        "{name}, {} to {} mm: {text}",
                        range.from_mm, range.to_mm
                    ));
                }
            }
        }
        let texts = [
            "settings of height ranges that are followed",
            "settings of height ranges are not followed",
        ];
        let found = found
            .into_iter()
            .zip(texts)
            .filter(|(found, _)| !found.is_empty());
        found
            .map(|(found, text)| format!("{text}: {}", told(found.into_iter(), "; ")))
            .collect()
    }
}

impl RangesOfObject {
    /// The layer heights, upwards: by the ranges, of which those without one are none, or by the profile.
    fn heights(&self) -> Vec<HeightRange> {
        if self.profile.len() > 1 {
            return profile_heights(&self.profile);
        }
        let ranges = self.ranges.iter().filter_map(|range| {
            let height = range.settings.iter().find(|(key, _)| key == "layer_height");
            Some(HeightRange {
                from_mm: range.from_mm,
                to_mm: range.to_mm,
                layer_mm: height?.1.parse().ok()?,
            })
        });
        let mut ranges: Vec<HeightRange> = ranges.collect();
        ranges.sort_by(|p, q| p.from_mm.total_cmp(&q.from_mm));
        ranges
    }
}

/// The layers of a profile: each as high as the profile is at its middle, and equal ones as a range.
fn profile_heights(profile: &[[f64; 2]]) -> Vec<HeightRange> {
    let at = |z_mm: f64| {
        let above = profile.partition_point(|[z, _]| *z <= z_mm);
        let [low, high] =
            [above.saturating_sub(1), above].map(|i| profile[i.min(profile.len() - 1)]);
        match high[0] - low[0] {
            wide if wide > 0.0 => low[1] + (high[1] - low[1]) * ((z_mm - low[0]) / wide),
            _ => low[1],
        }
    };
    let end_mm = profile.last().map_or(0.0, |[z, _]| *z);
    let (mut ranges, mut z_mm): (Vec<HeightRange>, f64) = (Vec::new(), 0.0);
    for _ in 0..PROFILE_LAYERS_MAX {
        let layer_mm = at(z_mm + 0.5 * at(z_mm));
        let is_height = layer_mm.is_finite() && layer_mm > 0.0;
        if !is_height || z_mm + 0.5 * layer_mm >= end_mm {
            break;
        }
        let to_mm = z_mm + layer_mm;
        match ranges.last_mut() {
            Some(below) if (below.layer_mm - layer_mm).abs() < SAME_MM => below.to_mm = to_mm,
            _ => ranges.push(HeightRange {
                from_mm: z_mm,
                to_mm,
                layer_mm,
            }),
        }
        z_mm = to_mm;
    }
    ranges
}

fn is_same(one: &[HeightRange], other: &[HeightRange]) -> bool {
    let is_near = |p: f64, q: f64| (p - q).abs() < SAME_MM;
    one.len() == other.len()
        && one.iter().zip(other).all(|(p, q)| {
            is_near(p.from_mm, q.from_mm)
                && is_near(p.to_mm, q.to_mm)
                && is_near(p.layer_mm, q.layer_mm)
        })
}

/// Ranges as `--layer-heights` takes them.
fn heights_text(heights: &[HeightRange]) -> String {
    let ranges = heights.iter().map(|range| {
        let [from, to, layer] =
            [range.from_mm, range.to_mm, range.layer_mm].map(|mm| (mm * 1e4).round() / 1e4);
        format!("{from}-{to}:{layer}")
    });
    told(ranges, ",")
}

/// The numbers of objects of the build, from 1, by the ids that items name. A further instance of an object is an object
/// of its own that has the first one as its only component.
pub(super) fn numbers(root: &Model, roles: &Roles) -> HashMap<usize, usize> {
    let others = root.objects.iter();
    let others = others.filter(|object| !roles.objects.contains_key(&object.id));
    let first_of: HashMap<usize, usize> = others
        .filter_map(|object| Some((object.id, object.first_instance()?.object)))
        .collect();
    let mut numbers: HashMap<usize, usize> = HashMap::new();
    let mut count = 0;
    for Item { object: id, .. } in &root.items {
        let first = first_of.get(id).unwrap_or(id);
        let number = *numbers.entry(*first).or_insert_with(|| {
            count += 1;
            count
        });
        numbers.insert(*id, number);
    }
    numbers
}
