//! Bytes of the line -> requests to the motion, and reports back to the host.
//!
//! In: bytes of any number of lines, each with a [`Conversation`] of its own; the motion, for reports. Out: knots with
//! their demands, flow events and commands for the motion; settings for the store; frames of reports.
//!
//! Receiving is divided into steps, so that a board can work at low priority, a part in each round of its main
//! loop, and lock the motion only briefly: [`Receiver::receive`] reads a frame, [`Receiver::work`] computes
//! the joint loads of some knots of a received block and [`Receiver::deliver`] hands them over;
//! [`Receiver::apply`] does that with any other [`Request`]. Stream frames are accepted in order and exactly
//! once; control frames if newer than the last one. `WIRE.md` of the protocol has the rules.

mod commands;
mod conversation;
pub mod measurement;
mod outgoing;
mod reports;
mod unpacking;

use crate::configuration::MachineConfiguration;
use crate::design::{HOST_SILENT_MS, NAK_PERIOD_MS, ticks_of_ms};
use crate::kinematics::winding::Winding;
use crate::motion::{CommandError, EMERGENCY, Motion};
use crate::path::load::LoadModel;
use crate::path::spline::SpanWindow;
use crate::settings::inbox::SettingsInbox;
pub use conversation::Conversation;
use conversation::Owner;
use headway_protocol::frame::full_sequence;
use headway_protocol::knot_block::KnotPredictor;
use headway_protocol::message::{
    Control, Crash, DeviceState, Fault, FaultCause, Finish, Hello, HostMessage, MessageClass,
    PROTOCOL_VERSION, RefusalReason, SCHEMA_HASH, Start,
};
use headway_protocol::segment::FlowEvent;
use headway_protocol::units::CHANNEL_VOLUME;
use measurement::Measurement;
pub use outgoing::Outgoing;
use unpacking::Unpacking;

/// A checked message, ready to be applied.
#[derive(Clone, Debug)]
pub struct Request {
    sequence: u16,
    content: Content,
}

#[derive(Clone, Debug)]
enum Content {
    Hello(Hello),
    Start(Start),
    Flow(FlowEvent),
    Finish(Finish),
    Control(Control),
    /// A stream frame that the host cannot have intended, although its CRC is valid.
    Damaged,
    /// Anything else of that kind.
    Unreadable(MessageClass),
    /// A stream frame out of order, or with no stream open.
    Misplaced,
}

/// An open stream.
#[derive(Clone, Debug)]
struct Stream {
    job: u32,
    first_sequence: u32,
    next_sequence: u32,
    knots: u32,
    events: u32,
    /// Span of the newest event.
    event_span: u32,
    predictor: KnotPredictor,
    window: SpanWindow,
    winding: Winding<f32>,
    /// Volume of the newest knot.
    volume_units: i32,
}

/// What all lines have in common: the stream and the settings, and who may change them.
#[derive(Clone, Debug)]
pub struct Receiver {
    loads: LoadModel,
    machine_hash: u32,
    settings_hash: u32,
    servo_hz: u32,
    step_hz: u32,
    session: u32,
    owner: Owner,
    host_silent_ticks: u64,
    stream: Option<Stream>,
    unpacking: Option<Unpacking>,
    /// Where the next stream's numbers begin after one that was left.
    next_first_sequence: Option<u32>,
    settings: SettingsInbox,
    /// The message that completed them.
    settings_sequence: u16,
    measurement: Measurement,
    crash: Option<Crash>,
}

impl Receiver {
    /// `session` should differ after every start of the controller.
    pub fn new(configuration: &MachineConfiguration, session: u32) -> Self {
        Self {
            loads: LoadModel::new(configuration),
            machine_hash: configuration.hash(),
            settings_hash: 0,
            servo_hz: configuration.servo_hz,
            step_hz: configuration.step_hz,
            session,
            owner: Owner::default(),
            host_silent_ticks: ticks_of_ms(HOST_SILENT_MS, configuration.servo_hz).into(),
            stream: None,
            unpacking: None,
            next_first_sequence: None,
            settings: SettingsInbox::default(),
            settings_sequence: 0,
            measurement: Measurement::default(),
            crash: None,
        }
    }

    /// Waits so long for a silent host before another one may have the machine: for a simulation whose time runs faster
    /// than its host's.
    pub fn wait_for_host(&mut self, silent_ms: u32) {
        self.host_silent_ticks = ticks_of_ms(silent_ms, self.servo_hz).into();
    }

    /// What the board measures of itself: it is to be served in each round of the main loop.
    pub fn measurement(&mut self) -> &mut Measurement {
        &mut self.measurement
    }

    /// How the run before this one ended, for every greeting.
    pub fn has_crashed(&mut self, crash: Option<Crash>) {
        self.crash = crash;
    }

    /// Receives one byte of a line. Damaged frames are dropped: the host sends them again. A block of knots makes the
    /// receiver busy ([`Self::is_busy`]).
    pub fn receive(&mut self, talk: &mut Conversation, byte: u8) -> Option<Request> {
        let frame = talk.decoder.push(byte)?.ok()?;
        let sequence = frame.sequence;
        let message = HostMessage::decode(frame.payload);
        let in_order = talk.host_session.is_some()
            && (self.stream.as_ref()).is_some_and(|stream| stream.next_sequence as u16 == sequence);
        let content = match message {
            Ok(HostMessage::Hello(hello)) => Content::Hello(hello),
            Ok(HostMessage::Start(start)) => Content::Start(start),
            Ok(HostMessage::Control(control)) => Content::Control(control),
            Ok(_) if !in_order => Content::Misplaced,
            Ok(HostMessage::Flow(event)) => Content::Flow(event),
            Ok(HostMessage::Finish(finish)) => Content::Finish(finish),
            Ok(HostMessage::Knots(block)) => {
                self.unpacking = Unpacking::new(talk.line, sequence, block, self.stream.as_ref()?);
                if self.unpacking.is_some() {
                    return None;
                }
                Content::Damaged
            }
            Err(_) => match MessageClass::of(frame.payload) {
                MessageClass::Stream if in_order => Content::Damaged,
                MessageClass::Stream => Content::Misplaced,
                class => Content::Unreadable(class),
            },
        };
        Some(Request { sequence, content })
    }

    /// Hands a request of a line's host over to the motion.
    pub fn apply(&mut self, talk: &mut Conversation, request: Request, motion: &mut Motion) {
        let sequence = request.sequence;
        match request.content {
            Content::Hello(hello) => self.greet(talk, sequence, &hello),
            // It comes to rest after an abort: the host repeats the opening until then.
            Content::Start(_) if motion.is_aborting() && talk.host_session.is_some() => {
                talk.due.ack = true;
            }
            Content::Start(start) => {
                if talk.take_control(sequence) {
                    self.start(talk, sequence, &start, motion);
                }
            }
            Content::Control(Control::EmergencyStop) => {
                // Whoever says so, whatever its number: it may be a repeat of one that was never heard.
                motion.fail_at_once(EMERGENCY);
                talk.take_control(sequence);
            }
            Content::Control(control) => {
                if talk.take_control(sequence) {
                    log_event!("command {}", control);
                    self.control(talk, sequence, control, motion);
                }
            }
            Content::Unreadable(class) => unreadable(talk, sequence, class),
            _ if talk.host_session.is_none() => talk.refuse(sequence, RefusalReason::NoStream),
            _ if !self.claim(talk, motion) => talk.refuse(sequence, RefusalReason::Busy),
            // Before the end of the stream only: later data would belong to the next one.
            _ if !motion.takes_stream() => self.misplaced(talk, sequence, motion),
            Content::Flow(event) => self.take_event(talk, &event, motion),
            Content::Finish(finish) => self.take_finish(talk, finish, motion),
            Content::Damaged => self.fail(talk, motion, FaultCause::BadSegment),
            Content::Misplaced => self.misplaced(talk, sequence, motion),
        }
        self.hear(talk, motion);
    }

    /// A valid message has come from the host of a line: only from the one whose heat it is does that count.
    fn hear(&mut self, talk: &Conversation, motion: &mut Motion) {
        if self.owner.hear(talk, motion.now_ticks()) {
            motion.heat_mut().hear();
        }
    }

    /// Whether the host of a line may stream, move and heat: it does already, or who did so last does nothing and heats
    /// nothing, or was silent for as long as the board waits for a host.
    fn claim(&mut self, talk: &Conversation, motion: &Motion) -> bool {
        let has_no_job = matches!(
            motion.state(),
            DeviceState::Idle | DeviceState::Finished | DeviceState::Faulted
        );
        let is_free = has_no_job && motion.is_at_rest() && !motion.heat().is_on();
        let (now_ticks, silent_ticks) = (motion.now_ticks(), self.host_silent_ticks);
        self.owner.claim(talk, now_ticks, is_free, silent_ticks)
    }

    fn greet(&mut self, talk: &mut Conversation, sequence: u16, hello: &Hello) {
        if hello.protocol_version != PROTOCOL_VERSION {
            talk.refuse(sequence, RefusalReason::ProtocolVersion(PROTOCOL_VERSION));
        } else if hello.schema_hash != SCHEMA_HASH {
            talk.refuse(sequence, RefusalReason::Schema(SCHEMA_HASH));
        } else {
            if talk.host_session != Some(hello.host_session) {
                self.owner.leave(talk.host_session);
            }
            talk.greet(sequence, hello.host_session);
        }
    }

    fn start(
        &mut self,
        talk: &mut Conversation,
        sequence: u16,
        start: &Start,
        motion: &mut Motion,
    ) {
        if start.machine_hash != self.machine_hash {
            talk.refuse_control(sequence, RefusalReason::Machine(self.machine_hash));
            return;
        }
        let before = self.owner;
        if !self.claim(talk, motion) {
            talk.refuse_control(sequence, RefusalReason::Busy);
            return;
        }
        match motion.start_in(&start.position, start.solution, &start.units) {
            Ok(()) => {
                self.owner.take_heat(talk);
                self.loads.take_solution(start.solution);
                self.loads.take_units(&start.units);
                log_event!("job {=u32:08x} opens", start.job);
                self.stream = Some(Stream {
                    job: start.job,
                    first_sequence: start.first_sequence,
                    next_sequence: start.first_sequence,
                    knots: 0,
                    events: 0,
                    event_span: 0,
                    predictor: KnotPredictor::new(start.position),
                    window: SpanWindow::at_rest(&start.position),
                    winding: self.loads.winding_at(&start.position),
                    volume_units: start.position[CHANNEL_VOLUME],
                });
            }
            Err(error) => {
                self.owner = before;
                talk.refuse_control(sequence, reason_of(error));
            }
        }
    }

    fn take_event(&mut self, talk: &mut Conversation, event: &FlowEvent, motion: &mut Motion) {
        let Some(stream) = &mut self.stream else {
            return;
        };
        // It comes before the knot of its span, and after the event before it.
        if event.span < stream.knots.max(stream.event_span) {
            self.fail(talk, motion, FaultCause::Sequence);
            return;
        }
        talk.due.ack = true;
        if let Err(fault) = self.loads.check_event(event) {
            motion.refuse_span(fault, event.span);
            return;
        }
        if motion.push_event(event) {
            stream.events = stream.events.wrapping_add(1);
            stream.event_span = event.span;
            motion.note_melt(event.span.wrapping_add(1));
            stream.next_sequence = stream.next_sequence.wrapping_add(1);
            self.owner.take_heat(talk);
        }
    }

    fn take_finish(&mut self, talk: &mut Conversation, finish: Finish, motion: &mut Motion) {
        let Some(stream) = &mut self.stream else {
            return;
        };
        log_event!("the stream ends after {=u32} knots", finish.knots);
        let totals = finish.knots == stream.knots && finish.events == stream.events;
        // An event after the last span would never run.
        if totals && (stream.events == 0 || stream.event_span < stream.knots) {
            stream.next_sequence = stream.next_sequence.wrapping_add(1);
            motion.finish();
            talk.due.ack = true;
        } else {
            self.fail(talk, motion, FaultCause::Sequence);
        }
    }

    fn fail(&self, talk: &mut Conversation, motion: &mut Motion, cause: FaultCause) {
        let knots = self.stream.as_ref().map_or(0, |stream| stream.knots);
        motion.fail_softly(Fault {
            cause,
            index: 0,
            value: knots as i32,
        });
        // A fault that is already latched is not reported again.
        talk.due.ack = true;
    }

    fn misplaced(&self, talk: &mut Conversation, sequence: u16, motion: &Motion) {
        let Some(stream) = &self.stream else {
            talk.refuse(sequence, RefusalReason::NoStream);
            return;
        };
        let ahead =
            full_sequence(stream.next_sequence, sequence).wrapping_sub(stream.next_sequence);
        let period = u64::from(ticks_of_ms(NAK_PERIOD_MS, self.servo_hz));
        if ahead > u32::MAX / 2 {
            talk.due.ack = true;
        } else if !motion.takes_stream() {
            talk.refuse(sequence, RefusalReason::NoStream);
        } else if motion.now_ticks() >= talk.nak_tick + period {
            log_event!("{=u32} frames missing", ahead);
            talk.nak_tick = motion.now_ticks();
            talk.due.nak = true;
        }
    }
}

/// An invalid message with a valid CRC, or one with a field out of range.
fn unreadable(talk: &mut Conversation, sequence: u16, class: MessageClass) {
    match class {
        // It may be of a host that speaks another version.
        MessageClass::Hello => {
            talk.refuse(sequence, RefusalReason::ProtocolVersion(PROTOCOL_VERSION));
        }
        MessageClass::Control => {
            if talk.take_control(sequence) {
                talk.refuse_control(sequence, RefusalReason::Invalid);
            }
        }
        MessageClass::Stream | MessageClass::Unknown => {
            talk.refuse(sequence, RefusalReason::Invalid);
        }
    }
}

fn is_newer(sequence: u16, taken: u16) -> bool {
    (sequence.wrapping_sub(taken) as i16) > 0
}

fn reason_of(error: CommandError) -> RefusalReason {
    match error {
        CommandError::Busy => RefusalReason::Busy,
        CommandError::Faulted => RefusalReason::Faulted,
        CommandError::Invalid => RefusalReason::Invalid,
        CommandError::Cold(heater) => RefusalReason::Cold(heater),
    }
}
