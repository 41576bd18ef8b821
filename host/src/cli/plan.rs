//! `headway plan`: input -> job file and figures.

use super::CliError;
use super::args::PlanArgs;
use super::console::Console;
use super::output_file::{check_file, write_file};
use super::planned::{self, Planned};
use crate::drive::limits;
use crate::job_file::{self, JobHeader};
use crate::report::figures::Figures;
use crate::report::job_texts::{NAME_TEXT, OUTLINE_TEXT, SETTINGS_TEXT, outline_to_json};
use crate::settings::machine_file;
use crate::wire_frames::WireFrames;

pub(super) fn run(args: &PlanArgs, console: &Console) -> Result<(), CliError> {
    check_file(&args.output)?;
    let mut planned = planned::from_input(
        &args.input,
        &args.reading,
        &args.place,
        &args.settings,
        console,
    )?;
    let bar = console.stage("checking");
    let (limits, frames) = rayon::join(
        || limits::sample(&planned.stream, &planned.settings),
        || WireFrames::encode(&planned.stream),
    );
    let frames =
        frames.map_err(|error| CliError::Job(format!("the plan cannot be packed: {error}")))?;
    bar.finish_and_clear();
    let bytes = frames.line_bytes() as u64;
    let print_s = planned.figures.print_s.unwrap_or_default();
    planned.figures = std::mem::take(&mut planned.figures).merged_with(&Figures {
        limit_ratio_velocity: Some(limits.velocity.ratio),
        limit_ratio_acceleration: Some(limits.acceleration.ratio),
        limit_ratio_jerk: Some(limits.jerk.ratio),
        bytes: Some(bytes),
        bytes_per_s: Some(bytes as f64 / print_s.max(1e-9)),
        ..planned::time_figures(&planned)
    });
    let job = job_bytes(&planned, &frames)?;
    write_file(&args.output, &job)?;
    console.say(&format!(
        "{}: job of {} bytes written to {}",
        planned.name,
        job.len(),
        args.output.display()
    ));
    if args.json {
        return console.result(&(planned.figures.to_json() + "\n"));
    }
    console.result(&planned.figures.to_text())
}

fn job_bytes(planned: &Planned, frames: &WireFrames) -> Result<Vec<u8>, CliError> {
    let settings = &planned.settings;
    let mut header = JobHeader::new(
        &planned.stream,
        frames,
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
    let mut bytes = Vec::new();
    job_file::write(&mut bytes, &header, frames)
        .map_err(|error| CliError::Job(error.to_string()))?;
    Ok(bytes)
}
