//! outline

pub mod clearance_grid;
pub mod contour;
pub mod reachable;
pub mod trimmed_outline;
pub mod unreachable;
