//! What wide beads change of a finished route: layers that follow each other without a rest, pumps that run on.
//!
//! ```text
//! Route --continuous, pump--> Route
//! ```

pub mod continuous;
pub mod pump;
