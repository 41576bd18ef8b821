//! Part, machine and options -> a job, with progress reports; the caller can stop it at any of
//! them.
//!
//! `ready.rs` has the way of each kind of part; this file watches it and packs the job in memory. The results do not depend
//! on the progress callback.

use super::blocks::{Cache, KeptBlocks};
use super::ready::Ready;
use super::{Error, Job, Options, Part};
use crate::pipeline::PlanError;
use crate::pipeline::packing::{JobPacking, job_header};
use crate::pipeline::piece::PieceCache;
use crate::pipeline::planned::Planned;
use crate::plan::progress::{Progress, Stage};
use crate::settings::{Settings, machine_file};
use std::io::Cursor;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

/// A machine, checked; the built-in planar one by default.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Machine {
    pub(super) settings: Settings,
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
    kept(part, machine, options, KeptBlocks::of(None), watch)
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
    kept(part, machine, options, KeptBlocks::of(Some(cache)), watch)
}

fn kept(
    part: &Part,
    machine: &Machine,
    options: &Options,
    mut blocks: KeptBlocks,
    watch: &(dyn Fn(Step) -> ControlFlow<()> + Sync),
) -> Result<Job, Error> {
    let ready = ready(part, machine, options, blocks.keeps())?;
    let watched = Watched::new(watch);
    let mut packing = JobPacking::new(Cursor::new(Vec::new()));
    let planned = ready.planned(&mut blocks, Some(&mut packing), &watched);
    packed(watched.ended(planned)?, packing)
}

/// A part ready to be planned on a machine; `is_cached` if its blocks are kept.
pub(super) fn ready(
    part: &Part,
    machine: &Machine,
    options: &Options,
    is_cached: bool,
) -> Result<Ready, Error> {
    let settings = options.over(machine.settings.clone());
    let settings = settings.map_err(|error| Error::Options(error.to_string()))?;
    Ready::of(part.clone(), options, settings, is_cached)
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

    /// What planning ended with.
    pub(super) fn ended<T>(&self, planned: Result<T, PlanError>) -> Result<T, Error> {
        match self.stops() {
            true => Err(Error::Stopped),
            false => planned.map_err(|error| Error::Plan(error.to_string())),
        }
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
        self.stopped.load(Ordering::Relaxed)
    }
}

fn job_error(error: impl std::fmt::Display) -> Error {
    Error::Job(error.to_string())
}

/// The job of a plan, as the command writes it.
fn packed(mut planned: Planned, packing: JobPacking<Cursor<Vec<u8>>>) -> Result<Job, Error> {
    let mut packed = packing.finish_plan(&mut planned).map_err(job_error)?;
    let objections = std::mem::take(&mut planned.objections).into_iter();
    let mut notes: Vec<String> = objections.map(|of| of.text).collect();
    if packed.refused.is_some() {
        return Err(Error::Plan(notes.swap_remove(0)));
    }
    let header = job_header(&planned, packed.frames.facts.clone());
    let mut bytes = Vec::new();
    let written = packed.frames.write(&mut bytes, &header);
    written.map_err(job_error)?;
    notes.append(&mut planned.notes);
    Job::planned(bytes, planned.figures, notes)
}
