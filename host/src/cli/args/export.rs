//! The options of `headway export`, with their help.

use crate::cli::args::output_path::OutputPath;
use crate::gcode::write::dialect::{Dialect, Retraction};
use crate::report::plan_marks::Colouring;
use clap::builder::BoolishValueParser;
use clap::{Args, ValueEnum, ValueHint};
use std::path::PathBuf;

/// `headway export`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway export part.hwj --to csv --every-ms 2 --output poses.csv
  headway export part.hwj --to csv --joints --every-ms 2 -o joints.csv
  headway export part.hwj --to ros2-yaml --every-ms 10 --joint-names j1,j2,j3,j4,j5,j6 -o part.yaml
  headway export wall.hwj --to rapid --tool nozzle --work-object bed -o wall.mod
  headway export part.hwj --to svg --layer 5 --colour width > layer-5.svg
  headway export part.hwj --to gcode --dialect klipper -o part.gcode")]
pub(crate) struct ExportArgs {
    /// A job file (.hwj).
    pub job: PathBuf,
    /// What to write.
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub to: ExportName,
    /// Layer of the picture, from 1 [default: the first that is printed].
    #[arg(long, value_name = "N")]
    pub layer: Option<u32>,
    /// Colouring of the picture's passes [default: zone].
    #[arg(long, value_enum, value_name = "WHAT")]
    pub colour: Option<Colouring>,
    /// Time between two rows of the table, ms.
    #[arg(
        long,
        value_name = "MS",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    pub every_ms: f64,
    /// Joints in place of poses, for csv and json: positions (mm, rad), rates, accelerations and motor steps.
    #[arg(long)]
    pub joints: bool,
    /// The robot's names of the joints, in the machine file's order, for ros2-json and ros2-yaml [default: the
    /// machine file's names].
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub joint_names: Option<Vec<String>>,
    /// File to write [default: stdout].
    #[arg(short, long, value_name = "FILE", value_hint = ValueHint::AnyPath)]
    pub output: Option<OutputPath>,
    /// Print the figures of G-code as one JSON object on stdout; needs --output.
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub program: ProgramArgs,
    #[command(flatten)]
    pub gcode: GcodeArgs,
}

/// What a program of a robot's controller is written like.
#[derive(Debug, Args)]
#[command(next_help_heading = "Programs of robots")]
pub(crate) struct ProgramArgs {
    /// Largest distance of the tip and of the nozzle's end from the job's, mm [default: 2 % of the narrow bead].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub tolerance: Option<f64>,
    /// Tool on the controller: a name for rapid, a number of TOOL_DATA for krl [default: hw_nozzle; 1].
    #[arg(long, value_name = "NAME")]
    pub tool: Option<String>,
    /// Work object for rapid, number of BASE_DATA for krl, feature for urscript, 54 to 57 for sinumerik [default: hw_bed;
    /// 1; the machine file's base; 54].
    #[arg(long, value_name = "NAME")]
    pub work_object: Option<String>,
    /// Largest file, kB; the next part is another file [default: 4000 for krl, 10000 for the others].
    #[arg(long, value_name = "KB")]
    pub max_kb: Option<u32>,
}

impl ProgramArgs {
    /// The first of them that is given.
    pub(crate) fn given(&self) -> Option<&'static str> {
        let given = [
            ("--tolerance", self.tolerance.is_some()),
            ("--tool", self.tool.is_some()),
            ("--work-object", self.work_object.is_some()),
            ("--max-kb", self.max_kb.is_some()),
        ];
        given.into_iter().find_map(|(name, is)| is.then_some(name))
    }
}

/// What heaters do at a job's end.
#[derive(Debug, Args)]
pub(crate) struct EndHeatArgs {
    /// Leave heaters on at the job's end as they are then; otherwise all go off. A board switches them off
    /// after 30 s without a next command.
    #[arg(long, help_heading = "Temperatures")]
    pub leave_hot: bool,
}

/// What G-code is written like.
#[derive(Debug, Args)]
#[command(next_help_heading = "G-code")]
pub(crate) struct GcodeArgs {
    /// Controller that G-code is for.
    #[arg(long, value_enum, value_name = "CONTROLLER")]
    pub dialect: Option<Dialect>,
    /// How primes and retracts are written [default: extruder, which changes no setting of the controller].
    #[arg(long, value_enum, value_name = "HOW")]
    pub retraction: Option<Retraction>,
    /// Diameter of the filament, mm.
    #[arg(
        long,
        value_name = "MM",
        default_value_t = 1.75,
        allow_negative_numbers = true
    )]
    pub filament_diameter: f64,
    /// Letters of the tilt about X, about Y, and of the heading [default: the machine file's [gcode] letters, else A,B,C].
    #[arg(long, value_name = "A,B,C")]
    pub letters: Option<String>,
    /// Letter of the extruder [default: E; U for linuxcnc and grblhal].
    #[arg(long, value_name = "LETTER")]
    pub extruder: Option<char>,
    /// Headings from 0 to 360 degrees, for axes that turn in the shorter direction; otherwise they
    /// count turns.
    #[arg(long)]
    pub wrapped: bool,
    /// Largest distance of a move from the job's path, mm [default: 0.002; 0.003 for linuxcnc, grblhal and
    /// marlin; more for beads wider than 0.4 mm, by their width].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub line_tolerance: Option<f64>,
    /// Arcs (G2, G3) where they are fewer moves [default: on for linuxcnc, off for the others].
    #[arg(
        long,
        value_parser = BoolishValueParser::new(),
        value_name = "on|off",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "on"
    )]
    pub arcs: Option<bool>,
    /// Start block with fields like {x} or {time_s}, in place of the dialect's; what the moves need is written after it.
    #[arg(long, value_name = "FILE")]
    pub start: Option<PathBuf>,
    /// Print the dialect's start block for this job, to be edited and given as --start.
    #[arg(long, conflicts_with_all = ["start", "json"])]
    pub print_start: bool,
    /// Print the dialect's end block, to be edited and given as --end.
    #[arg(long, conflicts_with_all = ["end", "json", "print_start"])]
    pub print_end: bool,
    /// Temperature of the hot end in place of the job's, °C; 0 leaves it off.
    #[arg(long, value_name = "C", allow_negative_numbers = true)]
    pub hot_end: Option<f64>,
    /// Temperature of the bed in place of the job's, °C; 0 leaves it off.
    #[arg(long, value_name = "C", allow_negative_numbers = true)]
    pub bed: Option<f64>,
    /// Write the job though neither it nor a start block heats a hot end.
    #[arg(long)]
    pub no_heat: bool,
    /// End block.
    #[arg(long, value_name = "FILE")]
    pub end: Option<PathBuf>,
    #[command(flatten)]
    pub end_heat: EndHeatArgs,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum ExportName {
    /// Poses at even steps of time.
    Csv,
    /// Passes with the nozzle's outlines.
    Svg,
    /// Everything: knots, events, marks, figures.
    Json,
    /// Joints as a JointTrajectory message of ROS 2, in rad and m.
    Ros2Json,
    /// The same as YAML.
    Ros2Yaml,
    /// Moves for another controller, of the --dialect.
    Gcode,
    /// Modules of RAPID, for arms of ABB.
    Rapid,
    /// Modules of KRL, for arms of KUKA.
    Krl,
    /// A script for arms of Universal Robots.
    Urscript,
    /// G-code of a Sinumerik with X, Y, Z and a heading axis C.
    Sinumerik,
}
