//! The planner's stages, in the order of the data: contour, medial axis, passes, headings, route
//! (order, travel, flow), time law, segments. A stage knows the output type of the stage before
//! it, `geometry` and `settings`; none knows a clock, a file or a thread.

pub mod bead_count;
pub mod beads;
pub mod bridge_cost;
pub mod bridges;
pub mod build_route;
pub mod by_place;
pub mod chains;
pub mod channel_walls;
pub mod contacts;
pub mod contour;
pub mod darts;
pub mod ends;
pub mod feasible;
mod feasible_polygon;
pub mod field;
pub mod figures;
pub mod flow;
mod gap_raster;
pub mod heading_law;
pub mod heading_profile;
pub mod headings_table;
pub mod infill;
pub mod inner_hull;
pub mod joint_limits;
pub mod keep_out;
pub mod layer_path;
pub mod links;
pub mod measure;
pub mod medial_axis;
pub mod order;
pub mod passes;
pub mod path_curve;
pub mod path_samples;
pub mod printed_order;
pub mod progress;
pub mod reachable;
pub mod region_plan;
pub mod room;
pub mod route;
mod runs;
pub mod seam;
pub mod segments;
pub mod single_runs;
pub mod skeleton;
pub mod skirt;
pub mod stack;
#[cfg(test)]
mod test_passes;
pub mod time_law;
pub mod travel_route;
pub mod travel_ways;
pub mod unreachable;
pub mod visits;
pub mod waypoint_curve;
pub mod waypoint_route;
