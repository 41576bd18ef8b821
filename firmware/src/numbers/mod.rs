//! Arithmetic: the number type that servo tick and planner share, and derivatives by it.
//!
//! In: f32 or f64. Out: roots and angles of a stated bound without libm (`real`), values with their derivatives (`jet`).

pub mod jet;
pub mod real;
