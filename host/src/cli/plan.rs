//! `headway plan`: input -> job file and figures.

use super::CliError;
use super::args::PlanArgs;
use super::console::Console;
use super::output_file::{check_file, nameless_file, write_file_with};
use super::planned;
use crate::job_packing::{JobFacts, JobPacking, job_header};
use crate::job_spool::SpoolError;

pub(super) fn run(args: &PlanArgs, console: &Console) -> Result<(), CliError> {
    check_file(&args.output)?;
    let mut job = JobPacking::new(nameless_file(&args.output)?);
    let mut planned = planned::from_input(
        &args.input,
        &args.reading,
        &args.place,
        &args.settings,
        Some(&mut job),
        console,
    )?;
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
    write_file_with(&args.output, |out| {
        let written = packed.frames.write(&mut { out }, &header);
        length = written.map_err(std::io::Error::other)?;
        Ok(())
    })?;
    console.say(&format!(
        "{}: job of {} bytes written to {}",
        planned.name,
        length,
        args.output.display()
    ));
    if args.json {
        return console.result(&(planned.figures.to_json() + "\n"));
    }
    console.result(&planned.figures.to_text())
}
