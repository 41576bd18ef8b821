//! The option by which a job that is not good is taken all the same, with its help.

use clap::{Args, ValueEnum};

/// What is taken although it is not good.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Verdict")]
pub(super) struct AllowArgs {
    /// What does not refuse the job, though it is still the first thing that is said of it.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT,...")]
    pub allow: Vec<AllowName>,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub(super) enum AllowName {
    /// Nozzle or head touches the table or the print.
    Touches,
    /// A joint leaves its range: a board with the same machine file stops there.
    Range,
}
