//! `headway export --to gcode`: a job for another controller, and figures of the exported file.

use crate::cli::args::export::ExportArgs;
use crate::cli::error::CliError;
use crate::cli::plan::missing_heat::{missing_heat, missing_in_text};
use crate::cli::reading::job::Job;
use crate::cli::reading::load;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::OutputFile;
use crate::gcode::FILAMENT_MM;
use crate::gcode::write::controller_time::SlowedBy;
use crate::gcode::write::ends::start_block;
use crate::gcode::write::limits::AxisLimits;
use crate::gcode::write::read_back::check_start;
use crate::gcode::write::{
    JobText, WriteError, WriteOptions, Written, filament_mm2, is_tilting, write_gcode,
};
use crate::job::heat::{BED, HOT_END, HeatEvent, HeatOrder};
use crate::pipeline::pass_facts::PassFacts;
use crate::settings::machine_file::gcode_letters;
use headway_protocol::message::DECIDEGREES_MAX;
use std::path::Path;

/// Accepted tip tolerances, mm.
const TIP_MM: [f64; 2] = [1e-4, 1.0];

/// Writes the job's G-code and reports the demands on a controller.
pub(crate) fn run(
    job: &Job,
    args: &ExportArgs,
    output: Option<&OutputFile>,
    console: &Console,
) -> Result<(), CliError> {
    let options = options(job, args)?;
    if args.json && output.is_none() {
        return Err(CliError::Usage(
            "--json prints the figures on stdout: give the G-code a file with --output".to_string(),
        ));
    }
    if is_tilting(&job.stream)
        && job
            .settings
            .as_ref()
            .is_none_or(|of| of.gcode_letters.is_none())
    {
        return Err(CliError::Job(format!(
            "{}: the head tilts, and X Y Z of the text are its tip: a controller that does not know where the tip is \
             prints it wrongly. Where yours does, plan with a machine file that says so: [gcode] letters = \"A,B,C\"",
            job.name
        )));
    }
    let heat = heat(job, args)?;
    let remedy = "give --hot-end 210 (your material's temperature), or a --start block that heats";
    let text = JobText {
        name: &job.name,
        machine: &job.file.header.machine_name,
        stream: &job.stream,
        servo_hz: job.servo_hz(),
        heat: &heat,
    };
    if args.gcode.print_start || args.gcode.print_end {
        let block = match args.gcode.print_start {
            true => start_block(&text, &options),
            false => options.dialect.end(is_tilting(&job.stream)).to_string(),
        };
        return console.result_to(output, &block);
    }
    let missing =
        || missing_heat(job, &heat, remedy).or_else(|| missing_in_text(job, &heat, remedy));
    if !args.gcode.no_heat
        && args.gcode.start.is_none()
        && let Some(missing) = missing()
    {
        return Err(CliError::Job(missing));
    }
    // What is wrong with the blocks is reported before anything is written.
    let checked = check_start(&text, &options);
    let checked = checked.and_then(|()| write_gcode(std::io::sink(), &text, &options));
    let written = checked.map_err(|error| CliError::Usage(error.to_string()))?;
    console.notes(&notes(&written, &options));
    console.write_to(output, |out| match write_gcode(out, &text, &options) {
        Ok(_) => Ok(()),
        Err(WriteError::Io(error)) => Err(error),
        Err(error) => Err(std::io::Error::other(error)),
    })?;
    match args.json {
        true => console.result_to(None, &format!("{}\n", json(&written, &options))),
        false => Ok(()),
    }
}

/// The job's commands of heaters and fans, with the temperatures that are given in place of its own.
fn heat(job: &Job, args: &ExportArgs) -> Result<Vec<HeatEvent>, CliError> {
    let mut heat = job.file.header.heat();
    let given = [
        ("--hot-end", HOT_END, args.gcode.hot_end),
        ("--bed", BED, args.gcode.bed),
    ];
    for (option, heater, celsius) in given {
        let Some(celsius) = celsius else { continue };
        let most_c = f64::from(DECIDEGREES_MAX) / 10.0;
        if !(0.0..=most_c).contains(&celsius) {
            let wrong = format!("{option} {celsius}: write 0 to {most_c} °C");
            return Err(CliError::Usage(wrong));
        }
        let order = HeatOrder::wait_for(heater, celsius);
        heat.retain(|event| !event.order.is_of_same(&order));
        // The bed first, which takes longer.
        let at = match heater {
            BED => 0,
            _ => heat.iter().take_while(|event| event.tick == 0).count(),
        };
        let event = (celsius > 0.0).then_some(HeatEvent { tick: 0, order });
        heat.splice(at..at, event);
    }
    Ok(heat)
}

/// The figures: lengths of time in seconds.
fn json(written: &Written, options: &WriteOptions) -> serde_json::Value {
    let mut figures = serde_json::json!({
        "dialect": options.dialect.name(),
        "moves": written.moves,
        "arcs": written.arcs,
        "moves_a_second": written.moves_a_second,
        "duration_s": written.duration_s,
        "volume_mm3": written.volume_mm3,
        "controller_time_s": written.controller_time_s,
        "limited_by": written.slowed_by.map(SlowedBy::text),
        "needs": options.dialect.needs(),
    });
    for (name, values) in written.demands.settings(options.dialect) {
        figures[name] = match values.as_slice() {
            [value] => (*value).into(),
            values => values.into(),
        };
    }
    figures
}

fn options(job: &Job, args: &ExportArgs) -> Result<WriteOptions, CliError> {
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
    let of_machine = job.settings.as_ref().and_then(|of| of.gcode_letters);
    let turns = match (&of.letters, of_machine) {
        (Some(text), _) => letters(text)?,
        (None, of_machine) => of_machine.unwrap_or(*b"ABC"),
    };
    let filament_mm = between("--filament-diameter", of.filament_diameter, FILAMENT_MM)?;
    let usual = WriteOptions::of_dialect(dialect);
    let usual = match &job.settings {
        Some(settings) => usual.with_settings(settings),
        None => usual,
    };
    Ok(WriteOptions {
        retraction: of.retraction,
        filament_mm,
        limits: AxisLimits::of_machine(&job.file.header.machine, filament_mm2(filament_mm)),
        turns,
        extruder: of
            .extruder
            .map(|letter| extruder(letter, turns[2]))
            .transpose()?,
        wrapped: of.wrapped,
        tip_mm: between(
            "--line-tolerance",
            of.line_tolerance.unwrap_or(usual.tip_mm),
            TIP_MM,
        )?,
        arcs: of.arcs,
        blocks: [block(of.start.as_deref())?, block(of.end.as_deref())?],
        leave_hot: of.end_heat.leave_hot,
        types: PassFacts::of_job(&job.file.header).slicer_words(&job.stream.marks),
        ..usual
    })
}

/// A letter that no axis has.
fn extruder(letter: char, heading: u8) -> Result<u8, CliError> {
    let letter = letter.to_ascii_uppercase();
    // On a machine that does not tilt the letters of the tilt are free.
    let is_free = "EABCUVWHJ".contains(letter) && letter != char::from(heading);
    u8::try_from(letter).ok().filter(|_| is_free).ok_or_else(|| {
        CliError::Usage(format!(
            "--extruder {letter}: write a letter of E, A, B, C, U, V, W, H, J that is not the heading's"
        ))
    })
}

/// `A,B,C`: three letters that are no other axis.
fn letters(text: &str) -> Result<[u8; 3], CliError> {
    let letters = gcode_letters(text);
    letters.ok_or_else(|| {
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
    let name = options.dialect.name();
    let slowed = written.slowed_by.map_or(String::new(), |by| {
        format!(" (slowed down most by {})", by.text())
    });
    let mut notes = vec![
        format!(
            "{} moves{arcs}, at most {:.0} a second, {:.1} s",
            written.moves, written.moves_a_second, written.duration_s
        ),
        format!(
            "{name} takes about {:.1} s for them{slowed}, if set as the guide has it: {}",
            written.controller_time_s,
            options.dialect.needs()
        ),
    ];
    notes.extend(written.demands.note(options.dialect));
    if written.moves_a_second > most {
        notes.push(format!(
            "more than the {most} moves a second that {} is trusted with: raise --line-tolerance, or lower \
             the speed",
            name
        ));
    }
    notes
}
