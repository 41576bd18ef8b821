//! Planned blocks of layers in a folder.
//!
//! In: blocks by name. Out: a file for each, written completely or not at all, which other machines may read at the same
//! time. Leaves out the removal of blocks that are no longer needed; the user empties the folder.

use headway::api::BlockStore;
use std::path::{Path, PathBuf};

/// A folder of blocks.
pub struct Folder(PathBuf);

impl Folder {
    /// The folder, made where it is not there.
    ///
    /// # Errors
    /// Of making it.
    pub fn open(path: &Path) -> std::io::Result<Folder> {
        std::fs::create_dir_all(path)?;
        Ok(Folder(path.to_path_buf()))
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(format!("{name}.piece"))
    }
}

impl BlockStore for Folder {
    fn get(&mut self, name: &str) -> Option<Vec<u8>> {
        std::fs::read(self.file(name)).ok()
    }

    fn put(&mut self, name: &str, block: &[u8]) -> Result<(), String> {
        // Another worker may write the same block: each its own file, and the last one stays.
        let own = self.0.join(format!("{name}.{}.part", std::process::id()));
        let written =
            std::fs::write(&own, block).and_then(|()| std::fs::rename(&own, self.file(name)));
        written.map_err(|problem| {
            let _ = std::fs::remove_file(&own);
            format!("{}: {problem}", self.0.display())
        })
    }
}
