//! The options of the verdict, with their help: how much of it is shown, what it is compared with, and which
//! objections are allowed.

use clap::{Args, ValueEnum};

/// Objections that do not refuse the job.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Verdict")]
pub(crate) struct AllowArgs {
    /// Objections that do not refuse the job; they are still reported first.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT,...")]
    pub allow: Vec<AllowName>,
    /// Findings that refuse the job, which are only reported otherwise.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT,...")]
    pub refuse: Vec<RefuseName>,
}

/// How much is reported about a job.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Verdict")]
pub(crate) struct VerdictArgs {
    /// All figures and notes, the verdict before and after them.
    #[arg(long)]
    pub figures: bool,
    /// Plan the part with this nozzle as well and compare the times, as in --against circle:0.4.
    #[arg(long, value_name = "APERTURE")]
    pub against: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub(crate) enum RefuseName {
    /// A layer takes longer than --max-layer-time.
    LayerTime,
    /// A curve's outside gets more than --max-outer-inner-ratio times the inside.
    Curves,
    /// An option that planning could not keep, such as --vase.
    Options,
    /// A layer is higher than 0.8 of the narrowest bead.
    LayerHeight,
    /// The flow is more than melt_max_mm3_s of the material.
    Melt,
    /// An area of a layer lies on nothing.
    Floating,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub(crate) enum AllowName {
    /// Nozzle or head collides with the table or the print.
    Touches,
    /// A joint leaves its range: a board with the same machine file stops there.
    Range,
}
