//! The options of `headway inspect`, with their help.

use crate::cli::args::output_path::OutputPath;
use crate::cli::args::{InputArgs, LayerArgs};
use clap::{Args, ValueHint};
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
    /// Free tool axes with the tip at a position, mm, input coordinates, at a time of the job, s: the nearest to the
    /// job's own, and the obstacles.
    #[arg(long, value_name = "X,Y,Z,T", allow_hyphen_values = true)]
    pub axes_at: Option<String>,
    /// Draws the free axes of --axes-at as a map of the half sphere, SVG.
    #[arg(long, value_name = "FILE", requires = "axes_at", value_hint = ValueHint::AnyPath)]
    pub picture: Option<OutputPath>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}
