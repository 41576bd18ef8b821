//! Axis: the interior medial axis with its radii, and the part of it that passes are planned on.
//!
//! ```text
//! EdgeIndex --medial_axis--> MedialAxis --pruned_axis--> Axis
//! (mm)                       (points, radii, mm)         (graph of short links, mm)
//! ```
//!
//! `region_cut` cuts a region along chords between the feet of an axis point. Not covered: the
//! number of beads across it (`beads`).

pub mod medial_axis;
pub mod pruned_axis;
pub mod region_cut;
