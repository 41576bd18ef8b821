//! The options of `headway measure`, with their help.

use crate::cli::args::units;
use crate::input::Units;
use clap::{Args, ValueHint};
use std::path::PathBuf;

/// `headway measure`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway measure layer.csv --job part.hwj
  headway measure layer.ply --job part.hwj --layer 5 --units m --json
  headway measure layer.csv --job part.hwj --write my-printer.toml

What a scan must show, and how well it tells: docs/guide/measure.md")]
pub(crate) struct MeasureArgs {
    /// Points of a printed layer with the bed around it: CSV or XYZ (rows of x, y, z) or PLY.
    pub scan: PathBuf,
    /// The job that was printed.
    #[arg(long, value_name = "JOB.hwj", value_hint = ValueHint::FilePath)]
    pub job: PathBuf,
    /// Layer that is on top in the scan, from 1 [default: the last].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub layer: Option<u32>,
    /// Unit of the scan's coordinates.
    #[arg(long, value_name = "UNIT", default_value = "mm", value_parser = units())]
    pub units: Units,
    /// Put the changed keys into this machine file, which is kept beside it as NAME.before.
    #[arg(long, value_name = "MACHINE.toml", value_hint = ValueHint::FilePath)]
    pub write: Option<PathBuf>,
    /// All that was found, by place as well, as one JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}
