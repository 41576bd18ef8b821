//! Changes to a finished route for wide beads: layers that follow each other without a rest, pumps that run on.
//!
//! ```text
//! Route --continuous, pump--> Route
//! ```

pub mod continuous;
pub mod pump;
mod seam;
