//! Curve: from placements to the C² curve that is printed, every pose of it inside the region.
//!
//! ```text
//! LayerPass --heading_stops--> pieces between the nozzle's stops
//!           --layer_path--> control points (mm, rad) --pushing_inside, detours--> PlaneControl
//! ```
//!
//! Leaves out: speed (`motion`) and volume (`route`).

pub mod detours;
pub mod even_spans;
pub mod heading_stops;
pub mod layer_path;
pub mod pushing_inside;
