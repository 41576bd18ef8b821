//! The log of a conversation: every byte on the line with its time and direction; and its replay
//! through the firmware library.
//!
//! ```text
//! # headway link log 1
//! # machine 00d00f...          postcard of the machine configuration, hex, where it is known
//! 1234567 > 02030b...          us since the log began, host to board
//! 1236000 < 0e0201...          board to host
//! 1240000 ! line lost          what happened to the line
//! ```
//! Lines that begin with `#` hold further data; `log_place` has one of them. The buffer is flushed ten times a
//! second, so that the log of a host that dies ends within a line.
//!
//! A replay needs no board and no clock: the host's bytes go to a controller at their recorded
//! times, on a virtual clock, so the same log gives the same steps each time.

use crate::drive::record::StepLog;
use headway_firmware::configuration::{ConfigurationError, MachineConfiguration};
use headway_firmware::machine::Machine;
use headway_protocol::frame::{FRAME_BYTES_MAX, FrameDecoder};
use headway_protocol::message::{DeviceState, Fault, HostMessage};
use std::fmt::Write as _;
use std::io::{self, BufRead, Write};
use thiserror::Error;

pub(super) const HEAD: &str = "# headway link log 1";
const MACHINE: &str = "# machine ";
/// Longest line that is read: a chunk of 64 KiB in hex.
pub(super) const LINE_BYTES_MAX: usize = 140_000;
/// How long lines may wait in memory, us.
const FLUSH_US: u64 = 100_000;
/// Virtual time after the last byte within which the machine must have come to rest, us.
const TAIL_US: u64 = 120_000_000;
/// Longest log that is replayed, us: four weeks.
const TIME_MAX_US: u64 = 28 * 86_400 * 1_000_000;

/// Direction of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// Host to board.
    Down,
    /// Board to host.
    Up,
}

/// Writes a log. Its errors are kept for [`LinkLog::finish`]: a full disk is no reason to stop a
/// print.
pub struct LinkLog {
    out: Box<dyn Write + Send>,
    problem: Option<io::Error>,
    flushed_us: u64,
}

impl std::fmt::Debug for LinkLog {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LinkLog")
            .field("problem", &self.problem)
            .finish_non_exhaustive()
    }
}

impl LinkLog {
    /// Begins a log.
    pub fn new(out: Box<dyn Write + Send>, machine: Option<&MachineConfiguration>) -> LinkLog {
        let mut log = LinkLog {
            out,
            problem: None,
            flushed_us: 0,
        };
        log.line(HEAD);
        let bytes = machine.and_then(|machine| postcard::to_allocvec(machine).ok());
        if let Some(bytes) = bytes {
            log.line(&format!("{MACHINE}{}", hex(&bytes)));
        }
        log
    }

    /// Bytes crossed the line.
    pub fn bytes(&mut self, now_us: u64, way: Way, bytes: &[u8]) {
        let arrow = match way {
            Way::Down => '>',
            Way::Up => '<',
        };
        self.line(&format!("{now_us} {arrow} {}", hex(bytes)));
        if now_us >= self.flushed_us + FLUSH_US && self.problem.is_none() {
            self.flushed_us = now_us;
            self.problem = self.out.flush().err();
        }
    }

    /// Why nothing has been written since: the first error.
    pub fn problem(&self) -> Option<&io::Error> {
        self.problem.as_ref()
    }

    /// Writes a remark on the conversation, in a line that a replay ignores.
    pub fn remark(&mut self, what: &str) {
        self.line(&format!("# {}", what.replace(['\n', '\r'], " ")));
    }

    /// Something happened to the line.
    pub fn event(&mut self, now_us: u64, what: &str) {
        self.line(&format!("{now_us} ! {}", what.replace(['\n', '\r'], " ")));
    }

    /// Writes the buffer.
    ///
    /// # Errors
    /// The first one since the log began.
    pub fn finish(mut self) -> io::Result<()> {
        match self.problem.take() {
            Some(problem) => Err(problem),
            None => self.out.flush(),
        }
    }

    fn line(&mut self, line: &str) {
        if self.problem.is_none() {
            self.problem = writeln!(self.out, "{line}").err();
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes
        .iter()
        .fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02x}");
            text
        })
}

fn from_hex(text: &str) -> Option<Vec<u8>> {
    let digits: Option<Vec<u8>> = text
        .chars()
        .map(|digit| Some(digit.to_digit(16)? as u8))
        .collect();
    let digits = digits.filter(|digits| digits.len() % 2 == 0)?;
    Some(
        digits
            .chunks(2)
            .map(|pair| pair[0] << 4 | pair[1])
            .collect(),
    )
}

/// One line of a log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Entry {
    /// Bytes that crossed the line.
    Bytes {
        /// Time since the log began.
        at_us: u64,
        /// The direction.
        way: Way,
        /// The bytes.
        bytes: Vec<u8>,
    },
    /// What happened to the line.
    Event {
        /// Time since the log began.
        at_us: u64,
        /// What.
        what: String,
    },
}

/// A log as read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogText {
    /// The machine, where the log knows it.
    pub machine: Option<MachineConfiguration>,
    /// Lines in order of time.
    pub entries: Vec<Entry>,
}

/// An error of a log.
#[derive(Debug, Error)]
pub enum LogError {
    /// Reading failed.
    #[error("log: {0}")]
    Io(#[from] io::Error),
    /// Something else.
    #[error("this is no link log (it does not begin with `{HEAD}`)")]
    NotALog,
    /// A line that no log has.
    #[error("log, line {line}: {why}")]
    Line {
        /// Line from 1.
        line: usize,
        /// The error.
        why: &'static str,
    },
    /// No stream began.
    #[error("in this log no stream began: nothing of a job was printed with it")]
    NoStream,
    /// The log ends before the stream.
    #[error(
        "this log could not be written (a full disk?) when its stream began, and says nothing of how far that went"
    )]
    Unwritten,
    /// The machine is missing.
    #[error("the log does not say which machine it is of; give its machine file (--machine)")]
    NoMachine,
    /// The firmware refuses the machine.
    #[error("the firmware cannot run this machine: {0}")]
    Configuration(ConfigurationError),
    /// The machine does not come to rest.
    #[error("two minutes after the last byte of the log the machine still moves")]
    Restless,
}

/// Reads a log.
///
/// # Errors
/// [`LogError`] with the line.
pub fn read_log(input: &mut impl BufRead) -> Result<LogText, LogError> {
    let mut log = LogText::default();
    let mut text = Vec::new();
    let (mut last_us, mut has_head) = (0, false);
    for line in 1.. {
        let bad = |why| LogError::Line { line, why };
        text.clear();
        let limit = LINE_BYTES_MAX as u64;
        if io::Read::take(&mut *input, limit).read_until(b'\n', &mut text)? == 0 {
            break;
        }
        let text = std::str::from_utf8(&text)
            .map_err(|_| bad("it is not text"))?
            .trim_end();
        if line == 1 {
            if text != HEAD {
                return Err(LogError::NotALog);
            }
            has_head = true;
        } else if let Some(machine) = text.strip_prefix(MACHINE) {
            let bytes = from_hex(machine).ok_or_else(|| bad("the machine is not hex"))?;
            let machine = postcard::from_bytes(&bytes);
            log.machine = Some(machine.map_err(|_| bad("the machine cannot be read"))?);
        } else if !text.starts_with('#') && !text.is_empty() {
            let entry = entry(text).map_err(bad)?;
            let at_us = match &entry {
                Entry::Bytes { at_us, .. } | Entry::Event { at_us, .. } => *at_us,
            };
            if at_us < last_us || at_us > TIME_MAX_US {
                return Err(bad(
                    "its time is before the line above, or beyond four weeks",
                ));
            }
            last_us = at_us;
            log.entries.push(entry);
        }
    }
    if has_head {
        Ok(log)
    } else {
        Err(LogError::NotALog)
    }
}

pub(super) fn entry(text: &str) -> Result<Entry, &'static str> {
    let mut parts = text.splitn(3, ' ');
    let at_us = parts
        .next()
        .and_then(|time| time.parse().ok())
        .ok_or("it has no time")?;
    let way = parts.next().ok_or("it has no direction")?;
    let rest = parts.next().unwrap_or_default();
    let way = match way {
        ">" => Way::Down,
        "<" => Way::Up,
        "!" => {
            return Ok(Entry::Event {
                at_us,
                what: rest.to_string(),
            });
        }
        _ => return Err("its direction is none of > < !"),
    };
    let bytes = from_hex(rest).ok_or("its bytes are not hex")?;
    Ok(Entry::Bytes { at_us, way, bytes })
}

/// Result of a replay.
#[derive(Clone, Debug, PartialEq)]
pub struct Replay {
    /// Complete messages of the host.
    pub messages: u64,
    /// Frames that did not.
    pub damaged: u64,
    /// Hash of every step, 16 hex digits.
    pub step_digest: String,
    /// Steps of all motors.
    pub steps: u64,
    /// Step counts at the end: joints in order, then the extruder.
    pub counts: Vec<i64>,
    /// State at the end.
    pub state: DeviceState,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// Virtual time.
    pub time_s: f64,
}

/// Runs the host's side of a log through the firmware library.
///
/// # Errors
/// [`LogError`].
pub fn replay(log: &LogText, machine: &MachineConfiguration) -> Result<Replay, LogError> {
    let mut controller = Machine::new(machine, 0x4e91_a100).map_err(LogError::Configuration)?;
    let servo_hz = u64::from(machine.servo_hz.max(1));
    let mut steps = StepLog::default();
    let mut decoder = FrameDecoder::new();
    let mut out = [0u8; FRAME_BYTES_MAX];
    let (mut tick, mut messages, mut damaged, mut end_us) = (0u64, 0, 0, 0);
    for entry in &log.entries {
        let Entry::Bytes {
            at_us,
            way: Way::Down,
            bytes,
        } = entry
        else {
            continue;
        };
        end_us = *at_us;
        while tick < at_us * servo_hz / 1_000_000 {
            tick += 1;
            run(&mut controller, &mut steps, &mut out);
        }
        for &byte in bytes {
            match decoder.push(byte) {
                None => {}
                Some(Ok(frame)) if HostMessage::decode(frame.payload).is_ok() => messages += 1,
                Some(_) => damaged += 1,
            }
        }
        controller.handle_bytes(bytes);
    }
    let last_tick = (end_us + TAIL_US) * servo_hz / 1_000_000;
    let mut rested = 0;
    // At rest for a second: longer than any wait for material or for more of a stream.
    while rested < servo_hz {
        if tick >= last_tick {
            return Err(LogError::Restless);
        }
        tick += 1;
        run(&mut controller, &mut steps, &mut out);
        rested = if controller.motion().is_at_rest() {
            rested + 1
        } else {
            0
        };
    }
    let motion = controller.motion();
    Ok(Replay {
        messages,
        damaged,
        step_digest: format!("{:016x}", steps.digest(0)),
        steps: steps.len() as u64,
        counts: motion.counts()[..motion.motors()].to_vec(),
        state: motion.state(),
        fault: motion.fault(),
        time_s: tick as f64 / servo_hz as f64,
    })
}

fn run(controller: &mut Machine, steps: &mut StepLog, out: &mut [u8; FRAME_BYTES_MAX]) {
    controller.run_servo_interval(steps);
    // Reports are made, as on a board, and have no reader.
    while controller.poll_report(out) > 0 {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::test_streams::SharedBytes;
    use crate::settings::Settings;

    #[test]
    fn a_log_reads_back_as_it_was_written() {
        let file = SharedBytes::default();
        let machine = Settings::default().machine;
        let mut log = LinkLog::new(Box::new(file.clone()), Some(&machine));
        log.bytes(5, Way::Down, &[0, 0xab, 7]);
        log.bytes(9, Way::Up, &[]);
        log.event(9, "line lost:\nend of file");
        log.finish().unwrap();
        let text = file.0.lock().unwrap().clone();
        let read = read_log(&mut text.as_slice()).unwrap();
        assert_eq!(read.machine.as_ref(), Some(&machine));
        let bytes = |at_us, way, bytes: &[u8]| Entry::Bytes {
            at_us,
            way,
            bytes: bytes.to_vec(),
        };
        let what = String::from("line lost: end of file");
        let expected = [
            bytes(5, Way::Down, &[0, 0xab, 7]),
            bytes(9, Way::Up, &[]),
            Entry::Event { at_us: 9, what },
        ];
        assert_eq!(read.entries, expected);
        let replayed = replay(&read, &machine).unwrap();
        assert_eq!((replayed.messages, replayed.steps), (0, 0));
    }

    #[test]
    fn what_is_no_log_is_refused_with_the_line() {
        assert!(matches!(
            read_log(&mut b"".as_slice()),
            Err(LogError::NotALog)
        ));
        assert!(matches!(
            read_log(&mut b"hello".as_slice()),
            Err(LogError::NotALog)
        ));
        for bad in [
            "x > 00",
            "1",
            "1 ? 00",
            "1 > 0",
            "1 > 0g",
            "99999999999999999 > 00",
            "5 > 00\n4 > 00",
            "# machine 00",
            "# machine zz",
            "1 > \u{ff}",
        ] {
            let text = format!("{HEAD}\n{bad}\n");
            let error = read_log(&mut text.as_bytes());
            assert!(
                matches!(error, Err(LogError::Line { line: 2 | 3, .. })),
                "{bad}: {error:?}"
            );
        }
    }
}
