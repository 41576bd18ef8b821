//! The options of `headway reach`, with their help.

use crate::cli::args::InputArgs;
use crate::cli::args::output_path::OutputPath;
use clap::{Args, ValueHint};
use std::path::PathBuf;

/// `headway reach`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway reach part.stl -m gantry.toml --aperture ellipse:1.2x0.4
  headway reach part.stl -m gantry.toml --tilt-max 30 --voxel 0.5 --output reach.svg
  headway reach part.stl -m gantry.toml --orient --json

Exit status 1 if nothing of it can be printed.")]
pub(crate) struct ReachArgs {
    /// Closed mesh: STL, 3MF or OBJ.
    pub input: PathBuf,
    /// Machine file [default: a built-in planar machine, which does not tilt].
    #[arg(short, long, value_name = "MACHINE.toml")]
    pub machine: Option<PathBuf>,
    /// Aperture, as for `plan` [default: the machine file's].
    #[arg(long, value_name = "SHAPE")]
    pub aperture: Option<String>,
    /// Side of a voxel, mm [default: 100,000 voxels in the part's box].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub voxel: Option<f64>,
    /// Largest tilt, degrees [default: what the joints permit, up to 90].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub tilt_max: Option<f64>,
    /// A mesh of obstacles on the machine, in machine coordinates; may be given several times.
    #[arg(long, value_name = "MESH")]
    pub obstacle: Vec<PathBuf>,
    /// Try each of six sides as the bottom, and answer for the one that leaves out least.
    #[arg(long, conflicts_with = "rotate")]
    pub orient: bool,
    /// Draw shares by tilt and two sections.
    #[arg(short, long, value_name = "PICTURE.svg", value_hint = ValueHint::AnyPath)]
    pub output: Option<OutputPath>,
    #[command(flatten)]
    pub reading: InputArgs,
    /// The figures as one JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}
