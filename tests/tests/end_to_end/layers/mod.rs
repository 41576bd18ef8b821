mod bridges;
mod infill;
mod keep_out;
mod method_figures;
mod stacks;
mod volume;
