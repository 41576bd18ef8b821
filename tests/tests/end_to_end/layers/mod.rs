//! Layers: covered, filled, bridged, stacked, kept out of.

mod bead_wide_walls;
mod blocks;
mod bridges;
mod infill;
mod keep_out;
mod method_figures;
mod one_bead_or_two;
mod stacks;
mod told_ground;
mod vases;
mod volume;
