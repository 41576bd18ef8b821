//! The command line: options -> settings, input, pipeline -> figures, files, exit status.
//!
//! The only place that reads and writes files and the terminal. JSON goes to stdout and everything
//! for the eye to stderr, so that a pipe sees one object and nothing else. Exit status: 0 done,
//! 1 the job cannot be done as asked, 2 wrong usage.

mod args;
mod args_allow;
mod args_board;
mod args_calibrate;
mod args_compare;
mod args_export;
mod args_inspect;
mod args_machine;
mod args_other_names;
mod args_shell;
mod args_wide;
mod board;
mod calibrate;
mod compare;
mod compare_sliced;
mod configure;
mod console;
mod copies;
mod drivers;
mod export;
mod export_gcode;
mod file_axes;
mod headings;
mod heat;
mod inspect;
mod inspect_axes;
mod job;
mod jog;
mod layer_options;
mod live;
mod live_page;
mod load;
mod load_run;
mod machine;
mod missing_heat;
mod operator;
mod output_file;
mod page_layers;
mod pass_facts;
mod pictures;
mod piece_cache;
mod plan;
mod planned;
mod planned_curved;
mod planned_gcode;
mod planned_part;
mod planned_patch;
mod printable;
mod probe;
mod resume_from;
mod shell;
mod signals;
mod simulate;
mod simulated_board;
mod stream;
mod stream_heat;
mod stream_problems;
mod talk;
mod tune;
mod verdict;
mod view;

use args::{Arguments, Command};
use clap::Parser;
use console::Console;
use std::ffi::OsString;
use std::process::ExitCode;

/// Why a command ends without its result.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// The options make no sense (exit status 2).
    #[error("{0}\n  see headway --help")]
    Usage(String),
    /// The job cannot be done as asked (exit status 1).
    #[error("{0}")]
    Job(String),
    /// A joint would leave its range (exit status 1); `--allow range` takes it.
    #[error("{input}: {place} (--allow range takes it as it is)")]
    OutsideRange {
        /// Input that is planned.
        input: String,
        /// Joint from 0.
        joint: usize,
        /// Where it would be.
        place: String,
    },
    /// A file cannot be read or written (exit status 1).
    #[error("{path}: {problem}")]
    File {
        /// The file.
        path: String,
        /// What the system says.
        problem: std::io::Error,
    },
    /// The reader of our output has gone: not an error worth a message.
    #[error("the output was closed")]
    OutputClosed,
}

impl CliError {
    fn exit_code(&self) -> ExitCode {
        match self {
            CliError::Usage(_) => ExitCode::from(2),
            CliError::Job(_) | CliError::OutsideRange { .. } | CliError::File { .. } => {
                ExitCode::from(1)
            }
            CliError::OutputClosed => ExitCode::SUCCESS,
        }
    }
}

/// Runs one command.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(error) => {
            let wrong = error.use_stderr();
            // Help to a closed pipe is nobody's loss.
            let _ = error.print();
            return ExitCode::from(if wrong { 2 } else { 0 });
        }
    };
    let console = Console::new(arguments.quiet);
    let result = match &arguments.command {
        Command::Machine(machine) => machine::run(machine, &console),
        Command::Calibrate(calibrate) => calibrate::run(calibrate, &console),
        Command::Plan(plan) => plan::run(plan, &console),
        Command::Headings(headings) => headings::run(headings, &console),
        Command::Simulate(simulate) => simulate::run(simulate, &console),
        Command::Compare(compare) => compare::run(compare, &console),
        Command::View(view) => view::run(view, &console),
        Command::Export(export) => export::run(export, &console),
        Command::Inspect(inspect) => inspect::run(inspect, &console),
        Command::Stream(stream) => stream::run(stream, &console),
        Command::Board(board) => board::run(board, &console),
        Command::Completions(completions) => shell::completions(completions, &console),
        Command::Man(man) => shell::man(man, &console),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            if !matches!(error, CliError::OutputClosed) {
                console.say(&format!("error: {error}"));
            }
            error.exit_code()
        }
    }
}
