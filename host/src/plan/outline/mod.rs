//! Outline: the printable part of the input, before anything is planned on it.
//!
//! ```text
//! Region --contour--> Contour --trimmed_outline--> Region --unreachable--> boundary runs
//! (mm, input)         (mm, local origin)           (mm, without what      (mm of boundary with
//!                                                   no aperture enters)    empty F(p))
//! ```
//!
//! `reachable` counts the cells of a raster that some feasible aperture covers, on a grid of
//! clearances. Not covered: repair of invalid input (`geometry::repair`) and keep-outs (`route`).

pub mod clearance_grid;
pub mod contour;
pub mod reachable;
pub mod trimmed_outline;
pub mod unreachable;
