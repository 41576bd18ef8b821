//! axis

pub mod medial_axis;
pub mod pruned_axis;
pub mod region_cut;
