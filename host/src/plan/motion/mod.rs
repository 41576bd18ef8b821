//! motion

pub mod joint_limits;
pub mod path_samples;
pub mod segments;
pub mod time_law;
