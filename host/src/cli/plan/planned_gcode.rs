//! A slicer's G-code -> its job, and notes for the user.

use crate::cli::error::CliError;
use crate::cli::plan::planned::plan_error;
use crate::cli::terminal::console::Console;
use crate::gcode::GcodeProgram;
use crate::pipeline::gcode::plan_gcode;
use crate::pipeline::planned::Planned;
use crate::settings::Settings;
use std::path::Path;
use std::time::Instant;

/// Plans a file's passes; `speed_mm_s` bounds its speeds.
pub(crate) fn from_gcode(
    path: &Path,
    program: GcodeProgram,
    speed_mm_s: Option<f64>,
    settings: Settings,
    console: &Console,
) -> Result<Planned, CliError> {
    let (bar, begun) = (console.planning(), Instant::now());
    let planned = plan_gcode(&program, speed_mm_s, &settings, &bar);
    let plan_s = begun.elapsed().as_secs_f64();
    bar.clear();
    let planned = planned.map_err(|error| plan_error(path, &error))?;
    let read = program.notes.len();
    let planned = Planned::of_gcode(program, planned, plan_s, &settings);
    console.notes(&planned.notes[read..]);
    Ok(planned)
}
