//! Input -> plan -> findings -> bytes of a job: the pipeline of each kind of input, and their common parts.
//!
//! ```text
//! outline ---+
//! surface ---+--> stack: contour, axis, headings, beads, joining, curve, layers, route --+
//! mesh ------+    (a prism at once, a part a few layers at a time: piece)                 |
//! waypoints ------> placed_passes ---------------------------------------------- route --+--> segments --> judge
//! gcode ------------------------------------------------------------------------ route --+    (SegmentStream) |
//! (replan: regions of its beads by the stack, other beads by gcode)                       |
//!                                                                  job's bytes <-- packing <-- findings <-----+
//! ```
//! The stages are in [`crate::plan`]; this module has their order for each kind of input. It knows no files, no
//! terminal and no line.

mod blocks;
pub mod centre_lines;
mod error;
pub mod findings;
pub mod gcode;
mod gcode_heat;
mod gcode_touches;
pub mod layer_time;
pub mod layer_uses;
mod links;
pub mod mesh;
pub mod open_ground;
mod outline;
pub mod packing;
pub mod page;
pub mod part_body;
pub mod pass_facts;
pub mod piece;
pub mod pieces;
mod placed_part;
mod placed_passes;
mod plan;
pub mod planned;
pub mod reach;
pub mod replan;
pub mod roofs;
pub mod shards;
pub mod stack;
pub mod stacked_ground;
mod stop_room;
pub mod surface;
pub mod two_bead_walls;
mod waypoints;

pub use error::PlanError;
pub use outline::{plan_target, plan_target_around};
pub use plan::Plan;
pub use waypoints::{plan_waypoints, plan_waypoints_with_progress};

use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS};

/// Where the head waits before a job: the work area's corner, lifted.
pub(crate) fn start_pose(settings: &Settings) -> [f64; CHANNELS] {
    let [low, _] = settings.work_area_mm;
    let mut pose = [0.0; CHANNELS];
    pose[CHANNEL_X] = low[0];
    pose[CHANNEL_Y] = low[1];
    pose[CHANNEL_Z] = low[2] + settings.layer_height_mm + settings.lift_mm;
    pose
}
