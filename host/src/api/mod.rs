//! The interface for library users: plan, simulate, stream, export.
//!
//! ```text
//! Part (outline, mesh, path, G-code, surface) + Machine + Options --plan--> Job --simulate--> Simulation
//!                                                                          |--poses, figures, csv, gcode, bytes
//!                                                                          '--stream--> a board
//! ```
//! Semantic versioning covers this module only: within a version `0.x` (later: a major one) names and
//! signatures are only added, which `host/tests/api_surface.txt` checks. **Everything else of this crate
//! is public for the workspace's own tests and changes at any time.** Lengths are in mm, angles in rad,
//! times in s, volumes in mm³, as the names state; coordinates are the part's own. Error messages give
//! the place and a remedy.
//!
//! ```
//! use headway::api::{Machine, Options, Part, plan};
//!
//! let square = vec![[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]];
//! let part = Part::from_polygons("square", &[vec![square]])?;
//! let mut options = Options::default();
//! options.speed_mm_s = Some(40.0);
//! let job = plan(&part, &Machine::default(), &options)?;
//! assert!(job.figure("covered_pct").unwrap() > 90.0);
//! assert_eq!(job.simulate("", 1)?.figure("faults"), Some(0.0));
//! # Ok::<(), headway::api::Error>(())
//! ```

pub(crate) mod blocks;
mod job;
mod joints;
pub(crate) mod part;
mod planning;
mod pose;
mod reach;
pub(crate) mod ready;
mod streaming;

pub use crate::input::Units;
pub use crate::job::MotionState;
pub use crate::pipeline::reach::{
    LeftOutPlace, PartReach, ReachDirection, ReachLevel, ReachOptions,
};
pub use crate::pipeline::shards::{PlannedBlock, PlannedShard};
pub use crate::scan::{
    Change, Estimate, FlowFactor, Measured, MeasuredStation, OffPlace, PictureScale, Registration,
    Scale,
};
pub use crate::settings::curved_layers::CurvedLayers;
pub use crate::settings::directions::Directions;
pub use crate::settings::options::{OPTION_NAMES, Options};
pub use crate::settings::{HeadingLaw, PassMode, Place, Quality, SeamPlace};
pub use blocks::{BlockStore, Cache, plan_shard};
pub use job::{Job, Simulation};
pub use joints::{JobJoint, JobJoints};
pub use part::{Part, Reading};
pub use planning::{Machine, Step, plan, plan_cached, plan_watched};
pub use pose::JobPose;
pub use reach::reach;
pub use streaming::StreamStep;

/// Why something cannot be done; the text gives the place and a remedy.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The outline or path.
    #[error("{0}")]
    Part(String),
    /// The machine file or the options.
    #[error("{0}")]
    Options(String),
    /// The part cannot be planned as requested.
    #[error("{0}")]
    Plan(String),
    /// A job file, or an operation on a job.
    #[error("{0}")]
    Job(String),
    /// The line to the board, or the board.
    #[error("{0}")]
    Line(String),
    /// The progress callback stopped it.
    #[error("stopped on request; nothing is written")]
    Stopped,
}
