//! The job file (`.hwj`): a planned job as it will be streamed.
//!
//! ```text
//! "HEADWAYJ"  8 bytes
//! header      u32 LE length | postcard JobHeader | u32 LE CRC-32 of both
//! frames      as on the wire (protocol/WIRE.md), sequence numbers from 0, each ended by 00
//! index       postcard Vec<IndexEntry>: every 64th frame, and where it begins
//! footer      u64 LE start of the index | u32 LE frames | u32 LE CRC-32 of index and these 12 bytes
//!             | "HWJINDEX"
//! ```
//! Every byte except the magic is covered by a CRC, and the header gives the number of frames,
//! knots and events, so that a truncated or altered file is refused, with the place. Inspecting
//! reads header and footer only. Lengths are checked against the file before memory is allocated.
//! Not covered: the outline and the pictures, which are made from the input.

use crate::job::frame_writer::FrameWriter;
use crate::job::frames::WireFrames;
use crate::job::heat::{HEAT_TEXT, HeatEvent, from_json};
use crate::job::machine_parts::{part_texts, take_parts, with_parts_as_texts};
use crate::job::transform::PartTransform;
use crate::job::units::{units_of_texts, units_text};
use crate::job::{Mark, SegmentStream, StreamFacts};
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::MachineConfiguration;
use headway_protocol::frame::{CRC, FrameDecoder};
use headway_protocol::message::{PROTOCOL_VERSION, SCHEMA_HASH};
use headway_protocol::units::ChannelPoint;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom, Write};
use thiserror::Error;

pub(crate) const MAGIC: &[u8; 8] = b"HEADWAYJ";
const FOOTER_MAGIC: &[u8; 8] = b"HWJINDEX";
/// Version of the file's layout.
pub const FORMAT_VERSION: u16 = 1;
/// Protocol version and schema before streams had units of their own: their frames are those of a stream in base units.
const BEFORE_UNITS: (u16, u32) = (9, 0xd967_f8b3);
/// Before boards measured themselves: the stream is the same.
const BEFORE_MEASUREMENT: (u16, u32) = (10, 0xd8f9_4d11);
/// Largest header: a million marks take 30 MB.
const HEADER_BYTES_MAX: u64 = 256 << 20;
/// Largest index: 64 frames an entry.
const INDEX_BYTES_MAX: u64 = 64 << 20;
/// Frames between two entries of the index.
pub(crate) const INDEX_EVERY_FRAMES: usize = 64;
const FOOTER_BYTES: u64 = 24;

/// The file's data about the job, before its frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobHeader {
    /// [`FORMAT_VERSION`] of the writer.
    pub format_version: u16,
    /// Protocol version that the frames were packed for.
    pub protocol_version: u16,
    /// Schema hash that the frames were packed for.
    pub schema_hash: u32,
    /// Name of the machine, for messages.
    pub machine_name: String,
    /// The machine as the firmware must know it.
    pub machine: MachineConfiguration,
    /// Hash of `machine`; the handshake compares it.
    pub machine_hash: u32,
    /// Position of the input on the machine; applied before kinematics, undone in every output.
    pub transform: PartTransform,
    /// Pose at rest before the first span, in the stream's units.
    pub start: ChannelPoint,
    /// Identity of the stream (`WireFrames::job`).
    pub job: u32,
    /// Frames in the file.
    pub frames: u32,
    /// Knots in them.
    pub knots: u32,
    /// Flow events in them.
    pub events: u32,
    /// What the stream is doing when.
    pub marks: Vec<Mark>,
    /// The plan's figures, a JSON object.
    pub figures_json: String,
    /// More texts by name: `settings` (the machine file), `input` (its origin).
    pub texts: BTreeMap<String, String>,
}

impl JobHeader {
    /// Header for a stream; figures and texts are left for the caller to fill in.
    pub fn new(
        stream: &SegmentStream,
        frames: &WireFrames,
        machine_name: &str,
        machine: &MachineConfiguration,
        transform: PartTransform,
    ) -> Self {
        let facts = StreamFacts {
            start: *frames.start(),
            job: frames.job(),
            frames: frames.len() as u32,
            knots: stream.knots.len() as u32,
            events: stream.events.len() as u32,
            marks: stream.marks.clone(),
            solution: stream.solution,
            units: stream.units,
        };
        JobHeader::of_facts(facts, machine_name, machine, transform)
    }

    /// The same from the facts of a stream.
    pub fn of_facts(
        stream: StreamFacts,
        machine_name: &str,
        machine: &MachineConfiguration,
        transform: PartTransform,
    ) -> Self {
        JobHeader {
            format_version: FORMAT_VERSION,
            protocol_version: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            machine_name: machine_name.to_string(),
            machine: MachineConfiguration {
                kinematics: machine.kinematics.with_solution(stream.solution),
                ..machine.clone()
            },
            machine_hash: machine.hash(),
            transform,
            start: stream.start,
            job: stream.job,
            frames: stream.frames,
            knots: stream.knots,
            events: stream.events,
            marks: stream.marks,
            figures_json: String::from("{}"),
            texts: part_texts(machine)
                .chain(units_text(&stream.units))
                .collect(),
        }
    }
}

/// Where a frame begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct IndexEntry {
    /// Frame number from 0.
    pub frame: u32,
    /// Its first byte in the file.
    pub offset: u64,
    /// Knots before it.
    pub knots_before: u32,
}

/// A job as read from a file.
#[derive(Clone, Debug)]
pub struct JobFile {
    /// The file's data about the job.
    pub header: JobHeader,
    /// The stream, packed.
    pub frames: WireFrames,
}

impl JobHeader {
    /// The job's heater and fan commands, by tick; empty if a text contains nothing known.
    pub fn heat(&self) -> Vec<HeatEvent> {
        let text = self.texts.get(HEAT_TEXT);
        text.and_then(|text| from_json(text)).unwrap_or_default()
    }
}

impl JobFile {
    /// The stream, unpacked.
    ///
    /// # Errors
    /// [`Refusal`] if a frame violates the protocol.
    pub fn stream(&self) -> Result<SegmentStream, Refusal> {
        let (knots, events) = self.frames.decode()?;
        Ok(SegmentStream {
            start: *self.frames.start(),
            knots,
            events,
            marks: self.header.marks.clone(),
            solution: self.header.machine.kinematics.solution(),
            units: self.header.units(),
        })
    }
}

/// Why a file is not a job that can be used.
#[derive(Debug, Error)]
pub enum JobFileError {
    /// Reading or writing failed.
    #[error("job file: {0}")]
    Io(#[from] io::Error),
    /// Something else, another version, or damage, with its place.
    #[error(transparent)]
    Refused(#[from] Refusal),
}

/// Writes a job; returns the bytes written.
///
/// # Errors
/// [`JobFileError::Io`] from the writer; a `Refusal` for a header past its bound.
pub fn write(
    out: &mut impl Write,
    header: &JobHeader,
    frames: &WireFrames,
) -> Result<u64, JobFileError> {
    let start = write_header(out, header)?;
    let mut packed = FrameWriter::default();
    let mut totals = (0, 0);
    for frame in 0..frames.len() {
        let (knots, events) = frames.totals_after(frame);
        let payload = frames.payload(frame);
        packed.write(out, payload, knots - totals.0, events - totals.1)?;
        totals = (knots, events);
    }
    let tail = packed.tail(start)?;
    out.write_all(&tail)?;
    Ok(start + packed.bytes() + tail.len() as u64)
}

/// Writes the beginning of a job; returns where its frames begin.
pub(crate) fn write_header(out: &mut impl Write, header: &JobHeader) -> Result<u64, JobFileError> {
    let mut section = Vec::from((0u32).to_le_bytes());
    let header = with_parts_as_texts(header);
    section =
        postcard::to_extend(&*header, section).map_err(|_| damaged(8, "header", "unwritable"))?;
    let bytes = section.len() as u64 - 4;
    if bytes > HEADER_BYTES_MAX {
        return Err(too_large("header", bytes));
    }
    section[..4].copy_from_slice(&(bytes as u32).to_le_bytes());
    section.extend_from_slice(&CRC.checksum(&section).to_le_bytes());
    out.write_all(MAGIC)?;
    out.write_all(&section)?;
    Ok((MAGIC.len() + section.len()) as u64)
}

pub(crate) fn index_and_footer(
    index: &[IndexEntry],
    index_start: u64,
    frames: u32,
) -> Result<Vec<u8>, JobFileError> {
    let mut tail = postcard::to_extend(index, Vec::new())
        .map_err(|_| damaged(index_start, "index", "unwritable"))?;
    tail.extend_from_slice(&index_start.to_le_bytes());
    tail.extend_from_slice(&frames.to_le_bytes());
    tail.extend_from_slice(&CRC.checksum(&tail).to_le_bytes());
    tail.extend_from_slice(FOOTER_MAGIC);
    Ok(tail)
}

pub(crate) fn damaged(at_byte: u64, part: &str, why: &str) -> JobFileError {
    refusal!("the job file is damaged in the {part} at byte {at_byte}: {why}; copy it again").into()
}

fn truncated(at_byte: u64, part: &str) -> JobFileError {
    refusal!(
        "the job file is truncated: it ends at byte {at_byte}, inside the {part}; copy it again"
    )
    .into()
}

fn too_large(part: &str, bytes: u64) -> JobFileError {
    refusal!("the job file states a {part} of {bytes} bytes, more than any job has; plan again")
        .into()
}

/// What inspecting finds without reading the frames.
#[derive(Clone, Debug)]
pub struct JobSummary {
    /// The header.
    pub header: JobHeader,
    /// Every 64th frame with its offset.
    pub index: Vec<IndexEntry>,
    /// First byte of the first frame.
    pub frames_start: u64,
    /// First byte after the last frame.
    pub frames_end: u64,
}

/// Reads header, index and footer.
///
/// # Errors
/// [`JobFileError`] with the place.
pub fn read_summary(input: &mut (impl Read + Seek)) -> Result<JobSummary, JobFileError> {
    let length = input.seek(SeekFrom::End(0))?;
    input.seek(SeekFrom::Start(0))?;
    let (header, frames_start) = read_header(input, length)?;
    if length < frames_start + FOOTER_BYTES {
        return Err(truncated(length, "frames"));
    }
    let (index, frames_end) = read_index(input, length, frames_start, &header)?;
    Ok(JobSummary {
        header,
        index,
        frames_start,
        frames_end,
    })
}

fn read_header(input: &mut impl Read, length: u64) -> Result<(JobHeader, u64), JobFileError> {
    let mut magic = [0u8; 8];
    if length >= 8 {
        input.read_exact(&mut magic)?;
    }
    if &magic != MAGIC {
        let none = "this is not a Headway job file (it does not begin with HEADWAYJ)";
        return Err(refusal!("{none}").into());
    }
    if length < 16 {
        return Err(truncated(length, "header"));
    }
    let mut size = [0u8; 4];
    input.read_exact(&mut size)?;
    let bytes = u64::from(u32::from_le_bytes(size));
    if bytes > HEADER_BYTES_MAX {
        return Err(too_large("header", bytes));
    }
    if 12 + bytes + 4 > length {
        return Err(truncated(length, "header"));
    }
    let mut section = vec![0u8; bytes as usize + 8];
    section[..4].copy_from_slice(&size);
    input.read_exact(&mut section[4..])?;
    let (body, checksum) = section.split_at(bytes as usize + 4);
    if CRC.checksum(body).to_le_bytes() != checksum {
        return Err(damaged(8, "header", "the checksum does not match"));
    }
    let header = parse_header(&body[4..])?;
    Ok((header, 12 + bytes + 4))
}

fn parse_header(body: &[u8]) -> Result<JobHeader, JobFileError> {
    // The versions are first in the header, so that they can be read whatever follows.
    let versions: (u16, u16, u32) = postcard::take_from_bytes(body)
        .map(|(versions, _)| versions)
        .map_err(|_| damaged(8, "header", "it cannot be read"))?;
    let (format, protocol, schema) = versions;
    let read = [
        (PROTOCOL_VERSION, SCHEMA_HASH),
        BEFORE_UNITS,
        BEFORE_MEASUREMENT,
    ];
    if format != FORMAT_VERSION || !read.contains(&(protocol, schema)) {
        return Err(refusal!(
            "the job file has format {format}, protocol {protocol} and schema {schema:08x}; this program reads \
             {FORMAT_VERSION}, {PROTOCOL_VERSION} and {SCHEMA_HASH:08x}; plan again"
        )
        .into());
    }
    let unreadable = || damaged(8, "header", "it cannot be read");
    let mut header: JobHeader = postcard::from_bytes(body).map_err(|_| unreadable())?;
    units_of_texts(&header.texts).ok_or_else(unreadable)?;
    take_parts(&mut header.machine, &header.texts).ok_or_else(unreadable)?;
    Ok(header)
}

fn read_index(
    input: &mut (impl Read + Seek),
    length: u64,
    frames_start: u64,
    header: &JobHeader,
) -> Result<(Vec<IndexEntry>, u64), JobFileError> {
    let footer_start = length - FOOTER_BYTES;
    input.seek(SeekFrom::Start(footer_start))?;
    let mut footer = [0u8; FOOTER_BYTES as usize];
    input.read_exact(&mut footer)?;
    if &footer[16..] != FOOTER_MAGIC {
        let part = "frames or index (or something was added behind its end)";
        return Err(truncated(length, part));
    }
    let index_start = u64::from_le_bytes(std::array::from_fn(|i| footer[i]));
    let frames = u32::from_le_bytes(std::array::from_fn(|i| footer[8 + i]));
    let bad = |why| damaged(footer_start, "footer", why);
    if !(frames_start..=footer_start).contains(&index_start) {
        return Err(bad("the index lies outside the file"));
    }
    let bytes = footer_start - index_start;
    if bytes > INDEX_BYTES_MAX {
        return Err(too_large("index", bytes));
    }
    input.seek(SeekFrom::Start(index_start))?;
    let mut tail = vec![0u8; bytes as usize + 12];
    input.read_exact(&mut tail)?;
    if CRC.checksum(&tail).to_le_bytes() != footer[12..16] {
        return Err(damaged(index_start, "index", "the checksum does not match"));
    }
    if frames != header.frames {
        return Err(bad("its frames are not those of the header"));
    }
    let index: Vec<IndexEntry> = postcard::from_bytes(&tail[..bytes as usize])
        .map_err(|_| damaged(index_start, "index", "it cannot be read"))?;
    Ok((index, index_start))
}

/// Reads and checks a complete job.
///
/// # Errors
/// [`JobFileError`] with the place.
pub fn read(input: &mut (impl Read + Seek)) -> Result<JobFile, JobFileError> {
    let summary = read_summary(input)?;
    input.seek(SeekFrom::Start(summary.frames_start))?;
    let frames = read_frames(input, &summary)?;
    let header = summary.header;
    let stream = |what: &str| -> JobFileError {
        refusal!("the job file's frames do not make the stream of its header: {what}; plan again")
            .into()
    };
    let disagree = |what: &str| Err(stream(what));
    if frames.job() != header.job {
        return disagree("their identity is another one");
    }
    let (knots, events) = frames
        .decode()
        .map_err(|error| stream(&error.to_string()))?;
    if knots.len() != header.knots as usize || events.len() != header.events as usize {
        return disagree("their number is another one");
    }
    Ok(JobFile { header, frames })
}

fn read_frames(input: &mut impl Read, summary: &JobSummary) -> Result<WireFrames, JobFileError> {
    let mut frames = WireFrames::new(summary.header.start, summary.header.units());
    let mut decoder = FrameDecoder::new();
    let mut at_byte = summary.frames_start;
    let mut frame_start = at_byte;
    let bytes = summary.frames_end - summary.frames_start;
    for byte in io::BufReader::new(input.take(bytes)).bytes() {
        let byte = byte?;
        at_byte += 1;
        let frame = frames.len() as u32;
        let bad = |why: &str| -> JobFileError {
            refusal!("the job file is damaged in frame {frame} at byte {frame_start}: {why}; copy it again").into()
        };
        match decoder.push(byte) {
            // Frames follow each other without idle zeros.
            None if byte == 0 => return Err(bad("it is empty")),
            None => continue,
            Some(Err(_)) => return Err(bad("the checksum does not match")),
            Some(Ok(found)) if found.sequence != frame as u16 => {
                return Err(bad("it is out of order"));
            }
            Some(Ok(found)) => frames
                .push_payload(found.payload)
                .map_err(|_| bad("it is not a stream message"))?,
        }
        frame_start = at_byte;
    }
    if frame_start != at_byte || frames.len() as u32 != summary.header.frames {
        return Err(truncated(at_byte, "frames"));
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    //! Goal: what was written comes back; nothing else does. Method: every byte of a small file
    //! changed, every length cut.
    use super::*;
    use crate::job::MotionState;
    use crate::settings::Settings;
    use headway_protocol::segment::{FlowAction, FlowEvent, Knot};
    use headway_protocol::units::Ticks;
    use std::io::Cursor;

    fn job(knots: usize) -> (JobHeader, WireFrames, SegmentStream) {
        let mut stream = SegmentStream {
            start: [5; 7],
            ..SegmentStream::default()
        };
        for i in 0..knots as i32 {
            stream.knots.push(Knot {
                control: [i * 37, i * i, 0, 0, i % 7, -i, i * 3],
                duration_ticks: 10 + (i % 9) as u16,
            });
        }
        stream.events.push(FlowEvent {
            span: 3,
            offset_ticks: 1,
            action: FlowAction::Prime,
            volume_units: 500,
            duration_ticks: Ticks(20),
        });
        stream.marks.push(Mark {
            start_tick: 0,
            end_tick: 100,
            state: MotionState::Travel,
            layer: 0,
            pass: None,
        });
        let frames = WireFrames::encode(&stream).unwrap();
        let machine = Settings::default().machine;
        let transform = PartTransform {
            offset_mm: [1.0, 2.0, 0.0],
        };
        let mut header = JobHeader::new(&stream, &frames, "test", &machine, transform);
        header.figures_json = String::from("{\"passes\":3}");
        (header, frames, stream)
    }

    fn written(knots: usize) -> Vec<u8> {
        let (header, frames, _) = job(knots);
        let mut bytes = Vec::new();
        let length = write(&mut bytes, &header, &frames).unwrap();
        assert_eq!(length, bytes.len() as u64);
        bytes
    }

    #[test]
    fn a_job_comes_back() {
        let (header, frames, stream) = job(5000);
        let file = read(&mut Cursor::new(written(5000))).unwrap();
        assert_eq!(file.header, header);
        assert_eq!(file.frames, frames);
        assert_eq!(file.stream().unwrap(), stream);
        let summary = read_summary(&mut Cursor::new(written(5000))).unwrap();
        assert!(summary.index.len() > 1);
        let bytes = written(5000);
        for entry in &summary.index {
            // A frame begins where the index says: the byte before is the last one's end.
            assert!(entry.frame == 0 || bytes[entry.offset as usize - 1] == 0);
        }
    }

    #[test]
    fn every_changed_byte_is_noticed() {
        let bytes = written(40);
        for at in 0..bytes.len() {
            for flip in [1u8, 0x80] {
                let mut changed = bytes.clone();
                changed[at] ^= flip;
                let result = read(&mut Cursor::new(changed));
                assert!(result.is_err(), "byte {at} of {}", bytes.len());
            }
        }
    }

    #[test]
    fn every_truncated_file_is_refused() {
        let bytes = written(40);
        for length in 0..bytes.len() {
            let result = read(&mut Cursor::new(&bytes[..length]));
            assert!(result.is_err(), "{length} of {}", bytes.len());
        }
        let error = read(&mut Cursor::new(&bytes[..bytes.len() - 30])).unwrap_err();
        assert!(error.to_string().contains("truncated"), "{error}");
    }

    #[test]
    fn the_place_of_a_damaged_frame_is_told() {
        let (header, frames, _) = job(5000);
        let mut bytes = Vec::new();
        write(&mut bytes, &header, &frames).unwrap();
        let summary = read_summary(&mut Cursor::new(&bytes)).unwrap();
        let entry = summary.index[1];
        bytes[entry.offset as usize + 10] ^= 4;
        let error = read(&mut Cursor::new(&bytes)).unwrap_err().to_string();
        assert!(error.contains("frame 64"), "{error}");
        assert!(error.contains(&format!("byte {}", entry.offset)), "{error}");
    }

    #[test]
    fn a_huge_stated_length_takes_no_memory() {
        let mut bytes = written(40);
        bytes[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
        let refused = read(&mut Cursor::new(&bytes)).unwrap_err().to_string();
        assert!(refused.contains("more than any job has"), "{refused}");
        bytes[8..12].copy_from_slice(&(100u32 << 20).to_le_bytes());
        let refused = read(&mut Cursor::new(&bytes)).unwrap_err().to_string();
        assert!(refused.contains("is truncated"), "{refused}");
    }
}
