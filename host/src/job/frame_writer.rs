//! Writes the frames of a job file in order, with their index.
//!
//! In: payloads in sending order. Out: frames as on the wire, and the offset of every 64th; or a complete
//! job file whose frames were written to a separate file before. Not covered: the header's contents.

use crate::job::file::{
    INDEX_EVERY_FRAMES, IndexEntry, JobFileError, JobHeader, damaged, index_and_footer,
    write_header,
};
use headway_protocol::frame::{FRAME_BYTES_MAX, encode_payload};
use std::io::{self, Read, Write};

/// Writes frames one after the other, and knows the index of them.
#[derive(Clone, Debug, Default)]
pub(crate) struct FrameWriter {
    /// Offsets count from the first frame.
    index: Vec<IndexEntry>,
    /// Bytes of the frames so far.
    bytes: u64,
    pub(crate) frames: u32,
    pub(crate) knots: u32,
    pub(crate) events: u32,
}

impl FrameWriter {
    /// Writes one more frame with this many knots and events.
    pub(crate) fn write(
        &mut self,
        out: &mut impl Write,
        payload: &[u8],
        knots: u32,
        events: u32,
    ) -> Result<(), JobFileError> {
        let mut line = [0u8; FRAME_BYTES_MAX];
        if (self.frames as usize).is_multiple_of(INDEX_EVERY_FRAMES) {
            self.index.push(IndexEntry {
                frame: self.frames,
                offset: self.bytes,
                knots_before: self.knots,
            });
        }
        let length = encode_payload(self.frames as u16, payload, &mut line)
            .map_err(|_| damaged(self.bytes, "frames", "a frame is too long"))?;
        out.write_all(&line[..length])?;
        self.bytes += length as u64;
        self.frames += 1;
        self.knots += knots;
        self.events += events;
        Ok(())
    }

    /// Bytes of the frames so far.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The data after the frames if they begin at byte `start`.
    pub(crate) fn tail(&self, start: u64) -> Result<Vec<u8>, JobFileError> {
        let index: Vec<IndexEntry> = self
            .index
            .iter()
            .map(|entry| IndexEntry {
                offset: entry.offset + start,
                ..*entry
            })
            .collect();
        index_and_footer(&index, start + self.bytes, self.frames)
    }
}

/// Writes a job whose frames were written before and are read from `frames`; returns the number of
/// bytes written.
///
/// # Errors
/// As [`write`].
pub(crate) fn write_with_frames(
    out: &mut impl Write,
    header: &JobHeader,
    packed: &FrameWriter,
    frames: &mut impl Read,
) -> Result<u64, JobFileError> {
    let start = write_header(out, header)?;
    let copied = io::copy(frames, out)?;
    if copied != packed.bytes {
        let problem = "what was planned cannot be read back";
        return Err(io::Error::new(io::ErrorKind::UnexpectedEof, problem).into());
    }
    let tail = packed.tail(start)?;
    out.write_all(&tail)?;
    Ok(start + packed.bytes + tail.len() as u64)
}
