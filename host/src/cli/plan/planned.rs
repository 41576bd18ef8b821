//! A job, newly planned or read from a file: the common input of `plan` and `simulate`.

use crate::api::blocks::KeptBlocks;
use crate::api::part::What;
use crate::api::ready::Ready;
use crate::api::{BlockStore, Cache, Options, Part};
use crate::cli::args::{InputArgs, PartArgs, PlaceArgs, SettingsArgs};
use crate::cli::error::CliError;
use crate::cli::plan::piece_cache::{CacheFolder, program};
use crate::cli::reading::job::{self, Job};
use crate::cli::reading::load;
use crate::cli::reading::part::ready;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::end_whole_on_interrupt;
use crate::input::Input;
use crate::input::waypoints::WaypointRun;
use crate::pipeline::PlanError;
use crate::pipeline::packing::JobPacking;
use crate::pipeline::planned::Planned;
use crate::plan::motion::motion_error::MotionError;
use crate::plan::progress::Progress;
use crate::settings::Settings;
use std::fs::File;
use std::path::Path;

/// By how much the range of a joint that may leave it becomes wider at either end: more than any part needs, and
/// not so much that a joint that turns has no end.
const WIDER_MM: f64 = 10_000.0;
const WIDER_RAD: f64 = 600.0;

/// Reads an input and plans it, the ranges of the joints `widened` as if they had no end. The stream of a mesh
/// is written to `job` if given, piece by piece, and is then not part of the result.
pub(crate) fn from_input(
    path: &Path,
    asked: &PartArgs,
    widened: &[usize],
    job: Option<&mut JobPacking<File>>,
    console: &Console,
) -> Result<Planned, CliError> {
    let (mut ready, path) = ready(path, asked, console)?;
    let own_joints = ready.settings.machine.joints.to_vec();
    for &joint in widened {
        if let Some(joint) = ready.settings.machine.joints.get_mut(joint) {
            let wider = if joint.rotary { WIDER_RAD } else { WIDER_MM };
            joint.position_min -= wider;
            joint.position_max += wider;
        }
    }
    let cache = asked.place.cache.as_deref();
    if ready.has_blocks() {
        end_whole_on_interrupt(interrupted(cache));
    }
    let planned = planned(ready, path, cache, job, console)?;
    Ok(Planned {
        own_joints: (!widened.is_empty()).then_some(own_joints),
        ..planned
    })
}

fn planned(
    ready: Ready,
    path: &Path,
    cache: Option<&Path>,
    job: Option<&mut JobPacking<File>>,
    console: &Console,
) -> Result<Planned, CliError> {
    let read = ready.notes.len();
    let planned = with_blocks(path, cache, console, |blocks, bar| {
        ready.planned(blocks, job, bar)
    })?;
    console.notes(&planned.notes[read..]);
    Ok(planned)
}

/// Plans under the bar, with the blocks that the folder keeps.
pub(crate) fn with_blocks<T>(
    path: &Path,
    folder: Option<&Path>,
    console: &Console,
    plan: impl FnOnce(&mut KeptBlocks, &dyn Progress) -> Result<T, PlanError>,
) -> Result<T, CliError> {
    let mut store = folder.map(CacheFolder::open).transpose()?;
    let program = folder.map(|_| program()).unwrap_or_default();
    let mut blocks = KeptBlocks::of(store.as_mut().map(|store| Cache {
        store: store as &mut dyn BlockStore,
        program: &program,
    }));
    let bar = console.planning();
    let planned = plan(&mut blocks, &bar);
    bar.clear();
    console.notes(&blocks.notes);
    planned.map_err(|error| plan_error(path, &error))
}

/// The message on Ctrl-C.
fn interrupted(cache: Option<&Path>) -> String {
    match cache {
        Some(folder) => format!(
            "stopped, no job is written; the layers planned so far are in {}: the same command goes on \
             with them",
            folder.display()
        ),
        None => {
            "stopped, no job is written; with --cache DIR the same command would go on where it was"
                .to_string()
        }
    }
}

/// Plans a run of waypoints that no file holds; `path` is what messages call it.
pub(crate) fn from_run(
    run: WaypointRun,
    settings: Settings,
    path: &Path,
    console: &Console,
) -> Result<Planned, CliError> {
    let part = Part::of(What::Input(Input::Path(run)));
    let ready = Ready::of(part, &Options::default(), settings, false);
    let ready = ready.map_err(|error| CliError::Job(error.to_string()))?;
    planned(ready, path, None, None, console)
}

/// Why an input cannot be planned.
fn plan_error(path: &Path, error: &PlanError) -> CliError {
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

/// Reads a job file, or an input and plans it.
pub(crate) fn from_file(
    path: &Path,
    asked: &PartArgs,
    widened: &[usize],
    console: &Console,
) -> Result<Planned, CliError> {
    if !job::is_job(path) {
        return from_input(path, asked, widened, None, console);
    }
    console.notes(of_no_use(path, asked).as_slice());
    from_job(path, &asked.settings)
}

/// Options given for a job that only planning could apply.
fn of_no_use(input: &Path, asked: &PartArgs) -> Option<String> {
    let InputArgs {
        from,
        units,
        scale,
        repair,
        rotate,
        filament_diameter,
        axes,
        dxf_layer,
        centre_lines,
    } = &asked.reading;
    let of_reading = from.is_some()
        || units.is_some()
        || *scale != 1.0
        || *repair
        || *centre_lines
        || rotate.is_some()
        || filament_diameter.is_some()
        || axes.is_some()
        || !dxf_layer.is_empty();
    let machine_alone = SettingsArgs {
        machine: asked.settings.machine.clone(),
        ..SettingsArgs::default()
    };
    let of_plan = asked.place != PlaceArgs::default() || asked.settings != machine_alone;
    (of_reading || of_plan).then(|| {
        let path = input.display();
        format!(
            "{path} is planned already: options of input and settings change nothing; plan the \
             input again with them"
        )
    })
}

/// Reads a job file. A machine that is given must be the job's.
fn from_job(path: &Path, settings: &SettingsArgs) -> Result<Planned, CliError> {
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
