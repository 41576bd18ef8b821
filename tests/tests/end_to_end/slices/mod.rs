//! Real slices and drawn parts, planned whole and judged.

mod held_out;
mod metamorphic;
mod noisy_slices;
mod reference_slices;
mod robustness;
