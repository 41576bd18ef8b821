//! A file whose contents outlast a power cut, but for the last second or two.
//!
//! Writes go into a buffer as ever; a thread of its own asks the system once a second to put what was flushed onto
//! the disk, so that whoever writes never waits for one.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// How often the disk is asked.
const SYNC: Duration = Duration::from_secs(1);

/// A buffered file.
#[derive(Debug)]
pub struct SyncedFile {
    out: BufWriter<File>,
    /// Dropped, it ends the thread.
    lives: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl SyncedFile {
    /// Creates the file, and its name in the folder, on the disk.
    ///
    /// # Errors
    /// What the system says.
    pub fn create(path: &Path) -> io::Result<SyncedFile> {
        let file = File::create(path)?;
        file.sync_all()?;
        let folder = path
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty());
        // Not every system opens folders; the name then is as lasting as it makes it.
        if let Ok(folder) = File::open(folder.unwrap_or(Path::new("."))) {
            let _ = folder.sync_all();
        }
        let (lives, ends) = channel::<()>();
        let synced = file.try_clone()?;
        let thread = std::thread::spawn(move || {
            loop {
                let waited = ends.recv_timeout(SYNC);
                // A disk that fails is told by the next write.
                let _ = synced.sync_data();
                if waited != Err(RecvTimeoutError::Timeout) {
                    return;
                }
            }
        });
        Ok(SyncedFile {
            out: BufWriter::new(file),
            lives: Some(lives),
            thread: Some(thread),
        })
    }
}

impl Write for SyncedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.out.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

impl Drop for SyncedFile {
    fn drop(&mut self) {
        let _ = self.out.flush();
        self.lives = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
