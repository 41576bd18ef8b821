//! `headway plan`: input -> job file and figures.

pub(crate) mod calibrate;
pub(crate) mod headings;
pub(crate) mod missing_heat;
pub(crate) mod piece_cache;
pub(crate) mod planned;
pub(crate) mod planned_curved;
pub(crate) mod planned_gcode;
pub(crate) mod planned_part;
pub(crate) mod planned_patch;
mod shards;
pub(crate) mod verdict;

use crate::cli::args::allow::AllowArgs;
use crate::cli::args::{PlanArgs, SettingsArgs};
use crate::cli::error::CliError;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::OutputFile;
use crate::cli::terminal::result_kind::JOB;
use crate::job::spool::SpoolError;
use crate::pipeline::findings::objections::Objection;
use crate::pipeline::findings::settled_verdict::settle;
use crate::pipeline::packing::{JobFacts, JobPacking, job_header};
use crate::pipeline::planned::Planned;
use crate::settings::aperture_text::nozzle_text;
use std::fs::File;

pub(crate) fn run(args: &PlanArgs, console: &Console) -> Result<(), CliError> {
    let Some(output) = &args.output else {
        return shards::run(args, console);
    };
    let output = output.file(JOB, console)?;
    if !args.verdict.figures {
        console.show_few_notes();
    }
    let (planned, job) = verdict::planned_as_allowed(&args.allow, |widened| {
        let mut job = JobPacking::new(output.nameless()?);
        let planned = planned::from_input(
            &args.input,
            &args.reading,
            &args.place,
            &args.settings,
            widened,
            Some(&mut job),
            console,
        )?;
        Ok((planned, job))
    })?;
    let (mut planned, written) = write_job(planned, job, &args.allow, &output, console)?;
    let other = |settings: &SettingsArgs| {
        let (input, place) = (&args.input, &args.place);
        planned::from_input(input, &args.reading, place, settings, &[], None, console)
    };
    verdict::compare(&args.verdict, &args.settings, other, &mut planned.figures)?;
    settle(&mut planned);
    let figures = &planned.figures;
    match args.json {
        true => console.result(&(figures.to_json() + "\n"))?,
        false => console.result(&verdict::text(figures, &args.verdict, console))?,
    }
    written
}

/// Checks a plan's finished motion and writes its job unless there are objections that are not allowed; returns
/// the plan with all figures, and the reason if it is not written.
///
/// # Errors
/// The reason why it cannot be packed or written.
pub(crate) fn write_job(
    mut planned: Planned,
    mut job: JobPacking<File>,
    allow: &AllowArgs,
    output: &OutputFile,
    console: &Console,
) -> Result<(Planned, Result<(), CliError>), CliError> {
    let bar = console.stage("checking");
    let spooled = |error: SpoolError| CliError::Job(error.to_string());
    if job.is_empty() {
        let taken = job.take(&planned.stream, 0, &planned.settings);
        taken.map_err(spooled)?;
    }
    let mut packed = job.finish(&planned.settings).map_err(spooled)?;
    bar.finish_and_clear();
    let of_plan = std::mem::take(&mut planned.figures);
    planned.figures = packed.figures(of_plan, &planned.transform);
    if let Some(refused) = &packed.refused {
        let fault = Objection::of_board(refused, &planned.transform, &planned.settings);
        planned.objections.insert(0, fault);
    }
    verdict::note(&planned.objections, &mut planned.figures);
    let stands = verdict::check(&planned.objections, allow, "the job is not written");
    if stands.is_err() {
        return Ok((planned, stands));
    }
    planned.restore_joints();
    let facts = JobFacts {
        name: &planned.name,
        outline: &planned.outline,
        layer_outlines: &planned.layer_outlines,
        settings: &planned.settings,
        transform: planned.transform,
        figures: &planned.figures,
        heat: &planned.heat,
        pass_facts: &planned.pass_facts,
    };
    let header = job_header(&facts, packed.frames.facts.clone());
    let mut length = 0;
    output.write_with(|out| {
        let written = packed.frames.write(&mut { out }, &header);
        length = written.map_err(std::io::Error::other)?;
        Ok(())
    })?;
    console.say(&format!(
        "{}: job of {} bytes written to {}",
        planned.name,
        length,
        output.path().display()
    ));
    console.say(&nozzle_text(&planned.settings.aperture));
    Ok((planned, Ok(())))
}
