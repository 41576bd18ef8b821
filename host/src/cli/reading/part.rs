//! Options and files -> a part, ready to be planned.

use crate::api::part::{What, read_surface};
use crate::api::ready::Ready;
use crate::api::{Error, Options, Part, Reading};
use crate::cli::args::{InputArgs, NO_INPUT, PartArgs, PlaceArgs, SettingsArgs};
use crate::cli::error::CliError;
use crate::cli::reading::job;
use crate::cli::reading::layer_options::{height_ranges, layer_range};
use crate::cli::reading::load::{self, input, parse_at, read_bounded};
use crate::cli::terminal::console::Console;
use crate::input::space_outline::{SpaceOutline, read_in_space};
use crate::input::{Format, Input, MESH_BYTES_MAX, ReadOptions};
use crate::mesh::Mesh;
use crate::settings::curved_layers::CurvedLayersTextError;
use crate::settings::directions::Directions;
use crate::settings::obstacles::Obstacles;
use crate::text::refusal::Refusal;
use std::path::{Path, PathBuf};

/// The part, with its options over the machine's settings, and what messages call it.
pub(crate) fn ready<'a>(
    path: &'a Path,
    PartArgs {
        reading,
        place,
        settings,
    }: &'a PartArgs,
    console: &Console,
) -> Result<(Ready, &'a Path), CliError> {
    let options = options(place, settings)?;
    let with_place = SettingsArgs {
        options: options.clone(),
        ..settings.clone()
    };
    let mut settings = load::settings(&with_place)?;
    settings.obstacles = obstacles(&place.obstacle)?;
    let at_mm = place
        .at
        .iter()
        .map(|text| parse_at(text))
        .collect::<Result<_, _>>()?;
    let path = match &place.surface {
        Some(surface) if path.as_os_str() == NO_INPUT => surface,
        _ => path,
    };
    let mut part = match patch(path, reading, place)? {
        Some(patch) => Part::of(patch),
        None => {
            let first = input(path, reading, &settings, console)?;
            let all = place.more.iter().try_fold(first, |run, path| {
                match (run, input(path, reading, &settings, console)?) {
                    (Input::Path(run), Input::Path(next)) => {
                        Ok(Input::Path(run.then(next, place.gap)))
                    }
                    _ => Err(CliError::Usage(format!(
                        "{}: only runs of waypoints are put together to one job",
                        path.display()
                    ))),
                }
            })?;
            let surface = place.surface.as_deref();
            let surface = surface
                .map(|path| surface_of(path, reading, place))
                .transpose()?;
            Part {
                surface,
                ..Part::of(What::Input(all))
            }
        }
    };
    part.keep_out = load::keep_out(place.keep_out.as_deref(), reading, &settings, console)?;
    part.at_mm = at_mm;
    part.height_ranges = height_ranges(&place.layers)?;
    let read = part.notes().len();
    let bar = console.stage("cutting");
    let ready = Ready::of(part, &options, settings, place.cache.is_some());
    bar.finish_and_clear();
    let ready = ready.map_err(|error| refused(path, &error))?;
    console.notes(&ready.notes[read..]);
    Ok((ready, path))
}

/// Why a part is refused.
fn refused(path: &Path, error: &Error) -> CliError {
    match error {
        Error::Options(text) => CliError::Usage(text.clone()),
        _ => CliError::Job(format!("{}: {error}", path.display())),
    }
}

/// All options of a part.
fn options(place: &PlaceArgs, settings: &SettingsArgs) -> Result<Options, CliError> {
    let curved_layers = place.curved_layers.as_deref().map(str::parse).transpose();
    Ok(Options {
        first_layer_height_mm: place.layers.first_layer_height,
        first_layer_speed_mm_s: place.first_layer_speed,
        layer_range: layer_range(&place.layers)?,
        curved_layers: curved_layers
            .map_err(|error: CurvedLayersTextError| CliError::Usage(error.to_string()))?,
        directions: place.directions.as_deref().map(directions).transpose()?,
        bead_width_mm: place.bead_width,
        copies: place.copies,
        copy_gap_mm: place.copy_gap,
        gap_mm: place.gap,
        corner_tolerance_mm: place.corner_tolerance,
        place: place.place,
        turn_deg: place.turn,
        axis_tolerance_deg: place.axis_tolerance,
        tilt_max_deg: place.tilt_max,
        ..settings.options.clone()
    })
}

/// Pieces of a file, or that they are to be found.
fn directions(path: &Path) -> Result<Directions, CliError> {
    let wrong =
        |error: Refusal| CliError::Usage(format!("--directions {}: {error}", path.display()));
    match path.to_str() {
        Some("auto") => Ok(Directions::Auto),
        _ => load::read_text(path)?.parse().map_err(wrong),
    }
}

/// A surface that is printed by itself or with an outline drawn on it in space; `None` for any other input.
fn patch(path: &Path, reading: &InputArgs, place: &PlaceArgs) -> Result<Option<What>, CliError> {
    let Some(surface) = &place.surface else {
        return Ok(None);
    };
    let is_alone = path == surface;
    let drawn = drawn(path, reading)?;
    if !is_alone && drawn.is_none() {
        return Ok(None);
    }
    let name = drawn.as_ref().map(|outline| outline.name.clone());
    Ok(Some(What::Patch {
        name: name.unwrap_or_else(|| job::stem(path)),
        mesh: surface_of(surface, reading, place)?,
        drawn,
    }))
}

/// An outline in space; `None` for any other input.
fn drawn(path: &Path, reading: &InputArgs) -> Result<Option<SpaceOutline>, CliError> {
    let format = Format::of_ending(path);
    if reading.from.is_some() || format != Some(Format::Polygon) {
        return Ok(None);
    }
    let options = ReadOptions {
        units: reading.units,
        scale: reading.scale,
        ..ReadOptions::default()
    };
    let bytes = read_bounded(path, Format::Polygon.bytes_max())?;
    let outline = read_in_space(&bytes, &job::stem(path), &options);
    outline.map_err(|error| CliError::Job(format!("{}: {error}", path.display())))
}

/// The surface, with the outline's units and scale.
fn surface_of(path: &Path, args: &InputArgs, place: &PlaceArgs) -> Result<Mesh, CliError> {
    let reading = Reading {
        units: args.units,
        scale: args.scale,
        surface_region: place.surface_region.clone(),
        ..Reading::default()
    };
    mesh_of("--surface", path, &reading)
}

/// The obstacles on the machine: meshes in machine coordinates, mm.
pub(crate) fn obstacles(paths: &[PathBuf]) -> Result<Obstacles, CliError> {
    let mut triangles = Vec::new();
    for path in paths {
        let mesh = mesh_of("--obstacle", path, &Reading::default())?;
        let corner = |vertex: u32| mesh.vertices[vertex as usize].coords;
        triangles.extend(mesh.triangles.iter().map(|triangle| triangle.map(corner)));
    }
    Ok(Obstacles::of(triangles))
}

/// The mesh of an option.
fn mesh_of(option: &str, path: &Path, reading: &Reading) -> Result<Mesh, CliError> {
    let Some(Format::Mesh(_)) = Format::of_ending(path) else {
        return Err(CliError::Usage(format!(
            "{option} {}: give a mesh, by its ending .stl, .3mf or .obj",
            path.display()
        )));
    };
    let bytes = read_bounded(path, MESH_BYTES_MAX)?;
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    read_surface(&ending, &bytes, reading).map_err(|error| refused(path, &error))
}
