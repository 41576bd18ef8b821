//! Layers: regions planned one by one, combined into the layers of a job.
//!
//! ```text
//! Contour --region_plan--> RegionPlan --layer_groups--> LayerGroup, RegionPrint, PlanePass
//! (mm, local)              (mm, rad)                    (alike layers once; machine coordinates)
//! passes --one_heading--> the cheaper of those that turn and those of one heading, optimised
//! the plan of the layer next to it --warm_start--> where the optimiser starts on an outline that is nearly the same
//! outline --skirt--> SkirtPlan (loops around the first layer)
//! outlines --bridge_ground--> Bridge (what spans open space, and in which direction)
//! outlines, infill --hollow--> the same of roofs over a sparse or empty inside
//! outlines --shells--> ground that lies open above or below, overhangs
//! ```
//!
//! Not covered: the choice of layers (`layer_stack`, `part_plan`), supports.

pub mod bridge_ground;
pub mod each_kind;
pub mod hollow;
pub mod inside;
pub mod inside_ground;
pub mod layer_groups;
pub mod one_heading;
pub mod optimised_passes;
pub mod region_plan;
pub mod shells;
pub mod skirt;

use crate::geometry::plane_curve::PlaneControl;
use crate::plan::pass::PassKind;
use std::sync::Arc;

/// A pass ready to be printed: its curve in the layer plane.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanePass {
    /// Its kind.
    pub kind: PassKind,
    /// The control points from which on it is of another kind, and that, in order.
    pub then: Vec<(usize, PassKind)>,
    /// Layer from 0.
    pub layer: u32,
    /// Tip height, mm.
    pub z_mm: f64,
    /// Control points (x, y, heading); identical layers share them.
    pub control: Arc<[PlaneControl]>,
}
