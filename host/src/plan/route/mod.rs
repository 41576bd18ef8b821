//! Route: all moves of the head, in order, from rest to rest.
//!
//! ```text
//! PlanePass   --flow, travel (keep_out, shortest_path), hop, build_route--> Route
//! (mm, rad)                                                                 (mm, rad, mm³)
//! WaypointRun --waypoint_curve--> PathCurve --waypoint_route--> Route
//! (mm, input)                     (mm, rad, machine coordinates)
//! GcodePass   --bead_headings, bead_curve, gcode_route--> Route
//! (mm, input)                                                     (mm, rad, mm³)
//! ```
//!
//! Not covered: speed (`motion`).

pub mod bead_curve;
pub mod bead_headings;
pub mod build_route;
pub mod clear_travel;
pub mod curve_cuts;
pub mod flow;
pub mod gcode_route;
pub mod hop;
pub mod keep_out;
pub mod lean;
pub mod moves;
pub mod path_curve;
pub mod shortest_path;
pub mod surface;
pub mod told_headings;
pub mod travel;
pub mod waypoint_curve;
pub mod waypoint_route;
pub mod wide_beads;
