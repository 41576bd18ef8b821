//! Options and files -> settings and target.

use crate::cli::args::compare::HeadingAxis;
use crate::cli::args::{InputArgs, SettingsArgs};
use crate::cli::error::CliError;
use crate::cli::reading::{file_axes, job};
use crate::cli::terminal::console::Console;
use crate::gcode::FILAMENT_MM;
use crate::geometry::polygon::Region;
use crate::input::error;
use crate::input::{self, BYTES_MAX, Format, Input, Loaded, ReadOptions};
use crate::settings::aperture_text::{aperture_text, file_of_aperture, parse_aperture};
use crate::settings::options::Options;
use crate::settings::{Quality, Settings, machine_file};
use crate::text::plain::plain;
use clap::ValueEnum;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// The machine file, or the built-in machine, with the overrides on top; checked.
pub(crate) fn settings(args: &SettingsArgs) -> Result<Settings, CliError> {
    let of_machine = match &args.machine {
        Some(path) => machine(path)?,
        None => Settings::default(),
    };
    // The machine file was checked on its own: what fails now is an option.
    if args.aperture.len() > 1 {
        return Err(CliError::Usage(
            "--aperture is given several times: only `headway compare` takes several nozzles"
                .to_string(),
        ));
    }
    let aperture = args.aperture.first();
    let aperture = aperture.map(|text| with_polygon(text, Path::new("")));
    let draft = args.is_draft.then_some(Quality::Fast);
    let options = Options {
        aperture: aperture.transpose()?,
        quality: args.options.quality.or(draft),
        ..args.options.clone()
    };
    let settings = options.over(of_machine);
    let mut settings = settings.map_err(|error| CliError::Usage(error.to_string()))?;
    if let Some(axis) = args.heading_axis {
        with_heading_axis(&mut settings, axis);
        let checked = settings.check();
        checked.map_err(|error| CliError::Usage(error.to_string()))?;
    }
    Ok(settings)
}

/// Gives the joint that turns the nozzle other limits: those given, else the lesser of its own and its motor's.
fn with_heading_axis(settings: &mut Settings, axis: HeadingAxis) {
    let Some([speed, acceleration]) = settings.heading_limits() else {
        return;
    };
    let speed = axis.speed_max_rad_s.unwrap_or(speed);
    let acceleration = axis.acceleration_max_rad_s2.unwrap_or(acceleration);
    if let Some(joint) = settings.heading_joint_mut() {
        joint.speed_max = axis.slower * speed;
        joint.acceleration_max = axis.slower * acceleration;
        joint.jerk_max *= axis.slower;
    }
}

/// Reads and checks a machine file.
pub(crate) fn machine(path: &Path) -> Result<Settings, CliError> {
    machine_of(read_text(path)?, path)
}

/// Checks a machine file's text; `path` is its place.
pub(crate) fn machine_of(text: String, path: &Path) -> Result<Settings, CliError> {
    let text = machine_with_polygon(text, path)?;
    machine_file::from_toml(&text)
        .map_err(|error| CliError::Job(format!("{}: {error}", path.display())))
}

pub(crate) fn read_text(path: &Path) -> Result<String, CliError> {
    String::from_utf8(plain(&read_file(path)?).into_owned()).map_err(|_| {
        let path = path.display();
        CliError::Job(format!("{path}: not a text in UTF-8; save it as that"))
    })
}

/// An aperture's description with the text of its polygon file, from `folder`, instead of the name;
/// other descriptions as they are.
fn with_polygon(text: &str, folder: &Path) -> Result<String, CliError> {
    let Some(name) = file_of_aperture(text) else {
        return Ok(text.to_string());
    };
    let path = folder.join(name);
    let place = |problem: String| CliError::Job(format!("{}: {problem}", path.display()));
    let corners = read_text(&path)?;
    let aperture =
        parse_aperture(&format!("polygon:{corners}")).map_err(|error| place(error.to_string()))?;
    Ok(aperture_text(&aperture))
}

/// A machine file's text in which a polygon aperture is given by its corners.
fn machine_with_polygon(text: String, path: &Path) -> Result<String, CliError> {
    // What is no TOML is refused with its line by the reader proper.
    let Ok(table) = text.parse::<toml::Table>() else {
        return Ok(text);
    };
    let aperture = table.get("print").and_then(|print| print.get("aperture"));
    let Some(given) = aperture.and_then(|a| a.as_str()) else {
        return Ok(text);
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    Ok(text.replacen(given, &with_polygon(given, folder)?, 1))
}

/// Reads an input and prints its notes.
pub(crate) fn input(
    path: &Path,
    args: &InputArgs,
    settings: &Settings,
    console: &Console,
) -> Result<Input, CliError> {
    let named = match &args.from {
        Some(name) => Format::parse(name.to_possible_value().unwrap_or_default().get_name()),
        None => Format::of_ending(path),
    };
    let format = named.ok_or_else(|| {
        let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
        let (path, is_folder) = (path.display().to_string(), path.is_dir());
        let what = match ending.to_str() {
            Some("step" | "stp" | "iges" | "igs" | "f3d" | "fcstd" | "sldprt") => {
                "a CAD model: export it as a mesh (.3mf or .stl, with a deviation of 0.01 mm or less) and plan that"
            }
            Some("hwj") => "a job, which is planned: simulate, export or stream it",
            Some("src" | "dat" | "mod" | "prg" | "script" | "urp") => {
                "a robot's program: these are written (headway export --to rapid, krl, urscript) and not read; give its \
                 path as waypoints (.wpt) or G-code"
            }
            Some("toml") => "a machine file: give it with -m, and the part as the input",
            _ if is_folder => "a folder: name a file in it",
            _ => {
                return CliError::Usage(format!(
                    "cannot tell the format of '{path}': use the ending .json, .geojson, .svg, .dxf, .wpt, .stl, \
                     .3mf, .obj or .gcode, or --from polygon|geojson|svg|dxf|waypoints|stl|3mf|obj|gcode"
                ));
            }
        };
        CliError::Usage(format!("'{path}' is {what}"))
    })?;
    if !(args.scale.is_finite() && args.scale > 0.0) {
        let error = error::scale(args.scale);
        return Err(CliError::Usage(error.to_string()));
    }
    if !args.dxf_layer.is_empty() && format != Format::Dxf {
        return Err(CliError::Usage(
            "--dxf-layer goes with DXF: no other format that is read has layers of a drawing"
                .into(),
        ));
    }
    let options = ReadOptions {
        units: args.units,
        scale: args.scale,
        flatten_mm: settings.tolerances.flatten_mm,
        repair: args.repair,
        gcode_axes: file_axes::of(args.axes.as_deref(), format, settings)?,
        head_letters: settings.gcode_letters,
        rotate_rad: rotate_rad(args.rotate.as_deref(), format)?,
        filament_mm: filament_mm(args.filament_diameter, format)?,
        dxf_layers: args.dxf_layer.clone(),
        centre_lines: args.centre_lines,
    };
    let bytes = read_bounded(path, format.bytes_max())?;
    let input = input::read_any(&bytes, &job::stem(path), format, &options)
        .map_err(|error| CliError::Job(format!("{}: {error}", path.display())))?;
    console.notes(input.notes());
    Ok(input)
}

/// Reads an outline and prints its notes.
pub(crate) fn target(
    path: &Path,
    args: &InputArgs,
    settings: &Settings,
    console: &Console,
) -> Result<Loaded, CliError> {
    let problem = match input(path, args, settings, console)? {
        Input::Outline(loaded) => return Ok(loaded),
        Input::Path(_) | Input::Gcode(_) | Input::Lines(_) => error::path_not_outline(),
        Input::Mesh(_) => error::mesh_not_outline(),
    };
    Err(CliError::Job(format!("{}: {problem}", path.display())))
}

/// Reads keep-outs with the input's units and scale; none without a file.
pub(crate) fn keep_out(
    path: Option<&Path>,
    args: &InputArgs,
    settings: &Settings,
    console: &Console,
) -> Result<Vec<Region>, CliError> {
    let Some(path) = path else {
        return Ok(Vec::new());
    };
    let reading = InputArgs {
        from: None,
        rotate: None,
        filament_diameter: None,
        axes: None,
        dxf_layer: Vec::new(),
        centre_lines: false,
        ..args.clone()
    };
    let loaded = target(path, &reading, settings, console)?;
    Ok(loaded.target.regions)
}

/// The rotations of a mesh; none for other inputs.
fn rotate_rad(text: Option<&str>, format: Format) -> Result<[f64; 3], CliError> {
    let Some(text) = text else {
        return Ok([0.0; 3]);
    };
    if !matches!(format, Format::Mesh(_)) {
        return Err(CliError::Usage(
            "--rotate turns meshes: an outline is in the layer's plane; rotate it in the drawing"
                .into(),
        ));
    }
    let turns_deg = three_numbers(text).ok_or_else(|| {
        CliError::Usage(format!(
            "--rotate {text}: write three angles in degrees, as in --rotate 90,0,45"
        ))
    })?;
    Ok(turns_deg.map(f64::to_radians))
}

/// The filament of G-code; none for other inputs.
fn filament_mm(given: Option<f64>, format: Format) -> Result<Option<f64>, CliError> {
    match given {
        Some(_) if format != Format::Gcode => Err(CliError::Usage(
            "--filament-diameter goes with G-code: what else is planned has its own flow"
                .to_string(),
        )),
        Some(mm) if !(FILAMENT_MM[0]..=FILAMENT_MM[1]).contains(&mm) => {
            Err(CliError::Usage(format!(
                "--filament-diameter {mm}: write a diameter of {} to {} mm",
                FILAMENT_MM[0], FILAMENT_MM[1]
            )))
        }
        given => Ok(given),
    }
}

/// Reads `X,Y,Z`.
pub(crate) fn parse_at(text: &str) -> Result<[f64; 3], CliError> {
    three_numbers(text).ok_or_else(|| {
        CliError::Usage(format!(
            "--at {text}: write three numbers in mm, as in --at 100,80,0"
        ))
    })
}

fn three_numbers(text: &str) -> Option<[f64; 3]> {
    let numbers: Vec<f64> = text
        .split(',')
        .filter_map(|part| part.trim().parse().ok())
        .filter(|number: &f64| number.is_finite())
        .collect();
    match (numbers.as_slice(), text.split(',').count()) {
        (&[x, y, z], 3) => Some([x, y, z]),
        _ => None,
    }
}

/// Reads a file of the size of outlines and texts.
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, CliError> {
    read_bounded(path, BYTES_MAX)
}

/// Reads a file of bounded size.
pub(crate) fn read_bounded(path: &Path, bytes_max: u64) -> Result<Vec<u8>, CliError> {
    let file = |problem| CliError::File {
        path: path.display().to_string(),
        problem,
    };
    // Devices and pipes have no length: no more than that is read of them.
    let mut open = File::open(path).map_err(file)?.take(bytes_max + 1);
    let mut read = Vec::new();
    open.read_to_end(&mut read).map_err(file)?;
    let bytes = read.len() as u64;
    if bytes > bytes_max {
        let bytes = std::fs::metadata(path).map_or(bytes, |known| known.len().max(bytes));
        let error = error::file_too_large(bytes, bytes_max);
        return Err(CliError::Job(format!("{}: {error}", path.display())));
    }
    Ok(read)
}
