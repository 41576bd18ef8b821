//! Layers: covered, filled, bridged, stacked, kept out of.

mod blocks;
mod bridges;
mod infill;
mod keep_out;
mod method_figures;
mod stacks;
mod volume;
