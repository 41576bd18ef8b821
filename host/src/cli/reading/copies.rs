//! `--copies` and several `--at`: the same part several times on the bed.
//!
//! In: the options, the part's outlines (input coordinates, mm). Out: the offset of each copy from the first one, or
//! why it cannot be placed. Not covered: parts of different files.

use crate::cli::args::PlaceArgs;
use crate::cli::error::CliError;
use crate::cli::reading::load::parse_at;
use crate::geometry::Vector2;
use crate::geometry::polygon::{Box2, Region};
use crate::input;
use crate::input::copies::{box_of, checked_gap_mm, in_rows};
use crate::settings::Settings;

/// The option that requests several parts.
pub(crate) fn option(place: &PlaceArgs) -> Option<&'static str> {
    match (place.at.len() > 1, place.copies, place.copy_gap) {
        (true, ..) => Some("a second --at"),
        (_, Some(_), _) => Some("--copies"),
        (_, _, Some(_)) => Some("--copy-gap"),
        _ => None,
    }
}

/// Machine coordinates of the first part's origin, where they are given.
pub(crate) fn first_at_mm(place: &PlaceArgs) -> Result<Option<[f64; 3]>, CliError> {
    place.at.first().map(|text| parse_at(text)).transpose()
}

/// The outlines of several parts from those of one; `layers` are all different layers of it, each replaced by
/// that of all parts. Says how many there are where that is more than one.
pub(crate) fn spread<'a>(
    place: &PlaceArgs,
    layers: impl Iterator<Item = &'a mut Vec<Region>>,
    settings: &Settings,
) -> Result<Option<String>, CliError> {
    if option(place).is_none() {
        return Ok(None);
    }
    let mut layers: Vec<&mut Vec<Region>> = layers.collect();
    let offsets = offsets(place, box_of(&layers), settings)?;
    let told = input::copies::spread(&mut layers, &offsets);
    told.map(Some)
        .map_err(|error| CliError::Job(error.to_string()))
}

fn offsets(place: &PlaceArgs, part: Box2, settings: &Settings) -> Result<Vec<Vector2>, CliError> {
    if let [first, _, ..] = place.at.as_slice() {
        if place.copies.is_some() || place.copy_gap.is_some() {
            return Err(CliError::Usage(
                "several --at give the position of each part: omit --copies and --copy-gap"
                    .to_string(),
            ));
        }
        let [x, y, z] = parse_at(first)?;
        let offset = |text: &String| {
            let at = parse_at(text)?;
            match at[2] == z {
                true => Ok(Vector2::new(at[0] - x, at[1] - y)),
                false => Err(CliError::Usage(format!(
                    "--at {text}: parts of one bed have the same Z, here {z}"
                ))),
            }
        };
        return place.at.iter().map(offset).collect();
    }
    let gap_mm = checked_gap_mm(place.copy_gap);
    let gap_mm = gap_mm.map_err(|error| CliError::Usage(error.to_string()))?;
    let Some(copies) = place.copies else {
        return Err(CliError::Usage("--copy-gap goes with --copies".to_string()));
    };
    let [low, high] = settings.work_area_mm;
    let area_mm = [high[0] - low[0], high[1] - low[1]];
    in_rows(copies, part, gap_mm, area_mm).map_err(|error| CliError::Job(error.to_string()))
}
