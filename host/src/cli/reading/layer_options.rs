//! Options for slicing a mesh -> its layers, and their heights.

use crate::cli::args::LayerArgs;
use crate::cli::error::CliError;
use crate::mesh::layers::{HeightRange, LayerHeights, check_height};

/// How a mesh is divided.
pub(crate) fn layer_heights(args: &LayerArgs, layer_mm: f64) -> Result<LayerHeights, CliError> {
    let (first_mm, ranges) = (args.first_layer_height, height_ranges(args)?);
    let heights = LayerHeights::of(layer_mm, first_mm, ranges, layer_range(args)?);
    heights.map_err(|error| CliError::Usage(error.to_string()))
}

/// The layers that are wanted.
pub(crate) fn layer_range(args: &LayerArgs) -> Result<Option<[u32; 2]>, CliError> {
    args.layer_range.as_deref().map(parse_range).transpose()
}

/// Ranges of layers of their own height.
pub(crate) fn height_ranges(args: &LayerArgs) -> Result<Vec<HeightRange>, CliError> {
    let ranges = args.layer_heights.as_deref().map(parse_heights);
    Ok(ranges.transpose()?.unwrap_or_default())
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
        let checked = check_height("--layer-heights", range.layer_mm);
        checked.map_err(|error| CliError::Usage(error.to_string()))?;
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
