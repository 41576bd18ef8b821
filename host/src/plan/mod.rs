//! The planner's stages, in the order of the data: contour, medial axis, passes, headings, route
//! (order, travel, flow), time law, segments. A stage knows the output type of the stage before
//! it, `geometry` and `settings`; none knows a clock, a file or a thread.

pub mod contour;
pub mod medial_axis;
pub mod route;
