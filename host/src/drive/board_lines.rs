//! The connections of a simulated board: lines of its controller, of which one host streams, moves and heats, and the
//! others query and stop. Which one is the controller's business (`headway_firmware::line`).
//!
//! Silent connections do not occupy a slot that another one needs: the one that was silent longest is closed.

use crate::drive::transport::{Listener, Transport};
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::line::Conversation;
use headway_firmware::machine::Machine;
use headway_protocol::frame::FRAME_BYTES_MAX;
use std::io;
use std::time::{Duration, Instant};

/// Connections at once.
const LINES_MAX: usize = 16;
/// Connections that are let in at once.
const ACCEPTS: usize = 8;
/// Reports of one turn to one host.
const REPORTS_MAX: usize = 32;
/// What may wait for a host that does not read, bytes: some seconds of reports.
const UNSENT_BYTES_MAX: usize = 65_536;
/// How long the board waits for the host that has the machine and does not read: the virtual time waits with it.
const ROOM_PATIENCE: Duration = Duration::from_secs(2);

/// A connection.
struct Line {
    transport: Box<dyn Transport>,
    /// Bytes that it has not received yet.
    unsent: Vec<u8>,
    talk: Conversation,
    /// Time of its last bytes, or of its connection.
    heard: Instant,
    has_spoken: bool,
}

/// All connections.
#[derive(Default)]
pub(super) struct Lines {
    lines: Vec<Line>,
    /// Number of the next one: 0 is the controller's own.
    next: u8,
    /// Hosts that have connected.
    pub hosts: u64,
}

impl Lines {
    /// Drops the line of the host that has the machine, as a pulled cable does.
    pub(super) fn pull(&mut self, machine: &mut Machine) {
        let owner = |line: &Line| machine.is_owner(&line.talk);
        if let Some(number) = self.lines.iter().position(owner) {
            self.close(number, machine);
        }
    }

    fn close(&mut self, number: usize, machine: &mut Machine) {
        let line = self.lines.remove(number);
        machine.hang_up(&line.talk);
    }

    /// Accepts new connections; if there is no free place, the one that was silent longest is closed,
    /// never that of the host that has the machine.
    pub(super) fn accept(
        &mut self,
        listener: &Listener,
        configuration: &MachineConfiguration,
        machine: &mut Machine,
    ) -> io::Result<()> {
        for _ in 0..ACCEPTS {
            let transport = match listener.accept() {
                Ok(Some(transport)) => transport,
                Ok(None) => return Ok(()),
                // Who has a line is served for as long as there is one.
                Err(_) if !self.lines.is_empty() => return Ok(()),
                Err(error) => return Err(error),
            };
            self.hosts += 1;
            if self.lines.len() >= LINES_MAX {
                let lines = self.lines.iter().enumerate();
                let others = lines.filter(|(_, line)| !machine.is_owner(&line.talk));
                let longest = others.min_by_key(|(_, line)| (line.has_spoken, line.heard));
                if let Some((number, _)) = longest {
                    self.close(number, machine);
                }
            }
            self.next = self.free_number();
            self.lines.push(Line {
                transport,
                unsent: Vec::new(),
                talk: Conversation::new(configuration, self.next),
                heard: Instant::now(),
                has_spoken: false,
            });
        }
        Ok(())
    }

    /// A number that no line has: there are fewer lines than numbers.
    fn free_number(&self) -> u8 {
        let numbers = (1..=u8::MAX).map(|step| self.next.wrapping_add(step).max(1));
        let is_free = |number: &u8| self.lines.iter().all(|line| line.talk.line() != *number);
        numbers.into_iter().find(is_free).unwrap_or(1)
    }

    /// Takes the bytes of all lines; `each` is called after every message. True if there were any.
    pub(super) fn hear(
        &mut self,
        machine: &mut Machine,
        mut each: impl FnMut(&mut Machine, &mut Conversation),
    ) -> bool {
        let mut has_heard = false;
        let mut buffer = [0u8; 4096];
        let mut number = 0;
        while number < self.lines.len() {
            let line = &mut self.lines[number];
            let Ok(count) = line.transport.receive(&mut buffer) else {
                self.close(number, machine);
                continue;
            };
            number += 1;
            if count == 0 {
                continue;
            }
            has_heard = true;
            line.heard = Instant::now();
            line.has_spoken = true;
            for message in buffer[..count].split_inclusive(|byte| *byte == 0) {
                machine.handle_line(&mut line.talk, message);
                each(machine, &mut line.talk);
            }
        }
        has_heard
    }

    /// The board's reports to all hosts.
    pub(super) fn report(&mut self, machine: &mut Machine) {
        let mut number = 0;
        while number < self.lines.len() {
            match self.lines[number].report(machine) {
                Ok(()) => number += 1,
                Err(_) => self.close(number, machine),
            }
        }
    }
}

impl Line {
    fn report(&mut self, machine: &Machine) -> io::Result<()> {
        self.say(&[])?;
        let mut out = [0u8; FRAME_BYTES_MAX];
        for _ in 0..REPORTS_MAX {
            let length = machine.poll_line(&mut self.talk, &mut out);
            if length == 0 {
                return Ok(());
            }
            self.say(&out[..length])?;
            if machine.is_owner(&self.talk) {
                self.wait_for_room()?;
            } else if self.unsent.len() > UNSENT_BYTES_MAX {
                return Err(io::Error::from(io::ErrorKind::TimedOut));
            }
        }
        Ok(())
    }

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
}
