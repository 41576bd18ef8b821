//! A planned job: its segments, the file that holds them, the frames that are sent, its heater commands, and its
//! rest after an interruption.
//!
//! In: a [`SegmentStream`] from the planner. Out: bytes of a job file, frames for a board. Knows no planning, no files
//! and no line.

pub mod file;
mod frame_writer;
pub mod frames;
pub mod heat;
mod machine_parts;
pub mod resume;
pub mod spool;
mod stream;
pub mod transform;
mod units;

pub use stream::{LEAD_IN_SPANS, Mark, MotionState, SegmentStream, StreamFacts, dwell_spans};
