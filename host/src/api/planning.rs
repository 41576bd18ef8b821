//! Part, machine and options -> a job, told step by step, stopped where whoever watches wants it.
//!
//! The planner reports how far it is and takes no answer; a stop unwinds it from within that report, with
//! a payload of our own and without the panic hook, and ends here. A program built with `panic = "abort"`
//! ends as a whole instead. Results do not depend on who watches.

use super::part::What;
use super::{Error, Job, Options, Part};
use crate::input::Target;
use crate::pipeline::findings::objections::Objection;
use crate::pipeline::findings::{Findings, findings};
use crate::pipeline::packing::{JobFacts, JobPacking, job_header};
use crate::pipeline::{Plan, plan_target_around, plan_waypoints_with_progress};
use crate::plan::progress::{Progress, Stage};
use crate::report::figures::Figures;
use crate::report::job_texts::LayerOutlines;
use crate::settings::{Settings, machine_file};
use std::io::Cursor;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
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
    /// Steps of it that are done.
    pub done: usize,
    /// Steps of it in all.
    pub total: usize,
}

/// Plans a part.
///
/// # Errors
/// [`Error::Options`] and [`Error::Plan`].
pub fn plan(part: &Part, machine: &Machine, options: &Options) -> Result<Job, Error> {
    plan_watched(part, machine, options, &|_| ControlFlow::Continue(()))
}

/// The same, watched: `watch` is called at each step, from whichever thread, one call after another, and
/// stops the planning with `Break`.
///
/// # Errors
/// The same and [`Error::Stopped`].
pub fn plan_watched(
    part: &Part,
    machine: &Machine,
    options: &Options,
    watch: &(dyn Fn(Step) -> ControlFlow<()> + Sync),
) -> Result<Job, Error> {
    let progress = Watched(watch);
    let planned = catch_unwind(AssertUnwindSafe(|| {
        planned(part, machine, options, &progress)
    }));
    planned.unwrap_or_else(|payload| match payload.is::<Stopped>() {
        true => Err(Error::Stopped),
        false => resume_unwind(payload),
    })
}

/// What a stop unwinds with.
struct Stopped;

struct Watched<'a>(&'a (dyn Fn(Step) -> ControlFlow<()> + Sync));

impl Progress for Watched<'_> {
    fn at(&self, stage: Stage, done: usize, total: usize) {
        let stage = stage.name();
        let step = Step { stage, done, total };
        if (self.0)(step).is_break() {
            resume_unwind(Box::new(Stopped));
        }
    }
}

fn planned(
    part: &Part,
    machine: &Machine,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Job, Error> {
    let settings = options.over(machine.settings.clone());
    let mut settings = Settings {
        at_mm: part.at_mm,
        ..settings.map_err(|error| Error::Options(error.to_string()))?
    };
    let begun = Instant::now();
    let plan = match &part.what {
        What::Outline(loaded) => {
            plan_target_around(&loaded.target, &part.keep_out, &settings, progress)
        }
        What::Path(run) => {
            if let Some(option) = options.of_outlines() {
                return Err(Error::Options(format!(
                    "{option} goes with outlines: a path is followed as it is"
                )));
            }
            plan_waypoints_with_progress(run, &settings, progress)
        }
    };
    let plan = plan.map_err(|error| Error::Plan(error.to_string()))?;
    let plan_s = begun.elapsed().as_secs_f64();
    settings.machine = plan.stream.machine(&settings.machine);
    packed(part, &plan, plan_s, &settings)
}

/// The job of a plan, as the command writes it.
fn packed(part: &Part, plan: &Plan, plan_s: f64, settings: &Settings) -> Result<Job, Error> {
    let job_error = |error: &dyn std::fmt::Display| Error::Job(error.to_string());
    let Findings {
        figures,
        warnings,
        objections,
        ..
    } = findings(plan, plan_s, settings);
    let mut packing = JobPacking::new(Cursor::new(Vec::new()));
    let taken = packing.take(&plan.stream, 0, settings);
    taken.map_err(|error| job_error(&error))?;
    let packed = packing.finish(settings);
    let mut packed = packed.map_err(|error| job_error(&error))?;
    if let Some(refused) = &packed.refused {
        let fault = Objection::of_board(refused, &plan.transform, settings);
        return Err(Error::Plan(fault.text));
    }
    let figures = Figures {
        objections: (!objections.is_empty()).then(|| lines(&objections)),
        ..packed.figures(figures, &plan.transform)
    };
    let outline = match &part.what {
        What::Outline(loaded) => {
            let Target { regions, .. } = &loaded.target;
            regions.as_slice()
        }
        What::Path(_) => &[],
    };
    let facts = JobFacts {
        name: part.name(),
        outline,
        layer_outlines: &LayerOutlines::default(),
        settings,
        transform: plan.transform,
        figures: &figures,
        heat: &[],
    };
    let header = job_header(&facts, packed.frames.facts.clone());
    let mut bytes = Vec::new();
    let written = packed.frames.write(&mut bytes, &header);
    written.map_err(|error| job_error(&error))?;
    let notes = lines(&objections).into_iter();
    let notes = notes.chain(part.notes().iter().cloned()).chain(warnings);
    let notes = notes.collect();
    Job::planned(bytes, figures, notes)
}

/// A line for each objection.
fn lines(objections: &[Objection]) -> Vec<String> {
    objections.iter().map(|o| o.text.clone()).collect()
}
