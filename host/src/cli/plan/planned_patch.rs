//! Plans a patch of a mesh, by itself or with an outline drawn on it.

use crate::cli::args::{InputArgs, NO_INPUT, PlaceArgs, UnitName};
use crate::cli::error::CliError;
use crate::cli::plan::planned::{finished, plan_error};
use crate::cli::reading::{copies, job, load, load_run};
use crate::cli::terminal::console::Console;
use crate::input::space_outline::{SpaceOutline, read_in_space};
use crate::input::{Format, ReadOptions, Target};
use crate::mesh::Mesh;
use crate::pipeline::planned::Planned;
use crate::pipeline::surface::plan_on_patch;
use crate::settings::Settings;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A patch and the drawing on it.
pub(crate) struct Patch {
    /// What messages call it.
    path: PathBuf,
    mesh: Mesh,
    outline: Option<SpaceOutline>,
}

/// The patch that is wanted: where there is a surface and no input, or an input with points in space.
pub(crate) fn wanted(
    path: &Path,
    (reading, place): (&InputArgs, &PlaceArgs),
) -> Result<Option<Patch>, CliError> {
    let Some(surface) = &place.surface else {
        return Ok(None);
    };
    let is_alone = path.as_os_str() == NO_INPUT;
    let outline = match is_alone {
        true => None,
        false => drawn(path, reading)?,
    };
    if !is_alone && outline.is_none() {
        return Ok(None);
    }
    let problem = if place.keep_out.is_some() {
        Some("--keep-out goes with outlines that are seen from above")
    } else if copies::option(place).is_some() {
        Some("a surface carries one part: leave --copies and further --at out")
    } else {
        None
    };
    if let Some(problem) = problem {
        return Err(CliError::Usage(problem.to_string()));
    }
    let path = if is_alone { surface } else { path };
    let mesh = load_run::surface(place, reading)?;
    Ok(mesh.map(|mesh| Patch {
        path: path.to_path_buf(),
        mesh,
        outline,
    }))
}

/// An outline in space; `None` for any other input.
fn drawn(path: &Path, reading: &InputArgs) -> Result<Option<SpaceOutline>, CliError> {
    let format = Format::of_ending(path);
    if reading.from.is_some() || format != Some(Format::Polygon) {
        return Ok(None);
    }
    let options = ReadOptions {
        units: reading.units.map(UnitName::units),
        scale: reading.scale,
        ..ReadOptions::default()
    };
    let bytes = load::read_bounded(path, Format::Polygon.bytes_max())?;
    let outline = read_in_space(&bytes, &job::stem(path), &options);
    outline.map_err(|error| CliError::Job(format!("{}: {error}", path.display())))
}

impl Patch {
    /// Plans it.
    pub(crate) fn planned(
        self,
        settings: Settings,
        console: &Console,
    ) -> Result<Planned, CliError> {
        let (bar, begun) = (console.planning(), Instant::now());
        let planned = plan_on_patch(self.outline.as_ref(), &self.mesh, &settings, &bar);
        let plan_s = begun.elapsed().as_secs_f64();
        bar.clear();
        let plan = planned.map_err(|error| plan_error(&self.path, &error))?;
        let name = match self.outline {
            Some(outline) => outline.name,
            None => job::stem(&self.path),
        };
        let target = Target {
            name,
            regions: Vec::new(),
        };
        Ok(finished(
            plan,
            plan_s,
            target,
            Vec::new(),
            settings,
            console,
        ))
    }
}
