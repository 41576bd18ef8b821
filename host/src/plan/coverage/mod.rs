//! Coverage: what passes cover, what they leave open, and where a nozzle may go between them.
//!
//! ```text
//! LayerPass --raster--------> counts of a cell; areas covered first, again and by one pass (mm²)
//!           --gap_raster----> gaps (cells), gain of a placement (mm²)
//!           --deposited_area> cost of cutting a pass in two (mm²)
//!           --idle_passes---> LayerPass but for those whose ground others cover
//! Configuration, Configuration --connections--> configurations between them, inside the walls
//! ```
//!
//! Leaves out: the figures of a finished plan (`judge`), measured on segments by other code.

pub mod connections;
pub mod deposited_area;
pub mod gap_raster;
pub mod idle_passes;
pub mod raster;
