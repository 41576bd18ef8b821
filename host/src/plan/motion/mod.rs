//! Motion: the route over time, within every limit, as the segments that are sent.
//!
//! ```text
//! Route --path_samples, joint_limits--> PathSample --time_law--> u at every servo tick
//! (mm, rad, mm³)                        (per joint)   --segments--> SegmentStream (integers, ticks)
//! ```
//!
//! Limits are checked on the quantised segments, in joint space. Not covered: the checks of the
//! executed steps (`drive`).

pub mod best_place;
pub mod box_reach;
pub mod joint_limits;
pub mod joint_turns;
pub mod lift_off;
pub mod motion_error;
pub mod path_samples;
pub mod segments;
pub mod singular;
pub mod time_law;
