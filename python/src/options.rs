//! Options as keywords.
//!
//! In: a dict, `None` where the machine's setting stays. Out: [`Options`]; the library's texts with the
//! command's options called as the keywords are.

use crate::{OptionsError, PartError};
use headway::api::{
    CurvedLayers, Directions, HeadingLaw, OPTION_NAMES, Options, PassMode, Place, Quality, Reading,
    SeamPlace, Units,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Options that are none of the planner's but of the input's place and reading, as the command calls them.
const OTHERS: [(&str, &str); 8] = [
    ("centre-lines", "centre_lines"),
    ("surface-region", "surface_region"),
    ("keep-out", "keep_out"),
    ("repair", "repair"),
    ("units", "units"),
    ("at", "at_mm"),
    ("cache", "cache"),
    ("shard", "shard"),
];

/// A text of the library with keywords in place of the command's options.
pub fn as_keywords(text: &str) -> String {
    let mut names: Vec<&(&str, &str)> = OPTION_NAMES.iter().chain(&OTHERS).collect();
    names.extend([&("aperture", "aperture"), &("scale", "scale")]);
    // Longer ones before those that they begin with.
    names.sort_by_key(|(option, _)| std::cmp::Reverse(option.len()));
    names
        .iter()
        .fold(text.to_string(), |text, (option, field)| {
            text.replace(&format!("--{option}"), &field.replace("_rad", "_deg"))
        })
}

/// The options of a dict.
pub fn options(given: &Bound<'_, PyDict>) -> PyResult<Options> {
    let mut options = Options::default();
    for (key, value) in given {
        let key: String = key.extract()?;
        if value.is_none() {
            continue;
        }
        let o = &mut options;
        match key.as_str() {
            "aperture" => o.aperture = Some(read(&key, &value, "a text as in ellipse:1.2x0.4")?),
            "speed_mm_s" => o.speed_mm_s = Some(number(&key, &value)?),
            "wall_speed_mm_s" => o.wall_speed_mm_s = Some(number(&key, &value)?),
            "solid_speed_mm_s" => o.solid_speed_mm_s = Some(number(&key, &value)?),
            "sparse_speed_mm_s" => o.sparse_speed_mm_s = Some(number(&key, &value)?),
            "layer_time_min_s" => o.layer_time_min_s = Some(number(&key, &value)?),
            "layer_time_max_s" => o.layer_time_max_s = Some(number(&key, &value)?),
            "outer_inner_ratio_max" => o.outer_inner_ratio_max = Some(number(&key, &value)?),
            "continuous_z" => o.continuous_z = Some(read(&key, &value, "True or False")?),
            "layer_height_mm" => o.layer_height_mm = Some(number(&key, &value)?),
            "layers" => o.layers = Some(count(&key, &value)?),
            "pass_mode" => o.pass_mode = Some(one_of(&key, &value, PassMode::NAMES)?),
            "heading_law" => o.heading_law = Some(one_of(&key, &value, HeadingLaw::NAMES)?),
            "quality" => o.quality = Some(one_of(&key, &value, Quality::NAMES)?),
            "tolerance_mm" => o.tolerance_mm = Some(number(&key, &value)?),
            "overlap_pct" => o.overlap_pct = Some(number(&key, &value)?),
            "walls" => o.walls = Some(count(&key, &value)?),
            "infill_density_pct" => o.infill_density_pct = Some(number(&key, &value)?),
            "bridge_max_mm" => o.bridge_max_mm = Some(number(&key, &value)?),
            "infill_spacing_mm" => o.infill_spacing_mm = Some(number(&key, &value)?),
            "infill_angle_deg" => o.infill_angle_rad = Some(number(&key, &value)?.to_radians()),
            "bottom_layers" => o.bottom_layers = Some(count(&key, &value)?),
            "top_layers" => o.top_layers = Some(count(&key, &value)?),
            "skirt_loops" => o.skirt_loops = Some(count(&key, &value)?),
            "skirt_distance_mm" => o.skirt_distance_mm = Some(number(&key, &value)?),
            "brim_loops" => o.brim_loops = Some(count(&key, &value)?),
            "avoid_crossing" => o.avoid_crossing = Some(read(&key, &value, "True or False")?),
            "seam" => o.seam = Some(one_of(&key, &value, SeamPlace::NAMES)?),
            "seam_direction_deg" => o.seam_direction_rad = Some(number(&key, &value)?.to_radians()),
            "first_layer_height_mm" => o.first_layer_height_mm = Some(number(&key, &value)?),
            "layer_range" => {
                o.layer_range = Some(read(&key, &value, "first and last layer, from 1")?)
            }
            "curved_layers" => {
                let text: String = read(&key, &value, "skin or skin:M")?;
                let asked = text.parse::<CurvedLayers>();
                o.curved_layers = Some(
                    asked
                        .map_err(|error| OptionsError::new_err(as_keywords(&error.to_string())))?,
                );
            }
            "directions" => {
                let text: String = read(&key, &value, "auto, or the text of a file")?;
                let asked = text.parse::<Directions>();
                o.directions = Some(
                    asked
                        .map_err(|error| OptionsError::new_err(as_keywords(&error.to_string())))?,
                );
            }
            "bead_width_mm" => o.bead_width_mm = Some(number(&key, &value)?),
            "copies" => o.copies = Some(count(&key, &value)?),
            "copy_gap_mm" => o.copy_gap_mm = Some(number(&key, &value)?),
            "gap_mm" => o.gap_mm = Some(number(&key, &value)?),
            "corner_tolerance_mm" => o.corner_tolerance_mm = Some(number(&key, &value)?),
            "place" => o.place = Some(one_of(&key, &value, Place::NAMES)?),
            _ => return Err(OptionsError::new_err(format!("{key} is no option"))),
        }
    }
    Ok(options)
}

/// How a file is read, of a dict.
pub fn reading(given: &Bound<'_, PyDict>) -> PyResult<Reading> {
    let mut reading = Reading::default();
    for (key, value) in given {
        let key: String = key.extract()?;
        if value.is_none() {
            continue;
        }
        match key.as_str() {
            "units" => {
                let text: String = read(&key, &value, "a unit")?;
                let units = Units::parse(&text);
                reading.units = Some(units.ok_or_else(|| {
                    PartError::new_err(format!("units {text:?}: give mm, cm, m, um or in"))
                })?);
            }
            "scale" => reading.scale = number(&key, &value)?,
            "repair" => reading.repair = read(&key, &value, "True or False")?,
            "centre_lines" => reading.centre_lines = read(&key, &value, "True or False")?,
            "flatten_mm" => reading.flatten_mm = number(&key, &value)?,
            "surface_region" => reading.surface_region = Some(read(&key, &value, "a region")?),
            _ => {
                return Err(OptionsError::new_err(format!(
                    "{key} is no option of reading"
                )));
            }
        }
    }
    Ok(reading)
}

fn number(key: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    read(key, value, "a number")
}

fn count(key: &str, value: &Bound<'_, PyAny>) -> PyResult<u32> {
    read(key, value, "a whole number from 0 on")
}

fn one_of<T: Copy>(key: &str, value: &Bound<'_, PyAny>, names: &[(&str, T)]) -> PyResult<T> {
    let all: Vec<&str> = names.iter().map(|(name, _)| *name).collect();
    let text: Option<String> = value.extract().ok();
    let known = names
        .iter()
        .find(|(name, _)| Some(*name) == text.as_deref());
    known
        .map(|(_, meant)| *meant)
        .ok_or_else(|| wrong(key, value, &format!("one of {}", all.join(", "))))
}

fn read<'py, T: for<'a> FromPyObject<'a, 'py>>(
    key: &str,
    value: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<T> {
    value.extract().map_err(|_| wrong(key, value, what))
}

fn wrong(key: &str, value: &Bound<'_, PyAny>, what: &str) -> PyErr {
    let given: String = value.to_string().chars().take(80).collect();
    OptionsError::new_err(format!("{key} is {given}: give {what}"))
}
