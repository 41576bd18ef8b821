//! route

pub mod build_route;
pub mod flow;
pub mod keep_out;
pub mod moves;
pub mod path_curve;
pub mod shortest_path;
pub mod travel;
pub mod waypoint_curve;
pub mod waypoint_route;
