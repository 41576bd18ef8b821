//! Printed patterns from which the values of a machine file are read.
//!
//! ```text
//! name, options, Settings --pattern--> Pattern: lines with the values they stand for, how to read them
//!                                        '--> runs of waypoints, planned as any other
//! ```
//! Each pattern prints lines of which one fits, or two marks at a known distance, so that a value can be read by
//! eye or with a ruler. Lengths are in mm, angles in degrees, in pattern coordinates, whose origin is
//! [`Pattern::at_mm`]. Not covered: files, and values that no line shows (homing, temperatures).

mod error;
mod flow_curve;
mod line;
mod patterns;
mod ringing;
mod sweep;
mod verniers;

pub use error::CalibrationError;
pub use flow_curve::{CurvePoint, FlowFit, Weight, fitted};
pub use line::Line;
pub use sweep::{RISE_HZ_S, Shaken, Sweep};

use crate::input::waypoints::WaypointRun;
use crate::settings::Settings;
use error::{machine, usage};

/// Most lines that step a value: more cannot be distinguished on a bed.
const LINES_MAX: u32 = 41;

/// The value to find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PatternKind {
    /// Steps of X, Y, Z and the extruder.
    Steps,
    /// Where the heading is zero, and the steps of its joint.
    Heading,
    /// How far the nozzle is off the axis that it turns about.
    Nozzle,
    /// Length from the tip to where the axes of a tilting head cross.
    Pivot,
    /// Share of the flow that does not arrive, by rate.
    Flow,
    /// Pressure advance.
    Advance,
    /// Volume of the prime before a pass.
    Prime,
    /// Volume of the retract after a pass.
    Retract,
    /// Frequency and damping of the frame.
    Ringing,
}

impl PatternKind {
    /// As the command calls it.
    pub fn name(self) -> &'static str {
        match self {
            PatternKind::Steps => "steps",
            PatternKind::Heading => "heading",
            PatternKind::Nozzle => "nozzle",
            PatternKind::Pivot => "pivot",
            PatternKind::Flow => "flow",
            PatternKind::Advance => "advance",
            PatternKind::Prime => "prime",
            PatternKind::Retract => "retract",
            PatternKind::Ringing => "ringing",
        }
    }
}

/// Options of a pattern; `None` is its default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Asked {
    /// Length of the lines, or between marks, mm.
    pub length_mm: Option<f64>,
    /// First of the stepped values, in the pattern's unit.
    pub from: Option<f64>,
    /// Last of them.
    pub to: Option<f64>,
    /// How many.
    pub lines: Option<u32>,
    /// Turns of the nozzle before the second fan of headings.
    pub turns: Option<u32>,
    /// Tilt of the pivot's lines, degrees.
    pub tilt_deg: Option<f64>,
    /// Machine coordinates of the pattern's origin; `None` centres it over the work area.
    pub at_mm: Option<[f64; 3]>,
}

/// A pattern: its lines, and how it is read.
#[derive(Clone, Debug)]
pub struct Pattern {
    /// Which.
    pub kind: PatternKind,
    /// Unit of the values.
    pub unit: &'static str,
    /// Machine coordinates of its origin, mm.
    pub at_mm: [f64; 3],
    /// The lines, as they are printed.
    pub lines: Vec<Line>,
    /// The jobs, in order; several if the machine differs between them.
    pub jobs: Vec<PatternJob>,
    /// How it is read, a sentence or two each.
    pub reading: Vec<String>,
    /// What to change then.
    pub change: String,
}

/// One of a pattern's jobs.
#[derive(Clone, Debug)]
pub struct PatternJob {
    /// The value of its machine; `None` if the machine is the given one.
    pub value: Option<f64>,
    /// Its lines.
    pub run: WaypointRun,
    /// Its machine.
    pub settings: Settings,
}

/// Lines and words of a pattern, before it has a place.
struct Drawn {
    unit: &'static str,
    lines: Vec<Line>,
    /// Machines of the jobs by the value they have; empty where it is the one given.
    machines: Vec<(f64, Settings)>,
    reading: Vec<String>,
    change: String,
}

/// Draws a pattern for a machine.
///
/// # Errors
/// [`CalibrationError`]: an option that makes no sense, or a machine for which the pattern has no
/// meaning.
pub fn pattern(
    kind: PatternKind,
    asked: &Asked,
    settings: &Settings,
) -> Result<Pattern, CalibrationError> {
    check_asked(kind, asked)?;
    let drawn = match kind {
        PatternKind::Steps => patterns::steps(asked, settings),
        PatternKind::Heading => patterns::heading(asked, settings),
        PatternKind::Nozzle => verniers::nozzle(asked, settings),
        PatternKind::Pivot => verniers::pivot(asked, settings),
        PatternKind::Flow => flow_curve::slugs(asked, settings),
        PatternKind::Advance => patterns::advance(asked, settings),
        PatternKind::Prime => patterns::prime(asked, settings),
        PatternKind::Retract => patterns::retract(asked, settings),
        PatternKind::Ringing => ringing::ringing(asked, settings),
    }?;
    let at_mm = match asked.at_mm {
        Some(at_mm) => at_mm,
        None => centred_mm(&drawn.lines, settings)?,
    };
    let machines = match drawn.machines.is_empty() {
        true => vec![(None, settings.clone())],
        false => {
            let machines = drawn.machines.into_iter();
            machines.map(|(value, own)| (Some(value), own)).collect()
        }
    };
    let jobs = machines.into_iter().enumerate();
    let jobs = jobs.map(|(number, (value, own))| {
        let lines = drawn.lines.iter().filter(|line| line.job == number);
        PatternJob {
            value,
            run: line::run_of(kind.name(), lines),
            settings: Settings {
                at_mm: Some(at_mm),
                ..own
            },
        }
    });
    Ok(Pattern {
        kind,
        unit: drawn.unit,
        at_mm,
        jobs: jobs.collect(),
        lines: drawn.lines,
        reading: drawn.reading,
        change: drawn.change,
    })
}

/// The motion that shakes X, then Y, from `from` to `to` Hz, and how it is read.
///
/// # Errors
/// As [`pattern`].
pub fn resonance(
    asked: &Asked,
    settings: &Settings,
) -> Result<(Sweep, Vec<String>, &'static str), CalibrationError> {
    let others = [
        ("--length", asked.length_mm.is_some()),
        ("--lines", asked.lines.is_some()),
        ("--turns", asked.turns.is_some()),
        ("--tilt", asked.tilt_deg.is_some()),
    ];
    if let Some((option, _)) = others.into_iter().find(|(_, given)| *given) {
        return Err(other_pattern(option, "resonance"));
    }
    let swept = sweep::sweep([asked.from, asked.to], asked.at_mm, settings)?;
    let mut reading = vec![
        "Nothing is laid: it may run cold. Fix an accelerometer to the head (or look and listen): the table tells which \
         frequency is when. Where the head, for X, or what Y moves shakes most is the frequency."
            .to_string(),
        "Of a spectrum take the highest peak; damping = (width of the peak at 0.71 of its height) / (2 times its \
         frequency)."
            .to_string(),
    ];
    reading.extend(ringing::shaped_note(settings));
    Ok((swept, reading, ringing::CHANGE))
}

fn other_pattern(option: &str, pattern: &str) -> CalibrationError {
    usage!("{option} does not go with the pattern `{pattern}`: it has nothing of that kind")
}

/// Options that are numbers, and go with the pattern.
fn check_asked(kind: PatternKind, asked: &Asked) -> Result<(), CalibrationError> {
    let steps_values = !matches!(kind, PatternKind::Steps | PatternKind::Ringing);
    let given = [
        ("--from", asked.from.is_some(), steps_values),
        ("--to", asked.to.is_some(), steps_values),
        ("--lines", asked.lines.is_some(), steps_values),
        (
            "--turns",
            asked.turns.is_some(),
            kind == PatternKind::Heading,
        ),
        (
            "--tilt",
            asked.tilt_deg.is_some(),
            kind == PatternKind::Pivot,
        ),
    ];
    if let Some((option, ..)) = given.iter().find(|(_, given, goes)| *given && !goes) {
        return Err(other_pattern(option, kind.name()));
    }
    if let Some(lines) = asked.lines.filter(|lines| !(3..=LINES_MAX).contains(lines)) {
        return Err(usage!(
            "--lines {lines}: write a number from 3 to {LINES_MAX}"
        ));
    }
    let in_range = |option, value: Option<f64>, low: f64, high: f64| match value {
        Some(value) if !(low..=high).contains(&value) => Err(usage!(
            "{option} {value}: write a number from {low} to {high}"
        )),
        _ => Ok(()),
    };
    in_range("--length", asked.length_mm, 5.0, 2000.0)?;
    in_range("--turns", asked.turns.map(f64::from), 0.0, 100.0)?;
    in_range("--tilt", asked.tilt_deg, 2.0, 45.0)
}

/// The origin with which the lines' box is in the middle of the work area, on the bed.
fn centred_mm(lines: &[Line], settings: &Settings) -> Result<[f64; 3], CalibrationError> {
    let points = || lines.iter().flat_map(|line| &line.points);
    let [low, high] = settings.work_area_mm;
    let mut at_mm = [0.0, 0.0, low[2]];
    let mut sizes_mm = [0.0; 2];
    for axis in 0..2 {
        let places = points().map(|point| point.tip_mm[axis]);
        let (least, most) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), at| {
            (f64::min(least, at), f64::max(most, at))
        });
        sizes_mm[axis] = most - least;
        at_mm[axis] = 0.5 * (low[axis] + high[axis] - least - most);
    }
    let area_mm = [high[0] - low[0], high[1] - low[1]];
    if sizes_mm[0] > area_mm[0] || sizes_mm[1] > area_mm[1] {
        return Err(machine!(
            "the pattern is {:.0} x {:.0} mm, the work area {} x {} mm: lay shorter lines (--length) or fewer (--lines)",
            sizes_mm[0],
            sizes_mm[1],
            area_mm[0],
            area_mm[1]
        ));
    }
    Ok(at_mm)
}

/// The stepped values: the requested ones, or `from` to `to` in `lines` steps, within a range.
fn values(
    asked: &Asked,
    [from, to]: [f64; 2],
    lines: u32,
    [low, high]: [f64; 2],
) -> Result<Vec<f64>, CalibrationError> {
    let (from, to) = (asked.from.unwrap_or(from), asked.to.unwrap_or(to));
    if !(from < to && from >= low && to <= high) {
        return Err(usage!(
            "values from {from} to {to}: write --from below --to, both from {low} to {high}"
        ));
    }
    let lines = asked.lines.unwrap_or(lines);
    let step = (to - from) / f64::from(lines - 1);
    Ok((0..lines).map(|k| from + step * f64::from(k)).collect())
}

/// A number brought to one digit: steps that a person reads.
fn one_digit(number: f64) -> f64 {
    let unit = 10f64.powf(number.log10().floor());
    (number / unit).round() * unit
}

#[cfg(test)]
mod tests;
