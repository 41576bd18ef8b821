//! `--copies` and several `--at`: the same part several times on the bed.
//!
//! In: the options, the part's outlines (input coordinates, mm). Out: where each copy lies against the first one, or
//! why it cannot. Leaves out parts of different files.

use crate::cli::args::PlaceArgs;
use crate::cli::error::CliError;
use crate::cli::reading::load::parse_at;
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::{Point2, Vector2};
use crate::input::copies::{check_apart, copied, in_rows};
use crate::settings::Settings;

/// Between copies where nothing else is asked, mm.
const GAP_MM: f64 = 5.0;
/// Gaps that are taken, mm.
const GAPS_MM: [f64; 2] = [0.2, 1000.0];

/// The option that asks for several parts.
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
    let outlines = || layers.iter().flat_map(|layer| layer.iter());
    let corners: Vec<Point2> = outlines()
        .flat_map(|region| [region.bounds().min, region.bounds().max])
        .collect();
    let offsets = offsets(place, Box2::of(&corners), settings)?;
    check_apart(outlines(), &offsets).map_err(|error| CliError::Job(error.to_string()))?;
    for layer in &mut layers {
        **layer = copied(layer, &offsets);
    }
    let told = offsets.iter().take(4);
    let told: Vec<String> = told
        .map(|at| format!("({:.2}, {:.2})", at.x, at.y))
        .collect();
    let more = if offsets.len() > 4 { ", ..." } else { "" };
    let count = offsets.len();
    Ok(Some(format!(
        "{count} parts, printed layer by layer together, at {}{more} mm from the first",
        told.join(", ")
    )))
}

fn offsets(place: &PlaceArgs, part: Box2, settings: &Settings) -> Result<Vec<Vector2>, CliError> {
    if let [first, _, ..] = place.at.as_slice() {
        if place.copies.is_some() || place.copy_gap.is_some() {
            return Err(CliError::Usage(
                "several --at say where each part lies: leave --copies and --copy-gap out"
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
    let gap_mm = place.copy_gap.unwrap_or(GAP_MM);
    if !(GAPS_MM[0]..=GAPS_MM[1]).contains(&gap_mm) {
        return Err(CliError::Usage(format!(
            "--copy-gap {gap_mm}: write {} to {} mm",
            GAPS_MM[0], GAPS_MM[1]
        )));
    }
    let Some(copies) = place.copies else {
        return Err(CliError::Usage("--copy-gap goes with --copies".to_string()));
    };
    let [low, high] = settings.work_area_mm;
    let area_mm = [high[0] - low[0], high[1] - low[1]];
    in_rows(copies, part, gap_mm, area_mm).map_err(|error| CliError::Job(error.to_string()))
}
