//! A file whose contents survive a power failure, except for the last second or two, and which is marked where it
//! ends early.
//!
//! Writes go into a buffer as usual; a thread of its own syncs flushed data to disk once a second, so that the
//! writer never waits for the disk. The first error of either ends the file: a final message overwrites its last
//! complete lines, where a full disk has room for it, and nothing more is written.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Period of syncs.
const SYNC: Duration = Duration::from_secs(1);
/// What waits in memory at most before it is written.
const BUFFER_BYTES: usize = 8192;
/// Bytes at the end in which a whole line is searched: longer than any line.
const TAIL_BYTES: u64 = 300_000;

/// A buffered file.
#[derive(Debug)]
pub struct SyncedFile {
    file: File,
    buffer: Vec<u8>,
    /// Line that ends a file which could not be written to its end; `None` once it is written.
    last_words: Option<&'static str>,
    /// Result of syncing.
    lost: Arc<Mutex<Option<io::Error>>>,
    /// Dropped, it ends the thread.
    lives: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl SyncedFile {
    /// Creates the file, and its name in the folder, on the disk. `last_words` is the line (without its end) with
    /// which it ends if it cannot be written any further.
    ///
    /// # Errors
    /// The system's error.
    pub fn create(path: &Path, last_words: &'static str) -> io::Result<SyncedFile> {
        let mut options = File::options();
        options.read(true).write(true).create(true).truncate(true);
        let file = options.open(path)?;
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
        let lost = Arc::new(Mutex::new(None));
        let found = lost.clone();
        let thread = std::thread::spawn(move || {
            loop {
                let waited = ends.recv_timeout(SYNC);
                // The system reports it once: it is kept for the next write.
                if let Err(error) = synced.sync_data() {
                    let mut lost = found.lock().unwrap_or_else(PoisonError::into_inner);
                    lost.get_or_insert(error);
                }
                if waited != Err(RecvTimeoutError::Timeout) {
                    return;
                }
            }
        });
        Ok(SyncedFile {
            file,
            buffer: Vec::with_capacity(2 * BUFFER_BYTES),
            last_words: Some(last_words),
            lost,
            lives: Some(lives),
            thread: Some(thread),
        })
    }

    fn write_buffer(&mut self) -> io::Result<()> {
        if self.last_words.is_none() {
            self.buffer.clear();
            return Err(io::Error::other("the file has ended"));
        }
        let mut lost = self.lost.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = lost.take();
        drop(lost);
        let written = kept.map_or(Ok(()), Err);
        let written = written.and_then(|()| self.file.write_all(&self.buffer));
        // What was written in part is not written again.
        self.buffer.clear();
        if written.is_err()
            && let Some(words) = self.last_words.take()
        {
            // If not even that can be written the file ends as after a power failure.
            let _ = end_with(&mut self.file, words);
        }
        written
    }
}

/// Ends the file with this line in place of its last whole lines, so that it needs no more of the disk than it has.
fn end_with(file: &mut File, words: &str) -> io::Result<()> {
    let words = format!("{words}\n");
    let length = file.seek(SeekFrom::End(0))?;
    let from = length.saturating_sub(TAIL_BYTES);
    file.seek(SeekFrom::Start(from))?;
    let mut tail = Vec::new();
    file.read_to_end(&mut tail)?;
    let room = tail.len().saturating_sub(words.len());
    let before = |room: usize| tail[..room].iter().rposition(|&byte| byte == b'\n');
    // The first line stays: it names the kind of file.
    let Some(line) = before(room).or_else(|| before(tail.len())) else {
        return Ok(());
    };
    let place = from + line as u64 + 1;
    file.seek(SeekFrom::Start(place))?;
    file.write_all(words.as_bytes())?;
    file.set_len(place + words.len() as u64)?;
    file.sync_data()
}

impl Write for SyncedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.buffer.extend_from_slice(bytes);
        if self.buffer.len() >= BUFFER_BYTES {
            self.write_buffer()?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.write_buffer()
    }
}

impl Drop for SyncedFile {
    fn drop(&mut self) {
        let _ = self.flush();
        self.lives = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: a file that cannot be written any further says so, and needs no room for it. Method: whole and torn
    /// ends of several lengths; the result is never longer, begins as before, and ends with the words.
    #[test]
    fn last_words_take_the_place_of_the_last_lines() {
        let words = "# lost";
        for (text, expected) in [
            ("head\nfirst\nsecond\nthi", "head\nfirst\n# lost\n"),
            ("head\nfirst\nsecond\n", "head\nfirst\n# lost\n"),
            ("head\nfirst line\n", "head\n# lost\n"),
            // Too short to give room: tried behind the last whole line.
            ("head\nf", "head\n# lost\n"),
            ("hea", "hea"),
        ] {
            let mut file = tempfile::tempfile().unwrap();
            file.write_all(text.as_bytes()).unwrap();
            end_with(&mut file, words).unwrap();
            let mut read = String::new();
            file.rewind().unwrap();
            file.read_to_string(&mut read).unwrap();
            assert_eq!(read, expected, "{text:?}");
        }
    }

    #[test]
    fn an_error_of_the_disk_is_reported_by_the_next_write_and_ends_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log");
        let mut file = SyncedFile::create(&path, "# lost").unwrap();
        file.write_all(b"head\nfirst\nsecond\n").unwrap();
        file.flush().unwrap();
        *file.lost.lock().unwrap() = Some(io::Error::other("no disk"));
        file.write_all(b"third\n").unwrap();
        assert_eq!(file.flush().unwrap_err().to_string(), "no disk");
        assert!(
            file.write_all(b"fourth\n")
                .and_then(|()| file.flush())
                .is_err()
        );
        drop(file);
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text, "head\nfirst\n# lost\n");
    }
}
