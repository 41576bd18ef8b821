//! Headway's host side: plans the motion of turned nozzles, simulates it, streams it.
#![forbid(unsafe_code)]

pub mod cli;
pub mod drive;
pub mod geometry;
pub mod input;
pub mod job;
pub mod job_file;
pub mod part_transform;
pub mod plan;
pub mod report;
pub mod settings;
pub mod wire_frames;
