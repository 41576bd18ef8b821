//! Moves bytes between a [`Sender`] and a port in real time, and reopens the port when the line is
//! lost: the cable may be unplugged and plugged in again, the sender continues by itself.
//!
//! Call [`Pump::turn`] repeatedly; each call waits a few milliseconds at most. Waits are counted by its clock
//! (`host_clock`), a log has the time that passed.

use crate::drive::host_clock::{HostClock, RealClock};
use crate::drive::link_log::{LinkLog, Way};
use crate::drive::sender::Sender;
use crate::drive::transport::{Port, Transport};
use headway_protocol::frame::FRAME_BYTES_MAX;
use std::io;
use std::time::{Duration, Instant, SystemTime};

/// Time between two attempts to open a port.
const REOPEN: Duration = Duration::from_millis(250);
/// Frames sent before bytes are read again.
const FRAMES_PER_TURN: usize = 16;

/// Event of the line in a turn.
#[derive(Debug)]
pub enum LineEvent {
    /// The port is open.
    Opened,
    /// The line is lost.
    Lost(io::Error),
}

/// A sender on a real port.
#[derive(Debug)]
pub struct Pump {
    port: Port,
    baud: u32,
    transport: Option<OpenLine>,
    next_try: Instant,
    begun: Instant,
    clock: HostClock,
    real: RealClock,
    log: Option<LinkLog>,
    opened: u64,
}

/// A number that no other run of the host has: time and process.
pub fn host_session() -> u32 {
    let time = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let nanoseconds = time.map_or(0, |time| time.as_nanos() as u64);
    let mixed =
        (nanoseconds ^ u64::from(std::process::id()) << 40).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed >> 32) as u32
}

struct OpenLine(Box<dyn Transport>);

impl std::fmt::Debug for OpenLine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("OpenLine")
    }
}

impl Pump {
    /// Opens the port, which must exist at the start.
    ///
    /// # Errors
    /// The system's error.
    pub fn open(port: &Port, baud: u32, log: Option<LinkLog>) -> io::Result<Pump> {
        let transport = Some(OpenLine(port.open(baud)?));
        let begun = Instant::now();
        Ok(Pump {
            port: port.clone(),
            baud,
            transport,
            next_try: begun,
            begun,
            clock: HostClock::default(),
            real: RealClock::begin(begun, SystemTime::now()),
            log,
            opened: 1,
        })
    }

    /// Time since the start in which this host could hear.
    pub fn now_us(&self) -> u64 {
        self.clock.at(self.logged_us())
    }

    /// Time since the start in which the host slept too.
    pub fn real_us(&mut self) -> u64 {
        self.real.at_us(Instant::now(), SystemTime::now())
    }

    fn logged_us(&self) -> u64 {
        self.begun.elapsed().as_micros() as u64
    }

    /// How often the port was opened.
    pub fn times_opened(&self) -> u64 {
        self.opened
    }

    /// True while the line is there.
    pub fn is_open(&self) -> bool {
        self.transport.is_some()
    }

    /// Sends pending frames, receives bytes.
    pub fn turn(&mut self, sender: &mut Sender) -> Option<LineEvent> {
        self.clock.round(self.logged_us());
        let opened = self.reopen();
        let result = self.exchange(sender);
        match result {
            Ok(()) => opened,
            Err(error) => {
                self.note(&format!("line lost: {error}"));
                self.transport = None;
                self.next_try = Instant::now() + REOPEN;
                Some(LineEvent::Lost(error))
            }
        }
    }

    /// Why the log is not written any more.
    pub fn log_problem(&self) -> Option<&io::Error> {
        self.log.as_ref().and_then(LinkLog::problem)
    }

    /// Ends the log.
    ///
    /// # Errors
    /// Its first one.
    pub fn finish(self) -> io::Result<()> {
        self.log.map_or(Ok(()), LinkLog::finish)
    }

    fn reopen(&mut self) -> Option<LineEvent> {
        if self.transport.is_some() {
            return None;
        }
        let now = Instant::now();
        if now >= self.next_try {
            self.next_try = now + REOPEN;
            if let Ok(transport) = self.port.open(self.baud) {
                self.transport = Some(OpenLine(transport));
                self.opened += 1;
                self.note("line open again");
                return Some(LineEvent::Opened);
            }
        }
        std::thread::sleep(Duration::from_millis(5));
        None
    }

    fn exchange(&mut self, sender: &mut Sender) -> io::Result<()> {
        let Some(OpenLine(transport)) = &mut self.transport else {
            return Ok(());
        };
        let (begun, clock) = (self.begun, &self.clock);
        let read = || begun.elapsed().as_micros() as u64;
        let mut out = [0u8; FRAME_BYTES_MAX];
        for _ in 0..FRAMES_PER_TURN {
            let at_us = read();
            let Some(length) = sender.poll_transmit(clock.at(at_us), &mut out) else {
                break;
            };
            if let Some(log) = &mut self.log {
                log.bytes(at_us, Way::Down, &out[..length]);
            }
            transport.send(&out[..length])?;
        }
        let mut buffer = [0u8; 4096];
        let count = transport.receive(&mut buffer)?;
        let at_us = read();
        if count > 0 {
            if let Some(log) = &mut self.log {
                log.bytes(at_us, Way::Up, &buffer[..count]);
            }
            sender.handle_bytes(clock.at(at_us), &buffer[..count]);
        }
        Ok(())
    }

    fn note(&mut self, what: &str) {
        let at_us = self.logged_us();
        if let Some(log) = &mut self.log {
            log.event(at_us, what);
        }
    }
}
