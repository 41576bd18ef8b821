//! What library users build on: plan, simulate, stream, export.
//!
//! ```text
//! Part (outline, mesh, path, G-code, surface) + Machine + Options --plan--> Job --simulate--> Simulation
//!                                                                          |--poses, figures, csv, gcode, bytes
//!                                                                          '--stream--> a board
//! ```
//! This module is what semantic versioning covers: within a version `0.x` (later: a major one) its names
//! and signatures only grow, held by `host/tests/api_surface.txt`. **Everything else of this crate is
//! public for the workspace's own tests and changes at any time.** Lengths in mm, angles in rad, times in
//! s, volumes in mm³, in the names; coordinates are the part's own. Errors are texts with the place and
//! what to do.
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

mod job;
mod joints;
mod part;
mod planning;
mod pose;
mod streaming;

pub use crate::input::Units;
pub use crate::job::MotionState;
pub use crate::settings::curved_layers::CurvedLayers;
pub use crate::settings::options::{OPTION_NAMES, Options};
pub use crate::settings::{HeadingLaw, PassMode, Place, Quality, SeamPlace};
pub use job::{Job, Simulation};
pub use joints::{JobJoint, JobJoints};
pub use part::{Part, Reading};
pub use planning::{Machine, Step, plan, plan_watched};
pub use pose::JobPose;
pub use streaming::StreamStep;

/// Why something cannot be done; the text names the place and what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The outline or path.
    #[error("{0}")]
    Part(String),
    /// The machine file or the options.
    #[error("{0}")]
    Options(String),
    /// The part cannot be planned as asked.
    #[error("{0}")]
    Plan(String),
    /// A job file, or what is to be made of a job.
    #[error("{0}")]
    Job(String),
    /// The line to the board, or the board.
    #[error("{0}")]
    Line(String),
    /// Whoever watched wanted no more.
    #[error("stopped as asked; nothing is written")]
    Stopped,
}
