//! The hosts of a simulated board: one streams and moves, the others query and stop.
//!
//! ```text
//! connections -> nothing of them is read twice: first line -> the machine's own receiver
//!                                               others     -> a receiver each (`Receiver::watching`)
//! ```
//! The first line belongs to the host that has requested something that needs it (a stream, a move, heat), or that
//! sends while no host has it. Another host that needs it gets it if the first host has requested nothing of that
//! kind, or its machine is at rest, cold and without a stream, or it was silent for as long as the board waits for a
//! host. A host that only queries never takes it from another, so that a watcher does not interfere with the next
//! stream. Silent connections do not occupy a slot that another one needs: the one that was silent longest is closed.

use crate::drive::transport::{Listener, Transport};
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::heat::HOST_SILENT_S;
use headway_firmware::line::{Receiver, Request};
use headway_firmware::machine::Machine;
use headway_protocol::frame::FRAME_BYTES_MAX;
use headway_protocol::message::DeviceState;
use std::io;
use std::time::{Duration, Instant};

/// Connections at once, the first line's among them.
const LINES_MAX: usize = 16;
/// Connections that are let in at once.
const ACCEPTS: usize = 8;
/// Reports of one turn to one host.
const REPORTS_MAX: usize = 32;
/// What may wait for a host that does not read, bytes: some seconds of reports.
const UNSENT_BYTES_MAX: usize = 65_536;
/// How long the board waits for a host on the first line that does not read: the virtual time waits with it.
const ROOM_PATIENCE: Duration = Duration::from_secs(2);

/// A connection.
struct Line {
    transport: Box<dyn Transport>,
    /// Bytes that it has not received yet.
    unsent: Vec<u8>,
    /// Its own conversation, while it is not the first one.
    receiver: Receiver,
    /// Time of its last complete message, or of its connection.
    heard: Instant,
    /// It has sent a complete message.
    has_spoken: bool,
    /// It has requested something that needs the first line, and got it.
    has_claimed: bool,
}

/// All connections.
#[derive(Default)]
pub(super) struct Lines {
    first: Option<Line>,
    others: Vec<Line>,
    /// Hosts that have connected.
    pub hosts: u64,
}

impl Lines {
    /// Drops the first line, as a pulled cable does.
    pub(super) fn pull(&mut self) {
        self.first = None;
    }

    /// Accepts new connections; if there is no free place, the one that was silent longest is closed,
    /// never the first one.
    pub(super) fn accept(
        &mut self,
        listener: &Listener,
        machine: &MachineConfiguration,
        session: u32,
    ) -> io::Result<()> {
        for _ in 0..ACCEPTS {
            let transport = match listener.accept() {
                Ok(Some(transport)) => transport,
                Ok(None) => return Ok(()),
                // Who has a line is served for as long as there is one.
                Err(_) if self.first.is_some() || !self.others.is_empty() => return Ok(()),
                Err(error) => return Err(error),
            };
            self.hosts += 1;
            if self.others.len() + 1 >= LINES_MAX {
                let silence = |line: &(usize, &Line)| (line.1.has_spoken, line.1.heard);
                let longest = self.others.iter().enumerate().min_by_key(silence);
                if let Some((number, _)) = longest {
                    self.others.remove(number);
                }
            }
            self.others.push(Line {
                transport,
                unsent: Vec::new(),
                receiver: Receiver::watching(machine, session),
                heard: Instant::now(),
                has_spoken: false,
                has_claimed: false,
            });
        }
        Ok(())
    }

    /// Takes the bytes of all lines; `each` is called after every request of the first one. True if there were any.
    pub(super) fn hear(
        &mut self,
        machine: &mut Machine,
        mut each: impl FnMut(&mut Machine),
    ) -> bool {
        let mut has_heard = false;
        let mut buffer = [0u8; 4096];
        if let Some(line) = &mut self.first {
            match line.transport.receive(&mut buffer) {
                Ok(count) => {
                    has_heard |= count > 0;
                    line.hear_first(&buffer[..count], machine, &mut each);
                }
                Err(_) => self.first = None,
            }
        }
        let mut number = 0;
        while number < self.others.len() {
            match self.others[number].transport.receive(&mut buffer) {
                Ok(0) => number += 1,
                Ok(count) => {
                    has_heard = true;
                    let bytes = &buffer[..count];
                    number += usize::from(!self.hear_other(number, bytes, machine, &mut each));
                }
                Err(_) => drop(self.others.remove(number)),
            }
        }
        has_heard
    }

    /// Bytes of a line that is not the first one; true if it is now.
    fn hear_other(
        &mut self,
        number: usize,
        bytes: &[u8],
        machine: &mut Machine,
        each: &mut impl FnMut(&mut Machine),
    ) -> bool {
        for (at, &byte) in bytes.iter().enumerate() {
            let (may_be_taken, has_none) = (self.may_be_taken(machine), self.first.is_none());
            let line = &mut self.others[number];
            let Some(request) = line.receiver.receive(0, byte) else {
                continue;
            };
            line.heard = Instant::now();
            let is_new = !std::mem::replace(&mut line.has_spoken, true);
            let speaks_first = is_new && has_none;
            if speaks_first || (may_be_taken && request.needs_the_line()) {
                let mut line = self.others.remove(number);
                // A host that speaks first may be the last one on a new connection: its numbers
                // continue.
                if !speaks_first {
                    machine.exchange_hosts(&mut line.receiver);
                }
                if let Some(mut before) = self.first.take() {
                    std::mem::swap(&mut before.receiver, &mut line.receiver);
                    before.has_claimed = false;
                    self.others.push(before);
                }
                let first = self.first.insert(line);
                first.take(request, machine, each);
                first.hear_first(&bytes[at + 1..], machine, each);
                return true;
            }
            machine.apply_watcher(&mut line.receiver, request);
        }
        false
    }

    /// Whether another host that needs the first line gets it.
    fn may_be_taken(&self, machine: &Machine) -> bool {
        let motion = machine.motion();
        let has_no_job = matches!(
            motion.state(),
            DeviceState::Idle | DeviceState::Finished | DeviceState::Faulted
        );
        let is_free = has_no_job && motion.is_at_rest() && !motion.heat().is_on();
        self.first.as_ref().is_none_or(|first| {
            let is_silent = first.heard.elapsed().as_secs_f32() > HOST_SILENT_S;
            !first.has_claimed || is_free || is_silent
        })
    }

    /// The board's reports to the first host.
    pub(super) fn report(&mut self, machine: &mut Machine) {
        if let Some(line) = &mut self.first
            && line.say(&[]).is_err()
        {
            self.first = None;
        }
        let mut out = [0u8; FRAME_BYTES_MAX];
        for _ in 0..REPORTS_MAX {
            let length = machine.poll_report(&mut out);
            if length == 0 {
                return;
            }
            if let Some(line) = &mut self.first
                && line
                    .say(&out[..length])
                    .and_then(|()| line.wait_for_room())
                    .is_err()
            {
                self.first = None;
            }
        }
    }

    /// Its reports to the others.
    pub(super) fn report_others(&mut self, machine: &Machine) {
        self.others.retain_mut(|line| {
            let mut out = [0u8; FRAME_BYTES_MAX];
            if line.say(&[]).is_err() {
                return false;
            }
            for _ in 0..REPORTS_MAX {
                let length = machine.poll_watcher(&mut line.receiver, &mut out);
                if length == 0 {
                    return true;
                }
                if line.say(&out[..length]).is_err() || line.unsent.len() > UNSENT_BYTES_MAX {
                    return false;
                }
            }
            true
        });
    }
}

impl Line {
    /// Sends what there is room for.
    fn say(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.unsent.extend_from_slice(bytes);
        while !self.unsent.is_empty() {
            match self.transport.send_some(&self.unsent)? {
                0 => break,
                sent => drop(self.unsent.drain(..sent)),
            }
        }
        Ok(())
    }

    fn wait_for_room(&mut self) -> io::Result<()> {
        let begun = Instant::now();
        while self.unsent.len() > UNSENT_BYTES_MAX {
            if begun.elapsed() > ROOM_PATIENCE {
                return Err(io::Error::from(io::ErrorKind::TimedOut));
            }
            std::thread::sleep(Duration::from_millis(1));
            self.say(&[])?;
        }
        Ok(())
    }

    /// Bytes of the first line.
    fn hear_first(
        &mut self,
        bytes: &[u8],
        machine: &mut Machine,
        each: &mut impl FnMut(&mut Machine),
    ) {
        for &byte in bytes {
            if let Some(request) = machine.push(byte) {
                self.take(request, machine, each);
            }
        }
    }

    fn take(
        &mut self,
        request: Request,
        machine: &mut Machine,
        each: &mut impl FnMut(&mut Machine),
    ) {
        self.heard = Instant::now();
        self.has_spoken = true;
        self.has_claimed |= request.needs_the_line();
        machine.apply(request);
        each(machine);
    }
}
