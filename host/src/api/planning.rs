//! Part, machine and options -> a job, with progress reports; the caller can stop it at any of
//! them.
//!
//! The stages for each kind of part are those of the pipeline, as for the command; this file adds the options of each
//! kind and packs the job. The results do not depend on the progress callback.

use super::blocks::{Cache, KeptBlocks, check_cached};
use super::part::{What, part_error};
use super::{Error, Job, Options, Part};
use crate::geometry::polygon::Region;
use crate::input::copies::{self, box_of};
use crate::input::declared_run::at_feeds;
use crate::input::{Loaded, Target};
use crate::job::SegmentStream;
use crate::mesh::LoadedMesh;
use crate::mesh::layers::{LayerHeights, SlicedPart, sliced_carved};
use crate::pipeline::findings::objections::Objection;
use crate::pipeline::gcode::plan_gcode;
use crate::pipeline::mesh::{FirstLayer, PartContext, plan_part_in_pieces};
use crate::pipeline::packing::{JobFacts, JobPacking, job_header};
use crate::pipeline::planned::{LaidPart, Planned};
use crate::pipeline::surface::curved_layers::{Beside, plan_curved_layers};
use crate::pipeline::surface::{plan_on_patch, plan_on_surface};
use crate::pipeline::{PlanError, plan_target_around, plan_waypoints_with_progress};
use crate::plan::progress::{Progress, Stage};
use crate::report::figures::Figures;
use crate::settings::{Settings, machine_file};
use std::io::Cursor;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// A machine, checked; the built-in planar one by default.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Machine {
    settings: Settings,
}

impl Machine {
    /// Of a machine file's text (`headway machine new` writes one); a polygon aperture with its corners.
    ///
    /// # Errors
    /// [`Error::Options`], with the key.
    pub fn from_toml(text: &str) -> Result<Machine, Error> {
        let settings = machine_file::from_toml(text);
        let settings = settings.map_err(|error| Error::Options(error.to_string()))?;
        Ok(Machine { settings })
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.settings.machine_name
    }
}

/// How far planning is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Step {
    /// The stage, in a word or two.
    pub stage: &'static str,
    /// Finished steps of it.
    pub done: usize,
    /// Total steps of it.
    pub total: usize,
}

/// Plans a part.
///
/// # Errors
/// [`Error::Options`] and [`Error::Plan`].
pub fn plan(part: &Part, machine: &Machine, options: &Options) -> Result<Job, Error> {
    plan_watched(part, machine, options, &|_| ControlFlow::Continue(()))
}

/// The same with progress reports: `watch` is called at each step, from any thread, one call after
/// another, and stops the planning with `Break`, at the latest when the current steps are done.
///
/// # Errors
/// The same and [`Error::Stopped`].
pub fn plan_watched(
    part: &Part,
    machine: &Machine,
    options: &Options,
    watch: &(dyn Fn(Step) -> ControlFlow<()> + Sync),
) -> Result<Job, Error> {
    kept(
        part,
        machine,
        options,
        (KeptBlocks::none(), String::new()),
        watch,
    )
}

/// The same of a mesh with its planned blocks of layers kept: those that are there are not planned again. The job is byte
/// for byte that of [`plan`].
///
/// # Errors
/// The same, and [`Error::Options`] for a part that is no mesh in flat layers.
pub fn plan_cached(
    part: &Part,
    machine: &Machine,
    options: &Options,
    cache: Cache,
    watch: &(dyn Fn(Step) -> ControlFlow<()> + Sync),
) -> Result<Job, Error> {
    check_cached(part, options)?;
    let blocks = KeptBlocks::new(cache.store);
    kept(
        part,
        machine,
        options,
        (blocks, cache.program.to_string()),
        watch,
    )
}

fn kept(
    part: &Part,
    machine: &Machine,
    options: &Options,
    (mut blocks, program): (KeptBlocks, String),
    watch: &(dyn Fn(Step) -> ControlFlow<()> + Sync),
) -> Result<Job, Error> {
    let watched = Watched::new(watch);
    let mut output = Output {
        packing: JobPacking::new(Cursor::new(Vec::new())),
        blocks: &mut blocks,
        program: &program,
    };
    let planned = planned(part, machine, options, &mut output, &watched);
    if watched.has_stopped() {
        return Err(Error::Stopped);
    }
    let (mut planned, packing) = (planned?, output.packing);
    planned.note_idle_options(options);
    planned.notes.append(&mut blocks.notes);
    packed(planned, packing)
}

/// Where blocks and stream of a part go.
struct Output<'a, 'b> {
    packing: Packing,
    blocks: &'a mut KeptBlocks<'b>,
    program: &'a str,
}

pub(super) struct Watched<'a> {
    watch: &'a (dyn Fn(Step) -> ControlFlow<()> + Sync),
    stopped: AtomicBool,
}

impl<'a> Watched<'a> {
    pub(super) fn new(watch: &'a (dyn Fn(Step) -> ControlFlow<()> + Sync)) -> Watched<'a> {
        Watched {
            watch,
            stopped: AtomicBool::new(false),
        }
    }

    pub(super) fn has_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

impl Progress for Watched<'_> {
    fn at(&self, stage: Stage, done: usize, total: usize) {
        let stage = stage.name();
        let step = Step { stage, done, total };
        if !self.stops() && (self.watch)(step).is_break() {
            self.stopped.store(true, Ordering::Relaxed);
        }
    }

    fn stops(&self) -> bool {
        self.has_stopped()
    }
}

/// The job so far, in memory.
type Packing = JobPacking<Cursor<Vec<u8>>>;

fn planned(
    part: &Part,
    machine: &Machine,
    options: &Options,
    output: &mut Output,
    progress: &dyn Progress,
) -> Result<Planned, Error> {
    let settings = settings_of(part, machine, options)?;
    let begun = Instant::now();
    let plan_s = || begun.elapsed().as_secs_f64();
    let (planned, target, settings) = match (&part.what, options.curved_layers) {
        (What::Mesh(loaded), Some(asked)) => {
            check_beside(part, loaded, options)?;
            let planned = plan_curved_layers(&loaded.mesh, asked, &settings, progress);
            (planned, unfilled(part), settings)
        }
        (What::Mesh(loaded), None) => {
            return planned_mesh(part, loaded, (options, settings), output, progress);
        }
        (What::Gcode(program), _) => {
            let planned = plan_gcode(program, options.speed_mm_s, &settings, progress);
            let planned = planned.map_err(plan_error)?;
            let program = program.as_ref().clone();
            return Ok(Planned::of_gcode(program, planned, plan_s(), &settings));
        }
        (What::Outline(loaded), _) => {
            let (target, planned) = planned_outline(part, loaded, (options, &settings), progress)?;
            (planned, target, settings)
        }
        (What::Path(run), _) => {
            let mut run = run.clone();
            let settings = at_feeds(&mut run, options.speed_mm_s, &settings);
            let planned = plan_waypoints_with_progress(&run, &settings, progress);
            (planned, unfilled(part), settings)
        }
        (What::Patch(_, surface), _) => {
            let planned = plan_on_patch(None, surface, &settings, progress);
            (planned, unfilled(part), settings)
        }
    };
    let plan = planned.map_err(plan_error)?;
    let notes = part.notes().to_vec();
    Ok(Planned::of_plan(plan, plan_s(), target, notes, settings))
}

/// The settings of a part, whose options are checked.
pub(super) fn settings_of(
    part: &Part,
    machine: &Machine,
    options: &Options,
) -> Result<Settings, Error> {
    let of_options = options.over(machine.settings.clone());
    let of_options = of_options.map_err(|error| Error::Options(error.to_string()))?;
    check_options(part, options)?;
    Ok(Settings {
        at_mm: part.at_mm,
        ..of_options
    })
}

/// A target without area of its own.
fn unfilled(part: &Part) -> Target {
    Target {
        name: part.name().to_string(),
        regions: Vec::new(),
    }
}

/// Refuses options of another kind of part.
fn check_options(part: &Part, options: &Options) -> Result<(), Error> {
    let of_runs = || Some((options.of_runs()?, "runs of waypoints"));
    let of_meshes = || Some((options.of_meshes()?, "meshes"));
    let of_outlines = || Some((options.of_outlines()?, "outlines and meshes"));
    let copied = || options.copies.is_some() || options.copy_gap_mm.is_some();
    let one_part = || {
        Error::Options("a surface carries one part: leave --copies and --copy-gap out".to_string())
    };
    let wrong = match &part.what {
        What::Patch(..) if copied() => return Err(one_part()),
        What::Outline(_) if part.surface.is_some() && copied() => return Err(one_part()),
        What::Outline(_) | What::Patch(..) => of_runs().or_else(of_meshes),
        What::Mesh(_) if options.layers.is_some() => Some(("--layers", "outlines")),
        What::Mesh(_) => of_runs(),
        What::Path(_) => of_meshes().or_else(of_outlines),
        What::Gcode(_) => of_runs().or_else(of_meshes).or_else(of_outlines),
    };
    match wrong {
        Some((option, kind)) => {
            let is_path = matches!(part.what, What::Path(_) | What::Gcode(_));
            let why = match is_path {
                true => ": a path is followed as it is",
                false => "",
            };
            Err(Error::Options(format!("{option} goes with {kind}{why}")))
        }
        None => Ok(()),
    }
}

/// Refuses what does not go with curved layers.
fn check_beside(part: &Part, loaded: &LoadedMesh, options: &Options) -> Result<(), Error> {
    let copied = options.copies.is_some() || options.copy_gap_mm.is_some();
    let given = [
        (Beside::KeepOut, !part.keep_out.is_empty()),
        (Beside::LayerRange, options.layer_range.is_some()),
        (
            Beside::FirstLayerHeight,
            options.first_layer_height_mm.is_some(),
        ),
        (Beside::Copies, copied),
        (Beside::Carved, !loaded.carved.is_empty()),
    ];
    match given.iter().find(|(_, given)| *given) {
        Some((beside, _)) => Err(Error::Options(beside.refusal().to_string())),
        None => Ok(()),
    }
}

fn planned_outline(
    part: &Part,
    loaded: &Loaded,
    (options, settings): (&Options, &Settings),
    progress: &dyn Progress,
) -> Result<(Target, Result<crate::pipeline::Plan, PlanError>), Error> {
    let mut target = loaded.target.clone();
    copied(&mut [&mut target.regions], options, settings)?;
    let planned = match &part.surface {
        Some(mesh) => plan_on_surface(&target, mesh, &part.keep_out, settings, progress),
        None => plan_target_around(&target, &part.keep_out, settings, progress),
    };
    Ok((target, planned))
}

/// Puts the requested number of parts into the layers, and returns their positions.
fn copied(
    layers: &mut [&mut Vec<Region>],
    options: &Options,
    settings: &Settings,
) -> Result<Option<String>, Error> {
    let Some(count) = options.copies else {
        return match options.copy_gap_mm {
            Some(_) => Err(Error::Options("--copy-gap goes with --copies".to_string())),
            None => Ok(None),
        };
    };
    let gap_mm = copies::checked_gap_mm(options.copy_gap_mm);
    let gap_mm = gap_mm.map_err(|error| Error::Options(error.to_string()))?;
    let [low, high] = settings.work_area_mm;
    let area_mm = [high[0] - low[0], high[1] - low[1]];
    let offsets = copies::in_rows(count, box_of(layers), gap_mm, area_mm);
    let told = offsets.and_then(|offsets| copies::spread(layers, &offsets));
    told.map(Some).map_err(part_error)
}

/// The layers of a mesh, as often as it is to be printed, and notes on them.
pub(super) fn sliced(
    loaded: &LoadedMesh,
    options: &Options,
    settings: &Settings,
) -> Result<(SlicedPart, Vec<String>), Error> {
    let heights = LayerHeights {
        first_mm: (options.first_layer_height_mm).unwrap_or(settings.layer_height_mm),
        layer_mm: settings.layer_height_mm,
        ranges: Vec::new(),
        range: options.layer_range,
    };
    let checked = heights.check();
    checked.map_err(|error| Error::Options(error.to_string()))?;
    let sliced = sliced_carved(&loaded.mesh, &loaded.carved, &heights);
    let mut sliced = sliced.map_err(part_error)?;
    let layers = sliced.layers.iter_mut().map(|layer| &mut layer.regions);
    let told = copied(&mut layers.collect::<Vec<_>>(), options, settings)?;
    let mut notes = loaded.notes.clone();
    notes.extend(sliced.notes.iter().cloned().chain(told));
    Ok((sliced, notes))
}

fn planned_mesh(
    part: &Part,
    loaded: &LoadedMesh,
    (options, settings): (&Options, Settings),
    output: &mut Output,
    progress: &dyn Progress,
) -> Result<Planned, Error> {
    let begun = Instant::now();
    let (sliced, notes) = sliced(loaded, options, &settings)?;
    let mut laid = LaidPart::default();
    let mut take = |piece: SegmentStream, first_pass| {
        laid.look_at(&piece, &settings);
        let taken = output.packing.take(&piece, first_pass, &settings);
        taken.map_err(|error| error.to_string())
    };
    let context = PartContext {
        progress,
        cache: output.blocks,
        program: output.program,
        take: &mut take,
    };
    let first = FirstLayer::default();
    let planned = plan_part_in_pieces(&sliced, &part.keep_out, first, &settings, context);
    let planned = planned.map_err(plan_error)?;
    Ok(Planned::of_part(
        (loaded.name.clone(), notes),
        &sliced,
        planned,
        laid,
        &part.keep_out,
        begun.elapsed().as_secs_f64(),
        settings,
    ))
}

pub(super) fn plan_error(error: PlanError) -> Error {
    Error::Plan(error.to_string())
}

fn job_error(error: impl std::fmt::Display) -> Error {
    Error::Job(error.to_string())
}

/// The job of a plan, as the command writes it.
fn packed(planned: Planned, mut packing: Packing) -> Result<Job, Error> {
    let (settings, transform) = (&planned.settings, planned.transform);
    if packing.is_empty() {
        let taken = packing.take(&planned.stream, 0, settings);
        taken.map_err(job_error)?;
    }
    let mut packed = packing.finish(settings).map_err(job_error)?;
    if let Some(refused) = &packed.refused {
        let fault = Objection::of_board(refused, &transform, settings);
        return Err(Error::Plan(fault.text));
    }
    let objections = planned.objections.iter();
    let objections: Vec<String> = objections.map(|objection| objection.text.clone()).collect();
    let figures = Figures {
        objections: (!objections.is_empty()).then(|| objections.clone()),
        ..packed.figures(planned.figures, &transform)
    };
    let facts = JobFacts {
        name: &planned.name,
        outline: &planned.outline,
        layer_outlines: &planned.layer_outlines,
        settings,
        transform,
        figures: &figures,
        heat: &planned.heat,
        pass_facts: &planned.pass_facts,
    };
    let header = job_header(&facts, packed.frames.facts.clone());
    let mut bytes = Vec::new();
    let written = packed.frames.write(&mut bytes, &header);
    written.map_err(job_error)?;
    let notes = objections.into_iter().chain(planned.notes).collect();
    Job::planned(bytes, figures, notes)
}
