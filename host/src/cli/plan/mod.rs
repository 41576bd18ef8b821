//! `headway plan`: input -> job file and figures.

pub(crate) mod calibrate;
mod flow_curve;
pub(crate) mod headings;
pub(crate) mod missing_heat;
pub(crate) mod piece_cache;
pub(crate) mod planned;
pub(crate) mod reach;
mod shards;
pub(crate) mod verdict;

use crate::cli::args::allow::AllowArgs;
use crate::cli::args::output_path::OutputPath;
use crate::cli::args::{PartArgs, PlanArgs};
use crate::cli::error::CliError;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::OutputFile;
use crate::cli::terminal::result_kind::{DIRECTIONS, JOB};
use crate::pipeline::findings::settled_verdict::settle;
use crate::pipeline::packing::{JobPacking, job_header};
use crate::pipeline::planned::Planned;
use crate::settings::aperture_text::nozzle_text;
use crate::settings::directions::to_toml;
use std::fs::File;
use std::path::Path;

pub(crate) fn run(args: &PlanArgs, console: &Console) -> Result<(), CliError> {
    let Some(output) = &args.output else {
        return shards::run(args, console);
    };
    let output = output.file(JOB, console)?;
    let finds = args.asked.place.directions.as_deref() == Some(Path::new("auto"));
    let found = finds.then(|| output.path().with_extension("directions.toml"));
    let found = found.map(|path| OutputPath::from(path).file(DIRECTIONS, console));
    let found = found.transpose()?;
    if !args.verdict.figures {
        console.show_few_notes();
    }
    let (planned, job) = verdict::planned_as_allowed(&args.allow, |widened| {
        let mut job = JobPacking::new(output.nameless()?);
        let planned =
            planned::from_input(&args.input, &args.asked, widened, Some(&mut job), console)?;
        Ok((planned, job))
    })?;
    let (mut planned, written) = write_job(planned, job, &args.allow, &output, console)?;
    let other = |asked: &PartArgs| planned::from_input(&args.input, asked, &[], None, console);
    verdict::compare(&args.verdict, &args.asked, other, &mut planned.figures)?;
    settle(&mut planned);
    let pieces = planned.plan.as_ref().and_then(|plan| plan.pieces.as_ref());
    let cuts = pieces.map_or(&[][..], |pieces| &pieces.cuts);
    if let Some(file) = found.filter(|_| written.is_ok() && !cuts.is_empty()) {
        file.write(to_toml(cuts).as_bytes())?;
        console.say(&format!(
            "its pieces are written to {}",
            file.path().display()
        ));
    }
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
    job: JobPacking<File>,
    allow: &AllowArgs,
    output: &OutputFile,
    console: &Console,
) -> Result<(Planned, Result<(), CliError>), CliError> {
    let bar = console.stage("checking");
    let packed = job.finish_plan(&mut planned);
    bar.finish_and_clear();
    let mut frames = packed
        .map_err(|error| CliError::Job(error.to_string()))?
        .frames;
    let stands = verdict::check(&planned.objections, allow, "the job is not written");
    if stands.is_err() {
        return Ok((planned, stands));
    }
    planned.restore_joints();
    let header = job_header(&planned, frames.facts.clone());
    let mut length = 0;
    output.write_with(|out| {
        let written = frames.write(&mut { out }, &header);
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
