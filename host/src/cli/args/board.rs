//! The options of `stream` and `board`, with their help.

use crate::cli::args::export::EndHeatArgs;
use crate::cli::args::output_path::OutputPath;
use crate::settings::heat::PAUSE_HEAT_MAX_MIN_MOST;
use clap::{Args, Subcommand, ValueHint};
use headway_protocol::message::REPORT_PERIOD_RANGE_MS;
use std::path::PathBuf;

/// Where the board is.
#[derive(Debug, Args)]
#[command(next_help_heading = "Connection")]
pub(crate) struct PortArgs {
    /// Serial port by name (/dev/ttyACM0, COM3), tcp:HOST:PORT or unix:PATH.
    #[arg(long, value_name = "PORT")]
    pub port: String,
    /// Line rate of a serial port; USB ports ignore it.
    #[arg(long, value_name = "BAUD", default_value_t = crate::drive::transport::BAUD_DEFAULT)]
    pub baud: u32,
}

/// `headway stream`.
#[derive(Debug, Args)]
#[command(after_help = "\
While it runs, lines on stdin are commands: pause, resume, override PCT, flow PCT, fan PCT, heat HEATER C, abort,
stop. Ctrl-C pauses on the path, a second one aborts on the path, a third one leaves the board alone; while it
heats and goes to where the job begins, the first one ends it. SIGTERM and a terminal that closes end it. Whatever
ends it, all heaters go off.

Examples:
  headway stream part.hwj --port /dev/ttyACM0
  headway stream part.hwj --port tcp:printer.local:7000 --resume
  headway stream part.hwj --port unix:/tmp/board --log print.log --json
  headway stream part.hwj --port /dev/ttyACM0 --resume-from print.log --log rest.log
  headway stream part.hwj --port /dev/ttyACM0 --view")]
pub(crate) struct StreamArgs {
    /// A job file (.hwj).
    pub job: PathBuf,
    #[command(flatten)]
    pub port: PortArgs,
    /// Hot end, °C: the job waits for it, and switches off at its end [default: the machine file's
    /// material].
    #[arg(long, value_name = "C", help_heading = "Temperatures")]
    pub hot_end: Option<f64>,
    /// Bed, °C.
    #[arg(long, value_name = "C", help_heading = "Temperatures")]
    pub bed: Option<f64>,
    /// Part fan, per cent.
    #[arg(long, value_name = "PCT", help_heading = "Temperatures")]
    pub fan: Option<f64>,
    /// How long a pause keeps heaters on, minutes: then the heaters go off and the pause continues [default: the
    /// machine file's material, or 120].
    #[arg(long, value_name = "MIN", help_heading = "Temperatures", value_parser = pause_minutes)]
    pub pause_heat_max_min: Option<f64>,
    /// Do not change heaters and fan, whatever the job's machine file contains, and let the extruder turn
    /// below extrude_min_c in this print: for a print without material.
    #[arg(long, help_heading = "Temperatures", conflicts_with_all = ["hot_end", "bed", "fan"])]
    pub no_heat: bool,
    #[command(flatten)]
    pub end_heat: EndHeatArgs,
    /// Print over the bed of this mesh (headway board mesh), blended out above it.
    #[arg(long, value_name = "BED.toml")]
    pub mesh: Option<PathBuf>,
    /// Continue this job if the board has part of it.
    #[arg(long)]
    pub resume: bool,
    /// Resume after a power failure, at the start of the pass that was being printed: LOG is the file of its --log;
    /// or pass:N (from 0, as in the progress), or layer:N (from 1). Home the machine first.
    #[arg(long, value_name = "LOG", value_parser = parse_place, conflicts_with = "resume")]
    pub resume_from: Option<Place>,
    /// With --resume-from, if Z is homed downwards: confirms that it was homed without touching the
    /// part.
    #[arg(long, requires = "resume_from")]
    pub part_clear: bool,
    /// Write every byte of the conversation (headway board replay reads it).
    #[arg(long, value_name = "FILE", value_hint = ValueHint::AnyPath)]
    pub log: Option<OutputPath>,
    /// Period of the board's status reports, ms, from 20 to 60000; kept until it restarts [default:
    /// 100]. If the line is silent for 0.2 s the board is queried.
    #[arg(long, value_name = "MS", value_parser = status_period())]
    pub status_period_ms: Option<u16>,
    /// Correct the flow by what this program prints, as docs/guide/sensor.md says, within the machine file's [measure].
    #[arg(long, value_name = "CMD", value_hint = ValueHint::CommandString)]
    pub sensor: Option<String>,
    /// Serve the job's page on this machine only, with the print and its controls. Its address contains a
    /// random key: everybody who knows it can move the machine.
    #[arg(long, help_heading = "Page")]
    pub view: bool,
    /// Port of 127.0.0.1 for the page; 0 chooses a free one.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        requires = "view",
        help_heading = "Page"
    )]
    pub view_port: u16,
    /// Only print the page's address.
    #[arg(long, requires = "view", help_heading = "Page")]
    pub no_open: bool,
    /// The figures as one JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Up to as long as a pause is waited for.
fn pause_minutes(text: &str) -> Result<f64, String> {
    let minutes: Option<f64> = text.parse().ok();
    let fits = minutes.filter(|minutes| (0.0..=PAUSE_HEAT_MAX_MIN_MOST).contains(minutes));
    fits.ok_or_else(|| format!("0 to {PAUSE_HEAT_MAX_MIN_MOST} minutes"))
}

fn status_period() -> clap::builder::RangedI64ValueParser<u16> {
    let [first, last] = [REPORT_PERIOD_RANGE_MS.start(), REPORT_PERIOD_RANGE_MS.end()];
    clap::value_parser!(u16).range(i64::from(*first)..=i64::from(*last))
}

/// `headway board`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway board status --port /dev/ttyACM0
  headway board measure --port /dev/ttyACM0
  headway board home z x y --port /dev/ttyACM0
  headway board jog x 10 --speed 20 --port /dev/ttyACM0
  headway board set-joint c 0 --port /dev/ttyACM0
  headway board extrude 5 --port /dev/ttyACM0
  headway board heat hot-end 210 --port /dev/ttyACM0
  headway board fan 40 --port /dev/ttyACM0
  headway board go part.hwj --port /dev/ttyACM0
  headway board probe --at 100,100 --repeat 10 --machine machine.toml --port /dev/ttyACM0
  headway board mesh --area 20,20,230,210 --machine machine.toml --port /dev/ttyACM0
  headway board configure machine.toml --port /dev/ttyACM0
  headway board simulate --listen tcp:127.0.0.1:7000
  headway board replay print.log")]
pub(crate) struct BoardArgs {
    #[command(subcommand)]
    pub command: BoardCommand,
}

/// Which machine the board is configured for.
#[derive(Debug, Args)]
pub(crate) struct BoardMachineArgs {
    /// Machine file of the board [default: the built-in planar machine].
    #[arg(short, long, value_name = "MACHINE.toml")]
    pub machine: Option<PathBuf>,
}

/// `headway board simulate`.
#[derive(Debug, Args)]
pub(crate) struct SimulateArgs {
    /// Where hosts connect: tcp:HOST:PORT or unix:PATH.
    #[arg(long, value_name = "PORT")]
    pub listen: String,
    #[command(flatten)]
    pub machine: BoardMachineArgs,
    /// Virtual seconds per second.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub speed: f64,
    /// Without limit switches.
    #[arg(long)]
    pub no_switches: bool,
    /// Its bed: a mesh as `board mesh` writes it [default: flat, at Z 0].
    #[arg(long, value_name = "BED.toml")]
    pub bed: Option<PathBuf>,
    /// File that represents the board's flash: stores the settings of `board configure`, and is read
    /// at the start, before --machine.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::AnyPath)]
    pub settings: Option<OutputPath>,
}

/// `headway board measure`.
#[derive(Debug, Args)]
pub(crate) struct MeasureArgs {
    /// Duration of the measurement, s.
    #[arg(long, value_name = "S", default_value_t = 2.0, value_parser = measured_seconds)]
    pub seconds: f64,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub port: PortArgs,
}

fn measured_seconds(text: &str) -> Result<f64, String> {
    let seconds: Option<f64> = text.parse().ok();
    let fits = seconds.filter(|seconds| (0.1..=3600.0).contains(seconds));
    fits.ok_or_else(|| "0.1 to 3600 seconds".to_string())
}

/// `headway board probe`.
#[derive(Debug, Args)]
pub(crate) struct ProbeArgs {
    /// Position to probe, machine coordinates, mm [default: the current one].
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true)]
    pub at: Option<String>,
    /// Number of touches, whose spread is reported, however large [default: the machine file's samples].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub repeat: Option<u32>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub machine: BoardMachineArgs,
    #[command(flatten)]
    pub port: PortArgs,
}

/// `headway board mesh`.
#[derive(Debug, Args)]
pub(crate) struct MeshArgs {
    /// Corners of the area to probe, machine coordinates, mm.
    #[arg(long, value_name = "X0,Y0,X1,Y1", allow_hyphen_values = true)]
    pub area: String,
    /// Points along x and along y, 3 to 64 each.
    #[arg(long, value_name = "NxM", default_value = "5x5", value_parser = points)]
    pub points: [u32; 2],
    /// Z from which on a job is planar again, mm [default: 10, or as much as a warped bed needs].
    #[arg(long, value_name = "MM")]
    pub fade_height: Option<f64>,
    /// File to write.
    #[arg(short, long, value_name = "FILE", default_value = "bed.toml", value_hint = ValueHint::AnyPath)]
    pub output: OutputPath,
    #[command(flatten)]
    pub machine: BoardMachineArgs,
    #[command(flatten)]
    pub port: PortArgs,
}

/// Command to a pin.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum PinName {
    /// In.
    Stow,
    /// Out.
    Deploy,
    /// Deploy and stow ten times.
    SelfTest,
    /// Stow, and clear an alarm.
    Reset,
}

/// 5x5.
fn points(text: &str) -> Result<[u32; 2], String> {
    let read = text.split_once('x').and_then(|(columns, rows)| {
        let side = |part: &str| part.parse().ok().filter(|side| (3..=64).contains(side));
        Some([side(columns)?, side(rows)?])
    });
    read.ok_or_else(|| "columns x rows, 3 to 64 each, as 5x5".to_string())
}

#[derive(Debug, Subcommand)]
pub(crate) enum BoardCommand {
    /// Identity of the board: versions, rates, queues, its stream.
    Info {
        #[command(flatten)]
        port: PortArgs,
        /// One JSON object on stdout.
        #[arg(long)]
        json: bool,
    },
    /// State of the board, and positions of its motors.
    Status {
        #[command(flatten)]
        port: PortArgs,
        /// One JSON object on stdout.
        #[arg(long)]
        json: bool,
    },
    /// Let the board measure itself: duration of its interrupts, locks and rounds, and its stack.
    Measure(MeasureArgs),
    /// Home joints, in the order given, and wait.
    Home {
        /// Joints by name (x y z c) or number [default: all with a switch].
        joints: Vec<String>,
        #[command(flatten)]
        machine: BoardMachineArgs,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Move one joint by a distance, and wait.
    Jog {
        /// Joint by name (x, y, z, c) or number.
        joint: String,
        /// Distance, mm or degrees.
        #[arg(allow_negative_numbers = true)]
        distance: f64,
        /// Speed, mm/s or degrees/s [default: a tenth of the joint's limit].
        #[arg(long, value_name = "SPEED")]
        speed: Option<f64>,
        #[command(flatten)]
        machine: BoardMachineArgs,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Declare the position of a joint without a switch, which is necessary after a stop.
    SetJoint {
        /// Joint by name (x, y, z, c) or number.
        joint: String,
        /// Its position, mm or degrees.
        #[arg(allow_negative_numbers = true)]
        position: f64,
        #[command(flatten)]
        machine: BoardMachineArgs,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Extrude material through the nozzle, or retract it, and wait.
    Extrude {
        /// Volume, mm³; negative retracts.
        #[arg(allow_negative_numbers = true)]
        volume: f64,
        /// Maximum rate, mm³/s [default: a tenth of the extruder's limit].
        #[arg(long, value_name = "SPEED")]
        speed: Option<f64>,
        /// Turn the extruder this once while the hot end is below extrude_min_c: without material in it.
        #[arg(long)]
        no_heat: bool,
        #[command(flatten)]
        machine: BoardMachineArgs,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Go to the start of a job, joint by joint, Z first if it rises, and wait.
    Go {
        /// A job file (.hwj).
        job: PathBuf,
        /// Over the bed of this mesh, as it will be streamed.
        #[arg(long, value_name = "BED.toml")]
        mesh: Option<PathBuf>,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Measure the height of the bed below the probe, and wait.
    Probe(ProbeArgs),
    /// Move the pin of a probe that has one (BLTouch).
    ProbePin {
        /// Where to.
        #[arg(value_enum)]
        position: PinName,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Probe a grid of points on the bed and write a mesh for `stream --mesh`.
    Mesh(MeshArgs),
    /// Come to rest on the path.
    Pause {
        #[command(flatten)]
        port: PortArgs,
    },
    /// Resume after a pause.
    Resume {
        #[command(flatten)]
        port: PortArgs,
    },
    /// Feed override.
    Override {
        /// Per cent of the planned rate, 1 to 200.
        #[arg(value_parser = clap::value_parser!(u16).range(1..=200))]
        percent: u16,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Flow override.
    Flow {
        /// Per cent of the planned volume, 10 to 200.
        #[arg(value_parser = clap::value_parser!(u16).range(10..=200))]
        percent: u16,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Set the target of a heater, and wait until it is reached; it is switched off again 30 s later if no
    /// other command follows, and at once if this one is aborted.
    Heat {
        /// hot-end, bed, hot-end-2, or the heater's number.
        heater: String,
        /// Target, °C; 0 switches off.
        celsius: f64,
        /// Do not wait: a stream, if any, rests until it is reached.
        #[arg(long)]
        no_wait: bool,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Find a heater's gains and loss: full power on and off around a temperature, some minutes.
    Tune {
        /// hot-end, bed, hot-end-2, or the heater's number.
        heater: String,
        /// Temperature to oscillate around, °C: that of printing.
        celsius: f64,
        /// Write the result into the machine file, whose old text is kept beside it as FILE.bak [default: it is
        /// printed].
        #[arg(long, requires = "machine")]
        in_place: bool,
        #[command(flatten)]
        machine: BoardMachineArgs,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Part fan.
    Fan {
        /// Per cent of its full speed.
        #[arg(value_parser = clap::value_parser!(u16).range(0..=100))]
        percent: u16,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Release the motors; home or declare every joint before the next job.
    MotorsOff {
        #[command(flatten)]
        port: PortArgs,
    },
    /// Come to rest on the path, then drop the stream.
    Abort {
        #[command(flatten)]
        port: PortArgs,
    },
    /// Stop immediately and latch a fault: the position is lost.
    Stop {
        #[command(flatten)]
        port: PortArgs,
    },
    /// Clear a latched fault.
    Reset {
        #[command(flatten)]
        port: PortArgs,
    },
    /// Send a machine file to a board that stores settings; active from its next start.
    Configure {
        /// Machine file: kinematics, joints, extruder, heaters.
        machine: PathBuf,
        #[command(flatten)]
        port: PortArgs,
    },
    /// Simulate a board without hardware: the firmware library on a socket.
    Simulate(SimulateArgs),
    /// Replay the host's side of a log through the firmware library.
    Replay {
        /// A log from headway stream --log.
        log: PathBuf,
        /// Machine file, if the log does not contain the machine.
        #[arg(short, long, value_name = "MACHINE.toml")]
        machine: Option<PathBuf>,
        /// One JSON object on stdout.
        #[arg(long)]
        json: bool,
    },
}

/// Where to begin again.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Place {
    /// Where a log ends.
    Log(PathBuf),
    /// At a pass, from 0.
    Pass(u32),
    /// At a layer's first pass, from 1.
    Layer(u32),
}

/// `pass:N`, `layer:N`, or a log.
pub(crate) fn parse_place(text: &str) -> Result<Place, String> {
    let number = |text: &str| {
        text.parse()
            .map_err(|_| format!("`{text}` is no number of a pass or layer"))
    };
    match text.split_once(':') {
        Some(("pass", text)) => number(text).map(Place::Pass),
        Some(("layer", text)) => number(text).map(Place::Layer),
        _ => Ok(Place::Log(PathBuf::from(text))),
    }
}
