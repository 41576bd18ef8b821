//! curve

pub mod detours;
pub mod heading_stops;
pub mod layer_path;
pub mod plane_curve;
pub mod pushing_inside;
