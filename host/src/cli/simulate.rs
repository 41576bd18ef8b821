//! `headway simulate`: the job through link and firmware, checked against the plan.

use super::args::{InputArgs, PlaceArgs, SettingsArgs, SimulateArgs};
use super::console::Console;
use super::output_file::{check_file, check_folder, write_file_with, write_folder};
use super::planned::{self, Planned};
use super::{CliError, job, pictures};
use crate::drive::dry_run::{DryRun, dry_run};
use crate::drive::link::LinkSpec;
use crate::drive::simulator::SimulatorSetup;
use crate::drive::time_by_limit::time_by_limit;
use crate::drive::trace_table;
use crate::findings::time_figures;
use crate::report::figures::Figures;
use std::path::Path;

/// Time between two rows of `--trace`.
const TRACE_EVERY_MS: f64 = 1.0;
/// Steps of the progress bar.
const BAR_STEPS: f64 = 1000.0;

pub(super) fn run(args: &SimulateArgs, console: &Console) -> Result<(), CliError> {
    let link: LinkSpec = match &args.link {
        Some(text) => text
            .parse()
            .map_err(|error| CliError::Usage(format!("--{error}")))?,
        None => LinkSpec::default(),
    };
    for file in [&args.trace, &args.trace_steps].into_iter().flatten() {
        check_file(file)?;
    }
    if let Some(folder) = &args.report {
        check_folder(folder)?;
    }
    let mut planned = if job::is_job(&args.input) {
        let unused = of_no_use(&args.input, &args.reading, &args.place, &args.settings);
        console.notes(unused.as_slice());
        planned::from_job(&args.input, &args.settings)?
    } else {
        planned::from_input(
            &args.input,
            &args.reading,
            &args.place,
            &args.settings,
            None,
            console,
        )?
    };
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
    planned.figures =
        std::mem::take(&mut planned.figures).merged_with(&simulation_figures(&planned, &dry_run));
    write_traces(args, &planned, &dry_run)?;
    if let Some(folder) = &args.report {
        write_report(folder, &planned, console)?;
    }
    if args.json {
        console.result(&(planned.figures.to_json() + "\n"))?;
    } else {
        console.result(&format!("{}\n{}", planned.name, planned.figures.to_text()))?;
    }
    verdict(&dry_run)
}

/// What is said of a job that only planning could heed.
pub(super) fn of_no_use(
    input: &Path,
    reading: &InputArgs,
    place: &PlaceArgs,
    settings: &SettingsArgs,
) -> Option<String> {
    let InputArgs {
        from,
        units,
        scale,
        repair,
        rotate,
        filament_diameter,
        dxf_layer,
    } = reading;
    let of_reading = from.is_some()
        || units.is_some()
        || *scale != 1.0
        || *repair
        || rotate.is_some()
        || filament_diameter.is_some()
        || !dxf_layer.is_empty();
    let machine_alone = SettingsArgs {
        machine: settings.machine.clone(),
        ..SettingsArgs::default()
    };
    let of_plan = *place != PlaceArgs::default() || *settings != machine_alone;
    (of_reading || of_plan).then(|| {
        let path = input.display();
        format!(
            "{path} is planned already: options of input and settings change nothing; plan the \
             input again with them"
        )
    })
}

fn simulation_figures(planned: &Planned, dry_run: &DryRun) -> Figures {
    let (s, t, l) = (&dry_run.simulation.figures, &dry_run.trace, &dry_run.limits);
    Figures {
        bytes: Some(s.bytes),
        bytes_per_s: Some(dry_run.bytes_per_s),
        limit_ratio_velocity: Some(l.velocity.ratio),
        limit_ratio_acceleration: Some(l.acceleration.ratio),
        limit_ratio_jerk: Some(l.jerk.ratio),
        heading_travel_rad: Some(l.heading_travel_rad),
        heading_rate_max_rad_s: Some(l.heading_rate_max_rad_s),
        tip_error_um_max: Some(t.tip_error_um_max),
        tip_error_um_rms: Some(t.tip_error_um_rms),
        heading_error_mrad_max: Some(t.heading_error_mrad_max),
        half_step_um_max: Some(t.half_step_um_max),
        half_step_mrad_max: Some(t.half_step_mrad_max),
        // 0 exactly where nothing is shaped.
        shaping_error_um_max: (t.shaping_error_um_max > 0.0).then_some(t.shaping_error_um_max),
        volume_error_pct: Some(t.volume_error_pct),
        step_time_error_us_max: Some(t.step_time_error_us_max),
        step_time_error_us_rms: Some(t.step_time_error_us_rms),
        steps: Some(s.steps),
        step_digest: Some(s.step_digest.clone()),
        final_counts: Some(s.final_counts.clone()),
        resent_frames: Some(s.resent_frames),
        underruns: Some(s.underruns),
        holds: Some(s.holds),
        faults: Some(s.faults),
        realtime_factor: Some(dry_run.realtime_factor),
        ..time_figures(
            time_by_limit(&planned.stream, &planned.settings),
            &planned.transform,
        )
    }
}

/// A fault, or steps that do not come to the plan's end, are no success.
fn verdict(dry_run: &DryRun) -> Result<(), CliError> {
    if let Some(fault) = &dry_run.simulation.fault {
        return Err(CliError::Job(format!(
            "the controller stopped with a fault: {fault}"
        )));
    }
    let trace = &dry_run.trace;
    if trace.final_counts != trace.expected_counts {
        return Err(CliError::Job(format!(
            "the steps end at {:?}, the plan's last pose asks for {:?}",
            trace.final_counts, trace.expected_counts
        )));
    }
    Ok(())
}

fn write_traces(args: &SimulateArgs, planned: &Planned, dry_run: &DryRun) -> Result<(), CliError> {
    let machine = &planned.settings.machine;
    let record = &dry_run.simulation.motion;
    if let Some(path) = &args.trace {
        write_file_with(path, |mut out| {
            trace_table::write_poses(
                &mut out,
                &planned.stream,
                machine,
                record,
                &planned.transform,
                TRACE_EVERY_MS,
            )
        })?;
    }
    if let Some(path) = &args.trace_steps {
        write_file_with(path, |mut out| {
            trace_table::write_steps(&mut out, machine, record)
        })?;
    }
    Ok(())
}

/// Writes the report's files, the page last.
pub(super) fn write_report(
    folder: &Path,
    planned: &Planned,
    console: &Console,
) -> Result<(), CliError> {
    let bar = console.stage("report");
    let files = pictures::report_files(planned);
    let files: Vec<(&str, &str)> = files
        .iter()
        .map(|file| (file.name.as_str(), file.text.as_str()))
        .collect();
    write_folder(folder, &files)?;
    bar.finish_and_clear();
    console.say(&format!("report: {}", folder.join("index.html").display()));
    Ok(())
}
