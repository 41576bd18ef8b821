//! Keys written into a machine file, the file before it kept beside it.
//!
//! In: a machine file that can be read, keys with their values. Out: the file with them, comments kept, and the old one
//! as NAME.before. Leaves out how a key finds its place (`settings/machine_file/edit.rs`).

use crate::cli::error::CliError;
use crate::cli::reading::load;
use crate::cli::terminal::output_file::write_file;
use crate::settings::machine_file::edit;
use std::path::{Path, PathBuf};

/// Group, key and value as TOML.
pub(crate) type Key<'a> = (&'a str, &'a str, String);

/// Writes keys into a machine file that can be read before and after; returns where the old one is.
pub(crate) fn put(path: &Path, keys: &[Key]) -> Result<PathBuf, CliError> {
    let old = load::read_text(path)?;
    load::machine(path)?;
    let mut new = old.clone();
    for (group, key, value) in keys {
        new = edit::with_key(&new, group, key, value)
            .map_err(|refused| CliError::Job(format!("{}: {refused}", path.display())))?;
    }
    load::machine_of(new.clone(), path)?;
    let mut kept = path.as_os_str().to_owned();
    kept.push(".before");
    let kept = PathBuf::from(kept);
    write_file(&kept, old.as_bytes())?;
    write_file(path, new.as_bytes())?;
    Ok(kept)
}
