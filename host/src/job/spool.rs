//! Parts of a stream -> a job file, without the complete stream in memory.
//!
//! The header precedes the frames and gives their number, so frames are written to a separate file as
//! they are made, and copied after the header at the end. Input: parts from rest to rest, a file to write
//! and read. Output: the bytes that [`crate::job::file::write`] makes of the complete stream. Memory
//! grows with the job by a mark for each move and an index entry for every 64th frame. Not covered: the
//! file's location.

use crate::job::file::{JobFileError, JobHeader};
use crate::job::frame_writer::{FrameWriter, write_with_frames};
use crate::job::frames::{StreamPacker, digest_from};
use crate::job::{Mark, SegmentStream, StreamFacts};
use crate::text::refusal::Refusal;
use crc::Digest;
use headway_protocol::frame::{CRC, FRAME_OVERHEAD_BYTES};
use headway_protocol::units::Units;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use thiserror::Error;

/// Why a part is refused.
#[derive(Debug, Error)]
pub enum SpoolError {
    /// The file cannot be written or read back.
    #[error("the file for the frames of the job: {0}; free some room there")]
    Io(#[from] io::Error),
    /// The stream is invalid.
    #[error("the plan cannot be packed: {0}")]
    Frames(#[from] Refusal),
    /// The job cannot be written.
    #[error(transparent)]
    File(#[from] JobFileError),
}

/// A job that is being written to a file.
pub struct JobSpool<F: Write> {
    out: BufWriter<F>,
    packer: Option<StreamPacker>,
    packed: FrameWriter,
    digest: Digest<'static, u32>,
    payload_bytes: u64,
    facts: StreamFacts,
    ticks: u64,
}

impl<F: Read + Write + Seek> JobSpool<F> {
    /// An empty job; frames go to `file`.
    pub fn new(file: F) -> JobSpool<F> {
        JobSpool {
            out: BufWriter::new(file),
            packer: None,
            packed: FrameWriter::default(),
            digest: CRC.digest(),
            payload_bytes: 0,
            facts: StreamFacts {
                start: Default::default(),
                job: 0,
                frames: 0,
                knots: 0,
                events: 0,
                marks: Vec::new(),
                solution: 0,
                units: Units::BASE,
            },
            ticks: 0,
        }
    }

    /// The next part, with its passes counted from `first_pass` on.
    ///
    /// # Errors
    /// [`SpoolError`].
    pub fn add(&mut self, piece: &SegmentStream, first_pass: u32) -> Result<(), SpoolError> {
        if self.packer.is_none() {
            self.facts.start = piece.start;
            self.facts.solution = piece.solution;
            self.facts.units = piece.units;
            self.digest = digest_from(&piece.start, &piece.units);
        }
        let mut packer = self
            .packer
            .take()
            .unwrap_or_else(|| StreamPacker::new(piece.start));
        let mut written = Ok(());
        packer.add(piece, &mut |payload, knots, events| {
            self.frame(payload, knots, events, &mut written);
        })?;
        self.packer = Some(packer);
        written?;
        let marks = piece.marks.iter().map(|mark| Mark {
            start_tick: mark.start_tick + self.ticks,
            end_tick: mark.end_tick + self.ticks,
            pass: mark.pass.map(|pass| pass + first_pass),
            ..*mark
        });
        self.facts.marks.extend(marks);
        self.ticks = self
            .facts
            .marks
            .last()
            .map_or(self.ticks, |mark| mark.end_tick);
        Ok(())
    }

    fn frame(
        &mut self,
        payload: &[u8],
        knots: u32,
        events: u32,
        written: &mut Result<(), JobFileError>,
    ) {
        self.digest.update(payload);
        self.payload_bytes += payload.len() as u64;
        if written.is_ok() {
            *written = self.packed.write(&mut self.out, payload, knots, events);
        }
    }

    /// The end of the stream; nothing is added after it.
    ///
    /// # Errors
    /// [`SpoolError`].
    pub fn finish(mut self) -> Result<SpooledJob<F>, SpoolError> {
        let mut written = Ok(());
        if let Some(packer) = self.packer.take() {
            packer.finish(&mut |payload, knots, events| {
                self.frame(payload, knots, events, &mut written);
            });
        }
        written?;
        let file = self
            .out
            .into_inner()
            .map_err(io::IntoInnerError::into_error)?;
        let packed = self.packed;
        let facts = StreamFacts {
            job: self.digest.finalize(),
            frames: packed.frames,
            knots: packed.knots,
            events: packed.events,
            ..self.facts
        };
        // Frames stay below COBS's 254-byte group: one code byte and the closing zero each.
        let overhead = FRAME_OVERHEAD_BYTES as u64 + 2;
        Ok(SpooledJob {
            line_bytes: self.payload_bytes + u64::from(packed.frames) * overhead,
            facts,
            packed,
            file,
        })
    }
}

/// A complete job, with its frames in a file.
pub struct SpooledJob<F> {
    /// Data of its header.
    pub facts: StreamFacts,
    /// Bytes on the line for the complete stream, framing included, without resends.
    pub line_bytes: u64,
    packed: FrameWriter,
    file: F,
}

impl<F: Read + Seek> SpooledJob<F> {
    /// Writes the job file; returns its bytes.
    ///
    /// # Errors
    /// [`SpoolError`].
    pub fn write(&mut self, out: &mut impl Write, header: &JobHeader) -> Result<u64, SpoolError> {
        self.file.seek(SeekFrom::Start(0))?;
        let mut frames = BufReader::new(&mut self.file);
        Ok(write_with_frames(out, header, &self.packed, &mut frames)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::test_streams::spiral;
    use crate::job::frames::WireFrames;
    use crate::job::transform::PartTransform;
    use crate::settings::Settings;

    /// Goal: a job in pieces is byte for byte the file of the whole, which says its units. Method: three spirals,
    /// appended in memory and spooled; the same numbers in base units and in coarser ones are two jobs.
    #[test]
    fn spooled_pieces_make_the_file_of_the_whole() {
        let coarse = Units {
            length_exponent: 5,
            angle_exponent: 0,
            volume_exponent: 16,
        };
        let mut jobs = Vec::new();
        for units in [Units::BASE, coarse] {
            let piece = SegmentStream {
                units,
                ..spiral(2.0)
            };
            let mut spool = JobSpool::new(io::Cursor::new(Vec::new()));
            let mut whole = SegmentStream::default();
            for number in 0..3 {
                spool.add(&piece, number).expect("room");
                whole.append(piece.clone(), number);
            }
            let mut spooled = spool.finish().expect("a job");
            let frames = WireFrames::encode(&whole).expect("frames");
            assert_eq!(spooled.line_bytes, frames.line_bytes() as u64);
            let machine = Settings::default().machine;
            let place = PartTransform::default();
            let header = JobHeader::new(&whole, &frames, "it", &machine, place);
            let same = JobHeader::of_facts(spooled.facts.clone(), "it", &machine, place);
            assert_eq!(header, same);
            let (mut expected, mut found) = (Vec::new(), Vec::new());
            crate::job::file::write(&mut expected, &header, &frames).expect("a file");
            spooled.write(&mut found, &same).expect("a file");
            assert!(found == expected);
            let read = crate::job::file::read(&mut io::Cursor::new(found)).expect("a job");
            assert_eq!(read.stream().expect("a stream"), whole);
            jobs.push(header.job);
        }
        assert_ne!(jobs[0], jobs[1]);
    }
}
