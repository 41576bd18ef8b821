//! Options for slicing a mesh -> heights of its layers, checked.

use crate::cli::args::LayerArgs;
use crate::cli::error::CliError;
use crate::mesh::layers::{HeightRange, LAYER_MM, LayerHeights};
use crate::settings::Settings;

/// How a mesh is divided: the options over the layer height. A first layer without a height of its
/// own has that of the range that begins with it.
pub(crate) fn layer_heights(args: &LayerArgs, layer_mm: f64) -> Result<LayerHeights, CliError> {
    check("--layer-height", layer_mm)?;
    let ranges = args.layer_heights.as_deref().map(parse_heights);
    let ranges = ranges.transpose()?.unwrap_or_default();
    let lowest = ranges.first().filter(|range| range.from_mm <= 0.0);
    let of_others_mm = lowest.map_or(layer_mm, |range| range.fitted_mm(range.to_mm));
    let first_mm = args.first_layer_height.unwrap_or(of_others_mm);
    check("--first-layer-height", first_mm)?;
    if let Some(range) = ranges.first().filter(|range| range.to_mm <= first_mm) {
        return Err(CliError::Usage(format!(
            "--layer-heights: the range up to {} mm lies in the first layer, which is {first_mm} mm high: \
             leave it out or give a smaller --first-layer-height",
            range.to_mm
        )));
    }
    let range = args.layer_range.as_deref().map(parse_range).transpose()?;
    Ok(LayerHeights {
        first_mm,
        layer_mm,
        ranges,
        range,
    })
}

/// Heights that the nozzle can print: no bead is higher than the widest one is wide.
pub(crate) fn check_bead_height(
    heights: &LayerHeights,
    settings: &Settings,
) -> Result<(), CliError> {
    let most_mm = 2.0 * settings.aperture.major_mm();
    if heights.first_mm > most_mm {
        return Err(CliError::Usage(format!(
            "--first-layer-height {}: this aperture's widest bead is {most_mm:.3} mm wide: give a lower height",
            heights.first_mm
        )));
    }
    let steep = heights.ranges.iter().find(|range| range.layer_mm > most_mm);
    steep.map_or(Ok(()), |range| {
        Err(CliError::Usage(format!(
            "--layer-heights: layers of {} mm from {} to {} mm, and this aperture's widest bead is {most_mm:.3} \
             mm wide: give a lower height",
            range.layer_mm, range.from_mm, range.to_mm
        )))
    })
}

fn check(option: &str, height_mm: f64) -> Result<(), CliError> {
    if (LAYER_MM[0]..=LAYER_MM[1]).contains(&height_mm) {
        return Ok(());
    }
    Err(CliError::Usage(format!(
        "{option} {height_mm}: write a height of {} to {} mm",
        LAYER_MM[0], LAYER_MM[1]
    )))
}

/// Reads `A-B` or `A`.
fn parse_range(text: &str) -> Result<[u32; 2], CliError> {
    let (from, to) = text.split_once('-').unwrap_or((text, text));
    match (from.trim().parse(), to.trim().parse()) {
        (Ok(from), Ok(to)) => Ok([from, to]),
        _ => Err(CliError::Usage(format!(
            "--layer-range {text}: write the first and the last layer, as in --layer-range 1-20"
        ))),
    }
}

/// Reads `A-B:H,A-B:H`, upwards.
fn parse_heights(text: &str) -> Result<Vec<HeightRange>, CliError> {
    let mut ranges: Vec<HeightRange> = Vec::new();
    for part in text.split(',') {
        let range = height_range(part).ok_or_else(|| {
            CliError::Usage(format!(
                "--layer-heights {text}: write from where to where above the bed layers are how high, in mm, \
                 as in --layer-heights 0-2:0.1,2-10:0.2; {part:?} is none of that"
            ))
        })?;
        check("--layer-heights", range.layer_mm)?;
        if range.from_mm >= range.to_mm {
            return Err(CliError::Usage(format!(
                "--layer-heights: the range from {} to {} mm is empty: write the lower end first",
                range.from_mm, range.to_mm
            )));
        }
        if let Some(below) = ranges.last().filter(|below| below.to_mm > range.from_mm) {
            return Err(CliError::Usage(format!(
                "--layer-heights: the range from {} mm begins below the end of the one before it, {} mm: write \
                 ranges upwards, each from where the last one ends",
                range.from_mm, below.to_mm
            )));
        }
        ranges.push(range);
    }
    Ok(ranges)
}

/// Reads `A-B:H`.
fn height_range(text: &str) -> Option<HeightRange> {
    let (ends, height) = text.split_once(':')?;
    let (from, to) = ends.split_once('-')?;
    let number = |text: &str| {
        let number: f64 = text.trim().parse().ok()?;
        (number.is_finite() && number >= 0.0).then_some(number)
    };
    Some(HeightRange {
        from_mm: number(from)?,
        to_mm: number(to)?,
        layer_mm: number(height)?,
    })
}
