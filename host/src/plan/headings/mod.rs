//! Headings: the rotation of the aperture along a run of contacts.
//!
//! ```text
//! Ring --contacts--> Contact --runs--> runs of contacts --profile--> Placement
//! (mm)               (mm)              (that hold a bead)            (mm, rad, unwrapped)
//! ```
//!
//! `heading_law` and `headings_table` treat one boundary point at a time, as the published method
//! does. Not covered: which walls are to be touched (`beads`).

pub mod contacts;
pub mod heading_law;
pub mod headings_table;
pub mod profile;
pub mod runs;
pub mod stops;
