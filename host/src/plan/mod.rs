//! The planner's stages, in the order of the data.

pub mod pass;
pub mod progress;

pub mod axis;
pub mod beads;
pub mod coverage;
pub mod curve;
pub mod feasible;
pub mod headings;
pub mod joining;
pub mod judge;
pub mod layers;
pub mod motion;
pub mod outline;
pub mod route;
