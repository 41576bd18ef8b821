//! Job files on disk: reading them, and the figures that need no new planning.

use crate::bed_mesh::{BedMesh, over_bed};
use crate::cli::error::CliError;
use crate::input::names::part_name;
use crate::job::SegmentStream;
use crate::job::file::{self, JobFile, JobSummary};
use crate::job::frames::WireFrames;
use crate::job::transform::PartTransform;
use crate::report::job_texts::{NAME_TEXT, SETTINGS_TEXT};
use crate::settings::{Settings, machine_file};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// A job read back: the stream and what rode along.
#[derive(Clone)]
pub(crate) struct Job {
    pub file: JobFile,
    pub stream: SegmentStream,
    pub transform: PartTransform,
    pub name: String,
    pub settings: Option<Settings>,
}

/// True where the file calls itself a job.
pub(crate) fn is_job(path: &Path) -> bool {
    path.extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case("hwj"))
}

/// Reads and checks a whole job.
pub(crate) fn read(path: &Path) -> Result<Job, CliError> {
    let place = |problem: String| CliError::Job(format!("{}: {problem}", path.display()));
    let file = file::read(&mut open(path)?).map_err(|error| place(error.to_string()))?;
    let stream = file.stream().map_err(|error| place(error.to_string()))?;
    let texts = &file.header.texts;
    Ok(Job {
        stream,
        transform: file.header.transform,
        name: texts
            .get(NAME_TEXT)
            .and_then(|name| part_name(name))
            .unwrap_or_else(|| stem(path)),
        settings: texts
            .get(SETTINGS_TEXT)
            .and_then(|text| machine_file::from_job_toml(text).ok()),
        file,
    })
}

/// Reads header and index only.
pub(crate) fn read_summary(path: &Path) -> Result<JobSummary, CliError> {
    file::read_summary(&mut open(path)?)
        .map_err(|error| CliError::Job(format!("{}: {error}", path.display())))
}

impl Job {
    /// The same job over a bed; it is another one for the board.
    ///
    /// Errors are texts without the mesh's place.
    pub(crate) fn over_bed(mut self, mesh: &BedMesh) -> Result<Job, String> {
        let header = &mut self.file.header;
        let stream = over_bed(&self.stream, mesh, &header.machine);
        let stream = stream.map_err(|error| error.to_string())?;
        let frames = WireFrames::encode(&stream).map_err(|error| error.to_string())?;
        header.start = stream.start;
        header.job = frames.job();
        header.frames = frames.len() as u32;
        header.knots = stream.knots.len() as u32;
        self.file.frames = frames;
        self.stream = stream;
        Ok(self)
    }

    /// Servo rate of the job's machine.
    pub(crate) fn servo_hz(&self) -> f64 {
        f64::from(self.file.header.machine.servo_hz)
    }
}

/// A file to be read from its beginning.
pub(crate) fn open(path: &Path) -> Result<BufReader<File>, CliError> {
    File::open(path)
        .map(BufReader::new)
        .map_err(|problem| CliError::File {
            path: path.display().to_string(),
            problem,
        })
}

/// The file's name without its ending.
pub(crate) fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(
        || "part".to_string(),
        |stem| stem.to_string_lossy().into_owned(),
    )
}
