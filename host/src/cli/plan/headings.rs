//! `headway headings`: the table of headings at the boundary.

use crate::cli::args::HeadingsArgs;
use crate::cli::error::CliError;
use crate::cli::reading::load;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::result_kind::TABLE;
use crate::plan::headings::headings_table::{
    HeadingRow, HeadingsRequest, headings_table, write_csv,
};
use serde_json::json;

/// Most rows: 3 µs and 100 bytes each still end within a minute.
const ROWS_MAX: f64 = 5e6;

pub(crate) fn run(args: &HeadingsArgs, console: &Console) -> Result<(), CliError> {
    if !(args.spacing.is_finite() && args.spacing > 0.0) {
        return Err(CliError::Usage(format!(
            "--spacing {}: must be a length in mm greater than 0",
            args.spacing
        )));
    }
    let output = args.output.as_ref();
    let output = output.map(|output| output.file(TABLE, console));
    let output = output.transpose()?;
    let settings = load::settings(&args.settings)?;
    let loaded = load::target(&args.input, &args.reading, &settings, console)?;
    let regions = &loaded.target.regions;
    let boundary_mm: f64 = regions
        .iter()
        .flat_map(|region| region.rings())
        .map(|ring| ring.perimeter_mm())
        .sum();
    if boundary_mm / args.spacing > ROWS_MAX {
        return Err(CliError::Usage(format!(
            "--spacing {}: {boundary_mm:.0} mm of boundary make more than {ROWS_MAX:.0} rows; give \
             a larger one",
            args.spacing
        )));
    }
    let request = HeadingsRequest {
        aperture: settings.aperture,
        spacing_mm: args.spacing,
        pass: settings.pass_mode,
        law: settings.heading_law,
    };
    let bar = console.stage("headings");
    let rows: Vec<HeadingRow> = regions
        .iter()
        .flat_map(|region| headings_table(region, &request))
        .collect();
    bar.finish_and_clear();
    let mut table = Vec::new();
    let text = write_csv(&mut table, &rows)
        .map_err(|problem| problem.to_string())
        .and_then(|()| String::from_utf8(table).map_err(|error| error.to_string()))
        .map_err(CliError::Job)?;
    let reachable = rows.iter().filter(|row| row.reached.is_some()).count();
    let summary = format!(
        "{}: {} samples on {boundary_mm:.3} mm of boundary, {reachable} reachable",
        loaded.target.name,
        rows.len()
    );
    if args.json {
        if let Some(output) = &output {
            output.write(text.as_bytes())?;
        }
        let object = json!({
            "name": loaded.target.name,
            "samples": rows.len(),
            "reachable": reachable,
            "boundary_mm": boundary_mm,
            "notes": loaded.notes,
        });
        return console.result(&format!("{object:#}\n"));
    }
    console.say(&summary);
    console.result_to(output.as_ref(), &text)
}
