//! Time limits of a host that waits for a board: each wait has its own.
//!
//! Progress of a [`Sender`], and time in microseconds in which the host could hear (`host_clock`) -> nothing, or the
//! wait that timed out and the board's last report. A board that answers but makes no progress is treated like a silent one. The
//! counts of accepted frames and finished spans only ever grow here, so that a board cannot gain time by
//! reporting smaller ones. Not covered: the user's abort (Ctrl-C, `abort`), which is handled elsewhere.

use crate::drive::sender::Sender;
use crate::drive::sender_state::SenderState;
use crate::job::SegmentStream;
use headway_protocol::message::{DeviceMessage, DeviceState, Status};
use std::fmt;

const S: u64 = 1_000_000;
/// A greeting, an opening: many round trips of the slowest line.
pub const ANSWER_US: u64 = 10 * S;
/// A command: the same, and a line that stalls for some seconds.
pub const COMMAND_US: u64 = 20 * S;
/// A span that should end, besides its own length.
pub const PROGRESS_US: u64 = 10 * S;
/// A state that does not belong to our stream: longer than a report in transit.
pub const GONE_US: u64 = 3 * S;
/// Rest after an abort: a ramp, and a servo interval.
pub const REST_US: u64 = 60 * S;
/// A cable that is plugged in again: somebody has to walk to the machine.
pub const LINE_US: u64 = 600 * S;
/// A pause: somebody checks the print in the morning.
pub const PAUSE_US: u64 = 12 * 3600 * S;
/// Slowest feed override, per cent: spans last so much longer.
const OVERRIDE_PERCENT_MIN: u64 = 1;

/// What was waited for in vain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// A welcome.
    Welcome,
    /// The stream's opening.
    Opening,
    /// A command to be accepted.
    Command,
    /// A frame to be accepted or a span to be finished.
    Progress,
    /// The end, when all spans are done.
    End,
    /// Our stream: the board does something else.
    Stream,
    /// Rest after an abort.
    Rest,
    /// The line.
    Line,
    /// The end of a pause.
    Resume,
}

/// A wait that is over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Overdue {
    /// The wait that timed out.
    pub wait: Wait,
    /// How long, s.
    pub waited_s: u64,
    /// Spans done and all of them.
    pub spans: (u32, u32),
    /// The board's last report.
    pub said: String,
}

impl fmt::Display for Overdue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (done, all) = self.spans;
        match self.wait {
            Wait::Welcome => f.write_str("the board does not greet back")?,
            Wait::Opening => f.write_str("the board does not open the stream")?,
            Wait::Command => f.write_str("the board does not take a command")?,
            Wait::Progress => write!(f, "the board gets no further than {done} of {all} spans")?,
            Wait::End => write!(f, "the board does not end after {done} of {all} spans")?,
            Wait::Stream => write!(f, "the board left the job at {done} of {all} spans")?,
            Wait::Rest => f.write_str("the board does not come to rest")?,
            Wait::Line => f.write_str("the line did not come back")?,
            Wait::Resume => write!(f, "nobody resumed the job at {done} of {all} spans")?,
        }
        write!(
            f,
            " ({} s); it said last: {}. Look at it with `headway board status`, end it with `headway board \
             abort`, or go on with --resume",
            self.waited_s, self.said
        )
    }
}

/// A message as a user reads it.
pub fn said(message: Option<&DeviceMessage>, unreadable: bool) -> String {
    if unreadable {
        return "something that this program does not know".to_string();
    }
    match message {
        None => "nothing".to_string(),
        Some(DeviceMessage::Welcome(_)) => "welcome".to_string(),
        Some(DeviceMessage::Refused(refusal)) => format!("refused ({})", refusal.reason),
        Some(DeviceMessage::Ack(ack)) => format!(
            "next frame {}, {} knots may come, command {} taken",
            ack.next_sequence, ack.knot_limit, ack.control_taken
        ),
        Some(DeviceMessage::Nak(ack)) => format!("frame {} is missing", ack.next_sequence),
        Some(DeviceMessage::Status(status)) => format!(
            "{}, {} spans done, {} knots queued",
            format!("{:?}", status.state).to_lowercase(),
            status.spans_done,
            status.queue_knots
        ),
        Some(DeviceMessage::Fault(fault)) => format!("fault: {fault}"),
        Some(DeviceMessage::Measured(_)) => "its own measurement".to_string(),
        Some(DeviceMessage::Crash(crash)) => format!("it had crashed: {crash}"),
    }
}

/// Watches one conversation.
#[derive(Clone, Debug)]
pub struct Patience {
    /// The longest span at the planned rate, and the longest prime or retract.
    span_us: u64,
    event_us: u64,
    spans: u32,
    spans_done: u32,
    frames_taken: usize,
    state: Option<SenderState>,
    wait: Wait,
    since_us: u64,
    /// Duration of pauses since the last executed span.
    paused_us: u64,
    /// Since when a command waits, the board is at something else.
    command: Option<(u16, u64)>,
    gone_us: Option<u64>,
    /// Since when the line is lost, or connects and drops without progress; whether it is connected, and
    /// since when.
    lost_us: Option<u64>,
    is_open: bool,
    opened_us: u64,
}

impl Patience {
    /// For a stream on a servo with this tick rate.
    pub fn new(stream: &SegmentStream, servo_hz: u32) -> Patience {
        let us = |ticks: u64| ticks * S / u64::from(servo_hz.max(1));
        let spans = stream
            .knots
            .iter()
            .map(|knot| u64::from(knot.duration_ticks));
        let events = stream
            .events
            .iter()
            .map(|event| u64::from(event.duration_ticks.0));
        Patience {
            span_us: us(spans.max().unwrap_or(0)),
            event_us: us(events.max().unwrap_or(0)),
            spans: stream.knots.len() as u32,
            spans_done: 0,
            frames_taken: 0,
            state: None,
            wait: Wait::Welcome,
            since_us: 0,
            paused_us: 0,
            command: None,
            gone_us: None,
            lost_us: None,
            is_open: true,
            opened_us: 0,
        }
    }

    /// For a conversation without a stream.
    #[cfg(test)]
    pub fn without_stream() -> Patience {
        Patience::new(&SegmentStream::default(), 1)
    }

    /// How long the present wait may take, besides that for a command, at this feed override.
    fn bound_us(&self, override_percent: u16) -> u64 {
        let percent = u64::from(override_percent).max(OVERRIDE_PERCENT_MIN);
        match self.wait {
            Wait::Welcome | Wait::Opening => ANSWER_US,
            Wait::Progress => PROGRESS_US + self.event_us + self.span_us * 100 / percent.min(100),
            Wait::End => PROGRESS_US + self.event_us,
            Wait::Rest => REST_US,
            Wait::Resume => PAUSE_US.saturating_sub(self.paused_us),
            Wait::Command => COMMAND_US,
            Wait::Stream => GONE_US,
            Wait::Line => LINE_US,
        }
    }

    /// The event that is waited for in this state; `None` if there is none.
    fn wait_of(&self, sender: &Sender, status: Option<&Status>) -> Option<Wait> {
        // A board that heats watches its heaters itself.
        let is_paused = status.is_some_and(|status| {
            matches!(status.state, DeviceState::Paused | DeviceState::Heating)
        });
        match sender.state() {
            SenderState::Greeting => Some(Wait::Welcome),
            SenderState::Opening => Some(Wait::Opening),
            SenderState::Streaming | SenderState::Finishing if is_paused => Some(Wait::Resume),
            SenderState::Finishing if self.spans_done >= self.spans => Some(Wait::End),
            SenderState::Streaming | SenderState::Finishing => Some(Wait::Progress),
            SenderState::Aborted => Some(Wait::Rest),
            SenderState::Talking | SenderState::Done | SenderState::Failed(_) => None,
        }
    }

    /// Checks the time limits. To be called often; `line_open`: bytes can arrive.
    pub fn look(&mut self, now_us: u64, sender: &Sender, line_open: bool) -> Option<Overdue> {
        if let late @ Some(_) = self.look_at_line(now_us, sender, line_open) {
            return late;
        }
        if !line_open {
            return None;
        }
        let status = sender.last_status();
        self.note_progress(now_us, sender, status);
        let command = sender.waits_for_command();
        if self.command.map(|(sequence, _)| sequence) != command {
            self.command = command.map(|sequence| (sequence, now_us));
        }
        if let Some((_, since_us)) = self.command {
            let late = self.overdue(now_us, since_us, COMMAND_US, Wait::Command, sender);
            if late.is_some() {
                return late;
            }
        }
        if let Some(since_us) = self.gone_us {
            let late = self.overdue(now_us, since_us, GONE_US, Wait::Stream, sender);
            if late.is_some() {
                return late;
            }
        }
        self.wait_of(sender, status)?;
        let percent = status.map_or(100, |status| status.override_percent);
        let (bound_us, wait) = (self.bound_us(percent), self.wait);
        self.overdue(now_us, self.since_us, bound_us, wait, sender)
    }

    /// A line that returns restarts every wait, since messages may have been lost; a line that connects and
    /// drops without progress counts as lost since it first dropped.
    fn look_at_line(&mut self, now_us: u64, sender: &Sender, open: bool) -> Option<Overdue> {
        if open && !self.is_open {
            self.opened_us = now_us;
            self.since_us = now_us;
            self.command = None;
            self.gone_us = None;
        }
        self.is_open = open;
        if !open {
            self.lost_us.get_or_insert(now_us);
        }
        // Nothing is reached in a pause: there an answer counts, from a line that stays.
        let answered = open && sender.heard_us() > self.opened_us;
        let stays = answered && now_us >= self.opened_us + ANSWER_US;
        if stays && self.wait == Wait::Resume {
            self.lost_us = None;
        }
        let since_us = self.lost_us?;
        self.overdue(now_us, since_us, LINE_US, Wait::Line, sender)
    }

    fn note_progress(&mut self, now_us: u64, sender: &Sender, status: Option<&Status>) {
        let (frames_taken, _) = sender.progress_frames();
        let streams = matches!(
            sender.state(),
            SenderState::Streaming | SenderState::Finishing
        );
        let spans_done = status
            .filter(|_| streams)
            .map_or(0, |status| status.spans_done.min(self.spans));
        let progressed = frames_taken > self.frames_taken || spans_done > self.spans_done;
        self.frames_taken = self.frames_taken.max(frames_taken);
        self.spans_done = self.spans_done.max(spans_done);
        let is_other = self.state.as_ref() != Some(sender.state());
        if is_other {
            self.state = Some(sender.state().clone());
            self.since_us = now_us;
        }
        if is_other || progressed {
            self.lost_us = None;
        }
        if let Some(wait) = self.wait_of(sender, status) {
            if progressed {
                self.paused_us = 0;
            }
            if wait != self.wait && [wait, self.wait].contains(&Wait::Resume) {
                // Repeated pauses add up, so that they do not extend the time without end.
                let waited_us = now_us.saturating_sub(self.since_us);
                self.paused_us += waited_us.max(PROGRESS_US);
                self.since_us = now_us;
            } else if progressed {
                self.since_us = now_us;
            }
            self.wait = wait;
        }
        let elsewhere = streams
            && status.is_some_and(|status| match status.state {
                DeviceState::Idle
                | DeviceState::Homing
                | DeviceState::Jogging
                | DeviceState::Probing => true,
                DeviceState::Finished => status.spans_done != self.spans || !sender.is_all_taken(),
                _ => false,
            });
        self.gone_us = elsewhere.then(|| self.gone_us.unwrap_or(now_us));
    }

    fn overdue(
        &self,
        now_us: u64,
        since_us: u64,
        bound_us: u64,
        wait: Wait,
        sender: &Sender,
    ) -> Option<Overdue> {
        let waited_us = now_us.saturating_sub(since_us);
        (waited_us > bound_us).then(|| Overdue {
            wait,
            waited_s: waited_us / S,
            spans: (self.spans_done, self.spans),
            said: sender.said_last(),
        })
    }
}
