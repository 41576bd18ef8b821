//! Beads: how one region is divided into channels and runs, each with its placements.
//!
//! ```text
//! Region, Axis --division (by t_join)--> one bead or two sides, a link of the axis each
//!   one bead:  --single_bead_paths--> paths along the axis --single_bead_runs--> runs, pieces cut off
//!   the rest:  --bead_count--> k beads across --field--> level curves (mm) --channel_walls--> walls
//!   all:       --passes--> LayerPass (mm, rad), unordered
//! open ground  --infill--> LayerPass of straight lines
//! ```
//!
//! Not covered: printing order and connections (`joining`).

pub mod bead_count;
pub mod channel_walls;
pub mod division;
pub mod field;
pub mod infill;
pub mod passes;
pub mod single_bead_paths;
pub mod single_bead_runs;
pub mod t_join;
