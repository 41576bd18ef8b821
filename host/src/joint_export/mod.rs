//! The joints of a job over time, for controllers and programs that accept joints instead of poses.
//!
//! ```text
//! SegmentStream, machine --samples--> JointSample --tables--> CSV, JSON
//!                                                 '--trajectory--> JointTrajectory of ROS 2
//! ```
//! In: a finished stream, machine coordinates. Out: joint positions in mm and rad with their first two derivatives,
//! continuous (a joint that turns without end counts its turns), at even steps of time and at the exact end. They are
//! the planned joints: before the input shapers of a machine file, and without the constant delay between a pose and
//! its steps. Not covered: the extruder's motor; the deposited volume is given with the joints.

pub mod samples;
pub mod tables;
pub mod trajectory;
