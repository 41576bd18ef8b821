//! Waypoints and surfaces on machines whose tool axis tilts.

mod arm_solutions;
mod axis_family;
mod clear_travel;
mod lean;
mod pieces;
mod programs;
mod published_arms;
mod pump_outputs;
mod reach;
mod real_runs;
mod rounded_corners;
mod singular_places;
mod surfaces;
mod waypoints;
mod wrist;
