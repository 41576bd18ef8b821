//! The host's end of the link, sans-IO: handshake, credits, resends, keep-alive.
//!
//! [`WireFrames`] -> bytes for the line; bytes from the line -> progress. Time is an argument, in
//! microseconds of any clock that only goes forward. Call order: when bytes arrive,
//! [`Sender::handle_bytes`]; when the line has room, [`Sender::poll_transmit`] until it returns
//! nothing; then [`Sender::poll_event`] until it is empty; again at the latest after
//! [`POLL_INTERVAL_US`]. Commands ([`Sender::command`]) may come at any time.
//!
//! The stream goes back to the frame that the controller requests (go-back-N); control messages are
//! sent one at a time and overtake the stream. `protocol/WIRE.md` has the rules of the
//! conversation. Not covered: opening and closing the line, which the transport does; this state
//! machine continues by itself when the line is restored.

use crate::drive::patience::said;
use crate::drive::round_trip::{RETRY_MAX_US, RETRY_MIN_US, RoundTrip};
use crate::drive::sender_state::{
    ControlMessage, InFlight, Intent, Outstanding, SenderEvent, SenderFigures, SenderSetup,
    SenderState,
};
use crate::job::frames::WireFrames;
use headway_protocol::frame::{FRAME_BYTES_MAX, FrameDecoder, encode_frame, encode_payload};
use headway_protocol::message::{
    Control, DeviceMessage, Hello, HostMessage, PROTOCOL_VERSION, SCHEMA_HASH, Start, Status,
};
use headway_protocol::units::{CHANNELS, Units};
use std::collections::VecDeque;

/// How long the caller may wait between two polls.
pub const POLL_INTERVAL_US: u64 = 5_000;
/// Silence after which the controller's status is queried.
const KEEP_ALIVE_US: u64 = 200_000;
/// Time without an acknowledgement after which one is requested while the stream waits for credits
/// or for its end: news of them may have been lost. The queue is full then, and credits arrive
/// unrequested as it empties, so this is rarely needed; every request costs a twelfth of a block.
const KEEP_ALIVE_WAITING_US: u64 = 250_000;
/// Time after which a waiting host sends a message, whatever it receives: a board that heats watches
/// only the frames that it receives, and switches off after 30 s
/// ([`headway_firmware::heat::HOST_SILENT_S`]). Six times in that.
const SAY_SOMETHING_US: u64 = 5_000_000;
/// Unanswered control messages after which every other one is a greeting.
const TRIES_BEFORE_HELLO: u32 = 2;
/// Bytes in transit before an acknowledgement is awaited: 20 ms at 1 Mbaud, enough for USB's
/// latency, little enough that a control message is never delayed much.
const WINDOW_BYTES: usize = 2048;

#[path = "sender_inbound.rs"]
mod inbound;

/// The host's end of one stream.
#[derive(Debug)]
pub struct Sender {
    frames: WireFrames,
    setup: SenderSetup,
    intent: Intent,
    state: SenderState,
    decoder: FrameDecoder,
    device_session: Option<u32>,
    /// Newest control sequence used.
    control_sequence: u16,
    outstanding: Option<Outstanding>,
    /// A welcome did not know our stream.
    may_have_lost_stream: bool,
    commands: VecDeque<Control>,
    events: VecDeque<SenderEvent>,
    first_sequence: u32,
    /// Frames before this one were accepted.
    acknowledged: usize,
    /// Frame to send next.
    cursor: usize,
    /// One past the furthest frame ever sent.
    high_water: usize,
    /// Frames acknowledged..cursor.
    in_flight: VecDeque<InFlight>,
    knot_limit: u32,
    event_limit: u32,
    round_trip: RoundTrip,
    retry_us: u64,
    /// The frame that was gone back to last, and when.
    went_back: Option<(usize, u64)>,
    heard_us: u64,
    /// When the last acknowledgement came.
    answered_us: u64,
    asked_us: u64,
    /// Time of the last message.
    said_us: u64,
    /// What was heard last, and whether it could not be read.
    last_message: Option<DeviceMessage>,
    unreadable: bool,
    last_status: Option<Status>,
    figures: SenderFigures,
}

impl Sender {
    /// A sender for `frames`; nothing is sent before the first poll.
    pub fn new(frames: WireFrames, setup: SenderSetup) -> Self {
        let intent = if setup.resume {
            Intent::ResumeOrStream
        } else {
            Intent::Stream
        };
        Self::with_intent(frames, setup, intent)
    }

    /// A sender that continues a stream of which the controller has a part, or fails.
    pub fn resuming(frames: WireFrames, setup: SenderSetup) -> Self {
        Self::with_intent(frames, setup, Intent::ResumeOnly)
    }

    /// A sender for commands and questions only; any machine will do.
    pub fn talking(host_session: u32) -> Self {
        let setup = SenderSetup {
            host_session,
            machine_hash: 0,
            solution: 0,
            servo_hz: 0,
            resume: false,
        };
        Self::with_intent(
            WireFrames::new([0; CHANNELS], Units::BASE),
            setup,
            Intent::Talk,
        )
    }

    fn with_intent(frames: WireFrames, setup: SenderSetup, intent: Intent) -> Self {
        Sender {
            frames,
            setup,
            intent,
            state: SenderState::Greeting,
            decoder: FrameDecoder::new(),
            device_session: None,
            control_sequence: setup.host_session as u16,
            outstanding: None,
            may_have_lost_stream: false,
            commands: VecDeque::new(),
            events: VecDeque::new(),
            first_sequence: 0,
            acknowledged: 0,
            cursor: 0,
            high_water: 0,
            in_flight: VecDeque::new(),
            knot_limit: 0,
            event_limit: 0,
            round_trip: RoundTrip::default(),
            retry_us: RoundTrip::default().estimate_us(),
            went_back: None,
            heard_us: 0,
            answered_us: 0,
            asked_us: 0,
            said_us: 0,
            last_message: None,
            unreadable: false,
            last_status: None,
            figures: SenderFigures::default(),
        }
    }

    /// Where the conversation is.
    pub fn state(&self) -> &SenderState {
        &self.state
    }

    /// The stream that is sent.
    pub fn frames(&self) -> &WireFrames {
        &self.frames
    }

    /// The sender's setup.
    pub fn setup(&self) -> &SenderSetup {
        &self.setup
    }

    /// Counters.
    pub fn figures(&self) -> &SenderFigures {
        &self.figures
    }

    /// Stream frames accepted by the controller, and their total.
    pub fn progress_frames(&self) -> (usize, usize) {
        (self.acknowledged, self.frames.len())
    }

    /// Time of the controller's last message.
    pub fn heard_us(&self) -> u64 {
        self.heard_us
    }

    /// The newest status of this conversation.
    pub fn last_status(&self) -> Option<&Status> {
        self.last_status.as_ref()
    }

    /// The controller's last message, as text.
    pub fn said_last(&self) -> String {
        said(self.last_message.as_ref(), self.unreadable)
    }

    /// The command that waits to be accepted, by its sequence number.
    pub fn waits_for_command(&self) -> Option<u16> {
        let outstanding = self.outstanding?;
        let is_command = matches!(outstanding.what, ControlMessage::Command(_));
        (is_command && outstanding.tries > 0).then_some(outstanding.sequence)
    }

    /// True while a command waits to be sent or accepted.
    pub fn has_command(&self) -> bool {
        let under_way = self.outstanding.map(|outstanding| outstanding.what);
        !self.commands.is_empty() || matches!(under_way, Some(ControlMessage::Command(_)))
    }

    /// True if every frame of the stream was accepted.
    pub fn is_all_taken(&self) -> bool {
        self.acknowledged == self.frames.len()
    }

    /// Estimated round trip.
    pub fn round_trip_us(&self) -> u64 {
        self.round_trip.estimate_us()
    }

    /// Queues a command. An emergency stop is sent at once and drops all others.
    pub fn command(&mut self, control: Control) {
        if control == Control::EmergencyStop {
            self.commands.clear();
            self.outstanding = None;
            self.commands.push_front(control);
        } else {
            self.commands.push_back(control);
        }
    }

    /// Takes bytes from the line.
    pub fn handle_bytes(&mut self, now_us: u64, bytes: &[u8]) {
        for &byte in bytes {
            let message = match self.decoder.push(byte) {
                None => continue,
                Some(Ok(frame)) => {
                    let message = DeviceMessage::decode(frame.payload).ok();
                    // Its CRC is right: the board reports it.
                    self.unreadable = message.is_none();
                    message
                }
                Some(Err(_)) => None,
            };
            match message {
                Some(message) => {
                    self.heard_us = now_us;
                    self.last_message = Some(message.clone());
                    self.handle_message(now_us, message);
                }
                None => self.figures.frames_damaged += 1,
            }
        }
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<SenderEvent> {
        self.events.pop_front()
    }

    /// Writes the next frame for the line into `out` and returns its length; `None` when there is
    /// nothing to send now.
    pub fn poll_transmit(&mut self, now_us: u64, out: &mut [u8; FRAME_BYTES_MAX]) -> Option<usize> {
        self.choose_control(now_us);
        let length = match self.transmit_control(now_us, out) {
            Some(length) => Some(length),
            None => self.transmit_stream(now_us, out),
        }?;
        self.figures.bytes_sent += length as u64;
        self.said_us = now_us;
        Some(length)
    }

    /// Makes the next control message the outstanding one, if none is in transit.
    fn choose_control(&mut self, now_us: u64) {
        if self.outstanding.is_some() {
            return;
        }
        let what = match (&self.state, self.commands.pop_front()) {
            (_, Some(command)) => ControlMessage::Command(command),
            (SenderState::Greeting, None) => ControlMessage::Hello,
            (SenderState::Opening, None) => ControlMessage::Start,
            (SenderState::Streaming | SenderState::Finishing, None)
                if self.may_have_lost_stream =>
            {
                ControlMessage::Hello
            }
            (SenderState::Done | SenderState::Failed(_), None) => return,
            (_, None) if self.is_silent(now_us) => ControlMessage::Command(Control::StatusRequest),
            (_, None) => return,
        };
        self.control_sequence = self.control_sequence.wrapping_add(1);
        self.outstanding = Some(Outstanding {
            sequence: self.control_sequence,
            what,
            sent_us: None,
            retry_us: self.retry_us.max(RETRY_MIN_US),
            tries: 0,
        });
    }

    fn is_silent(&self, now_us: u64) -> bool {
        let (since_us, patience_us) = if self.in_flight.is_empty() {
            (self.answered_us, KEEP_ALIVE_WAITING_US)
        } else {
            (self.heard_us, KEEP_ALIVE_US)
        };
        now_us >= since_us.max(self.asked_us) + patience_us
            || now_us >= self.said_us + SAY_SOMETHING_US
    }

    fn transmit_control(&mut self, now_us: u64, out: &mut [u8]) -> Option<usize> {
        let mut outstanding = self.outstanding?;
        if let Some(sent_us) = outstanding.sent_us {
            if now_us < sent_us + outstanding.retry_us {
                return None;
            }
            outstanding.retry_us = (outstanding.retry_us * 2).min(RETRY_MAX_US);
        }
        outstanding.sent_us = Some(now_us);
        outstanding.tries += 1;
        self.asked_us = now_us;
        self.outstanding = Some(outstanding);
        let hello = HostMessage::Hello(Hello {
            protocol_version: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            host_session: self.setup.host_session,
        });
        if outstanding.tries > TRIES_BEFORE_HELLO && outstanding.tries % 2 == 0 {
            // A controller that has restarted hears nothing but a greeting. It is older than what
            // waits for an answer, so that it takes nothing away from it.
            return encode_frame(outstanding.sequence.wrapping_sub(1), &hello, out).ok();
        }
        let message = match outstanding.what {
            ControlMessage::Hello => hello,
            ControlMessage::Start => HostMessage::Start(Start {
                job: self.frames.job(),
                machine_hash: self.setup.machine_hash,
                first_sequence: self.first_sequence,
                position: *self.frames.start(),
                solution: self.setup.solution,
                units: self.frames.units(),
            }),
            ControlMessage::Command(control) => HostMessage::Control(control),
        };
        // Half a frame of a host that died, or noise, may be on the line: that ends before a stop, not with it.
        let is_stop = message == HostMessage::Control(Control::EmergencyStop);
        let (ends, out) = out.split_at_mut_checked(usize::from(is_stop))?;
        ends.fill(0);
        let length = encode_frame(outstanding.sequence, &message, out).ok()?;
        Some(ends.len() + length)
    }

    /// Sends a `Hello` before the next repeat of the message that waits for an answer.
    fn greet_next(&mut self) {
        if let Some(outstanding) = &mut self.outstanding {
            outstanding.tries = TRIES_BEFORE_HELLO + 1;
            outstanding.sent_us = None;
        }
    }

    fn transmit_stream(&mut self, now_us: u64, out: &mut [u8]) -> Option<usize> {
        if self.state != SenderState::Streaming {
            return None;
        }
        let overdue = |oldest: &InFlight| now_us >= oldest.sent_us + self.retry_us;
        if self.in_flight.front().is_some_and(overdue) {
            self.retry_us = (self.retry_us * 2).min(RETRY_MAX_US);
            self.go_back(now_us, self.acknowledged);
        }
        if self.cursor >= self.frames.len() {
            return None;
        }
        let under_way: usize = self.in_flight.iter().map(|frame| frame.bytes).sum();
        if under_way >= WINDOW_BYTES {
            return None;
        }
        let (knots, events) = self.frames.totals_after(self.cursor);
        if knots > self.knot_limit || events > self.event_limit {
            self.figures.credit_waits += 1;
            return None;
        }
        let sequence = self.first_sequence.wrapping_add(self.cursor as u32);
        let payload = self.frames.payload(self.cursor);
        let length = encode_payload(sequence as u16, payload, out).ok()?;
        let repeated = self.cursor < self.high_water;
        self.figures.frames_sent += 1;
        self.figures.frames_resent += u64::from(repeated);
        self.in_flight.push_back(InFlight {
            sent_us: now_us,
            bytes: length,
            repeated,
        });
        self.cursor += 1;
        self.high_water = self.high_water.max(self.cursor);
        Some(length)
    }

    fn go_back(&mut self, now_us: u64, frame: usize) {
        let kept = frame.saturating_sub(self.acknowledged);
        self.in_flight.truncate(kept);
        self.cursor = frame;
        self.went_back = Some((frame, now_us));
    }
}

#[cfg(test)]
#[path = "sender_tests.rs"]
mod tests;
