//! Headway's host side: plans the motion of turned nozzles, simulates it, streams it.
//!
//! ```text
//! Target --contour--> Contour --hull--> Region --medial axis--> MedialAxis --prune--> Axis
//!  (mm)               (mm, local)       (mm, local)             (mm)                  (mm)
//!    --passes--> LayerPass --order--> LayerGroup --layers--> PlanePass
//!                (mm, rad)            (mm, rad)            (mm, rad, machine coordinates)
//!    --route--> Route --time law, segments--> SegmentStream --measure--> Figures
//!               (mm, rad, mm³)                (integer units, servo ticks)
//! WaypointRun --curve--> PathCurve --route--> Route, and on as above
//! Mesh --flattened--> chart; Target in it --as above--> Route --on surface--> Route (mm, rad, tool axis), and on as above
//! GcodeProgram --route--> Route, layer by layer
//! ```
//!
//! [`input`], [`mesh`] and [`gcode`] read; [`pipeline`] takes each kind of input through the stages of [`plan`];
//! [`job`] is the result; [`drive`] moves the finished stream, [`report`] draws and tabulates, `cli` is the command
//! (feature `command`).
//!
//! **Library users build on [`api`]**: semantic versioning covers that module and nothing else here.
#![forbid(unsafe_code)]

pub mod api;
pub mod bed_mesh;
pub mod calibration;
#[cfg(feature = "command")]
pub mod cli;
pub mod drive;
pub mod gcode;
pub mod input;
pub mod job;
pub mod joint_export;
pub mod mesh;
pub mod pipeline;
pub mod plan;
pub mod programs;
pub mod report;
pub mod scan;
pub mod settings;
pub mod text;

pub use headway_geometry as geometry;
pub use headway_reach as reach;
pub use pipeline::{
    Plan, PlanError, plan_target, plan_target_around, plan_waypoints, plan_waypoints_with_progress,
};
