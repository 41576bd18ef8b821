//! coverage

pub mod connections;
pub mod deposited_area;
pub mod gap_raster;
pub mod nearby_passes;
pub mod pass_ends;
pub mod visits;
