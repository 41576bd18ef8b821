//! The progress of a stream according to its log: the board's last report, and the frames sent to
//! it.
//!
//! ```text
//! # rest of job 1a2b3c4d from pass 17       the stream is what was left of that job (`job::resume`)
//! 1234567 > ...  Start                      which stream; from its acknowledgement on
//! 1240000 < ...  Status, Ack                spans that are done
//! ```
//! In: the lines of a log. Out: [`LoggedStream`]. A log that filled the disk has [`UNWRITTEN`] at its end: the stream
//! continued. A power failure leaves an incomplete last line, or bytes after it that were never written: both are
//! read as its end. A line that cannot be read, followed by good ones, is damage.

use crate::drive::link_log::{Entry, HEAD, LINE_BYTES_MAX, LogError, Way, entry};
use crate::job::resume::LoggedStream;
use headway_protocol::frame::FrameDecoder;
use headway_protocol::message::{DeviceMessage, DeviceState, HostMessage, Start};
use std::io::{self, BufRead};

/// Last line of a log that could not be written any further while its stream went on.
pub const UNWRITTEN: &str = "# the log could not be written any further, the stream went on";
const REST: &str = "# rest of job ";
const FROM_PASS: &str = " from pass ";

/// The remark for the log of a resumed job.
pub fn rest_remark(job: u32, pass: u32) -> String {
    format!("rest of job {job:08x}{FROM_PASS}{pass}")
}

fn from_rest_remark(text: &str) -> Option<(u32, u32)> {
    let (job, pass) = text.strip_prefix(REST)?.split_once(FROM_PASS)?;
    Some((u32::from_str_radix(job, 16).ok()?, pass.parse().ok()?))
}

/// Reads the progress of the last stream in a log.
///
/// # Errors
/// [`LogError`]: no log, no stream in it, damage with the line.
pub fn last_stream(input: &mut impl BufRead) -> Result<LoggedStream, LogError> {
    let mut reader = Reader::default();
    let mut text = Vec::new();
    let mut unreadable: Option<(usize, &'static str)> = None;
    for line in 1.. {
        text.clear();
        let limit = LINE_BYTES_MAX as u64;
        if io::Read::take(&mut *input, limit).read_until(b'\n', &mut text)? == 0 {
            break;
        }
        if line == 1 {
            if text.trim_ascii_end() != HEAD.as_bytes() {
                return Err(LogError::NotALog);
            }
            continue;
        }
        let read = match text.strip_suffix(b"\n") {
            Some(text) => reader.line(text),
            None => Err("it has no end"),
        };
        match (read, unreadable) {
            (Ok(()), None) => {}
            (Ok(()), Some((line, why))) => return Err(LogError::Line { line, why }),
            (Err(why), before) => unreadable = before.or(Some((line, why))),
        }
        reader.stops = unreadable.is_some();
    }
    match reader.found {
        Some(found) => Ok(LoggedStream {
            rest_of: reader.rest_of,
            is_torn: unreadable.is_some(),
            went_on: reader.went_on,
            ..found
        }),
        None if reader.went_on => Err(LogError::Unwritten),
        None => Err(LogError::NoStream),
    }
}

/// What was read so far.
#[derive(Default)]
struct Reader {
    down: FrameDecoder,
    up: FrameDecoder,
    rest_of: Option<(u32, u32)>,
    went_on: bool,
    /// A start that was sent, by its sequence number, until it is acknowledged.
    asked: Option<(u16, Start)>,
    found: Option<LoggedStream>,
    /// Number of the stream's first frame.
    first_sequence: u32,
    /// Lines are only checked for whether they can be read.
    stops: bool,
}

impl Reader {
    fn line(&mut self, text: &[u8]) -> Result<(), &'static str> {
        let text = std::str::from_utf8(text).map_err(|_| "it is not text")?;
        let text = text.trim_end();
        if text.starts_with('#') || text.is_empty() {
            self.rest_of = from_rest_remark(text).or(self.rest_of);
            self.went_on |= text == UNWRITTEN;
            return Ok(());
        }
        let Entry::Bytes { way, bytes, .. } = entry(text)? else {
            return Ok(());
        };
        if self.stops {
            return Ok(());
        }
        for byte in bytes {
            match way {
                Way::Down => self.host_byte(byte),
                Way::Up => self.board_byte(byte),
            }
        }
        Ok(())
    }

    fn host_byte(&mut self, byte: u8) {
        let Some(Ok(frame)) = self.down.push(byte) else {
            return;
        };
        match HostMessage::decode(frame.payload) {
            Ok(HostMessage::Start(start)) => self.asked = Some((frame.sequence, start)),
            Ok(HostMessage::Knots(_) | HostMessage::Flow(_) | HostMessage::Finish(_)) => {
                let sent = self.found.map_or(0, |found| found.frames_sent);
                let newest = self.first_sequence.wrapping_add(sent) as u16;
                // Frames are repeated, and at most some dozens are in transit.
                let ahead = frame.sequence.wrapping_sub(newest);
                if let (Some(found), 0..0x8000) = (&mut self.found, ahead) {
                    found.frames_sent += u32::from(ahead) + 1;
                }
            }
            _ => {}
        }
    }

    fn board_byte(&mut self, byte: u8) {
        let Some(Ok(frame)) = self.up.push(byte) else {
            return;
        };
        match DeviceMessage::decode(frame.payload) {
            Ok(DeviceMessage::Ack(ack) | DeviceMessage::Nak(ack)) => {
                let taken = |asked: &mut (u16, Start)| asked.0 == ack.control_taken;
                if let Some((_, start)) = self.asked.take_if(taken) {
                    // Also where the board had been through the same job before.
                    self.found = None;
                    self.go_on(start.job, start.first_sequence, 0);
                }
            }
            Ok(DeviceMessage::Welcome(welcome)) => {
                if let Some(stream) = welcome.stream {
                    self.go_on(stream.job, stream.first_sequence, stream.spans_done);
                    let taken = stream.next_sequence.wrapping_sub(stream.first_sequence);
                    if let Some(found) = &mut self.found {
                        found.frames_sent = found.frames_sent.max(taken);
                    }
                }
            }
            Ok(DeviceMessage::Status(status)) => {
                if let Some(found) = &mut self.found {
                    found.spans_done = found.spans_done.max(status.spans_done);
                    found.flow_percent = Some(status.flow_percent);
                    found.finished |= status.state == DeviceState::Finished;
                }
            }
            _ => {}
        }
    }

    /// From here on it is about this stream.
    fn go_on(&mut self, job: u32, first_sequence: u32, spans_done: u32) {
        self.first_sequence = first_sequence;
        let known = self.found.filter(|found| found.job == job);
        let known = known.unwrap_or(LoggedStream {
            job,
            ..LoggedStream::default()
        });
        self.found = Some(LoggedStream {
            spans_done: known.spans_done.max(spans_done),
            ..known
        });
    }
}

#[cfg(test)]
#[path = "log_place_tests.rs"]
mod tests;
