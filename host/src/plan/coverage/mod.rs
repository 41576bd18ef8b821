//! Coverage: what passes cover, what they leave open, and where a nozzle may go between them.
//!
//! ```text
//! LayerPass --visits--------> passes a cell (count)
//!           --gap_raster----> gaps (cells), gain of a placement (mm²)
//!           --nearby_passes-> area that a connection would cover again (mm²)
//!           --deposited_area> cost of cutting a pass in two (mm²)
//!           --pass_ends-----> LayerPass, cut back where others cover the ground
//! Configuration, Configuration --connections--> configurations between them, inside the walls
//! ```
//!
//! Leaves out: the figures of a finished plan (`judge`), measured on segments by other code.

pub mod connections;
pub mod deposited_area;
pub mod gap_raster;
pub mod nearby_passes;
pub mod pass_ends;
pub mod visits;
