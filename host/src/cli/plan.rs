//! `headway plan`: input -> job file and figures.

use super::CliError;
use super::args::PlanArgs;
use super::console::Console;
use super::output_file::{check_file, nameless_file, write_file_with};
use super::planned::{self, Planned};
use crate::job_packing::{JobFacts, JobPacking, job_header};
use crate::job_spool::SpoolError;
use std::fs::File;
use std::path::Path;

pub(super) fn run(args: &PlanArgs, console: &Console) -> Result<(), CliError> {
    check_file(&args.output)?;
    let mut job = JobPacking::new(nameless_file(&args.output)?);
    let planned = planned::from_input(
        &args.input,
        &args.reading,
        &args.place,
        &args.settings,
        Some(&mut job),
        console,
    )?;
    let planned = write_job(planned, job, &args.output, console)?;
    if args.json {
        return console.result(&(planned.figures.to_json() + "\n"));
    }
    console.result(&planned.figures.to_text())
}

/// Checks a plan's finished motion and writes its job; the plan comes back with all figures.
pub(super) fn write_job(
    mut planned: Planned,
    mut job: JobPacking<File>,
    path: &Path,
    console: &Console,
) -> Result<Planned, CliError> {
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
    let facts = JobFacts {
        name: &planned.name,
        outline: &planned.outline,
        settings: &planned.settings,
        transform: planned.transform,
        figures: &planned.figures,
        heat: &planned.heat,
    };
    let header = job_header(&facts, packed.frames.facts.clone());
    let mut length = 0;
    write_file_with(path, |out| {
        let written = packed.frames.write(&mut { out }, &header);
        length = written.map_err(std::io::Error::other)?;
        Ok(())
    })?;
    console.say(&format!(
        "{}: job of {} bytes written to {}",
        planned.name,
        length,
        path.display()
    ));
    Ok(planned)
}
