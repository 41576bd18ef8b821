//! A job on its way to its file: packed, checked against the limits and timed as its pieces come.
//!
//! Input: pieces of a stream, of whatever planned it. Output: the job's frames in a file without a
//! name, so that nothing of it is left behind, and what the figures need of the motion.

use super::CliError;
use super::output_file::nameless_file;
use crate::drive::limits::{LimitFigures, LimitTally};
use crate::drive::time_by_limit::{TimeByLimit, TimeTally};
use crate::job::SegmentStream;
use crate::job_spool::{JobSpool, SpooledJob};
use crate::settings::Settings;
use std::fs::File;
use std::path::{Path, PathBuf};

/// The job so far.
pub(super) struct PlannedJob {
    /// Where it will be written.
    output: PathBuf,
    spool: Option<JobSpool<File>>,
    limits: LimitTally,
    times: TimeTally,
}

/// A whole job.
pub(super) struct PackedJob {
    pub frames: SpooledJob<File>,
    pub limits: LimitFigures,
    pub times: TimeByLimit,
}

impl PlannedJob {
    /// A job that will be written there.
    pub(super) fn new(output: &Path) -> PlannedJob {
        PlannedJob {
            output: output.to_path_buf(),
            spool: None,
            limits: LimitTally::default(),
            times: TimeTally::default(),
        }
    }

    /// Nothing was taken yet.
    pub(super) fn is_empty(&self) -> bool {
        self.spool.is_none()
    }

    /// Takes the next piece.
    pub(super) fn take(
        &mut self,
        piece: &SegmentStream,
        first_pass: u32,
        settings: &Settings,
    ) -> Result<(), CliError> {
        let spool = match &mut self.spool {
            Some(spool) => spool,
            none => none.insert(JobSpool::new(nameless_file(&self.output)?)),
        };
        let settings = Settings {
            machine: piece.machine(&settings.machine),
            ..settings.clone()
        };
        let (limits, times) = (&mut self.limits, &mut self.times);
        let added = spool.add(piece, first_pass);
        rayon::join(
            || limits.add(piece, &settings),
            || times.add(piece, &settings),
        );
        added.map_err(|error| CliError::Job(error.to_string()))
    }

    /// All of it.
    pub(super) fn finish(self, settings: &Settings) -> Result<PackedJob, CliError> {
        let spool = match self.spool {
            Some(spool) => spool,
            None => JobSpool::new(nameless_file(&self.output)?),
        };
        let frames = spool.finish();
        Ok(PackedJob {
            frames: frames.map_err(|error| CliError::Job(error.to_string()))?,
            limits: self.limits.figures,
            times: self.times.finish(settings),
        })
    }
}
