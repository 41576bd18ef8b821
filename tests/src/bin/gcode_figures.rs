//! Figures of slicers' files as jobs: `gcode_figures FILE...`, a row of a table for each.
//!
//! In: G-code. Out: how far the stream leaves the file's lines away from corners and in them, how far a vertex is
//! from the stream, the volume against the file's, the job's time against the slicer's estimate. Built-in machine.

use headway::gcode::{GcodeOptions, read};
use headway::pipeline::gcode::plan_gcode;
use headway::settings::Settings;
use headway_tests::centre_line::beside;
use std::path::Path;

fn row(path: &Path) -> Result<String, Box<dyn std::error::Error>> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let program = read(&std::fs::read(path)?, &name, &GcodeOptions::default())?;
    let settings = Settings::default();
    let plan = plan_gcode(&program, None, &settings, &())?;
    let [away, corner, vertex] = beside(&program, &plan).map(|mm| mm * 1e3);
    let asked_mm3 = program.volume_mm3().unwrap_or(f64::NAN);
    let share_pct = 100.0 * (plan.figures.volume_mm3 / asked_mm3 - 1.0);
    let end_tick = plan.stream.marks.last().map_or(0, |mark| mark.end_tick);
    let job_s = end_tick as f64 / f64::from(settings.machine.servo_hz);
    let estimate_s = program.estimate_s.unwrap_or(f64::NAN);
    Ok(format!(
        "| {name} | {} | {} | {away:.1} | {corner:.1} | {vertex:.1} | {share_pct:.4} | {job_s:.0} | {estimate_s:.0} | {:.2} |",
        program.layers(),
        program.passes.len(),
        job_s / estimate_s
    ))
}

fn main() {
    println!(
        "| file | layers | passes | away from corners µm | in corners µm | vertices µm | volume % | job s | slicer s | ratio |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for path in std::env::args_os().skip(1) {
        match row(Path::new(&path)) {
            Ok(row) => println!("{row}"),
            Err(error) => println!("| {} | {error} |", Path::new(&path).display()),
        }
    }
}
