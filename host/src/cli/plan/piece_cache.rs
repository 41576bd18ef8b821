//! Planned blocks of layers in a folder (`--cache`): stopped planning continues where it was.
//!
//! One file for each block, named by its key, written completely or not at all. A damaged one is
//! reported, planned again and replaced. Input: keys and blocks. Output: files and notes. Not covered:
//! removal of blocks that are no longer needed; the user empties the folder.

use crate::cli::error::CliError;
use crate::cli::terminal::output_file::{check_folder, write_file};
use crate::pipeline::piece::{Piece, PieceCache};
use siphasher::sip128::{Hasher128, SipHasher13};
use std::hash::Hasher;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// A folder of pieces, or none.
pub(crate) struct CacheFolder {
    folder: Option<PathBuf>,
    /// Notes for the user.
    pub notes: Vec<String>,
    /// Pieces that were there.
    pub found: usize,
}

impl CacheFolder {
    /// The folder, made where it is not there.
    pub(crate) fn open(folder: Option<&Path>) -> Result<CacheFolder, CliError> {
        if let Some(folder) = folder {
            check_folder(folder)?;
            std::fs::create_dir_all(folder).map_err(|problem| CliError::File {
                path: folder.display().to_string(),
                problem,
            })?;
        }
        Ok(CacheFolder {
            folder: folder.map(Path::to_path_buf),
            notes: Vec::new(),
            found: 0,
        })
    }
}

/// File of a piece.
fn file_of(folder: &Path, key: u128) -> PathBuf {
    folder.join(format!("{key:032x}.piece"))
}

impl PieceCache for CacheFolder {
    /// False as well after a block could not be written.
    fn keeps(&self) -> bool {
        self.folder.is_some()
    }

    fn get(&mut self, key: u128) -> Option<Piece> {
        let path = file_of(self.folder.as_ref()?, key);
        let problem = match std::fs::read(&path) {
            Ok(bytes) => match Piece::from_bytes(&bytes) {
                Some(piece) => {
                    self.found += 1;
                    return Some(piece);
                }
                None => "is damaged".to_string(),
            },
            Err(problem) if problem.kind() == ErrorKind::NotFound => return None,
            Err(problem) => format!("cannot be read ({problem})"),
        };
        let file = path.display();
        self.notes
            .push(format!("{file} {problem}: its layers are planned again"));
        None
    }

    fn put(&mut self, key: u128, piece: &Piece) {
        let Some(folder) = &self.folder else {
            return;
        };
        let path = file_of(folder, key);
        let written = match piece.to_bytes() {
            Some(bytes) => write_file(&path, &bytes).map_err(|error| error.to_string()),
            None => Err("the piece cannot be packed".to_string()),
        };
        if let Err(why) = written {
            self.notes
                .push(format!("pieces are no longer kept in --cache: {why}"));
            // Told once; planning does without.
            self.folder = None;
        }
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
