//! Bytes of the line -> requests to the motion, and reports back to the host.
//!
//! In: bytes of one line or two; the motion, for reports. Out: knots with their demands, flow events and commands for
//! the motion; settings for the store; frames of reports.
//!
//! Receiving is divided into steps, so that a board can work at low priority, a part in each round of its main
//! loop, and lock the motion only briefly: [`Receiver::receive`] reads a frame, [`Receiver::work`] computes
//! the joint loads of some knots of a received block and [`Receiver::deliver`] hands them over;
//! [`Receiver::apply`] does that with any other [`Request`]. Stream frames are accepted in order and exactly
//! once; control frames if newer than the last one. `WIRE.md` of the protocol has the rules.

mod commands;
mod outgoing;
mod reports;
mod second_line;
mod unpacking;

use crate::configuration::MachineConfiguration;
use crate::design::{NAK_PERIOD_MS, STATUS_PERIOD_MS, ticks_of_ms};
use crate::kinematics::winding::Winding;
use crate::motion::{CommandError, Motion};
use crate::path::load::LoadModel;
use crate::path::spline::SpanWindow;
use crate::settings::inbox::SettingsInbox;
use headway_protocol::frame::{FrameDecoder, full_sequence};
use headway_protocol::knot_block::KnotPredictor;
use headway_protocol::message::{
    Control, DeviceState, Fault, FaultCause, Finish, Hello, HostMessage, MessageClass,
    PROTOCOL_VERSION, Refusal, RefusalReason, SCHEMA_HASH, Start,
};
use headway_protocol::segment::FlowEvent;
use headway_protocol::units::CHANNEL_VOLUME;
use heapless::Deque;
pub use outgoing::Outgoing;
use second_line::Watched;
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

/// Pending reports.
#[derive(Clone, Debug, Default)]
struct Due {
    welcome: bool,
    refusals: Deque<Refusal, REFUSALS_MAX>,
    ack: bool,
    nak: bool,
    status: bool,
    fault: bool,
}

/// Refusals that wait to be sent. A message that would need one more is dropped as if it had been
/// lost, and answered when the host repeats it.
const REFUSALS_MAX: usize = 4;
/// Lines that a host may be at the other end of: each has a decoder of its own, so that noise on one
/// damages nothing on the other.
const LINES: usize = 2;
/// The second of them.
pub const SECOND_LINE: usize = 1;

/// The controller's end of the line.
#[derive(Clone, Debug)]
pub struct Receiver {
    decoders: [FrameDecoder; LINES],
    /// Where a valid frame came last.
    line: usize,
    loads: LoadModel,
    machine_hash: u32,
    settings_hash: u32,
    servo_hz: u32,
    step_hz: u32,
    session: u32,
    host_session: Option<u32>,
    control_taken: u16,
    /// The newest control message that was refused: its repeat is refused again.
    refused: Option<Refusal>,
    stream: Option<Stream>,
    unpacking: Option<Unpacking>,
    /// Where the next stream's numbers begin after one that was left.
    next_first_sequence: Option<u32>,
    /// Of a second line: what the first one streams.
    watched: Option<Watched>,
    settings: SettingsInbox,
    /// The message that completed them.
    settings_sequence: u16,
    due: Due,
    /// Credit last sent to the host.
    knot_limit_told: u32,
    /// Ticks of the last Nak and of the last status.
    nak_tick: u64,
    status_tick: u64,
    status_period_ticks: u64,
    last_state: DeviceState,
    last_fault: Option<Fault>,
    report_sequence: u16,
}

impl Receiver {
    /// `session` should differ after every start of the controller.
    pub fn new(configuration: &MachineConfiguration, session: u32) -> Self {
        Self {
            decoders: core::array::from_fn(|_| FrameDecoder::new()),
            line: 0,
            loads: LoadModel::new(configuration),
            machine_hash: configuration.hash(),
            settings_hash: 0,
            servo_hz: configuration.servo_hz,
            step_hz: configuration.step_hz,
            session,
            host_session: None,
            control_taken: 0,
            refused: None,
            stream: None,
            unpacking: None,
            next_first_sequence: None,
            watched: None,
            settings: SettingsInbox::default(),
            settings_sequence: 0,
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

    /// Line for reports: the one on which the last valid frame arrived, whatever else arrived
    /// since.
    pub fn line(&self) -> usize {
        self.line
    }

    /// Receives one byte of a line (0 or [`SECOND_LINE`]). Damaged frames are dropped: the host sends
    /// them again. A block of knots makes the receiver busy ([`Self::is_busy`]).
    pub fn receive(&mut self, line: usize, byte: u8) -> Option<Request> {
        let frame = self.decoders.get_mut(line)?.push(byte)?.ok()?;
        self.line = line;
        let sequence = frame.sequence;
        let message = HostMessage::decode(frame.payload);
        let in_order = self
            .stream
            .as_ref()
            .is_some_and(|stream| stream.next_sequence as u16 == sequence);
        let content = match message {
            Ok(HostMessage::Hello(hello)) => Content::Hello(hello),
            Ok(HostMessage::Start(start)) => Content::Start(start),
            Ok(HostMessage::Control(control)) => Content::Control(control),
            Ok(_) if !in_order => Content::Misplaced,
            Ok(HostMessage::Flow(event)) => Content::Flow(event),
            Ok(HostMessage::Finish(finish)) => Content::Finish(finish),
            Ok(HostMessage::Knots(block)) => {
                self.unpacking = Unpacking::new(sequence, block, self.stream.as_ref()?);
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

    /// Hands a request over to the motion.
    pub fn apply(&mut self, request: Request, motion: &mut Motion) {
        let sequence = request.sequence;
        if self.refuses_watcher(&request) {
            return;
        }
        if self.watched.is_none() {
            motion.heat_mut().hear();
        }
        match request.content {
            Content::Hello(hello) => self.greet(sequence, &hello),
            // It comes to rest after an abort: the host repeats the opening until then.
            Content::Start(_) if motion.is_aborting() && self.host_session.is_some() => {
                self.due.ack = true;
            }
            Content::Start(start) => {
                if self.take_control(sequence) {
                    self.start(sequence, &start, motion);
                }
            }
            Content::Control(control) => {
                if self.take_control(sequence) {
                    log_event!("command {}", control);
                    self.control(sequence, control, motion);
                }
            }
            Content::Unreadable(class) => self.unreadable(sequence, class),
            // Before the end of the stream only: later data would belong to the next one.
            _ if !motion.takes_stream() => self.misplaced(sequence, motion),
            Content::Flow(event) => self.take_event(&event, motion),
            Content::Finish(finish) => self.take_finish(finish, motion),
            Content::Damaged => self.fail(motion, FaultCause::BadSegment),
            Content::Misplaced => self.misplaced(sequence, motion),
        }
    }

    /// An invalid message with a valid CRC, or one with a field out of range.
    fn unreadable(&mut self, sequence: u16, class: MessageClass) {
        match class {
            // It may be of a host that speaks another version.
            MessageClass::Hello => {
                self.refuse(sequence, RefusalReason::ProtocolVersion(PROTOCOL_VERSION));
            }
            MessageClass::Control => {
                if self.take_control(sequence) {
                    self.refuse_control(sequence, RefusalReason::Invalid);
                }
            }
            MessageClass::Stream | MessageClass::Unknown => {
                self.refuse(sequence, RefusalReason::Invalid);
            }
        }
    }

    fn greet(&mut self, sequence: u16, hello: &Hello) {
        let reason = if hello.protocol_version != PROTOCOL_VERSION {
            Some(RefusalReason::ProtocolVersion(PROTOCOL_VERSION))
        } else if hello.schema_hash != SCHEMA_HASH {
            Some(RefusalReason::Schema(SCHEMA_HASH))
        } else {
            None
        };
        if let Some(reason) = reason {
            self.refuse(sequence, reason);
            return;
        }
        if self.host_session != Some(hello.host_session) || is_newer(sequence, self.control_taken) {
            self.control_taken = sequence;
            self.refused = None;
        }
        log_event!("host {=u32:08x} says hello", hello.host_session);
        self.host_session = Some(hello.host_session);
        self.due.welcome = true;
        // A later host gets it as well, and the reason for a restart of the board.
        self.due.fault = true;
    }

    /// True if a control frame is new; answers it in any case.
    fn take_control(&mut self, sequence: u16) -> bool {
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

    fn start(&mut self, sequence: u16, start: &Start, motion: &mut Motion) {
        if start.machine_hash != self.machine_hash {
            self.refuse_control(sequence, RefusalReason::Machine(self.machine_hash));
            return;
        }
        match motion.start_in(&start.position, start.solution, &start.units) {
            Ok(()) => {
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
            Err(error) => self.refuse_control(sequence, reason_of(error)),
        }
    }

    fn take_event(&mut self, event: &FlowEvent, motion: &mut Motion) {
        let Some(stream) = &mut self.stream else {
            return;
        };
        // It comes before the knot of its span, and after the event before it.
        if event.span < stream.knots.max(stream.event_span) {
            self.fail(motion, FaultCause::Sequence);
            return;
        }
        if let Err(fault) = self.loads.check_event(event) {
            motion.refuse_span(fault, event.span);
            self.due.ack = true;
            return;
        }
        if motion.push_event(event) {
            stream.events = stream.events.wrapping_add(1);
            stream.event_span = event.span;
            motion.note_melt(event.span.wrapping_add(1));
            stream.next_sequence = stream.next_sequence.wrapping_add(1);
        }
        self.due.ack = true;
    }

    fn take_finish(&mut self, finish: Finish, motion: &mut Motion) {
        let Some(stream) = &mut self.stream else {
            return;
        };
        log_event!("the stream ends after {=u32} knots", finish.knots);
        let totals = finish.knots == stream.knots && finish.events == stream.events;
        // An event after the last span would never run.
        if totals && (stream.events == 0 || stream.event_span < stream.knots) {
            stream.next_sequence = stream.next_sequence.wrapping_add(1);
            motion.finish();
            self.due.ack = true;
        } else {
            self.fail(motion, FaultCause::Sequence);
        }
    }

    fn fail(&mut self, motion: &mut Motion, cause: FaultCause) {
        let knots = self.stream.as_ref().map_or(0, |stream| stream.knots);
        motion.fail_softly(Fault {
            cause,
            index: 0,
            value: knots as i32,
        });
        // A fault that is already latched is not reported again.
        self.due.ack = true;
    }

    fn misplaced(&mut self, sequence: u16, motion: &Motion) {
        let Some(stream) = &self.stream else {
            self.refuse(sequence, RefusalReason::NoStream);
            return;
        };
        let ahead =
            full_sequence(stream.next_sequence, sequence).wrapping_sub(stream.next_sequence);
        let period = u64::from(ticks_of_ms(NAK_PERIOD_MS, self.servo_hz));
        if ahead > u32::MAX / 2 {
            self.due.ack = true;
        } else if !motion.takes_stream() {
            self.refuse(sequence, RefusalReason::NoStream);
        } else if motion.now_ticks() >= self.nak_tick + period {
            log_event!("{=u32} frames missing", ahead);
            self.nak_tick = motion.now_ticks();
            self.due.nak = true;
        }
    }

    fn refuse(&mut self, sequence: u16, reason: RefusalReason) {
        log_event!("refused {=u16}: {}", sequence, reason);
        // Where there is no room the host repeats itself.
        let _ = self.due.refusals.push_back(Refusal { sequence, reason });
    }

    /// The same for an accepted control message.
    fn refuse_control(&mut self, sequence: u16, reason: RefusalReason) {
        self.refused = Some(Refusal { sequence, reason });
        self.refuse(sequence, reason);
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
