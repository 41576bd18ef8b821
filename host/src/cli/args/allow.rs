//! The options of the verdict, with their help: how much of it is shown, what it is compared with, and which
//! objections are allowed.

use clap::{Args, ValueEnum};

/// What is taken although it is not good.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Verdict")]
pub(crate) struct AllowArgs {
    /// What does not refuse the job, though it is still the first thing that is said of it.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT,...")]
    pub allow: Vec<AllowName>,
    /// What refuses the job, though it is only reported else.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT,...")]
    pub refuse: Vec<RefuseName>,
}

/// How much is said of a job.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Verdict")]
pub(crate) struct VerdictArgs {
    /// All figures and notes, the verdict before and after them.
    #[arg(long)]
    pub figures: bool,
    /// Plan the part with this nozzle as well and say how its time compares, as in --against circle:0.2.
    #[arg(long, value_name = "APERTURE")]
    pub against: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub(crate) enum RefuseName {
    /// A layer takes longer than --max-layer-time.
    LayerTime,
    /// A curve's outside gets more than --max-outer-inner-ratio times the inside.
    Curves,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub(crate) enum AllowName {
    /// Nozzle or head touches the table or the print.
    Touches,
    /// A joint leaves its range: a board with the same machine file stops there.
    Range,
}
