//! Planned blocks of layers in a folder (`--cache`): stopped planning continues where it was.
//!
//! One file for each block, named by its key, written completely or not at all. A damaged one is
//! reported, planned again and replaced. Input: keys and blocks. Output: files and notes. Not covered:
//! removal of blocks that are no longer needed; the user empties the folder.

use crate::api::BlockStore;
use crate::cli::error::CliError;
use crate::cli::terminal::output_file::{check_folder, write_file};
use siphasher::sip128::{Hasher128, SipHasher13};
use std::hash::Hasher;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// A folder of pieces.
pub(crate) struct CacheFolder(PathBuf);

impl CacheFolder {
    /// The folder, made where it is not there.
    pub(crate) fn open(folder: &Path) -> Result<CacheFolder, CliError> {
        check_folder(folder)?;
        std::fs::create_dir_all(folder).map_err(|problem| CliError::File {
            path: folder.display().to_string(),
            problem,
        })?;
        Ok(CacheFolder(folder.to_path_buf()))
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(format!("{name}.piece"))
    }
}

impl BlockStore for CacheFolder {
    fn get(&mut self, name: &str) -> Option<Vec<u8>> {
        match std::fs::read(self.file(name)) {
            Err(problem) if problem.kind() == ErrorKind::NotFound => None,
            // One that cannot be read is as good as damaged.
            read => Some(read.unwrap_or_default()),
        }
    }

    fn put(&mut self, name: &str, block: &[u8]) -> Result<(), String> {
        write_file(&self.file(name), block).map_err(|error| error.to_string())
    }
}

/// The planning program by what it consists of: pieces of another build are not used, those of the same one on another
/// machine are.
pub(crate) fn program() -> String {
    let bytes = std::env::current_exe().and_then(std::fs::read);
    let mut hash = SipHasher13::new();
    hash.write(&bytes.unwrap_or_default());
    format!(
        "{} {:032x}",
        env!("CARGO_PKG_VERSION"),
        hash.finish128().as_u128()
    )
}
