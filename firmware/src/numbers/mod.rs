//! Arithmetic: the number type that servo tick and planner share, and derivatives with it.
//!
//! In: f32 or f64. Out: roots and angles with a stated error bound, without libm (`real`), values with their
//! derivatives (`jet`).

pub mod jet;
pub mod real;
