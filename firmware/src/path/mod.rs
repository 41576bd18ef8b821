//! Knots -> targets of the motors at any segment time.
//!
//! ```text
//! knots -> spline -> load -> queue -> interpolator -> joints
//!          spans     demands  ceilings  offsets, f32    targets, 2^-31 steps
//!                    of joints          and exact bases (joint_channels)
//! ```
//! In: received knots, with their durations in servo ticks. Out: at a segment time (2^-16 ticks) the target of every
//! joint, and its soft limits; for each span its demands on the joints. Not covered: the rate of segment time
//! (`motion`).

pub mod interpolator;
pub mod joint_channels;
pub mod joints;
pub mod load;
pub mod queue;
pub mod spline;
