//! Edits of a machine file, the file before each kept beside it.
//!
//! In: a machine file that can be read, keys with their values, or its new text. Out: the file with them, comments kept, and
//! the old one under a name that no file had. Leaves out how a key finds its place (`settings/machine_file/edit.rs`).

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
    replace(path, [&old, &new], ".before")
}

/// Writes the new text if it can be read; returns where the old one is, `FILE.ending` or with numbers.
pub(crate) fn replace(
    path: &Path,
    [old, new]: [&str; 2],
    ending: &str,
) -> Result<PathBuf, CliError> {
    load::machine_of(new.to_string(), path)?;
    let kept = free_name(path, ending);
    write_file(&kept, old.as_bytes())?;
    write_file(path, new.as_bytes())?;
    Ok(kept)
}

/// The name with this ending, or with numbers if there is one already.
fn free_name(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_os_string();
    name.push(ending);
    while Path::new(&name).symlink_metadata().is_ok() {
        name.push("2");
    }
    PathBuf::from(name)
}
