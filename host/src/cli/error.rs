//! Why a command ends without its result, and its exit status then.

use std::process::ExitCode;

/// Why a command ends without its result.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// The options make no sense (exit status 2).
    #[error("{0}\n  see headway --help")]
    Usage(String),
    /// The job cannot be done as requested (exit status 1).
    #[error("{0}")]
    Job(String),
    /// A joint would leave its range (exit status 1); `--allow range` permits it.
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
        /// The system's message.
        problem: std::io::Error,
    },
    /// The reader of the output has closed it: no message is needed.
    #[error("the output was closed")]
    OutputClosed,
}

impl CliError {
    pub(crate) fn exit_code(&self) -> ExitCode {
        match self {
            CliError::Usage(_) => ExitCode::from(2),
            CliError::Job(_) | CliError::OutsideRange { .. } | CliError::File { .. } => {
                ExitCode::from(1)
            }
            CliError::OutputClosed => ExitCode::SUCCESS,
        }
    }
}
