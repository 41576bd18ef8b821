mod held_out;
mod metamorphic;
mod noisy_slices;
mod reference_slices;
mod robustness;
