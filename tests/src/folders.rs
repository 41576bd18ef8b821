//! Files beside the checkout and in it that tests go over.
//!
//! Reference data lies beside the checkout and may be missing: then a test says what it skips, or
//! fails where `HEADWAY_DEMAND_DATA` is set, as it is in CI.

use std::path::{Path, PathBuf};

/// Says that `what` is missing and so not tested.
///
/// # Panics
///
/// Where reference data is demanded.
pub fn skipped(what: impl std::fmt::Display) {
    let demanded = std::env::var_os("HEADWAY_DEMAND_DATA").is_some();
    assert!(
        !demanded,
        "HEADWAY_DEMAND_DATA is set, but {what} is not there"
    );
    println!("skipped: {what} is not there");
}

/// The files of a folder with this ending (no dot), in order; none, and said so, where it is not there.
///
/// # Panics
///
/// Where an entry cannot be read, or the folder is missing and demanded.
pub fn files(folder: impl AsRef<Path>, ending: &str) -> Vec<PathBuf> {
    let folder = folder.as_ref();
    let Ok(entries) = std::fs::read_dir(folder) else {
        skipped(folder.display());
        return Vec::new();
    };
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.expect("folder entry").path())
        .filter(|path| path.extension().is_some_and(|e| e == ending))
        .collect();
    files.sort();
    files
}
