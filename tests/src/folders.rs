//! Files beside the checkout and in it that tests go over.

use std::path::{Path, PathBuf};

/// The files of a folder with this ending (no dot), in order; none, and said so, where it is not there.
///
/// # Panics
///
/// Where an entry cannot be read.
pub fn files(folder: impl AsRef<Path>, ending: &str) -> Vec<PathBuf> {
    let folder = folder.as_ref();
    let Ok(entries) = std::fs::read_dir(folder) else {
        println!("skipped: {} is not there", folder.display());
        return Vec::new();
    };
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.expect("folder entry").path())
        .filter(|path| path.extension().is_some_and(|e| e == ending))
        .collect();
    files.sort();
    files
}
