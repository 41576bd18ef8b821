//! beads

pub mod bead_count;
pub mod channel_walls;
pub mod division;
pub mod field;
pub mod infill;
pub mod passes;
pub mod single_bead_paths;
pub mod single_bead_runs;
pub mod t_join;
