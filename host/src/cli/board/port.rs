//! Opens the port of a board, and limits how long the board may stay silent.

use crate::cli::args::board::PortArgs;
use crate::cli::error::CliError;
use crate::drive::link_log::LinkLog;
use crate::drive::patience::ANSWER_US;
use crate::drive::pump::Pump;
use crate::drive::transport::Port;
use std::time::Duration;

/// Silence at the start after which there is no board.
pub(crate) const ANSWER_PATIENCE: Duration = Duration::from_micros(ANSWER_US);

/// Opens the port, or returns an error with what to check.
pub(crate) fn open(args: &PortArgs, log: Option<LinkLog>) -> Result<Pump, CliError> {
    let port: Port = args
        .port
        .parse()
        .map_err(|error| CliError::Usage(format!("--port: {error}")))?;
    Pump::open(&port, args.baud, log).map_err(|problem| {
        CliError::Job(format!(
            "{port}: {problem}; is the board connected? A serial port has one user: a program that \
             streams takes `pause`, `abort` and `stop` at its own terminal, and Ctrl-C"
        ))
    })
}

/// Nobody speaks our language on that port.
pub(crate) fn no_answer(port: &str, said: &str) -> CliError {
    CliError::Job(format!(
        "{port}: no answer in {} s; is it the right port and rate (--baud), and is the firmware \
         flashed? It said last: {said}",
        ANSWER_PATIENCE.as_secs()
    ))
}
