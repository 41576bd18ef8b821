//! The options of `headway export`, with their help.

use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// `headway export`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway export part.hwj --to csv --every-ms 2 --output poses.csv
  headway export part.hwj --to svg --layer 5 > layer-5.svg")]
pub(super) struct ExportArgs {
    /// A job file (.hwj).
    pub job: PathBuf,
    /// What to write.
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub to: ExportName,
    /// Layer of the picture, from 1.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub layer: u32,
    /// Time between two rows of the table, ms.
    #[arg(
        long,
        value_name = "MS",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    pub every_ms: f64,
    /// File to write [default: stdout].
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum ExportName {
    /// Poses at even steps of time.
    Csv,
    /// Passes with the nozzle's outlines.
    Svg,
    /// Everything: knots, events, marks, figures.
    Json,
}
