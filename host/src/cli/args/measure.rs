//! The options of `headway measure`, with their help.

use crate::cli::args::output_path::OutputPath;
use crate::cli::args::units;
use crate::input::Units;
use crate::scan::{PictureScale, Scale};
use clap::{Args, ValueHint};
use std::path::PathBuf;

/// `headway measure`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway measure layer.csv --job part.hwj --output layer.svg
  headway measure layer.ply --job part.hwj --layer 5 --units m --json
  headway measure layer.png --pixel 0.02 --level 0.001 --job part.hwj
  headway measure layer.csv --job part.hwj --write my-printer.toml

What a scan must show, and how well it tells: docs/guide/measure.md")]
pub(crate) struct MeasureArgs {
    /// A printed layer with the bed around it: CSV or XYZ (rows of x, y, z), PLY, a height map (grey PNG), a mesh of Klipper.
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
    /// Side of a pixel of a height map, mm.
    #[arg(long, value_name = "MM", value_parser = length_mm, requires = "level")]
    pub pixel: Option<f64>,
    /// Height of a grey level of a height map, mm.
    #[arg(long, value_name = "MM", value_parser = length_mm, requires = "pixel")]
    pub level: Option<f64>,
    /// Put the changed keys into this machine file, which is kept beside it as NAME.before.
    #[arg(long, value_name = "MACHINE.toml", value_hint = ValueHint::FilePath)]
    pub write: Option<PathBuf>,
    /// Draw the layer, coloured by how much too much or too little it has.
    #[arg(short, long, value_name = "PICTURE.svg", value_hint = ValueHint::AnyPath)]
    pub output: Option<OutputPath>,
    /// All that was found, by place as well, as one JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

impl MeasureArgs {
    pub(crate) fn scale(&self) -> Scale {
        let picture = self.pixel.zip(self.level);
        Scale {
            mm_per_unit: self.units.mm(),
            picture: picture.map(|(pixel_mm, level_mm)| PictureScale { pixel_mm, level_mm }),
        }
    }
}

/// From 10 nm, the step of a fine profiler.
fn length_mm(text: &str) -> Result<f64, String> {
    let length_mm: Option<f64> = text.parse().ok();
    let fits = length_mm.filter(|length_mm| (1e-5..=100.0).contains(length_mm));
    fits.ok_or_else(|| "0.00001 to 100 mm".to_string())
}
