//! The options of `headway calibrate`, with their help.

use crate::calibration::PatternKind;
use crate::cli::args::SettingsArgs;
use crate::cli::args::allow::AllowArgs;
use crate::cli::args::output_path::OutputPath;
use clap::{Args, ValueEnum, ValueHint};
use std::path::PathBuf;

/// `headway calibrate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway calibrate steps -m my-printer.toml
  headway calibrate heading -m my-printer.toml --from -20 --to 20 --lines 9 -o fan.hwj
  headway calibrate advance -m my-printer.toml --to 0.1 -o advance.hwj
  headway calibrate flow -m my-printer.toml --weights weights.csv --write my-printer.toml
  headway calibrate resonance -m my-printer.toml --from 20 --to 70 -o shake.hwj

What each is for and how it is read: docs/guide/calibration.md")]
pub(crate) struct CalibrateArgs {
    /// Value to calibrate.
    #[arg(value_enum, value_name = "NAME")]
    pub pattern: PatternName,
    /// Job file to write; several jobs each have their value in the name, and a machine file of the
    /// same name [default: the pattern's name].
    #[arg(short, long, value_name = "JOB.hwj", value_hint = ValueHint::AnyPath)]
    pub output: Option<OutputPath>,
    /// Length of the lines, or distance of the marks, mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub length: Option<f64>,
    /// First of the stepped values, in the pattern's unit.
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub from: Option<f64>,
    /// Last of the stepped values.
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub to: Option<f64>,
    /// Number of values.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub lines: Option<u32>,
    /// Turns of the nozzle before the second fan of `heading` [default: 5 without stops, else 0].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub turns: Option<u32>,
    /// Tilt of the lines of `pivot`, degrees [default: 15].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub tilt: Option<f64>,
    /// Machine coordinates of the pattern's front left corner, mm [default: centred over the work area].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub at: Option<String>,
    #[command(flatten)]
    pub settings: SettingsArgs,
    #[command(flatten)]
    pub allow: AllowArgs,
    /// What the slugs of `flow` weighed, columns `mm3_s` and `g`: fits `flow_loss` in place of a job.
    #[arg(long, value_name = "FILE.csv", value_hint = ValueHint::FilePath)]
    #[arg(conflicts_with_all = ["output", "from", "to", "lines", "at"])]
    pub weights: Option<PathBuf>,
    /// Put `flow_loss` into this machine file, which is kept beside it as NAME.before.
    #[arg(long, value_name = "MACHINE.toml", value_hint = ValueHint::FilePath, requires = "weights")]
    pub write: Option<PathBuf>,
    /// The lines with positions and values, as one JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum PatternName {
    /// Steps of X, Y, Z and the extruder: marks at a known distance, a tube of known height and weight.
    Steps,
    /// Zero of the heading: a fan of headings.
    Heading,
    /// Offset of the nozzle from its axis of rotation: lines in halves, half a turn apart.
    Nozzle,
    /// Pivot length of a head that tilts: lines in halves that are tilted to either side.
    Pivot,
    /// Share of the flow that does not arrive: slugs at several rates, to be weighed.
    Flow,
    /// Pressure advance: lines with slow, fast and slow parts; a job for each value.
    Advance,
    /// Volume of a prime: lines that begin with increasing volumes.
    Prime,
    /// Volume of a retract: lines that end with increasing volumes.
    Retract,
    /// Ringing frequency of the frame, by eye: walls with waves after their corners.
    Ringing,
    /// Ringing frequency of the frame, with an accelerometer: X, then Y, vibrated from --from to --to Hz;
    /// nothing is printed.
    Resonance,
}

impl PatternName {
    /// `None` for a pattern without print.
    pub(crate) fn kind(self) -> Option<PatternKind> {
        Some(match self {
            PatternName::Steps => PatternKind::Steps,
            PatternName::Heading => PatternKind::Heading,
            PatternName::Nozzle => PatternKind::Nozzle,
            PatternName::Pivot => PatternKind::Pivot,
            PatternName::Flow => PatternKind::Flow,
            PatternName::Advance => PatternKind::Advance,
            PatternName::Prime => PatternKind::Prime,
            PatternName::Retract => PatternKind::Retract,
            PatternName::Ringing => PatternKind::Ringing,
            PatternName::Resonance => return None,
        })
    }
}
