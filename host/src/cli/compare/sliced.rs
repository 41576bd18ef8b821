//! A slicer's own file beside a comparison: its nozzle's motion as it is, timed under the same limits.
//!
//! In: G-code, the machine of the comparison. Out: its job with a round nozzle of the file's diameter, and what
//! the slicer estimates. Leaves out ground that stays open: the file has no outline to tell it from.

use crate::cli::args::compare::{CompareArgs, HeadingAxis};
use crate::cli::args::{InputArgs, PartArgs, PlaceArgs, SettingsArgs};
use crate::cli::error::CliError;
use crate::cli::plan::planned;
use crate::cli::reading::load;
use crate::cli::terminal::console::Console;
use crate::pipeline::planned::Planned;
use std::path::{Path, PathBuf};

/// Diameter of a nozzle that a file does not name, mm: what most printers have.
const USUAL_MM: f64 = 0.4;

/// A slicer's file, and the nozzle that it was made for.
pub(crate) struct SlicedFile {
    path: PathBuf,
    /// As an option has it.
    pub(crate) aperture: String,
}

impl SlicedFile {
    /// Looks for the nozzle that the file names.
    pub(crate) fn read(path: &Path, console: &Console) -> Result<SlicedFile, CliError> {
        let diameter_mm = nozzle_diameter_mm(&load::read_text(path)?);
        if diameter_mm.is_none() {
            console.notes(&[format!(
                "{}: names no nozzle_diameter; {USUAL_MM} mm is taken",
                path.display()
            )]);
        }
        Ok(SlicedFile {
            path: path.to_path_buf(),
            aperture: format!("circle:{}", diameter_mm.unwrap_or(USUAL_MM)),
        })
    }

    /// Its name without folders.
    pub(crate) fn name(&self) -> String {
        let name = self.path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// Plans the file along its own lines.
    pub(crate) fn planned(
        &self,
        args: &CompareArgs,
        axis: HeadingAxis,
        console: &Console,
    ) -> Result<Planned, CliError> {
        let path = &self.path;
        let asked = PartArgs {
            settings: SettingsArgs {
                machine: args.asked.settings.machine.clone(),
                heading_axis: Some(axis),
                aperture: vec![self.aperture.clone()],
                ..SettingsArgs::default()
            },
            reading: InputArgs {
                from: None,
                units: None,
                scale: 1.0,
                repair: false,
                rotate: None,
                dxf_layer: Vec::new(),
                ..args.asked.reading.clone()
            },
            place: PlaceArgs::default(),
        };
        let planned = planned::from_input(path, &asked, &[], None, console)?;
        if planned.outline.is_empty() && planned.plan.is_none() {
            return Ok(planned);
        }
        Err(CliError::Usage(format!(
            "--sliced {}: give a slicer's G-code",
            path.display()
        )))
    }
}

/// What a slicer's comment says: `; nozzle_diameter = 0.4`, of several the first.
fn nozzle_diameter_mm(text: &str) -> Option<f64> {
    let comments = text
        .lines()
        .filter_map(|line| line.trim().strip_prefix(';'));
    let mut named = comments.filter_map(|comment| {
        let value = comment.trim().strip_prefix("nozzle_diameter")?;
        let value = value.trim_start().strip_prefix(['=', ':'])?;
        let first = value.split([',', ';']).next()?;
        first.trim().parse::<f64>().ok()
    });
    named.find(|mm| (0.05..=20.0).contains(mm))
}

#[cfg(test)]
mod tests {
    use super::nozzle_diameter_mm;

    #[test]
    fn the_nozzle_is_what_the_comment_says() {
        for (text, expected) in [
            ("G1 X1\n; nozzle_diameter = 0.4\n", Some(0.4)),
            ("; nozzle_diameter = 0.6,0.4", Some(0.6)),
            (";nozzle_diameter: 0.25", Some(0.25)),
            ("; nozzle_diameter_note = 0.4", None),
            ("; nozzle_diameter = wide", None),
            ("; nozzle_diameter = 900", None),
            ("G1 X0.4 nozzle_diameter = 0.4", None),
        ] {
            assert_eq!(nozzle_diameter_mm(text), expected, "{text}");
        }
    }
}
