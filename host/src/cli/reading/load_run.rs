//! Options and files of paths in space -> runs of waypoints, surfaces, placements.

use crate::cli::args::{InputArgs, PlaceArgs};
use crate::cli::error::CliError;
use crate::cli::reading::load::{input, read_bounded};
use crate::cli::terminal::console::Console;
use crate::input::waypoints::WaypointRun;
use crate::input::{Format, Input};
use crate::mesh::{self, Mesh, MeshOptions, SurfaceRegion};
use crate::settings::obstacles::Obstacles;
use crate::settings::{AXIS_TOLERANCE_MAX_DEG, AXIS_TOLERANCE_RAD, Settings, TILT_MAX_ASKED_DEG};

/// A run with those that are to be printed after it.
pub(crate) fn with_more(
    run: WaypointRun,
    args: &InputArgs,
    place: &PlaceArgs,
    settings: &Settings,
    console: &Console,
) -> Result<WaypointRun, CliError> {
    place.more.iter().try_fold(run, |run, path| {
        match input(path, args, settings, console)? {
            Input::Path(next) => Ok(run.then(next, place.gap)),
            Input::Outline(_) | Input::Mesh(_) | Input::Gcode(_) => Err(CliError::Usage(format!(
                "{}: only runs of waypoints are put together to one job",
                path.display()
            ))),
        }
    })
}

/// Reads the mesh onto which an outline is projected, with the outline's units and scale; none without
/// a file.
pub(crate) fn surface(place: &PlaceArgs, args: &InputArgs) -> Result<Option<Mesh>, CliError> {
    let Some(path) = place.surface.as_deref() else {
        return Ok(None);
    };
    let region = place.surface_region.as_deref();
    let region = region.map(surface_region).transpose()?;
    let Some(format @ Format::Mesh(mesh_format)) = Format::of_ending(path) else {
        return Err(CliError::Usage(format!(
            "--surface {}: give a mesh, by its ending .stl, .3mf or .obj",
            path.display()
        )));
    };
    let bytes = read_bounded(path, format.bytes_max())?;
    let options = MeshOptions {
        unit_mm: args.units.map(|unit| unit.units().mm()),
        scale: args.scale,
        rotate_rad: [0.0; 3],
    };
    let mesh = mesh::read_surface(&bytes, mesh_format, &options, region.as_ref());
    let mesh = mesh.map_err(|error| CliError::Job(format!("{}: {error}", path.display())))?;
    Ok(Some(mesh))
}

/// What of a surface is meant.
fn surface_region(text: &str) -> Result<SurfaceRegion, CliError> {
    SurfaceRegion::parse(text).ok_or_else(|| {
        CliError::Usage(format!(
            "--surface-region {text}: write group:NAME, colour:#RRGGBB or normal:DEG, as in normal:60"
        ))
    })
}

/// How far a run is turned, in rad.
pub(crate) fn turn_rad(given: Option<f64>) -> Result<f64, CliError> {
    match given {
        Some(degrees) if !(-360.0..=360.0).contains(&degrees) => Err(CliError::Usage(format!(
            "--turn {degrees}: write an angle from -360 to 360 degrees"
        ))),
        given => Ok(given.unwrap_or(0.0).to_radians()),
    }
}

/// Reads how far tool axes may be off, in rad.
pub(crate) fn axis_tolerance_rad(given: Option<f64>) -> Result<f64, CliError> {
    match given {
        Some(degrees) if !(0.0..=AXIS_TOLERANCE_MAX_DEG).contains(&degrees) => {
            Err(CliError::Usage(format!(
                "--axis-tolerance {degrees}: write an angle from 0 to {AXIS_TOLERANCE_MAX_DEG} degrees"
            )))
        }
        given => Ok(given.map_or(AXIS_TOLERANCE_RAD, f64::to_radians)),
    }
}

/// Reads the largest tilt of tool axes, in rad.
pub(crate) fn tilt_max_rad(given: Option<f64>) -> Result<Option<f64>, CliError> {
    match given {
        Some(degrees) if !(0.0..=TILT_MAX_ASKED_DEG).contains(&degrees) => Err(CliError::Usage(
            format!("--tilt-max {degrees}: write an angle from 0 to {TILT_MAX_ASKED_DEG} degrees"),
        )),
        given => Ok(given.map(f64::to_radians)),
    }
}

/// Reads the obstacles on the machine: meshes in machine coordinates, mm.
pub(crate) fn obstacles(paths: &[std::path::PathBuf]) -> Result<Obstacles, CliError> {
    let mut triangles = Vec::new();
    for path in paths {
        let Some(format @ Format::Mesh(mesh_format)) = Format::of_ending(path) else {
            return Err(CliError::Usage(format!(
                "--obstacle {}: give a mesh, by its ending .stl, .3mf or .obj",
                path.display()
            )));
        };
        let bytes = read_bounded(path, format.bytes_max())?;
        let options = MeshOptions {
            unit_mm: None,
            scale: 1.0,
            rotate_rad: [0.0; 3],
        };
        let mesh = mesh::read_surface(&bytes, mesh_format, &options, None);
        let mesh = mesh.map_err(|error| CliError::Job(format!("{}: {error}", path.display())))?;
        let corner = |vertex: u32| mesh.vertices[vertex as usize].coords;
        triangles.extend(mesh.triangles.iter().map(|triangle| triangle.map(corner)));
    }
    Ok(Obstacles::of(triangles))
}
