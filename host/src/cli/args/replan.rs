//! The options of `headway replan`, with their help.

use crate::cli::args::SettingsArgs;
use crate::cli::args::allow::AllowArgs;
use crate::cli::args::output_path::OutputPath;
use crate::gcode::write::dialect::Dialect;
use clap::{Args, ValueHint};
use std::path::PathBuf;

/// `headway replan`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway replan sliced.gcode -m my-printer.toml -o out.gcode
  headway replan sliced.gcode -m my-printer.toml -o job.hwj --json
  headway replan --in-place -m my-printer.toml sliced.gcode")]
pub(crate) struct ReplanArgs {
    /// G-code of PrusaSlicer, SuperSlicer, OrcaSlicer, Bambu Studio or Cura.
    pub input: PathBuf,
    /// File to write: G-code, or a job (.hwj).
    #[arg(short, long, value_name = "FILE", value_hint = ValueHint::AnyPath)]
    #[arg(conflicts_with = "in_place", required_unless_present = "in_place")]
    pub output: Option<OutputPath>,
    /// Replace the input, as a post-processing script of a slicer does.
    #[arg(long)]
    pub in_place: bool,
    /// Controller that G-code is for [default: the file's flavour].
    #[arg(long, value_enum, value_name = "CONTROLLER")]
    pub dialect: Option<Dialect>,
    #[command(flatten)]
    pub settings: SettingsArgs,
    #[command(flatten)]
    pub allow: AllowArgs,
    /// Print the figures as one JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}
