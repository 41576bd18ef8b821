//! `headway measure`: a scan of a printed layer -> what of the machine file is wrong.
//!
//! In: a scan, the job that was printed. Out: a table of values with their errors, keys that change, places with gaps and
//! bulges; with `--write` a machine file with the keys. Leaves out how it is measured (`scan/`).

use crate::api::Job;
use crate::cli::args::measure::MeasureArgs;
use crate::cli::error::CliError;
use crate::cli::reading::{job, load, machine_keys};
use crate::cli::terminal::console::Console;
use crate::cli::terminal::result_kind::PICTURE;
use crate::report::scan_picture::{self, ScannedPiece};
use crate::scan::{Measured, MeasuredStation};
use crate::text::short_number::Short;
use std::fmt::Write;

/// Places that are printed.
const PLACES: usize = 5;

pub(crate) fn run(args: &MeasureArgs, console: &Console) -> Result<(), CliError> {
    let place = |problem: String| CliError::Job(format!("{}: {problem}", args.job.display()));
    if !job::is_job(&args.job) {
        return Err(CliError::Usage(format!(
            "--job {}: name a job file (.hwj), the one that was printed",
            args.job.display()
        )));
    }
    let output = args.output.as_ref();
    let output = output
        .map(|output| output.file(PICTURE, console))
        .transpose()?;
    let job = Job::from_bytes(load::read_file(&args.job)?);
    let job = job.map_err(|error| place(error.to_string()))?;
    let measured = job.measure(
        job::open(&args.scan)?,
        &args.scale(),
        args.layer.map(|layer| layer - 1),
    );
    let measured =
        measured.map_err(|error| CliError::Job(format!("{}: {error}", args.scan.display())))?;
    if let Some(output) = &output {
        output.write(drawn(&measured, &args.scan.display().to_string()).as_bytes())?;
    }
    let keys = measured.changes.iter();
    let keys = keys.map(|change| (change.group, change.key, Short(change.new).to_string()));
    let keys: Vec<machine_keys::Key> = keys.collect();
    let write = args.write.as_deref().filter(|_| !keys.is_empty());
    let kept = write
        .map(|path| machine_keys::put(path, &keys))
        .transpose()?;
    if args.json {
        let text = serde_json::to_string_pretty(&measured).unwrap_or_default();
        return console.result(&(text + "\n"));
    }
    let mut text = as_text(&measured);
    if let (Some(path), Some(kept)) = (write, kept) {
        text += &format!(
            "{}: written, the file before it is {}\n",
            path.display(),
            kept.display()
        );
    }
    console.result(&text)
}

/// The layer; edges that touch other beads are not seen, and lie where they were asked for.
fn drawn(measured: &Measured, title: &str) -> String {
    let piece = |station: &MeasuredStation| ScannedPiece {
        at_mm: station.at_mm,
        along: station.along,
        length_mm: station.length_mm,
        widths_mm: station
            .edges_mm
            .map(|off| 0.5 * station.width_mm + off.unwrap_or(0.0)),
        off: match station.volume_mm3 {
            [Some(asked), Some(found)] if asked > 0.0 => Some(found / asked - 1.0),
            _ => None,
        },
    };
    let pieces: Vec<ScannedPiece> = measured.stations.iter().map(piece).collect();
    let places: Vec<[f64; 2]> = measured.places.iter().map(|place| place.at_mm).collect();
    scan_picture::draw(title, &pieces, &places)
}

fn as_text(measured: &Measured) -> String {
    let fit = &measured.registration;
    let mut text = format!(
        "{} points, turned by {:.2} degrees, bed tilted by {:.2} degrees, noise {:.3} mm, {:.0} % of the layer seen\n",
        measured.points, fit.turn_deg, fit.tilt_deg, fit.noise_mm, fit.seen_pct
    );
    if !fit.other_turns_deg.is_empty() {
        let turns: Vec<String> = fit
            .other_turns_deg
            .iter()
            .map(|deg| format!("{deg:.0}"))
            .collect();
        let turns = turns.join(", ");
        let _ = writeln!(
            text,
            "the outline fits as well turned by {turns} degrees: the least turn is taken"
        );
    }
    let _ = writeln!(text, "{:<18}{:>10}  {:>8}", "value", "found", "+-");
    for estimate in &measured.estimates {
        let _ = match estimate.value {
            Some(value) => writeln!(
                text,
                "{:<18}{value:>10.4}  {:>8.4}",
                estimate.name, estimate.error
            ),
            None => writeln!(
                text,
                "{:<18}{:>10}  not told: needs {}",
                estimate.name, "-", estimate.needs
            ),
        };
    }
    for place in measured.places.iter().take(PLACES) {
        let what = if place.volume_mm3 > 0.0 {
            "bulge"
        } else {
            "gap"
        };
        let [x, y] = place.at_mm;
        let _ = writeln!(
            text,
            "{what} at ({x:.2}, {y:.2}), pass {}: {:+.3} mm³ over {:.2} mm",
            place.pass, place.volume_mm3, place.length_mm
        );
    }
    for change in &measured.changes {
        let [old, new] = [change.old, change.new].map(Short);
        let _ = writeln!(
            text,
            "change: [{}] {} = {new} (was {old})",
            change.group, change.key
        );
    }
    if measured.changes.is_empty() {
        text += "no key changes: nothing is off by more than twice its error\n";
    }
    text
}
