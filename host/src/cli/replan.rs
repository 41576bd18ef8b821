//! `headway replan`: a slicer's file -> the same file, the regions that its beads fill planned anew.
//!
//! In: G-code of a slicer. Out: G-code with the file's blocks and lines, or a job, and what was done in one line. Times before
//! and after are those of one model of the controller's planner under the same limits.

use crate::cli::args::replan::ReplanArgs;
use crate::cli::error::CliError;
use crate::cli::plan::{verdict, write_job};
use crate::cli::reading::{job, load};
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::OutputFile;
use crate::cli::terminal::result_kind::{GCODE, JOB};
use crate::gcode::around::{Around, around};
use crate::gcode::flavour::{Flavour, declared};
use crate::gcode::write::dialect::Dialect;
use crate::gcode::write::file_time::file_time_s;
use crate::gcode::write::limits::AxisLimits;
use crate::gcode::write::read_back::check_start;
use crate::gcode::write::{JobText, WriteError, WriteOptions, filament_mm2, write_gcode};
use crate::gcode::{GCODE_BYTES_MAX, GcodeOptions, GcodeProgram, read};
use crate::pipeline::packing::JobPacking;
use crate::pipeline::planned::Planned;
use crate::pipeline::replan::{Replanned, replan};
use crate::report::verdict::duration;
use crate::settings::Settings;
use crate::text::refusal::Refusal;
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// Where slicers tell a post-processing script what the file will be called.
const OUTPUT_NAME: &str = "SLIC3R_PP_OUTPUT_NAME";
/// Speed of what the start block's retract is made up for by, mm/min.
const PUSH_MM_MIN: u32 = 1800;

/// Parts of notes on what a job does without, and the text of the file has.
const OF_A_JOB: [&str; 3] = [
    "not done: ",
    "the moves behind the last bead",
    "the file's end leaves on",
];

/// A file, and what is around its beads.
struct Sliced {
    program: GcodeProgram,
    around: Around,
    dialect: Dialect,
    limits: AxisLimits,
    filament_mm: f64,
    estimate_s: Option<f64>,
    print_s: f64,
}

pub(crate) fn run(args: &ReplanArgs, console: &Console) -> Result<(), CliError> {
    let is_job = |path: &Path| path.extension().is_some_and(|ending| ending == "hwj");
    let output = match &args.output {
        Some(output) if is_job(output.name()) => output.file(JOB, console)?,
        Some(output) => output.file(GCODE, console)?,
        None => OutputFile::in_place(&args.input)?,
    };
    let named = |problem: String| CliError::Job(format!("{}: {problem}", args.input.display()));
    let mut settings = load::settings(&args.settings)?;
    // The file's places are the printer's.
    settings.at_mm = settings.at_mm.or(Some([0.0; 3]));
    let mut file = Sliced::read(args, is_job(output.path()), &settings)?;
    let program = std::mem::take(&mut file.program);
    let (begun, read) = (Instant::now(), program.notes.len());
    console.notes(&program.notes);
    let bar = console.planning();
    let made = replan(program, args.settings.options.speed_mm_s, &settings, &bar);
    bar.clear();
    let (program, plan, report) = made.map_err(|error| named(error.to_string()))?;
    let (lines, left) = file.around.between(&plan.lines);
    let plan_s = begun.elapsed().as_secs_f64();
    let planned = Planned::of_gcode(program, plan, plan_s, &settings);
    console.notes(&of_file(&planned.notes[read..]));
    if left > 0 {
        console.notes(&[format!(
            "{left} lines between the beads set limits of the axes, progress or moves, which the job has of its own: left out"
        )]);
    }
    let options = file.options(&planned, lines);
    let text = text_of(&planned);
    let written = check_start(&text, &options)
        .and_then(|()| write_gcode(std::io::sink(), &text, &options))
        .map_err(|error| named(error.to_string()))?;
    let after_s = written.controller_time_s;
    match is_job(output.path()) {
        true => {
            let packing = JobPacking::new(output.nameless()?);
            write_job(planned, packing, &args.allow, &output, console)?.1?;
        }
        false => write_text(planned, &options, args, &output, console)?,
    }
    match args.json {
        true => console.result(&format!("{:#}\n", figures(&report, &file, after_s))),
        false => console.result(&line(&report, &file, after_s)),
    }
}

/// Notes without those that hold for a job alone.
fn of_file(notes: &[String]) -> Vec<String> {
    let notes = notes.iter();
    let own = notes.filter(|note| !OF_A_JOB.iter().any(|of| note.contains(of)));
    own.cloned().collect()
}

/// The controller that a file is written for.
fn dialect_of(flavour: Flavour) -> Dialect {
    match flavour {
        Flavour::Klipper => Dialect::Klipper,
        Flavour::RepRapFirmware => Dialect::RepRapFirmware,
        Flavour::MachineTool => Dialect::LinuxCnc,
        Flavour::Marlin | Flavour::Prusa | Flavour::Unknown => Dialect::Marlin,
    }
}

fn text_of(planned: &Planned) -> JobText<'_> {
    JobText {
        name: &planned.name,
        machine: &planned.settings.machine_name,
        stream: &planned.stream,
        servo_hz: f64::from(planned.settings.machine.servo_hz),
        heat: &planned.heat,
    }
}

impl Sliced {
    /// The file; a job has its beads and temperatures before the first layer too.
    fn read(args: &ReplanArgs, is_job: bool, settings: &Settings) -> Result<Sliced, CliError> {
        let named = |error: Refusal| CliError::Job(format!("{}: {error}", args.input.display()));
        let bytes = load::read_bounded(&args.input, GCODE_BYTES_MAX)?;
        let name = std::env::var(OUTPUT_NAME).ok().filter(|_| args.in_place);
        let name = job::stem(name.as_deref().map_or(args.input.as_path(), Path::new));
        let mut program = read(&bytes, &name, &GcodeOptions::default()).map_err(named)?;
        let text = String::from_utf8_lossy(&bytes);
        let around = match is_job {
            true => around(&text, &mut program.clone()).map_err(named)?,
            false => {
                program.notes = of_file(&program.notes);
                around(&text, &mut program).map_err(named)?
            }
        };
        let dialect = args.dialect.unwrap_or(dialect_of(declared(&text).flavour));
        let filament_mm = program.filament_mm;
        let area_mm2 = filament_mm2(filament_mm);
        let limits = AxisLimits::of_machine(&settings.machine, area_mm2);
        let push_mm3_s = settings.prime_retract.retract_rate_mm3_s;
        Ok(Sliced {
            print_s: file_time_s(&program.passes, dialect, limits, area_mm2, push_mm3_s),
            estimate_s: program.estimate_s,
            program,
            around,
            dialect,
            limits,
            filament_mm,
        })
    }

    /// How the job is written: with the file's blocks, behind which as much is retracted as the job primes first.
    fn options(&self, planned: &Planned, lines: Vec<(u64, String)>) -> WriteOptions {
        let dialect = self.dialect;
        let settings = &planned.settings;
        let [mut start, end] = self.around.blocks.clone();
        let primed_mm = settings.prime_retract.prime_mm3 / filament_mm2(self.filament_mm);
        let missing_mm = primed_mm - self.around.retracted_mm;
        if !dialect.is_machine_tool() && missing_mm.abs() > 1e-4 {
            start += &format!("M83\nG1 E{:.4} F{PUSH_MM_MIN}\n", -missing_mm);
        }
        WriteOptions {
            filament_mm: self.filament_mm,
            turns: settings.gcode_letters.unwrap_or(*b"ABC"),
            limits: self.limits,
            blocks: [Some(start), Some(end)],
            // The end block says what goes off.
            leave_hot: true,
            lines,
            types: planned.pass_facts.slicer_words(&planned.stream.marks),
            ..WriteOptions::of_dialect(dialect).with_settings(settings)
        }
    }
}

/// Checks the finished motion and writes the text.
fn write_text(
    mut planned: Planned,
    options: &WriteOptions,
    args: &ReplanArgs,
    output: &OutputFile,
    console: &Console,
) -> Result<(), CliError> {
    let bar = console.stage("checking");
    let packed = JobPacking::new(output.nameless()?).finish_plan(&mut planned);
    bar.finish_and_clear();
    packed.map_err(|error| CliError::Job(error.to_string()))?;
    verdict::check(&planned.objections, &args.allow, "the file is not written")?;
    console.write_to(Some(output), |out| {
        match write_gcode(out, &text_of(&planned), options) {
            Ok(_) => Ok(()),
            Err(WriteError::Io(error)) => Err(error),
            Err(error) => Err(std::io::Error::other(error)),
        }
    })
}

/// What was done, in one line.
fn line(report: &Replanned, file: &Sliced, after_s: f64) -> String {
    let features: std::collections::BTreeSet<&str> =
        report.kept_mm.keys().map(|(feature, _)| *feature).collect();
    let kept = match features.len() {
        0 => String::new(),
        1 => ", 1 feature kept".to_string(),
        count => format!(", {count} features kept"),
    };
    format!(
        "{} -> {}, {:.0} % planned anew{kept}\n",
        duration(file.print_s),
        duration(after_s),
        report.anew_pct()
    )
}

fn figures(report: &Replanned, file: &Sliced, after_s: f64) -> serde_json::Value {
    let kept = report.kept_mm.iter();
    let kept = kept.map(|((feature, why), mm)| json!({"feature": feature, "mm": mm, "why": why}));
    json!({
        "print_s_before": file.print_s,
        "print_s_after": after_s,
        "slicer_estimate_s": file.estimate_s,
        "replanned_pct": report.anew_pct(),
        "volume_ratio": report.laid_mm3 / report.volume_mm3.max(1e-9),
        "covered_pct": report.swept.covered_pct(),
        "covered_pct_before": 100.0 * report.covered_before_mm2 / report.swept.area_mm2.max(1e-9),
        "outside_depth_mm": report.swept.outside_depth_mm,
        "slowed_layers": report.slowed_layers,
        "kept": kept.collect::<Vec<_>>(),
    })
}
