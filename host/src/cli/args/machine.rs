//! The options of `headway machine`, with their help.

use crate::cli::args::output_path::OutputPath;
use clap::{Args, Subcommand, ValueEnum, ValueHint};
use std::path::PathBuf;

/// `headway machine`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway machine new --kind planar > my-printer.toml
  headway machine new --arm kuka-kr-150-r3100-2 -o my-arm.toml
  headway machine check my-printer.toml
  headway machine firmware my-printer.toml -o my-printer.bin")]
pub(crate) struct MachineArgs {
    #[command(subcommand)]
    pub command: MachineCommand,
}

#[derive(Debug, Subcommand)]
pub(crate) enum MachineCommand {
    /// Write a commented machine file to start from.
    New {
        /// Kinematics of the machine.
        #[arg(long, value_enum, default_value = "planar")]
        kind: KindName,
        /// A published arm whose wrist turns the nozzle, by its maker's data, such as abb-irb-4600-60-205; `list` names all.
        #[arg(long, value_name = "MODEL", conflicts_with = "kind")]
        arm: Option<String>,
        /// Name of the machine in messages and job files [default: the kind].
        #[arg(long)]
        name: Option<String>,
        /// File to write [default: stdout].
        #[arg(short, long, value_name = "FILE", value_hint = ValueHint::AnyPath)]
        output: Option<OutputPath>,
    },
    /// Check a machine file, report errors or a summary.
    Check {
        /// The machine file.
        file: PathBuf,
        /// One JSON object on stdout.
        #[arg(long)]
        json: bool,
    },
    /// Write the settings with which a board's firmware is built (`HEADWAY_MACHINE`, see
    /// docs/guide/boards.md).
    Firmware {
        /// The machine file.
        file: PathBuf,
        /// File to write.
        #[arg(short, long, value_name = "FILE", value_hint = ValueHint::AnyPath)]
        output: OutputPath,
    },
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum KindName {
    /// X Y Z and a nozzle that turns.
    Planar,
    /// The same on two belts: the motors of X and Y turn by their sum and their difference.
    #[value(name = "corexy")]
    CoreXy,
    /// X Y Z and a head that tilts (A, B) and turns (C).
    Gantry,
    /// X Y Z and a table that tilts (A) and turns (C).
    Trunnion,
    /// A six-joint arm.
    Arm6,
    /// X Y Z and a head that turns (C) and, on it, tilts (B).
    HeadCb,
    /// X Y Z and a table that tilts (B) and turns (C).
    TableBc,
    /// X Y Z and a head that turns (C) with a nozzle that is tilted by a fixed angle.
    TiltedHead,
    /// A table that turns (C) under X and Z.
    Polar,
}
