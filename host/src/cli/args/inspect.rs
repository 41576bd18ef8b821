//! The options of `headway inspect`, with their help.

use crate::cli::args::{InputArgs, LayerArgs};
use clap::Args;
use std::path::PathBuf;

/// `headway inspect`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway inspect part.hwj
  headway inspect drawing.svg --json
  headway inspect part.stl --layer-height 0.3")]
pub(crate) struct InspectArgs {
    /// A job file (.hwj), or an input.
    pub file: PathBuf,
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub layers: LayerArgs,
    /// Height of a mesh's layers, mm.
    #[arg(
        long,
        value_name = "MM",
        default_value_t = 0.2,
        allow_negative_numbers = true
    )]
    pub layer_height: f64,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}
