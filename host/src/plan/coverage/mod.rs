//! Coverage: the area that passes cover, the area that they leave uncovered, and where a nozzle may
//! move between them.
//!
//! ```text
//! LayerPass --raster--------> counts of a cell; areas covered first, again and by one pass (mm²)
//!           --gap_raster----> gaps (cells), gain of a placement (mm²)
//!           --deposited_area> cost of cutting a pass in two (mm²)
//!           --idle_passes---> LayerPass but for those whose ground others cover
//! Configuration, Configuration --connections--> configurations between them, inside the walls
//! ```
//!
//! Not covered: the figures of a finished plan (`judge`), measured on segments by other code.

pub mod connections;
pub mod deposited_area;
pub mod gap_raster;
pub mod idle_passes;
pub mod raster;
