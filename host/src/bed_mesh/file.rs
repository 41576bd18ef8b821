//! `bed.toml`: a bed mesh as readable text. Text <-> [`BedMesh`], checked.

use super::surface::POINTS_MIN;
use super::{BedMesh, FADE_HEIGHT_MM, FADE_START_MM};
use crate::text::short_number::Short;
use serde::Deserialize;
use std::fmt::Write;

/// Most points along a side.
pub const POINTS_MAX: usize = 64;
/// A bed that is farther from Z 0 is another bed.
pub const HEIGHT_MAX_MM: f64 = 20.0;
/// Furthest corner of a grid, mm.
const PLACE_MAX_MM: f64 = 10_000.0;

/// Why a mesh file cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BedMeshFileError {
    /// Not TOML, an unknown or missing key, or a value of the wrong type.
    #[error("{0}")]
    Toml(String),
    /// A value out of range, with its key.
    #[error("{0}; probe the bed again (headway board mesh)")]
    Value(String),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    machine: String,
    fade_start_mm: Option<f64>,
    fade_height_mm: Option<f64>,
    grid: Grid,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Grid {
    min_mm: [f64; 2],
    max_mm: [f64; 2],
    heights_mm: Vec<Vec<f64>>,
}

/// Reads and checks a mesh.
///
/// # Errors
/// [`BedMeshFileError`] with the key.
pub fn from_toml(text: &str) -> Result<BedMesh, BedMeshFileError> {
    let file: File = toml::from_str(text)
        .map_err(|error| BedMeshFileError::Toml(error.to_string().trim_end().to_string()))?;
    let value = |problem: String| Err(BedMeshFileError::Value(problem));
    let Ok(machine_hash) = u32::from_str_radix(&file.machine, 16) else {
        return value(format!("machine: {} is no machine's hash", file.machine));
    };
    let Grid {
        min_mm,
        max_mm,
        heights_mm,
    } = file.grid;
    for axis in 0..2 {
        let place = |at: f64| at.abs() <= PLACE_MAX_MM;
        // Written so that a NaN does not fit.
        let rises = max_mm[axis] - min_mm[axis] >= 1.0;
        if !rises || !place(min_mm[axis]) || !place(max_mm[axis]) {
            return value("grid: max_mm is at least 1 mm above min_mm".to_string());
        }
    }
    let sizes = POINTS_MIN..=POINTS_MAX;
    let columns = heights_mm.first().map_or(0, Vec::len);
    let is_grid = heights_mm.iter().all(|row| row.len() == columns);
    if !sizes.contains(&heights_mm.len()) || !sizes.contains(&columns) || !is_grid {
        return value(format!(
            "grid.heights_mm: {POINTS_MIN} to {POINTS_MAX} rows of {POINTS_MIN} to {POINTS_MAX} numbers, all of \
             them as long"
        ));
    }
    let far = |height: &&f64| height.is_nan() || height.abs() > HEIGHT_MAX_MM;
    if let Some(height) = heights_mm.iter().flatten().find(far) {
        return value(format!(
            "grid.heights_mm: {} is farther than {HEIGHT_MAX_MM} mm from Z 0",
            Short(*height)
        ));
    }
    let fade_start_mm = file.fade_start_mm.unwrap_or(FADE_START_MM);
    let fade_height_mm = file.fade_height_mm.unwrap_or(FADE_HEIGHT_MM);
    let fades = fade_start_mm >= 0.0 && fade_height_mm - fade_start_mm >= 0.1;
    if !fades || fade_height_mm > PLACE_MAX_MM {
        return value(format!(
            "fade_height_mm: {} is not above fade_start_mm, {}, by 0.1 mm",
            Short(fade_height_mm),
            Short(fade_start_mm)
        ));
    }
    Ok(BedMesh {
        machine_hash,
        min_mm,
        max_mm,
        heights_mm,
        fade_start_mm,
        fade_height_mm,
    })
}

/// The mesh as a file.
pub fn to_toml(mesh: &BedMesh) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write(&mut text, mesh);
    text
}

fn write(text: &mut String, mesh: &BedMesh) -> std::fmt::Result {
    let [low, high] = mesh.range_mm();
    writeln!(
        text,
        "# Where the nozzle touches the bed, Z in mm. `headway stream JOB --mesh FILE` prints over it.\n\
         # Range {low:.4} to {high:.4} mm, mean {:.4} mm.",
        mesh.mean_mm()
    )?;
    writeln!(text, "machine = \"{:08x}\"", mesh.machine_hash)?;
    writeln!(
        text,
        "# The job follows the bed up to the first height, and is planar from the second one on.\n\
         fade_start_mm = {}\nfade_height_mm = {}",
        mesh.fade_start_mm, mesh.fade_height_mm
    )?;
    writeln!(
        text,
        "\n# Places are the nozzle's, machine coordinates. Rows from the lowest y up, each from the lowest x.\n[grid]"
    )?;
    let [x, y] = mesh.min_mm;
    writeln!(text, "min_mm = [{x}, {y}]")?;
    let [x, y] = mesh.max_mm;
    writeln!(text, "max_mm = [{x}, {y}]")?;
    writeln!(text, "heights_mm = [")?;
    for row in &mesh.heights_mm {
        let row: Vec<String> = row.iter().map(|height| format!("{height:.4}")).collect();
        writeln!(text, "    [{}],", row.join(", "))?;
    }
    writeln!(text, "]")
}
