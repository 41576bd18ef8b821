//! `headway export`: a job as tables, pictures, JSON or G-code.

use crate::cli::args::export::{ExportArgs, ExportName};
use crate::cli::error::CliError;
use crate::cli::job::{export_gcode, export_program};
use crate::cli::plan::planned;
use crate::cli::reading::job;
use crate::cli::reading::job::Job;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::OutputFile;
use crate::cli::terminal::result_kind::{GCODE, JSON, PICTURE, TABLE, YAML};
use crate::joint_export::tables::JointTable;
use crate::joint_export::trajectory::{TrajectoryFormat, joint_names_of, write_trajectory};
use crate::pipeline::page::pictures;
use crate::pipeline::planned::Planned;
use crate::report::plan_picture::PlanPicture;
use crate::report::pose_table::ROWS_MAX;
use crate::report::{plan_picture, pose_table};
use headway_protocol::segment::FlowAction;
use headway_protocol::units::{CHANNEL_VOLUME, CHANNELS, Units};
use serde_json::json;

pub(crate) fn run(args: &ExportArgs, console: &Console) -> Result<(), CliError> {
    if !(args.every_ms.is_finite() && args.every_ms > 0.0) {
        return Err(CliError::Usage(format!(
            "--every-ms {}: must be greater than 0",
            args.every_ms
        )));
    }
    if args.colour.is_some() && !matches!(args.to, ExportName::Svg) {
        return Err(CliError::Usage(
            "--colour goes with pictures: --to svg".to_string(),
        ));
    }
    if args.json && !matches!(args.to, ExportName::Gcode) {
        return Err(CliError::Usage(
            "--json goes with --to gcode: it prints what was written".to_string(),
        ));
    }
    let is_trajectory = matches!(args.to, ExportName::Ros2Json | ExportName::Ros2Yaml);
    if args.joints && !is_trajectory && !matches!(args.to, ExportName::Csv | ExportName::Json) {
        return Err(CliError::Usage(
            "--joints goes with tables: --to csv or --to json".to_string(),
        ));
    }
    if args.joint_names.is_some() && !is_trajectory {
        return Err(CliError::Usage(
            "--joint-names goes with --to ros2-json and --to ros2-yaml".to_string(),
        ));
    }
    let language = export_program::language(args.to);
    if let (None, Some(option)) = (language, args.program.given()) {
        return Err(CliError::Usage(format!(
            "{option} goes with programs: --to rapid, krl, urscript or sinumerik"
        )));
    }
    if let Some(language) = language {
        return export_program::run(&job::read(&args.job)?, language, args, console);
    }
    let kind = match args.to {
        ExportName::Csv => TABLE,
        ExportName::Svg => PICTURE,
        ExportName::Json | ExportName::Ros2Json => JSON,
        ExportName::Ros2Yaml => YAML,
        _ => GCODE,
    };
    let output = args.output.as_ref();
    let output = output
        .map(|output| output.file(kind, console))
        .transpose()?;
    let output = output.as_ref();
    let job = job::read(&args.job)?;
    let text = match args.to {
        ExportName::Ros2Json => {
            return trajectory(&job, args, TrajectoryFormat::Json, output, console);
        }
        ExportName::Ros2Yaml => {
            return trajectory(&job, args, TrajectoryFormat::Yaml, output, console);
        }
        ExportName::Csv | ExportName::Json if args.joints => {
            return joints(&job, args, output, console);
        }
        ExportName::Csv => return csv(&job, args, output, console),
        ExportName::Svg => svg(planned::of_job(job), args)?,
        ExportName::Json => format!("{:#}\n", json(&job)),
        _ => return export_gcode::run(&job, args, output, console),
    };
    console.result_to(output, &text)
}

/// A layer's picture.
fn svg(planned: Planned, args: &ExportArgs) -> Result<String, CliError> {
    let layers = planned.stream.layers();
    // A job of some layers of a part leaves out the ones below.
    let mut marks = planned.stream.marks.iter();
    let first = marks.find(|mark| mark.pass.is_some());
    let first = first.map_or(1, |mark| mark.layer + 1);
    let number = args.layer.unwrap_or(first);
    if !(first..=layers).contains(&number) {
        return Err(CliError::Usage(format!(
            "--layer {number}: the job has layers {first} to {layers}"
        )));
    }
    let title = match layers {
        1 => planned.name.clone(),
        _ => format!("{}: layer {number} of {layers}", planned.name),
    };
    let picture = PlanPicture {
        colouring: args.colour.unwrap_or_default(),
        ..pictures::plan_picture(&title, &planned, number - 1)
    };
    Ok(plan_picture::draw(&picture))
}

/// As many rows as a table may have.
fn check_rows(job: &Job, args: &ExportArgs) -> Result<(), CliError> {
    let motion_s = pose_table::duration_ticks(&job.stream) as f64 / job.servo_hz();
    if motion_s * 1e3 / args.every_ms > ROWS_MAX {
        return Err(CliError::Usage(format!(
            "--every-ms {}: {motion_s:.1} s of motion make more than {ROWS_MAX:.0} rows; give a larger \
             one",
            args.every_ms
        )));
    }
    Ok(())
}

/// The job's joints, a row per this many ms.
fn joint_table<'a>(job: &'a Job, args: &ExportArgs) -> Result<JointTable<'a>, CliError> {
    check_rows(job, args)?;
    let header = &job.file.header;
    Ok(JointTable {
        name: &job.name,
        machine_name: &header.machine_name,
        stream: &job.stream,
        machine: &header.machine,
        offset_mm: header.transform.offset_mm,
        every_ms: args.every_ms,
    })
}

/// Joints as a table.
fn joints(
    job: &Job,
    args: &ExportArgs,
    output: Option<&OutputFile>,
    console: &Console,
) -> Result<(), CliError> {
    let table = joint_table(job, args)?;
    console.write_to(output, |mut out| match args.to {
        ExportName::Json => table.write_json(&mut out),
        _ => table.write_csv(&mut out),
    })
}

/// Joints as a controller of robots takes them.
fn trajectory(
    job: &Job,
    args: &ExportArgs,
    format: TrajectoryFormat,
    output: Option<&OutputFile>,
    console: &Console,
) -> Result<(), CliError> {
    let table = joint_table(job, args)?;
    let names = joint_names_of(&table, args.joint_names.as_deref())
        .map_err(|error| CliError::Usage(format!("--joint-names: {error}")))?;
    console.write_to(output, |mut out| {
        write_trajectory(&mut out, &table, &names, format)
    })
}

/// Writes rows as they are computed: a long job's table need not fit into memory.
fn csv(
    job: &Job,
    args: &ExportArgs,
    output: Option<&OutputFile>,
    console: &Console,
) -> Result<(), CliError> {
    check_rows(job, args)?;
    console.write_to(output, |mut out| {
        let servo_hz = job.servo_hz();
        pose_table::write_csv(
            &mut out,
            &job.stream,
            servo_hz,
            args.every_ms,
            &job.transform,
        )
    })
}

fn json(job: &Job) -> serde_json::Value {
    let header = &job.file.header;
    let figures: serde_json::Value = serde_json::from_str(&header.figures_json).unwrap_or_default();
    let marks: Vec<_> = job
        .stream
        .marks
        .iter()
        .map(|m| {
            json!({
                "start_tick": m.start_tick,
                "end_tick": m.end_tick,
                "state": m.state.name(),
                "layer": m.layer,
                "pass": m.pass,
            })
        })
        .collect();
    let per_mm3 = job.stream.units.per_natural(CHANNEL_VOLUME);
    let events: Vec<_> = job
        .stream
        .events
        .iter()
        .map(|e| {
            json!({
                "span": e.span,
                "offset_ticks": e.offset_ticks,
                "action": match e.action {
                    FlowAction::Prime => "prime",
                    FlowAction::Retract => "retract",
                },
                "volume_mm3": f64::from(e.volume_units) / per_mm3,
                "duration_ticks": e.duration_ticks.0,
            })
        })
        .collect();
    let controls = job.stream.unwrapped().skip(1);
    let knots: Vec<_> = (job.stream.knots.iter().zip(controls))
        .map(|(k, control)| json!([k.duration_ticks, control]))
        .collect();
    json!({
        "name": job.name,
        "machine": header.machine_name,
        "servo_hz": header.machine.servo_hz,
        "step_hz": header.machine.step_hz,
        "offset_mm": header.transform.offset_mm,
        "figures": figures,
        "channels": channels(&job.stream.units),
        "start": job.stream.start,
        "knots": knots,
        "events": events,
        "marks": marks,
    })
}

/// The channels with the unit in which each is counted.
fn channels(units: &Units) -> [String; CHANNELS] {
    let names = ["x", "y", "z", "tilt x", "tilt y", "heading", "volume"];
    let natural = ["mm", "mm", "mm", "rad", "rad", "rad", "mm3"];
    std::array::from_fn(|channel| {
        let unit = 1.0 / units.per_natural(channel);
        format!("{} {unit:e} {}", names[channel], natural[channel])
    })
}
