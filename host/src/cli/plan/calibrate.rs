//! `headway calibrate`: a machine file -> jobs that print a pattern, and instructions for reading
//! it.
//!
//! In: the pattern's name, options, settings. Out: a job file as `plan` writes it, or one for each value with
//! its machine file, and a table of lines with their values, in pattern coordinates.

use crate::calibration::{
    Asked, CalibrationError, Line, Pattern, PatternJob, PatternKind, RISE_HZ_S, Sweep, pattern,
    resonance,
};
use crate::cli::args::allow::AllowArgs;
use crate::cli::args::calibrate::CalibrateArgs;
use crate::cli::args::output_path::OutputPath;
use crate::cli::error::CliError;
use crate::cli::plan::write_job;
use crate::cli::plan::{flow_curve, planned};
use crate::cli::reading::load;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::OutputFile;
use crate::cli::terminal::result_kind::{MACHINE, PATTERN};
use crate::job::SegmentStream;
use crate::job::transform::PartTransform;
use crate::pipeline::packing::JobPacking;
use crate::pipeline::planned::Planned;
use crate::settings::options::OF_OUTLINES;
use crate::settings::{Settings, machine_file};
use crate::text::short_number::Short;
use headway_protocol::units::CHANNEL_VOLUME;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Rows of the table of frequencies are so far apart, Hz.
const TABLE_HZ: f64 = 5.0;

/// A job that was written.
struct Written {
    file: PathBuf,
    machine_file: Option<PathBuf>,
    value: Option<f64>,
    print_s: Option<f64>,
    volume_mm3: f64,
}

pub(crate) fn run(args: &CalibrateArgs, console: &Console) -> Result<(), CliError> {
    let settings = load::settings(&args.settings)?;
    let given = args.settings.options.given();
    if let Some(option) = OF_OUTLINES.split(", ").find(|name| given.contains(name)) {
        return Err(CliError::Usage(format!(
            "{option} goes with outlines: a pattern is printed unchanged"
        )));
    }
    if let Some(file) = &args.weights {
        if args.pattern.kind() != Some(PatternKind::Flow) {
            return Err(CliError::Usage(
                "--weights goes with the pattern `flow`".to_string(),
            ));
        }
        return flow_curve::run(file, &settings, args, console);
    }
    let asked = Asked {
        length_mm: args.length,
        from: args.from,
        to: args.to,
        lines: args.lines,
        turns: args.turns,
        tilt_deg: args.tilt,
        at_mm: args.at.as_deref().map(load::parse_at).transpose()?,
    };
    let Some(kind) = args.pattern.kind() else {
        return shake(&asked, settings, args, console);
    };
    let drawn = pattern(kind, &asked, &settings).map_err(pattern_error)?;
    let named = PathBuf::from(format!("{}.hwj", drawn.kind.name()));
    let output = args.output.clone().unwrap_or(named.into());
    let mut files = Vec::new();
    for job in &drawn.jobs {
        files.push(Files::of(output.name(), job, console)?);
    }
    let mut written = Vec::new();
    for (job, files) in drawn.jobs.iter().zip(files) {
        written.push(write(job, files, &args.allow, console)?);
    }
    if args.json {
        return console.result(&format!("{:#}\n", as_json(&drawn, &written)));
    }
    console.result(&as_text(&drawn, &written))
}

/// What shakes the machine, which is no run of lines.
fn shake(
    asked: &Asked,
    settings: Settings,
    args: &CalibrateArgs,
    console: &Console,
) -> Result<(), CliError> {
    let (swept, read, change) = resonance(asked, &settings).map_err(pattern_error)?;
    let named = || OutputPath::from(PathBuf::from("resonance.hwj"));
    let output = args.output.clone().unwrap_or_else(named);
    let file = output.file(PATTERN, console)?;
    let packing = JobPacking::new(file.nameless()?);
    let planned = Planned {
        name: "resonance".to_string(),
        transform: PartTransform {
            offset_mm: swept.at_mm,
        },
        stream: swept.stream.clone(),
        // Nothing is printed: nothing is heated.
        settings: Settings {
            material: None,
            ..settings
        },
        ..Planned::default()
    };
    let (_, is_written) = write_job(planned, packing, &args.allow, &file, console)?;
    is_written?;
    let file = file.path().display().to_string();
    if !args.json {
        return console.result(&shaken_text(&swept, &file, &read, change));
    }
    let shaken = swept.shaken.iter().map(|shaken| {
        json!({
            "joint": shaken.joint,
            "begin_s": shaken.begin_s,
            "end_s": shaken.end_s,
            "from_hz": shaken.from_hz,
            "to_hz": shaken.to_hz,
            "rise_hz_s": RISE_HZ_S,
            "amplitude_mm": shaken.amplitude_mm,
        })
    });
    let table = json!({
        "pattern": "resonance",
        "unit": "Hz",
        "at_mm": swept.at_mm,
        "jobs": [{ "file": file }],
        "shaken": shaken.collect::<Vec<Value>>(),
        "read": read,
        "change": change,
    });
    console.result(&format!("{table:#}\n"))
}

fn shaken_text(swept: &Sweep, file: &str, read: &[String], change: &str) -> String {
    let [x, y, z] = swept.at_mm;
    let mut text = format!("resonance: about {x:.2}, {y:.2}, {z:.2} mm on the machine\n");
    text += &format!("{:>6}  {:>10}  {:>10}\n", "Hz", "X at s", "Y at s");
    let (from, to) = swept
        .shaken
        .first()
        .map_or((0.0, 0.0), |shaken| (shaken.from_hz, shaken.to_hz));
    let rows = ((to - from) / TABLE_HZ).floor() as u32;
    for row in 0..=rows {
        let hz = from + TABLE_HZ * f64::from(row);
        let at: Vec<String> = swept
            .seconds_of(hz)
            .iter()
            .map(|at_s| format!("{at_s:>10.1}"))
            .collect();
        text += &format!("{:>6}  {}\n", Short(hz), at.join("  "));
    }
    for shaken in &swept.shaken {
        let (joint, most_mm) = (shaken.joint, shaken.amplitude_mm);
        text += &format!("{joint}: {most_mm:.3} mm to either side at most\n");
    }
    text += &format!("job: {file}\n");
    for sentence in read {
        text += &format!("read: {sentence}\n");
    }
    text + &format!("change: {change}\n")
}

pub(super) fn pattern_error(error: CalibrationError) -> CliError {
    match error {
        CalibrationError::Usage(refused) => CliError::Usage(refused.to_string()),
        CalibrationError::Machine(refused) => CliError::Job(refused.to_string()),
    }
}

/// The name of one of several jobs has its value in it.
fn file_of(output: &Path, job: &PatternJob) -> PathBuf {
    let Some(value) = job.value else {
        return output.to_path_buf();
    };
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    let ending = output.extension().unwrap_or("hwj".as_ref());
    output.with_file_name(format!("{stem}-{value:.4}.{}", ending.to_string_lossy()))
}

/// What is written of a job: its file, and a machine file with its text where it is one of several.
struct Files {
    job: OutputFile,
    machine: Option<(OutputFile, String)>,
}

impl Files {
    fn of(output: &Path, job: &PatternJob, console: &Console) -> Result<Files, CliError> {
        let path = file_of(output, job);
        let beside = path.with_extension("toml");
        let machine = |_| {
            let file = OutputPath::from(beside).file(MACHINE, console)?;
            let text = machine_file::to_toml(&job.settings);
            file.check_kept(text.as_bytes())?;
            Ok((file, text))
        };
        Ok(Files {
            job: OutputPath::from(path).file(PATTERN, console)?,
            machine: job.value.map(machine).transpose()?,
        })
    }
}

fn write(
    job: &PatternJob,
    files: Files,
    allow: &AllowArgs,
    console: &Console,
) -> Result<Written, CliError> {
    let packing = JobPacking::new(files.job.nameless()?);
    let (run, path) = (job.run.clone(), files.job.path());
    let planned = planned::from_run(run, job.settings.clone(), path, console)?;
    let (planned, is_written) = write_job(planned, packing, allow, &files.job, console)?;
    is_written?;
    if let Some((file, text)) = &files.machine {
        file.write(text.as_bytes())?;
    }
    Ok(Written {
        file: files.job.path().to_path_buf(),
        machine_file: files.machine.map(|(file, _)| file.path().to_path_buf()),
        value: job.value,
        print_s: planned.figures.print_s,
        volume_mm3: volume_mm3(&planned.stream),
    })
}

/// Volume deposited by a stream, without primes and retracts.
fn volume_mm3(stream: &SegmentStream) -> f64 {
    let units = stream.displacement()[CHANNEL_VOLUME];
    units as f64 / stream.units.per_natural(CHANNEL_VOLUME)
}

fn as_json(drawn: &Pattern, written: &[Written]) -> Value {
    let jobs = written.iter().map(|job| {
        json!({
            "file": job.file.display().to_string(),
            "machine_file": job.machine_file.as_ref().map(|path| path.display().to_string()),
            "value": job.value,
            "print_s": job.print_s,
            "volume_mm3": job.volume_mm3,
        })
    });
    let lines = drawn.lines.iter().enumerate().map(|(number, line)| {
        let [from_mm, to_mm] = line.ends_mm();
        json!({
            "line": number + 1,
            "job": line.job,
            "what": line.what,
            "value": line.value,
            "from_mm": from_mm,
            "to_mm": to_mm,
            "heading_deg": line.heading_deg(),
        })
    });
    json!({
        "pattern": drawn.kind.name(),
        "unit": drawn.unit,
        "at_mm": drawn.at_mm,
        "jobs": jobs.collect::<Vec<Value>>(),
        "lines": lines.collect::<Vec<Value>>(),
        "read": drawn.reading,
        "change": drawn.change,
    })
}

fn as_text(drawn: &Pattern, written: &[Written]) -> String {
    let [x, y, z] = drawn.at_mm;
    let mut text = format!(
        "{}: its origin is at {x:.2}, {y:.2}, {z:.2} mm on the machine; lines as they are printed\n",
        drawn.kind.name()
    );
    text += &format!(
        "{:>4}  {:>10}  {:>18}  {:>18}  {}\n",
        "line", drawn.unit, "from x, y", "to x, y", "what"
    );
    for (number, line) in drawn.lines.iter().enumerate() {
        text += &line_text(number + 1, line);
    }
    for job in written {
        let seconds = job.print_s.unwrap_or_default();
        let (file, volume_mm3) = (job.file.display(), job.volume_mm3);
        text += &format!("job: {file}, {seconds:.1} s, {volume_mm3:.1} mm³");
        if let Some(path) = &job.machine_file {
            text += &format!(", for {}", path.display());
        }
        text += "\n";
    }
    for sentence in &drawn.reading {
        text += &format!("read: {sentence}\n");
    }
    text + &format!("change: {}\n", drawn.change)
}

fn line_text(number: usize, line: &Line) -> String {
    let value = line.value.map_or("-".to_string(), value_text);
    let place = |[x, y, _]: [f64; 3]| format!("{x:.2}, {y:.2}");
    let [from, to] = line.ends_mm().map(place);
    let what = &line.what;
    format!("{number:>4}  {value:>10}  {from:>18}  {to:>18}  {what}\n")
}

/// Four digits are finer than any pattern is read.
fn value_text(value: f64) -> String {
    Short((value * 1e4).round() / 1e4).to_string()
}
