//! The options of `headway compare`, with their help.

use crate::cli::args::PartArgs;
use crate::cli::args::output_path::OutputPath;
use clap::{Args, ValueHint};
use std::path::PathBuf;

/// `headway compare`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway compare examples/bracket.json --aperture ellipse:1.2x0.4 --aperture circle:0.4 --aperture circle:0.8
  headway compare part.stl --aperture rect:3x1.5x0.2 --aperture circle:1.5 --layer-height 0.5 --picture compare.svg
  headway compare part.stl --aperture ellipse:1.2x0.4 --aperture circle:0.4 --heading-speed 300 --break-even
  headway compare part.stl --aperture ellipse:1.2x0.4 --sliced sliced.gcode")]
pub(crate) struct CompareArgs {
    /// What is printed, as for `plan`. --aperture is given once for each nozzle.
    pub input: PathBuf,
    /// Top speed of the heading axis, degrees/s [default: the machine file's, of its joint or its motor ([drivers.c])
    /// the lesser].
    #[arg(long, value_name = "DEG_S", allow_negative_numbers = true)]
    pub heading_speed: Option<f64>,
    /// Top acceleration of the heading axis, degrees/s² [default: as that of the speed].
    #[arg(long, value_name = "DEG_S2", allow_negative_numbers = true)]
    pub heading_acceleration: Option<f64>,
    /// Search the speed of the heading axis below which the first nozzle that is not round takes longer than the
    /// fastest round one: up to eight plans more.
    #[arg(long)]
    pub break_even: bool,
    /// A slicer's G-code of the same part, timed along its own lines with its round nozzle, and the slicer's own
    /// estimate where its comments have one.
    #[arg(long, value_name = "SLICED.gcode")]
    pub sliced: Option<PathBuf>,
    /// Thickness of the walls, mm: each nozzle gets as many --walls as that takes.
    #[arg(
        long,
        value_name = "MM",
        allow_negative_numbers = true,
        conflicts_with = "walls"
    )]
    pub shell: Option<f64>,
    /// Density of the material, g/cm³ [default: the machine file's, else 1.24, PLA].
    #[arg(long, value_name = "G_CM3", allow_negative_numbers = true)]
    pub density: Option<f64>,
    /// Draw the times as bars, and a layer of each.
    #[arg(long, value_name = "PICTURE.svg", value_hint = ValueHint::AnyPath)]
    pub picture: Option<OutputPath>,
    #[command(flatten)]
    pub asked: PartArgs,
    /// The rows as one JSON list on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Limits of the heading axis in place of the machine file's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HeadingAxis {
    pub speed_max_rad_s: Option<f64>,
    pub acceleration_max_rad_s2: Option<f64>,
    /// Factor of speed, acceleration and jerk, as another ratio of its gear has it.
    pub slower: f64,
}
