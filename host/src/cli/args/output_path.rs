//! The type of options that name a result: all other options that are paths name files that are read.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A file or folder that a command writes, as it is named; it is written only once it is checked.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OutputPath(PathBuf);

impl From<OsString> for OutputPath {
    fn from(name: OsString) -> OutputPath {
        OutputPath(name.into())
    }
}

impl From<PathBuf> for OutputPath {
    fn from(path: PathBuf) -> OutputPath {
        OutputPath(path)
    }
}

impl OutputPath {
    /// The name, for others that are made from it.
    pub(crate) fn name(&self) -> &Path {
        &self.0
    }
}
