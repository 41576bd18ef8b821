//! The files that a command's options name: those that it reads, which none of its outputs may be, and those
//! that it writes, each of which is another one.
//!
//! In: the parsed options. A path is read unless its option is an [`OutputPath`], so that a new option needs no entry
//! here; files that an aperture, `--axes` or a machine file names are read too. A file is known by its device and
//! number, elsewhere than on Unix by its real path.
//!
//! [`OutputPath`]: crate::cli::args::output_path::OutputPath

use crate::cli::args::board::Place;
use crate::cli::error::CliError;
use crate::settings::aperture_text::file_of_aperture;
use crate::settings::axes_words::{AxesWords, MachineWord};
use clap::ArgMatches;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Longest file that is looked through for names of further files: no machine file is longer.
const MACHINE_BYTES_MAX: u64 = 1_000_000;

/// The files of one command.
#[derive(Debug, Default)]
pub(crate) struct NamedFiles {
    inputs: Vec<(PathBuf, FileIdentity)>,
    outputs: Mutex<Vec<FileIdentity>>,
    /// Files that are no results are replaced too (`--force`).
    pub force: bool,
}

/// What makes two names one file.
#[derive(Clone, Debug, PartialEq)]
enum FileIdentity {
    /// Device and number.
    #[cfg(unix)]
    Node(u64, u64),
    /// Of a file that is not there yet.
    Place(PathBuf),
}

impl FileIdentity {
    fn of(path: &Path) -> FileIdentity {
        #[cfg(unix)]
        if let Ok(known) = std::fs::metadata(path) {
            use std::os::unix::fs::MetadataExt;
            return FileIdentity::Node(known.dev(), known.ino());
        }
        let beside = || Some(parent(path).canonicalize().ok()?.join(path.file_name()?));
        let place = path.canonicalize().ok().or_else(beside);
        FileIdentity::Place(place.unwrap_or_else(|| path.to_path_buf()))
    }
}

impl NamedFiles {
    /// The files of a command and of the ones below it.
    pub(crate) fn of(matches: &ArgMatches, force: bool) -> NamedFiles {
        let mut files = NamedFiles {
            force,
            ..NamedFiles::default()
        };
        let mut level = Some(matches);
        while let Some(matches) = level {
            for id in matches.ids().map(clap::Id::as_str) {
                values(matches, id).for_each(|path: &PathBuf| files.read(path));
                let logs = values(matches, id).filter_map(|place| match place {
                    Place::Log(path) => Some(path),
                    Place::Pass(_) | Place::Layer(_) => None,
                });
                logs.for_each(|path| files.read(path));
                let texts = values::<String>(matches, id);
                let named = texts.flat_map(|text| [polygon_in(text), machine_in(text)]);
                named.flatten().for_each(|path| files.read(&path));
            }
            level = matches.subcommand().map(|(_, below)| below);
        }
        files
    }

    /// Adds a file that is read, and those that it names.
    fn read(&mut self, path: &Path) {
        let identity = FileIdentity::of(path);
        if self.inputs.iter().any(|(_, of)| *of == identity) {
            return;
        }
        self.inputs.push((path.to_path_buf(), identity));
        // A pipe is read once, by the command.
        let known = std::fs::metadata(path).ok();
        let short = known.filter(|known| known.is_file() && known.len() <= MACHINE_BYTES_MAX);
        let text = short.and_then(|_| std::fs::read_to_string(path).ok());
        let table: Option<toml::Table> = text.and_then(|text| text.parse().ok());
        let table = table.unwrap_or_default();
        let value = |group: &str, key: &str| Some(table.get(group)?.get(key)?.as_str()?.to_owned());
        if let Some(polygon) = value("print", "aperture").as_deref().and_then(polygon_in) {
            self.read(&parent(path).join(polygon));
        }
        if let Some(machine) = value("gcode", "axes").as_deref().and_then(machine_in) {
            self.read(&machine);
        }
    }

    /// Takes a file for an output.
    ///
    /// # Errors
    /// It is read by this command, or is another output of it.
    pub(crate) fn claim(&self, path: &Path) -> Result<(), CliError> {
        let identity = FileIdentity::of(path);
        let output = path.display();
        if let Some((input, _)) = self.inputs.iter().find(|(_, of)| *of == identity) {
            let why = match input == path {
                true => "read by this command".to_string(),
                false => format!(
                    "the same file as {}, which this command reads",
                    input.display()
                ),
            };
            return Err(CliError::Usage(format!(
                "{output}: is {why}, so it is not written; name another file for the output"
            )));
        }
        let mut outputs = self.outputs.lock().unwrap_or_else(PoisonError::into_inner);
        if outputs.contains(&identity) {
            return Err(CliError::Usage(format!(
                "{output}: is named for two outputs; name another file for one of them"
            )));
        }
        outputs.push(identity);
        Ok(())
    }
}

/// Values of an option, if they are of this type.
fn values<'a, T: Clone + Send + Sync + 'static>(
    matches: &'a ArgMatches,
    id: &str,
) -> impl Iterator<Item = &'a T> {
    let values = matches.try_get_many::<T>(id).ok().flatten();
    values.into_iter().flatten()
}

/// The file of an aperture's corners.
fn polygon_in(text: &str) -> Option<PathBuf> {
    file_of_aperture(text).map(PathBuf::from)
}

/// The machine file in the words of `--axes`.
fn machine_in(text: &str) -> Option<PathBuf> {
    match AxesWords::parse(text).ok()?.machine? {
        MachineWord::File(file) => Some(PathBuf::from(file)),
        MachineWord::Own => None,
    }
}

/// The folder of a file.
pub(super) fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}
