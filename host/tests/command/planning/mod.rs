//! What the command makes of its inputs, and what it refuses.

mod api;
mod awkward;
mod centre_lines;
mod copies;
mod curved_layers;
mod directions;
mod dxf;
mod gcode;
mod gcode_axes;
mod idle_options;
mod joined_kinds;
mod meshes;
mod projects;
mod reach;
mod replan;
mod start_blocks;
mod surfaces;
mod wide_beads;
