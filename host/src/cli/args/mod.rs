//! The options of every command, with their help.

pub(crate) mod allow;
pub(crate) mod board;
pub(crate) mod calibrate;
pub(crate) mod compare;
pub(crate) mod export;
pub(crate) mod inspect;
pub(crate) mod machine;
pub(crate) mod measure;
mod names;
pub(crate) mod other_names;
pub(crate) mod output_path;
pub(crate) mod reach;
pub(crate) mod replan;
pub(crate) mod shell;
pub(crate) mod wrong_number;

use crate::cli::args::allow::{AllowArgs, VerdictArgs};
use crate::cli::args::board::{BoardArgs, StreamArgs};
use crate::cli::args::calibrate::CalibrateArgs;
use crate::cli::args::compare::{CompareArgs, HeadingAxis};
use crate::cli::args::export::ExportArgs;
use crate::cli::args::inspect::InspectArgs;
use crate::cli::args::machine::MachineArgs;
use crate::cli::args::measure::MeasureArgs;
use crate::cli::args::other_names::{OtherNames, named};
use crate::cli::args::reach::ReachArgs;
use crate::cli::args::replan::ReplanArgs;
use crate::cli::args::shell::{CompletionsArgs, ManArgs};
pub(crate) use names::FormatName;

use crate::cli::args::output_path::OutputPath;
use crate::input::Units;
use crate::pipeline::shards::Shard;
use crate::settings::Place;
use crate::settings::options::Options;

use clap::builder::{ArgPredicate, PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueHint};
use std::path::PathBuf;

/// Plans, simulates and streams the motion of print heads with turning, non-round nozzles.
#[derive(Debug, Parser)]
#[command(name = "headway", version, max_term_width = 100, after_help = EXAMPLES)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub command: Command,
    /// Show no progress, not even on a terminal; notes and errors stay.
    #[arg(long, global = true)]
    pub quiet: bool,
    /// Replace a file that is no older result of the same kind, too, and a log or machine file; never one that the
    /// command reads.
    #[arg(long, global = true)]
    pub force: bool,
}

const EXAMPLES: &str = "\
Examples:
  headway simulate examples/u-part.json --report report
  headway plan part.svg --machine my-printer.toml --output part.hwj
  headway headings part.json --aperture ellipse:1.2x0.4 --spacing 0.25 --output headings.csv
  headway machine new --kind gantry --output my-printer.toml
  headway stream part.hwj --port /dev/ttyACM0

Exit status: 0 done, 1 the job cannot be done as asked, 2 wrong usage.";

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Plan an input and write the job file.
    Plan(PlanArgs),
    /// Plan a slicer's file anew: the regions that its beads fill, in the file's place.
    Replan(ReplanArgs),
    /// Write the feasible headings at every boundary sample.
    Headings(HeadingsArgs),
    /// Find how much of a mesh the machine can print at most, before any planning.
    Reach(ReachArgs),
    /// Run a job through the firmware library and check the result.
    Simulate(SimulateArgs),
    /// Plan a part with several nozzles and compare their times.
    Compare(CompareArgs),
    /// Write a job's report, a page that draws and plays it, and open it.
    View(ViewArgs),
    /// Write a job as a table of poses, a picture or JSON.
    Export(ExportArgs),
    /// Show the contents of a job file or an input.
    Inspect(InspectArgs),
    /// Stream a job to a board.
    Stream(StreamArgs),
    /// Query a board, command it, or simulate one without hardware.
    Board(BoardArgs),
    /// Write a job that prints a pattern from which a value of the machine file is read.
    Calibrate(CalibrateArgs),
    /// Tell from a scan of a printed layer what of the machine file is wrong.
    Measure(MeasureArgs),
    /// Write or check a machine file.
    Machine(MachineArgs),
    /// Write the completion script for a shell.
    Completions(CompletionsArgs),
    /// Write manual pages.
    Man(ManArgs),
}

/// Represents the input if there is only a surface.
pub(crate) const NO_INPUT: &str = "-";

/// The input, and its position on the machine.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Input")]
pub(crate) struct InputArgs {
    /// Format of the input, if its file extension does not define it.
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub from: Option<FormatName>,
    /// Unit of the input's coordinates; overrides the file's.
    #[arg(long, value_name = "UNIT", value_parser = units())]
    pub units: Option<Units>,
    /// Factor on all coordinates of the input.
    #[arg(
        long,
        value_name = "FACTOR",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    pub scale: f64,
    /// Repair crossings, overlaps and open contours by the fill rule, and report the changes.
    #[arg(long)]
    pub repair: bool,
    /// Lines of a drawing (DXF, strokes of an SVG, LineStrings of a GeoJSON) are the middles of beads: each is printed once
    /// on every layer, in place of filling what a contour encloses.
    #[arg(long)]
    pub centre_lines: bool,
    /// Turn a mesh about its x, then y, then z axis, degrees.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub rotate: Option<String>,
    /// Diameter of the filament of G-code, mm [default: the file's, or 1.75].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub filament_diameter: Option<f64>,
    /// Axes of the machine that G-code was written for, if it is another one: the letters that turn head or table,
    /// about which axis, and whether X Y Z are the tip's position on the part:
    /// "B=table:y,C=table:z,coordinates=pivot", "A=head:x:at=0/0/60,U=heading,coordinates=tip", "machine:FILE.toml"
    /// (its joints). Further words: :zero=DEG, shift=X/Y/Z, lean=DEG, feed=tip, xyz or all, extruder=LETTER; the
    /// guide has them for each program [default: the machine file's].
    #[arg(long, value_name = "WORDS", allow_hyphen_values = true)]
    pub axes: Option<String>,
    /// Layer of a DXF drawing that is read; once for each [default: all but frozen and off].
    #[arg(long, value_name = "NAME")]
    pub dxf_layer: Vec<String>,
}

/// Units of an input by name.
fn units() -> impl TypedValueParser<Value = Units> {
    let names = PossibleValuesParser::new(["mm", "cm", "m", "um", "in"]);
    names.try_map(|name| Units::parse(&name).ok_or("no unit"))
}

/// How a mesh is divided into layers.
#[derive(Clone, Debug, Default, PartialEq, Args)]
#[command(next_help_heading = "Input")]
pub(crate) struct LayerArgs {
    /// Range of layers of a mesh, counted from 1, first and last [default: all].
    #[arg(long, value_name = "A-B")]
    pub layer_range: Option<String>,
    /// Heights of a mesh's layers by ranges above the bed, mm, upwards: 0-2:0.1,2-10:0.2; elsewhere that of
    /// --layer-height.
    #[arg(long, value_name = "A-B:MM,...", allow_hyphen_values = true)]
    pub layer_heights: Option<String>,
    /// Height of the first layer of a mesh, mm [default: that of the others].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub first_layer_height: Option<f64>,
}

/// Position of the input on the machine.
#[derive(Clone, Debug, Default, PartialEq, Args)]
#[command(next_help_heading = "Input")]
pub(crate) struct PlaceArgs {
    /// Further runs of waypoints, printed after the input in this order, as one job.
    #[arg(value_name = "MORE")]
    pub more: Vec<PathBuf>,
    /// Machine coordinates of the input's origin, mm [default: the input's box centred over the
    /// work area, on the bed]. Given several times, an outline or mesh is printed at each place.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub at: Vec<String>,
    /// Width of the beads along --centre-lines, mm [default: the nozzle's with its long
    /// axis across the line].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub bead_width: Option<f64>,
    /// Number of copies of an outline or mesh, in rows, up to 1000.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub copies: Option<u32>,
    /// Distance between the boxes of copies, mm [default: 5].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub copy_gap: Option<f64>,
    /// Outlines that neither aperture nor nozzle body enters (clamps, finished neighbours), in the
    /// input's coordinates; read like the input.
    #[arg(long, value_name = "FILE")]
    pub keep_out: Option<PathBuf>,
    /// Mesh, in the outline's coordinates, that the layers follow; for heads that tilt. A plane outline is projected
    /// from above onto the mesh's upper side, one with points [x, y, z] is drawn on it, and without an outline the
    /// mesh is covered up to its rims: these two may overhang or close around.
    #[arg(long, value_name = "MESH")]
    pub surface: Option<PathBuf>,
    /// Region of the surface: group:NAME (of an OBJ, or an object or component of a 3MF), colour:#RRGGBB (of all three
    /// corners of a triangle), or normal:DEG, with normals tilted from Z by no more than that.
    #[arg(long, value_name = "REGION", requires = "surface")]
    pub surface_region: Option<String>,
    /// Layers of a mesh that follow its tops instead of forming stairs: a number of them over flat ones (skin:M, or skin
    /// for 3). Curved layers are solid.
    #[arg(long, value_name = "skin[:M]", conflicts_with = "surface")]
    pub curved_layers: Option<String>,
    /// Print a mesh in pieces with build directions of their own, for heads or tables that tilt: those of a file (TOML), or
    /// found (auto), which `plan` writes beside the job, JOB.directions.toml, to start from.
    #[arg(long, value_name = "auto|FILE", conflicts_with = "surface")]
    pub directions: Option<PathBuf>,
    /// Waypoints further apart than this end a pass: retract, travel clear of the print, prime
    /// [default: six times the usual spacing].
    #[arg(long, value_name = "MM")]
    pub gap: Option<f64>,
    /// Position of an outline, a mesh or a run of waypoints.
    #[arg(long, value_enum, value_name = "PLACE", conflicts_with = "at")]
    pub place: Option<Place>,
    /// Rotates a run of waypoints about Z, counter-clockwise, degrees; positions and messages are those
    /// of the rotated run.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub turn: Option<f64>,
    /// Largest deviation of the tool axis from that of the waypoints where two rotary axes of the
    /// machine line up, degrees; 0 keeps it unchanged [default: 0.5].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub axis_tolerance: Option<f64>,
    /// Largest tilt of the tool axis of a run of waypoints from the given one, degrees, where nozzle or head would
    /// collide with obstacles or earlier print: the smallest clear tilt is used; a column cone_deg permits less at
    /// single waypoints [default: axes are unchanged].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub tilt_max: Option<f64>,
    /// A mesh of obstacles on the machine (clamps, finished parts), in machine coordinates; may be given several
    /// times. Tilting heads are checked against it; outlines and meshes avoid its projection.
    #[arg(long, value_name = "MESH")]
    pub obstacle: Vec<PathBuf>,
    /// Corners of a run of waypoints are rounded within this many mm, and those of its tool axis within half of
    /// --axis-tolerance; 0 keeps corners unchanged: the head rests at those of the path. Small roundings, below about
    /// 0.1 mm, can take LONGER than rests: compare print_s [default: 0, or the machine file's].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub corner_tolerance: Option<f64>,
    /// Folder for planned layers of a mesh, which are not planned again.
    #[arg(long, value_name = "DIR")]
    pub cache: Option<PathBuf>,
    #[command(flatten)]
    pub layers: LayerArgs,
    /// Tip speed while the first layer of a mesh is printed, mm/s [default: that of the others].
    #[arg(long, value_name = "MM_S", allow_negative_numbers = true)]
    pub first_layer_speed: Option<f64>,
}

/// Options that override the machine file.
#[derive(Clone, Debug, Default, PartialEq, Args)]
#[command(next_help_heading = "Settings")]
pub(crate) struct SettingsArgs {
    #[command(flatten)]
    pub other_names: OtherNames,
    /// Machine file [default: a built-in planar machine; see `headway machine new`].
    #[arg(short, long, value_name = "MACHINE.toml")]
    pub machine: Option<PathBuf>,
    /// Aperture, full sizes in mm: ellipse:LxW, circle:D, stadium:LxW, rect:LxWxR (with the corner
    /// radius), polygon:FILE (a JSON list of corners about the tool's axis).
    #[arg(long, value_name = "SHAPE")]
    pub aperture: Vec<String>,
    /// What `compare` makes of the heading axis.
    #[arg(skip)]
    pub heading_axis: Option<HeadingAxis>,
    /// Fast where no option asks for another quality, as `compare` plans.
    #[arg(skip)]
    pub is_draft: bool,
    #[command(flatten)]
    pub options: Options,
}

/// How an input is read, placed and planned.
#[derive(Clone, Debug, Args)]
pub(crate) struct PartArgs {
    #[command(flatten)]
    pub reading: InputArgs,
    #[command(flatten)]
    pub place: PlaceArgs,
    #[command(flatten)]
    pub settings: SettingsArgs,
}

/// `headway plan`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway plan examples/bracket.json --output bracket.hwj
  headway plan drawing.svg -m my-printer.toml --speed 40 --overlap 5 -o part.hwj --json
  headway plan examples/bracket.json --layers 40 --walls 2 --infill-density 20 -o bracket.hwj
  headway plan part.stl --layer-height 0.25 --walls 2 --infill-density 15 -o part.hwj
  headway plan sliced.gcode -o part.hwj
  headway plan five-axis.gcode --axes A=table:x,C=table:z,coordinates=pivot -m my-printer.toml -o part.hwj")]
pub(crate) struct PlanArgs {
    /// Mesh (STL, 3MF, OBJ), outline (polygon JSON, GeoJSON, SVG), waypoints or G-code; none with only --surface.
    #[arg(
        required = false,
        required_unless_present = "surface",
        default_value_if("surface", ArgPredicate::IsPresent, NO_INPUT)
    )]
    pub input: PathBuf,
    /// Job file to write; none with --shard.
    #[arg(short, long, value_name = "JOB.hwj", required_unless_present = "shard", value_hint = ValueHint::AnyPath)]
    pub output: Option<OutputPath>,
    /// Plan only every Nth block of a mesh's layers, from the Kth on, into the folder of --cache, and write no job: on
    /// several machines at once. The same command without it then takes all blocks from the folder.
    #[arg(long, value_name = "K/N", requires = "cache", conflicts_with_all = ["output", "against"], value_parser = shard)]
    pub shard: Option<Shard>,
    #[command(flatten)]
    pub asked: PartArgs,
    #[command(flatten)]
    pub allow: AllowArgs,
    #[command(flatten)]
    pub verdict: VerdictArgs,
    /// The figures as one JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// A share of the work, `K/N`.
fn shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/');
    let number = |text: &str| text.trim().parse::<usize>().ok();
    match numbers.and_then(|(k, n)| Some((number(k)?, number(n)?))) {
        Some((number, count)) if (1..=count).contains(&number) => Ok(Shard { number, count }),
        _ => Err(format!("`{text}` is not K/N with 1 <= K <= N, such as 3/8")),
    }
}

/// `headway headings`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway headings examples/taper.json --spacing 0.25 > headings.csv
  headway headings part.svg --aperture ellipse:1.6x0.6 --pass one --law linear -o headings.csv")]
pub(crate) struct HeadingsArgs {
    /// Outline: polygon JSON, GeoJSON or SVG.
    pub input: PathBuf,
    /// Longest part of the boundary between two samples, mm.
    #[arg(
        long,
        value_name = "MM",
        default_value_t = 0.25,
        allow_negative_numbers = true
    )]
    pub spacing: f64,
    /// Table to write [default: stdout].
    #[arg(short, long, value_name = "F.csv", value_hint = ValueHint::AnyPath)]
    pub output: Option<OutputPath>,
    #[command(flatten)]
    pub reading: InputArgs,
    #[command(flatten)]
    pub settings: SettingsArgs,
    /// A summary as one JSON object on stdout (the table only to --output).
    #[arg(long)]
    pub json: bool,
}

/// `headway simulate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway simulate examples/u-part.json --report report
  headway simulate part.hwj --trace poses.csv --trace-steps steps.csv
  headway simulate part.svg --link \"drop=0.01,flip=1e-5,stall=2s@5s\" --seed 7 --json
  headway simulate part.hwj --material examples/materials/hot-end.toml --report report")]
pub(crate) struct SimulateArgs {
    /// Mesh (STL, 3MF, OBJ), outline (polygon JSON, GeoJSON, SVG), waypoints, G-code, or a job file (.hwj); none with
    /// only --surface.
    #[arg(
        required = false,
        required_unless_present = "surface",
        default_value_if("surface", ArgPredicate::IsPresent, NO_INPUT)
    )]
    pub input: PathBuf,
    /// Folder for figures and pictures; created if missing.
    #[arg(long, value_name = "DIR", value_hint = ValueHint::AnyPath)]
    pub report: Option<OutputPath>,
    #[arg(short = 'o', long = "output", hide = true, value_parser = named("--report"))]
    not_output: Option<String>,
    /// Table of the poses of the simulated steps.
    #[arg(long, value_name = "F.csv", value_hint = ValueHint::AnyPath)]
    pub trace: Option<OutputPath>,
    /// Table of every step.
    #[arg(long, value_name = "F.csv", value_hint = ValueHint::AnyPath)]
    pub trace_steps: Option<OutputPath>,
    /// Faults of the simulated line: drop, flip, dup, delay, stall=LENGTH@START,
    /// pull=LENGTH@START, baud.
    #[arg(long, value_name = "FAULTS")]
    pub link: Option<String>,
    /// A known extruder with its material (TOML): what arrives is laid, told and drawn.
    #[arg(long, value_name = "FILE.toml", value_hint = ValueHint::FilePath)]
    pub material: Option<PathBuf>,
    /// Fixes every random choice of the simulated line.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    #[command(flatten)]
    pub asked: PartArgs,
    #[command(flatten)]
    pub allow: AllowArgs,
    #[command(flatten)]
    pub verdict: VerdictArgs,
    /// The figures as one JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// `headway view`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway view part.hwj
  headway view part.svg -m machine.toml --report pages/part --no-open")]
pub(crate) struct ViewArgs {
    /// A job file (.hwj), or an input, which is planned.
    pub input: PathBuf,
    /// Folder for the page and its pictures [default: the input's name, with -report].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::AnyPath)]
    pub report: Option<OutputPath>,
    /// Only write the page.
    #[arg(long)]
    pub no_open: bool,
    #[command(flatten)]
    pub asked: PartArgs,
}
