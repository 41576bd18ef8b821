//! `headway export --to gcode`: a job for another controller.

use super::CliError;
use super::args_export::{ArcsName, DialectName, ExportArgs, RetractionName};
use super::console::Console;
use super::job::Job;
use super::load;
use super::missing_heat::missing_heat;
use crate::gcode::FILAMENT_MM;
use crate::gcode::write::dialect::{Dialect, Retraction};
use crate::gcode::write::{
    JobText, TIP_TOLERANCE_MM, WriteError, WriteOptions, Written, write_gcode,
};
use std::path::Path;

/// Tip tolerances that are taken, mm.
const TIP_MM: [f64; 2] = [1e-4, 1.0];

/// Writes the job's G-code and says what a controller has to keep up with.
pub(super) fn run(job: &Job, args: &ExportArgs, console: &Console) -> Result<(), CliError> {
    let options = options(args)?;
    let heat = job.file.header.heat();
    if !args.gcode.no_heat
        && args.gcode.start.is_none()
        && let Some(missing) = missing_heat(job, &heat, "give a --start block that heats")
    {
        return Err(CliError::Job(missing));
    }
    let text = JobText {
        name: &job.name,
        machine: &job.file.header.machine_name,
        stream: &job.stream,
        servo_hz: job.servo_hz(),
        heat: &heat,
    };
    // What the blocks lack is said before anything is written.
    let checked = write_gcode(std::io::sink(), &text, &options);
    let written = checked.map_err(|error| CliError::Usage(error.to_string()))?;
    console.notes(&notes(&written, &options));
    console.write_to(args.output.as_deref(), |out| {
        match write_gcode(out, &text, &options) {
            Ok(_) => Ok(()),
            Err(WriteError::Io(error)) => Err(error),
            Err(error) => Err(std::io::Error::other(error)),
        }
    })
}

fn options(args: &ExportArgs) -> Result<WriteOptions, CliError> {
    let Some(dialect) = args.gcode.dialect else {
        return Err(CliError::Usage(
            "--to gcode needs --dialect klipper|reprapfirmware|linuxcnc|grblhal|marlin".to_string(),
        ));
    };
    let of = &args.gcode;
    let between =
        |option: &str, value: f64, [least, most]: [f64; 2]| match (least..=most).contains(&value) {
            true => Ok(value),
            false => Err(CliError::Usage(format!(
                "{option} {value}: write {least} to {most} mm"
            ))),
        };
    let block = |path: Option<&Path>| path.map(load::read_text).transpose();
    Ok(WriteOptions {
        dialect: match dialect {
            DialectName::Klipper => Dialect::Klipper,
            DialectName::Reprapfirmware => Dialect::RepRapFirmware,
            DialectName::Linuxcnc => Dialect::LinuxCnc,
            DialectName::Grblhal => Dialect::GrblHal,
            DialectName::Marlin => Dialect::Marlin,
        },
        retraction: of.retraction.map(|retraction| match retraction {
            RetractionName::Firmware => Retraction::Firmware,
            RetractionName::Source => Retraction::Source,
            RetractionName::Extruder => Retraction::Extruder,
        }),
        filament_mm: between("--filament-diameter", of.filament_diameter, FILAMENT_MM)?,
        turns: letters(&of.letters)?,
        extruder: of
            .extruder
            .map(|letter| extruder(letter, &of.letters))
            .transpose()?,
        wrapped: of.wrapped,
        tip_mm: between(
            "--line-tolerance",
            of.line_tolerance.unwrap_or(TIP_TOLERANCE_MM),
            TIP_MM,
        )?,
        arcs: of.arcs.map(|arcs| arcs == ArcsName::On),
        blocks: [block(of.start.as_deref())?, block(of.end.as_deref())?],
    })
}

/// A letter that no axis has.
fn extruder(letter: char, axes: &str) -> Result<u8, CliError> {
    let letter = letter.to_ascii_uppercase();
    // On a machine that does not tilt the letters of the tilt are free.
    let heading = axes.split(',').nth(2).unwrap_or_default().trim();
    let is_free =
        "EABCUVWHJ".contains(letter) && !heading.eq_ignore_ascii_case(&letter.to_string());
    u8::try_from(letter).ok().filter(|_| is_free).ok_or_else(|| {
        CliError::Usage(format!(
            "--extruder {letter}: write a letter of E, A, B, C, U, V, W, H, J that is not the heading's"
        ))
    })
}

/// `A,B,C`: three letters that are no other axis.
fn letters(text: &str) -> Result<[u8; 3], CliError> {
    let bytes: Vec<u8> = text
        .split(',')
        .filter_map(|part| part.trim().bytes().next())
        .collect();
    let is_letter = |letter: &u8| b"ABCUVWHJ".contains(&letter.to_ascii_uppercase());
    let letters = <[u8; 3]>::try_from(bytes)
        .ok()
        .filter(|l| l.iter().all(is_letter));
    let letters = letters.map(|l| l.map(|letter| letter.to_ascii_uppercase()));
    letters.filter(|[a, b, c]| a != b && b != c && a != c).ok_or_else(|| {
        CliError::Usage(format!(
            "--letters {text}: write three different letters of A, B, C, U, V, W, H, J for the tilt about X, \
             about Y and the heading, as in --letters A,B,C"
        ))
    })
}

fn notes(written: &Written, options: &WriteOptions) -> Vec<String> {
    let most = options.dialect.moves_a_second_max();
    let arcs = match written.arcs {
        0 => String::new(),
        arcs => format!(" ({arcs} arcs)"),
    };
    let mut notes = vec![format!(
        "{} moves{arcs}, at most {:.0} a second, {:.1} s",
        written.moves, written.moves_a_second, written.duration_s
    )];
    if written.moves_a_second > most {
        notes.push(format!(
            "more than the {most} moves a second that {} is trusted with: raise --line-tolerance, or lower \
             the speed",
            options.dialect.name()
        ));
    }
    notes
}
