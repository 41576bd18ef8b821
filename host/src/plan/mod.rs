//! The planner's stages, in the order of the data.
//!
//! ```text
//! Region --outline--> Contour --axis--> Axis --headings, coverage, beads--> LayerPass
//! (mm)                (mm, local)       (mm)                                (mm, rad)
//!   --joining, the optimiser--> passes in printing order --curve--> PlaneControl --layers--> PlanePass
//!                                (mm, rad)                           (mm, rad)       (machine coordinates)
//!   --route--> Route --motion--> SegmentStream --judge--> PlanFigures
//!              (mm, rad, mm³)    (integers, ticks)        (%, mm, s)
//! ```
//!
//! A stage imports only from the stages above it in the list below (a test reads the `use` lines), from
//! `headway_geometry`, `headway_optimiser` and `settings`; none knows a clock, a file or a thread. `pass` has the
//! types that the stages hand on.

pub mod pass;
pub mod pose_limits;
pub mod progress;

pub mod feasible;
pub mod outline;

pub mod axis;

pub mod headings;

pub mod coverage;

pub mod beads;

pub mod joining;

pub mod curve;

pub mod layers;

pub mod route;

pub mod motion;

pub mod judge;
