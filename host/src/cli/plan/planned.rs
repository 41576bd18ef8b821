//! A job, newly planned or read from a file: the common input of `plan` and `simulate`.

use crate::cli::args::{InputArgs, PlaceArgs, SettingsArgs};
use crate::cli::error::CliError;
use crate::cli::plan::{planned_curved, planned_gcode, planned_part, planned_patch};
use crate::cli::reading::job;
use crate::cli::reading::job::Job;
use crate::cli::reading::{copies, load, load_run};
use crate::cli::terminal::console::Console;
use crate::geometry::polygon::Region;
use crate::input::declared_run::at_feeds;
use crate::input::waypoints::WaypointRun;
use crate::input::{Input, Loaded, Target};
use crate::mesh::Mesh;
use crate::pipeline::packing::JobPacking;
use crate::pipeline::planned::Planned;
use crate::pipeline::surface::plan_on_surface;
use crate::pipeline::{Plan, PlanError, plan_target_around, plan_waypoints_with_progress};
use crate::plan::motion::motion_error::MotionError;
use crate::settings::Settings;
use crate::settings::run_options::RunOptions;
use std::fs::File;
use std::path::Path;
use std::time::Instant;

/// By how much the range of a joint that may leave it becomes wider at either end: more than any part needs, and
/// not so much that a joint that turns has no end.
const WIDER_MM: f64 = 10_000.0;
const WIDER_RAD: f64 = 600.0;

/// An input that is planned in one piece.
enum Flat {
    Outline(Loaded),
    Path(WaypointRun),
}

impl Flat {
    /// Its name, its regions where it has any, and the notes of reading.
    fn named(self) -> (Target, Vec<String>) {
        match self {
            Flat::Outline(loaded) => (loaded.target, loaded.notes),
            Flat::Path(run) => {
                let regions = Vec::new();
                let name = run.name;
                (Target { name, regions }, run.notes)
            }
        }
    }
}

/// Reads an input and plans it, the ranges of the joints `widened` as if they had no end. The stream of a mesh
/// is written to `job` if given, piece by piece, and is then not part of the result.
pub(crate) fn from_input(
    path: &Path,
    reading: &InputArgs,
    place: &PlaceArgs,
    settings_args: &SettingsArgs,
    widened: &[usize],
    job: Option<&mut JobPacking<File>>,
    console: &Console,
) -> Result<Planned, CliError> {
    let mut settings = placed_settings(place, settings_args)?;
    let own_joints = settings.machine.joints.to_vec();
    for &joint in widened {
        if let Some(joint) = settings.machine.joints.get_mut(joint) {
            let wider = if joint.rotary { WIDER_RAD } else { WIDER_MM };
            joint.position_min -= wider;
            joint.position_max += wider;
        }
    }
    let mut planned = planned_input(
        path,
        (reading, place, settings_args),
        settings,
        job,
        console,
    )?;
    console.notes(planned.note_idle_options(&settings_args.options));
    Ok(Planned {
        own_joints: (!widened.is_empty()).then_some(own_joints),
        ..planned
    })
}

fn planned_input(
    path: &Path,
    (reading, place, settings_args): (&InputArgs, &PlaceArgs, &SettingsArgs),
    mut settings: Settings,
    job: Option<&mut JobPacking<File>>,
    console: &Console,
) -> Result<Planned, CliError> {
    if let Some(patch) = planned_patch::wanted(path, (reading, place))? {
        return patch.planned(settings, console);
    }
    let turn_rad = load_run::turn_rad(place.turn)?;
    let input = load::input(path, reading, &settings, console)?;
    check_options(&input, place, settings_args)?;
    let surface = load_run::surface(place, reading)?;
    let keep_out = load::keep_out(place.keep_out.as_deref(), reading, &settings, console)?;
    let input = match input {
        Input::Mesh(loaded) if place.curved_layers.is_some() => {
            return planned_curved::from_mesh(
                path,
                loaded,
                (place, settings_args),
                settings,
                console,
            );
        }
        Input::Mesh(loaded) => {
            return planned_part::from_mesh(path, loaded, place, &keep_out, settings, job, console);
        }
        Input::Gcode(program) => {
            let speed = settings_args.options.speed_mm_s;
            return planned_gcode::from_gcode(path, program, speed, settings, console);
        }
        Input::Outline(mut loaded) => {
            let layer = std::iter::once(&mut loaded.target.regions);
            let told = copies::spread(place, layer, &settings)?;
            console.notes(told.as_slice());
            loaded.notes.extend(told);
            Flat::Outline(loaded)
        }
        Input::Path(run) => {
            let run = load_run::with_more(run, reading, place, &settings, console)?;
            let mut run = run.turned(turn_rad);
            settings = at_feeds(&mut run, settings_args.options.speed_mm_s, &settings);
            Flat::Path(run)
        }
    };
    planned_flat(input, surface.as_ref(), &keep_out, settings, path, console)
}

/// Plans a run of waypoints that no file holds; `path` is what messages call it.
pub(crate) fn from_run(
    run: WaypointRun,
    settings: Settings,
    path: &Path,
    console: &Console,
) -> Result<Planned, CliError> {
    planned_flat(Flat::Path(run), None, &[], settings, path, console)
}

fn planned_flat(
    input: Flat,
    surface: Option<&Mesh>,
    keep_out: &[Region],
    settings: Settings,
    path: &Path,
    console: &Console,
) -> Result<Planned, CliError> {
    let (bar, begun) = (console.planning(), Instant::now());
    let planned = match (&input, surface) {
        (Flat::Outline(Loaded { target, .. }), Some(mesh)) => {
            plan_on_surface(target, mesh, keep_out, &settings, &bar)
        }
        (Flat::Outline(Loaded { target, .. }), None) => {
            plan_target_around(target, keep_out, &settings, &bar)
        }
        (Flat::Path(run), _) => plan_waypoints_with_progress(run, &settings, &bar),
    };
    let plan_s = begun.elapsed().as_secs_f64();
    bar.clear();
    let plan = planned.map_err(|error| plan_error(path, &error))?;
    let (target, notes) = input.named();
    Ok(finished(plan, plan_s, target, notes, settings, console))
}

/// What a plan came to.
pub(crate) fn finished(
    plan: Plan,
    plan_s: f64,
    target: Target,
    notes: Vec<String>,
    settings: Settings,
    console: &Console,
) -> Planned {
    let read = notes.len();
    let planned = Planned::of_plan(plan, plan_s, target, notes, settings);
    console.notes(&planned.notes[read..]);
    planned
}

/// Why an input cannot be planned.
pub(crate) fn plan_error(path: &Path, error: &PlanError) -> CliError {
    let (input, place) = (path.display().to_string(), error.to_string());
    match error {
        PlanError::Motion(MotionError::OutsideJointRange { joint, .. }) => CliError::OutsideRange {
            input,
            joint: *joint,
            place,
        },
        _ => CliError::Job(format!("{input}: {place}")),
    }
}

/// The settings with the options for the input's position.
pub(crate) fn placed_settings(
    place: &PlaceArgs,
    settings: &SettingsArgs,
) -> Result<Settings, CliError> {
    let settings = load::settings(settings)?;
    let of_run = RunOptions {
        gap_mm: place.gap,
        corner_tolerance_mm: place.corner_tolerance,
        place: place.place,
    };
    let settings = of_run.over(settings);
    Ok(Settings {
        axis_tolerance_rad: load_run::axis_tolerance_rad(place.axis_tolerance)?,
        tilt_max_rad: load_run::tilt_max_rad(place.tilt_max)?,
        obstacles: load_run::obstacles(&place.obstacle)?,
        at_mm: copies::first_at_mm(place)?,
        ..settings.map_err(|error| CliError::Usage(error.to_string()))?
    })
}

/// Options that go with another kind of input.
pub(crate) fn check_options(
    input: &Input,
    place: &PlaceArgs,
    settings: &SettingsArgs,
) -> Result<(), CliError> {
    let of_outlines = load::outline_option(settings, place.keep_out.as_deref());
    let problem = match (input, of_outlines, load::mesh_option(place)) {
        (Input::Mesh(_), ..) if settings.options.layers.is_some() => {
            "--layers goes with outlines: a mesh has its own; --layer-range takes some of them"
                .to_string()
        }
        (Input::Mesh(_) | Input::Path(_) | Input::Gcode(_), ..) if place.surface.is_some() => {
            "--surface goes with outlines: only they are projected onto a surface".to_string()
        }
        (Input::Outline(_) | Input::Path(_) | Input::Gcode(_), ..)
            if place.curved_layers.is_some() =>
        {
            "--curved-layers goes with meshes (STL, 3MF, OBJ): only a part has tops to follow"
                .to_string()
        }
        (Input::Path(_) | Input::Gcode(_), ..) if copies::option(place).is_some() => {
            let option = copies::option(place).unwrap_or_default();
            format!("{option} goes with outlines and meshes: a path is printed once")
        }
        _ if place.surface.is_some() && copies::option(place).is_some() => {
            "a surface carries one part: leave --copies and further --at out".to_string()
        }
        (Input::Path(_) | Input::Gcode(_), Some(option), _) => {
            format!("{option} goes with outlines: a path is followed as it is")
        }
        (Input::Outline(_) | Input::Mesh(_) | Input::Gcode(_), ..)
            if load::run_option(place).is_some() =>
        {
            let option = load::run_option(place).unwrap_or_default();
            format!("{option} goes with runs of waypoints: outlines have no tool axes")
        }
        (Input::Outline(_) | Input::Path(_) | Input::Gcode(_), _, Some(option)) => {
            format!("{option} goes with meshes: all layers of an outline are the same")
        }
        _ => return Ok(()),
    };
    Err(CliError::Usage(problem))
}

/// Reads a job file. A machine that is given must be the job's.
pub(crate) fn from_job(path: &Path, settings: &SettingsArgs) -> Result<Planned, CliError> {
    let job = job::read(path)?;
    if settings.machine.is_some() {
        let given = load::settings(settings)?;
        let header = &job.file.header;
        if given.machine != header.machine {
            return Err(CliError::Job(format!(
                "{}: planned for machine {}, which is not the same as {}: plan again for it",
                path.display(),
                header.machine_name,
                given.machine_name
            )));
        }
    }
    Ok(of_job(job))
}

/// What a job file knows.
pub(crate) fn of_job(job: Job) -> Planned {
    Planned::of_job(&job.file.header, job.stream, job.name)
}
