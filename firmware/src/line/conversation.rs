//! What the controller knows of the host at one of its lines.
//!
//! In: bytes of that line. Out: which of its messages are new, and the reports that it is to get. Every line has its
//! numbers, refusals and reports for itself, so that no host ends another one's commands, or hears their answers. What
//! is common to all lines (the stream, who has it, the settings) is the [`Receiver`](super::Receiver)'s.

use super::{Receiver, is_newer};
use crate::configuration::MachineConfiguration;
use crate::design::{STATUS_PERIOD_MS, ticks_of_ms};
use headway_protocol::frame::FrameDecoder;
use headway_protocol::message::{DeviceState, Fault, Refusal, RefusalReason};
use heapless::Deque;

/// Refusals that wait to be sent. A message that would need one more is dropped as if it had been
/// lost, and answered when the host repeats it.
const REFUSALS_MAX: usize = 4;

/// Pending reports.
#[derive(Clone, Debug, Default)]
pub(super) struct Due {
    pub(super) welcome: bool,
    pub(super) refusals: Deque<Refusal, REFUSALS_MAX>,
    pub(super) ack: bool,
    pub(super) nak: bool,
    pub(super) status: bool,
    pub(super) fault: bool,
    pub(super) crash: bool,
    pub(super) measured: bool,
}

/// The controller's end of one line.
#[derive(Clone, Debug)]
pub struct Conversation {
    pub(super) decoder: FrameDecoder,
    /// Number of the line: a block that arrives in pieces is its own.
    pub(super) line: u8,
    pub(super) host_session: Option<u32>,
    pub(super) control_taken: u16,
    /// The newest control message that was refused: its repeat is refused again.
    pub(super) refused: Option<Refusal>,
    pub(super) due: Due,
    /// Credit last sent to the host.
    pub(super) knot_limit_told: u32,
    /// Ticks of the last Nak and of the last status.
    pub(super) nak_tick: u64,
    pub(super) status_tick: u64,
    pub(super) status_period_ticks: u64,
    pub(super) last_state: DeviceState,
    pub(super) last_fault: Option<Fault>,
    pub(super) report_sequence: u16,
}

impl Conversation {
    /// Nobody was heard yet. Lines have different numbers.
    pub fn new(configuration: &MachineConfiguration, line: u8) -> Self {
        Self {
            decoder: FrameDecoder::new(),
            line,
            host_session: None,
            control_taken: 0,
            refused: None,
            due: Due::default(),
            knot_limit_told: 0,
            nak_tick: 0,
            status_tick: 0,
            status_period_ticks: ticks_of_ms(STATUS_PERIOD_MS, configuration.servo_hz).into(),
            last_state: DeviceState::Idle,
            last_fault: None,
            report_sequence: 0,
        }
    }

    /// Number of the line.
    pub fn line(&self) -> u8 {
        self.line
    }

    /// A host that may be a new one says hello: a new one starts the counter at its own number.
    pub(super) fn greet(&mut self, sequence: u16, host_session: u32) {
        if self.host_session != Some(host_session) || is_newer(sequence, self.control_taken) {
            self.control_taken = sequence;
            self.refused = None;
        }
        log_event!("host {=u32:08x} says hello", host_session);
        self.host_session = Some(host_session);
        self.due.welcome = true;
        // A later host gets it as well, and the reason for a restart of the board.
        self.due.fault = true;
        self.due.crash = true;
    }

    /// True if a control frame is new; answers it in any case.
    pub(super) fn take_control(&mut self, sequence: u16) -> bool {
        if self.host_session.is_none() {
            self.refuse(sequence, RefusalReason::NoHello);
            return false;
        }
        self.due.ack = true;
        if !is_newer(sequence, self.control_taken) {
            // The refusal may have been lost.
            let again = self.refused.filter(|refused| refused.sequence == sequence);
            if let Some(refused) = again {
                self.refuse(sequence, refused.reason);
            }
            return false;
        }
        // Only if a refusal of it could be sent.
        let takes = !self.due.refusals.is_full();
        if takes {
            self.control_taken = sequence;
            self.refused = None;
        }
        takes
    }

    pub(super) fn refuse(&mut self, sequence: u16, reason: RefusalReason) {
        log_event!("refused {=u16}: {}", sequence, reason);
        // Where there is no room the host repeats itself.
        let _ = self.due.refusals.push_back(Refusal { sequence, reason });
    }

    /// The same for an accepted control message.
    pub(super) fn refuse_control(&mut self, sequence: u16, reason: RefusalReason) {
        self.refused = Some(Refusal { sequence, reason });
        self.refuse(sequence, reason);
    }
}

/// Who may stream, move and heat.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Owner {
    /// The host that has asked for something that only one may do.
    session: Option<u32>,
    /// Servo tick at which it was last heard.
    heard_ticks: u64,
    /// The host that has ordered heat, a stream or a move last: its silence ends the heat.
    heats: Option<u32>,
}

impl Owner {
    /// True for the host that has the machine.
    pub(super) fn is(&self, talk: &Conversation) -> bool {
        self.session.is_some() && self.session == talk.host_session
    }

    /// A host is heard: true if it is the one that heats.
    pub(super) fn hear(&mut self, talk: &Conversation, now_ticks: u64) -> bool {
        if self.is(talk) {
            self.heard_ticks = now_ticks;
        }
        self.heats.is_some() && self.heats == talk.host_session
    }

    /// A host asks for something that only one may do: true if it has the machine, from now on or already. It gets it
    /// from another one where `is_free`, or where that one was silent for `silent_ticks`.
    pub(super) fn claim(
        &mut self,
        talk: &Conversation,
        now_ticks: u64,
        is_free: bool,
        silent_ticks: u64,
    ) -> bool {
        let is_silent = now_ticks >= self.heard_ticks + silent_ticks;
        let may = self.session.is_none() || self.is(talk) || is_free || is_silent;
        if may && talk.host_session.is_some() {
            self.session = talk.host_session;
            self.heard_ticks = now_ticks;
        }
        self.is(talk)
    }

    /// What only one may do was done: heat is that host's from now on.
    pub(super) fn take_heat(&mut self, talk: &Conversation) {
        self.heats = talk.host_session;
    }

    /// Its line has another host now, or none.
    pub(super) fn leave(&mut self, session: Option<u32>) {
        if self.session == session {
            self.session = None;
        }
    }
}

impl Receiver {
    /// True for the host that streams, moves and heats.
    pub fn is_owner(&self, talk: &Conversation) -> bool {
        self.owner.is(talk)
    }

    /// The connection of a line has ended, where that can be known: its host keeps nothing back from the others.
    pub fn hang_up(&mut self, talk: &Conversation) {
        self.owner.leave(talk.host_session);
    }
}
