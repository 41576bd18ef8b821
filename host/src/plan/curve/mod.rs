//! Curve: from placements to the printed C² curve, with every pose inside the region.
//!
//! ```text
//! LayerPass --heading_stops--> pieces between the nozzle's stops
//!           --layer_path--> control points (mm, rad) --pushing_inside, detours--> PlaneControl
//! ```
//!
//! Not covered: speed (`motion`) and volume (`route`).

pub mod curls;
pub mod detours;
pub mod even_spans;
pub mod heading_stops;
pub mod layer_path;
pub mod optimised_curve;
pub mod pushing_inside;
