//! `headway simulate`: the job through link and firmware, checked against the plan.

use crate::cli::args::output_path::OutputPath;
use crate::cli::args::{PartArgs, SimulateArgs};
use crate::cli::error::CliError;
use crate::cli::plan::planned;
use crate::cli::plan::verdict;
use crate::cli::reading::{job, load};
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::{OutputFile, ReportFolder};
use crate::cli::terminal::result_kind::TABLE;
use crate::drive::dry_run::{DryRun, dry_run};
use crate::drive::laid_beads::laid_beads;
use crate::drive::link::LinkSpec;
use crate::drive::simulator::SimulatorSetup;
use crate::drive::trace_table;
use crate::job::heat::{self, job_events};
use crate::pipeline::findings::laid::laid_figures;
use crate::pipeline::findings::objections::Objection;
use crate::pipeline::findings::settled_verdict::settle;
use crate::pipeline::findings::simulated::{outcome, simulation_figures};
use crate::pipeline::page::pictures;
use crate::pipeline::planned::Planned;
use crate::settings::extruder_model::ExtruderModel;
use std::path::Path;

/// Time between two rows of `--trace`.
const TRACE_EVERY_MS: f64 = 1.0;
/// Heater and fan commands that are listed one by one.
const ORDERS_TOLD: usize = 12;
/// Steps of the progress bar.
const BAR_STEPS: f64 = 1000.0;

pub(crate) fn run(args: &SimulateArgs, console: &Console) -> Result<(), CliError> {
    let link: LinkSpec = match &args.link {
        Some(text) => text
            .parse()
            .map_err(|error| CliError::Usage(format!("--{error}")))?,
        None => LinkSpec::default(),
    };
    let material = args.material.as_deref().map(material).transpose()?;
    let table = |path: &Option<OutputPath>| path.as_ref().map(|path| path.file(TABLE, console));
    let poses = table(&args.trace).transpose()?;
    let steps = table(&args.trace_steps).transpose()?;
    let report = args.report.as_ref().map(|folder| folder.report(console));
    let report = report.transpose()?;
    if !args.verdict.figures {
        console.show_few_notes();
    }
    let mut planned = planned_of(args, console)?;
    tell_heat(&mut planned, console);
    let setup = SimulatorSetup {
        link,
        seed: args.seed,
        commands: Vec::new(),
    };
    let bar = console.bar("simulating", BAR_STEPS as u64);
    let dry_run = dry_run(&planned.stream, &planned.settings, &setup, |done| {
        bar.set_position((done * BAR_STEPS) as u64);
    });
    bar.finish_and_clear();
    let dry_run = dry_run.map_err(|error| CliError::Job(error.to_string()))?;
    let simulated = simulation_figures(
        &dry_run,
        &planned.stream,
        &planned.transform,
        &planned.settings,
    );
    planned.figures = std::mem::take(&mut planned.figures).merged_with(&simulated);
    if let Some(model) = &material {
        lay(&mut planned, &dry_run, model);
    }
    if let Err(fault) = outcome(&dry_run) {
        let fault = Objection::of_run(&fault);
        planned.objections.insert(0, fault);
    }
    planned.note_objections();
    if !job::is_job(&args.input) {
        let other = |asked: &PartArgs| planned::from_input(&args.input, asked, &[], None, console);
        verdict::compare(&args.verdict, &args.asked, other, &mut planned.figures)?;
    }
    settle(&mut planned);
    write_traces(&poses, &steps, &planned, &dry_run)?;
    if let Some(folder) = &report {
        write_report(folder, &planned, console)?;
    }
    if args.json {
        console.result(&(planned.figures.to_json() + "\n"))?;
    } else {
        let text = verdict::text(&planned.figures, &args.verdict, console);
        console.result(&text)?;
    }
    verdict::check(&planned.objections, &args.allow, "the job is not good")
}

fn material(path: &Path) -> Result<ExtruderModel, CliError> {
    ExtruderModel::from_toml(&load::read_text(path)?)
        .map_err(|refused| CliError::Job(format!("{}: {refused}", path.display())))
}

fn lay(planned: &mut Planned, dry_run: &DryRun, model: &ExtruderModel) {
    let beads = laid_beads(
        &planned.stream,
        &planned.settings,
        &dry_run.simulation.motion,
        model,
        &planned.transform,
    );
    planned.figures = std::mem::take(&mut planned.figures).merged_with(&laid_figures(&beads));
    planned.laid = Some(beads);
}

/// The job as it is read, or planned.
fn planned_of(args: &SimulateArgs, console: &Console) -> Result<Planned, CliError> {
    if job::is_job(&args.input) && args.verdict.against.is_some() {
        return Err(CliError::Usage(
            "--against plans the input again: give the input, not its job".to_string(),
        ));
    }
    let (planned, ()) = verdict::planned_as_allowed(&args.allow, |widened| {
        let planned = planned::from_file(&args.input, &args.asked, widened, console)?;
        Ok((planned, ()))
    })?;
    Ok(planned)
}

/// Reports the commands for heaters and fans: the simulated line carries only the motion.
fn tell_heat(planned: &mut Planned, console: &Console) {
    let material = planned.settings.material.as_ref();
    let events = job_events(&planned.heat, material, &planned.stream.marks);
    if events.is_empty() {
        return;
    }
    let servo_hz = f64::from(planned.settings.machine.servo_hz);
    let mut told = heat::list(&events, servo_hz);
    if let Some(more) = told.len().checked_sub(ORDERS_TOLD).filter(|more| *more > 0) {
        told.truncate(ORDERS_TOLD);
        told.push(format!(
            "and {more} more (`headway inspect JOB` lists them)"
        ));
    }
    let note = format!("heaters and fans: {}", told.join("; "));
    console.notes(std::slice::from_ref(&note));
    planned.notes.push(note);
}

fn write_traces(
    poses: &Option<OutputFile>,
    steps: &Option<OutputFile>,
    planned: &Planned,
    dry_run: &DryRun,
) -> Result<(), CliError> {
    let machine = &planned.settings.machine;
    let record = &dry_run.simulation.motion;
    if let Some(file) = poses {
        file.write_with(|mut out| {
            trace_table::write_poses(
                &mut out,
                &planned.stream,
                machine,
                record,
                &planned.transform,
                TRACE_EVERY_MS,
                planned.laid.as_ref(),
            )
        })?;
    }
    if let Some(file) = steps {
        file.write_with(|mut out| trace_table::write_steps(&mut out, machine, record))?;
    }
    Ok(())
}

/// Writes the report's files, the page last.
pub(crate) fn write_report(
    folder: &ReportFolder,
    planned: &Planned,
    console: &Console,
) -> Result<(), CliError> {
    let bar = console.stage("report");
    let files = pictures::report_files(planned);
    let files: Vec<(&str, &str)> = files
        .iter()
        .map(|file| (file.name.as_str(), file.text.as_str()))
        .collect();
    folder.write(&files)?;
    bar.finish_and_clear();
    console.say(&format!("report: {}", folder.page().display()));
    Ok(())
}
