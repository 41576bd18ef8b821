//! The command line: options -> settings, input, pipeline -> figures, files, exit status.
//!
//! The only module that reads and writes files and the terminal. JSON goes to stdout and everything
//! for people to stderr, so that a pipe gets one object and nothing else. Exit status: 0 done, 1
//! the job cannot be done as requested, 2 wrong usage.

mod args;
mod board;
mod compare;
mod error;
mod job;
mod live;
mod machine;
mod plan;
mod reading;
mod replan;
mod shell;
mod stream;
mod terminal;

use args::{Arguments, Command};
use clap::{CommandFactory, FromArgMatches};
use error::CliError;
use std::ffi::OsString;
use std::process::ExitCode;
use terminal::console::Console;
use terminal::named_files::NamedFiles;

/// Runs one command.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let mut command = Arguments::command();
    let parsed = command.try_get_matches_from_mut(arguments);
    let parsed = parsed.and_then(|matches| Ok((Arguments::from_arg_matches(&matches)?, matches)));
    let (arguments, matches) = match parsed.map_err(|error| error.format(&mut command)) {
        Ok(parsed) => parsed,
        Err(error) => {
            if let Some(told) = args::wrong_number::told(&error) {
                eprintln!("error: {told}");
                return ExitCode::from(2);
            }
            let wrong = error.use_stderr();
            // Help to a closed pipe is not an error.
            let _ = error.print();
            return ExitCode::from(if wrong { 2 } else { 0 });
        }
    };
    let files = NamedFiles::of(&matches, arguments.force);
    let console = Console::new(arguments.quiet, files);
    let result = match &arguments.command {
        Command::Machine(machine) => machine::run(machine, &console),
        Command::Calibrate(calibrate) => plan::calibrate::run(calibrate, &console),
        Command::Measure(measure) => job::measure::run(measure, &console),
        Command::Plan(plan) => plan::run(plan, &console),
        Command::Replan(replan) => replan::run(replan, &console),
        Command::Headings(headings) => plan::headings::run(headings, &console),
        Command::Reach(reach) => plan::reach::run(reach, &console),
        Command::Simulate(simulate) => job::simulate::run(simulate, &console),
        Command::Compare(compare) => compare::run(compare, &console),
        Command::View(view) => job::view::run(view, &console),
        Command::Export(export) => job::export::run(export, &console),
        Command::Inspect(inspect) => job::inspect::run(inspect, &console),
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
            if let (CliError::Usage(_), Some(name)) = (&error, matches.subcommand_name()) {
                console.say(&format!("  see headway {name} --help"));
            }
            error.exit_code()
        }
    }
}
