//! layers

pub mod layer_groups;
pub mod region_plan;
pub mod skirt;
