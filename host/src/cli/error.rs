//! Why a command ends without its result, and its exit status then.

use std::io::ErrorKind;
use std::process::ExitCode;

/// Why a command ends without its result.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// The options make no sense (exit status 2).
    #[error("{0}")]
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
    #[error("{path}: {}", in_words(problem))]
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
    /// Whether another part, or this one with another nozzle, can do without it.
    pub(crate) fn is_of_part(&self) -> bool {
        matches!(self, CliError::Job(_) | CliError::OutsideRange { .. })
    }

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

/// What the system says, without its numbers where it is plain.
fn in_words(problem: &std::io::Error) -> String {
    match problem.kind() {
        ErrorKind::NotFound => "there is no such file".to_string(),
        ErrorKind::PermissionDenied => "you may not read or write it".to_string(),
        _ => problem.to_string(),
    }
}
