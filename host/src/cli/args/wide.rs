//! The options of wide beads, with their help.

use clap::Args;

/// What wide beads of clay, concrete and pellets ask for.
#[derive(Clone, Debug, Default, PartialEq, Args)]
pub(crate) struct WideArgs {
    /// Most time of a layer, s: longer ones are reported, since their joints are cold; --refuse layer-time
    /// refuses the job [default: 0, any].
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub max_layer_time: Option<f64>,
    /// Most that a wide bead may lay on the outside of a curve against the inside, as in 1.2 for concrete: paths are
    /// rounded for it where they can be [default: 0, any].
    #[arg(long, value_name = "RATIO", allow_negative_numbers = true)]
    pub max_outer_inner_ratio: Option<f64>,
    /// Layers of one closed bead rise along it and follow each other without a rest (vase mode); walls of a solid part
    /// with --walls 1 --infill-density 0 --top 0.
    #[arg(long, visible_alias = "vase")]
    pub continuous_z: bool,
}
