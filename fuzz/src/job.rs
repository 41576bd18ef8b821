//! Job files whose checksums are right, so that the reader's other checks are reached.

use arbitrary::Arbitrary;
use headway_protocol::frame::{CRC, FRAME_BYTES_MAX, encode_payload};

/// A job file as the fuzzer wants it.
#[derive(Arbitrary, Debug)]
pub struct JobFile {
    /// Bytes of the header; true versions in front if `versions`.
    header: Vec<u8>,
    versions: bool,
    /// Payloads of the frames.
    frames: Vec<Vec<u8>>,
    index: Vec<u8>,
    frames_stated: Option<u32>,
    index_start_shift: i8,
    /// Bytes cut off the end, and one byte changed.
    cut: u8,
    change: Option<(u16, u8)>,
}

impl JobFile {
    /// The file's bytes, with checksums made for what is in it.
    pub fn bytes(&self) -> Vec<u8> {
        let mut header = Vec::new();
        if self.versions {
            let versions = (
                headway::job::file::FORMAT_VERSION,
                headway_protocol::message::PROTOCOL_VERSION,
                headway_protocol::message::SCHEMA_HASH,
            );
            header = postcard::to_allocvec(&versions).unwrap_or_default();
        }
        header.extend_from_slice(&self.header);
        let mut section = Vec::from((header.len() as u32).to_le_bytes());
        section.extend_from_slice(&header);
        section.extend_from_slice(&CRC.checksum(&section).to_le_bytes());
        let mut bytes = b"HEADWAYJ".to_vec();
        bytes.extend_from_slice(&section);
        let mut line = [0u8; FRAME_BYTES_MAX];
        for (number, payload) in self.frames.iter().enumerate() {
            if let Ok(length) = encode_payload(number as u16, payload, &mut line) {
                bytes.extend_from_slice(&line[..length]);
            }
        }
        let index_start = (bytes.len() as u64).wrapping_add_signed(self.index_start_shift.into());
        let mut tail = self.index.clone();
        tail.extend_from_slice(&index_start.to_le_bytes());
        let frames = self.frames_stated.unwrap_or(self.frames.len() as u32);
        tail.extend_from_slice(&frames.to_le_bytes());
        tail.extend_from_slice(&CRC.checksum(&tail).to_le_bytes());
        bytes.extend_from_slice(&tail);
        bytes.extend_from_slice(b"HWJINDEX");
        bytes.truncate(bytes.len() - usize::from(self.cut).min(bytes.len()));
        if let Some((at, value)) = self.change
            && let Some(byte) = bytes.get_mut(usize::from(at))
        {
            *byte = value;
        }
        bytes
    }
}
