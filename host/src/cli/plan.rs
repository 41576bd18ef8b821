//! `headway plan`: input -> job file and figures.

use super::CliError;
use super::args::PlanArgs;
use super::console::Console;
use super::output_file::{check_file, write_file_with};
use super::planned::{self, Planned};
use super::planned_job::{PackedJob, PlannedJob};
use crate::job_file::{JobHeader, StreamFacts};
use crate::report::figures::Figures;
use crate::report::job_texts::{NAME_TEXT, OUTLINE_TEXT, SETTINGS_TEXT, outline_to_json};
use crate::settings::machine_file;

pub(super) fn run(args: &PlanArgs, console: &Console) -> Result<(), CliError> {
    check_file(&args.output)?;
    let mut job = PlannedJob::new(&args.output);
    let mut planned = planned::from_input(
        &args.input,
        &args.reading,
        &args.place,
        &args.settings,
        Some(&mut job),
        console,
    )?;
    let bar = console.stage("checking");
    if job.is_empty() {
        job.take(&planned.stream, 0, &planned.settings)?;
    }
    let PackedJob {
        mut frames,
        limits,
        times,
    } = job.finish(&planned.settings)?;
    bar.finish_and_clear();
    let bytes = frames.line_bytes;
    let print_s = planned.figures.print_s.unwrap_or_default();
    planned.figures = std::mem::take(&mut planned.figures).merged_with(&Figures {
        limit_ratio_velocity: Some(limits.velocity.ratio),
        limit_ratio_acceleration: Some(limits.acceleration.ratio),
        limit_ratio_jerk: Some(limits.jerk.ratio),
        bytes: Some(bytes),
        bytes_per_s: Some(bytes as f64 / print_s.max(1e-9)),
        ..planned::time_figures(times, &planned)
    });
    let header = header(&planned, frames.facts.clone());
    let mut length = 0;
    write_file_with(&args.output, |out| {
        let written = frames.write(&mut { out }, &header);
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

fn header(planned: &Planned, stream: StreamFacts) -> JobHeader {
    let settings = &planned.settings;
    let mut header = JobHeader::of_facts(
        stream,
        &settings.machine_name,
        &settings.machine,
        planned.transform,
    );
    // How long planning took is no property of the job: the same job is the same file.
    let figures = Figures {
        plan_s: None,
        ..planned.figures.clone()
    };
    header.figures_json = figures.to_json();
    let texts = [
        (NAME_TEXT, planned.name.clone()),
        (OUTLINE_TEXT, outline_to_json(&planned.outline)),
        (SETTINGS_TEXT, machine_file::to_toml(settings)),
    ];
    header.texts = texts.map(|(key, text)| (key.to_string(), text)).into();
    header
}
