//! The host's sender and its patience, whatever a board says and whenever.
//!
//! 1. No stream frame is sent beyond the credit that any acknowledgement of this board has given.
//! 2. What is sent is frames of messages.
//! 3. Every wait ends, even if the board repeats for ever what it said, and the line connects and drops.

use arbitrary::Arbitrary;
use headway::drive::patience::{LINE_US, PAUSE_US, Patience};
use headway::drive::sender::Sender;
use headway::drive::sender_state::{SenderSetup, SenderState};
use headway::job::SegmentStream;
use headway::job::frames::WireFrames;
use headway_protocol::frame::{FRAME_BYTES_MAX, FrameDecoder, encode_frame, encode_payload};
use headway_protocol::message::{
    Ack, Control, DeviceMessage, DeviceState, Fault, FaultCause, HostMessage, OpenStream,
    PROTOCOL_VERSION, Refusal, RefusalReason, SCHEMA_HASH, Status, Welcome,
};
use headway_protocol::segment::{FlowAction, FlowEvent, Knot};
use headway_protocol::units::Ticks;
use std::sync::LazyLock;

const HOST_SESSION: u32 = 77;
const DEVICE_SESSION: u32 = 5;
const MACHINE_HASH: u32 = 9;
/// Knots of the stream: some blocks, so that credit and windows matter.
const KNOTS: u32 = 120;
const MS: u64 = 1_000;
const S: u64 = 1_000_000;
/// What a board may do in a run, and frames that are sent at a poll: the window's bytes are fewer.
const ACTS_MAX: usize = 64;
const FRAMES_AT_ONCE_MAX: usize = 2_048;
/// A run of acts is repeated until the patience ends, in steps of so long at least.
const REPEAT_US: u64 = 60 * S;
/// Time within which it ends: a pause, and a line that comes and goes, for every state of the conversation. What is
/// repeated brings the stream no further.
const END_US: u64 = 6 * (PAUSE_US + LINE_US);

/// A board's words.
#[derive(Arbitrary, Clone, Debug)]
pub enum Word {
    Welcome {
        ours: bool,
        session: u8,
        stream: Option<(bool, u8, u8)>,
    },
    Ack {
        nak: bool,
        session: u8,
        frames: u8,
        credit: u16,
        taken: u8,
    },
    Wild {
        nak: bool,
        next: u32,
        knots: u32,
        events: u32,
        taken: u16,
    },
    Status {
        session: u8,
        state: u8,
        spans: u8,
        percent: u16,
        fault: bool,
    },
    Refused {
        back: u8,
        reason: u8,
    },
    Fault,
    Payload(Vec<u8>),
    Noise(Vec<u8>),
}

/// What happens.
#[derive(Arbitrary, Clone, Debug)]
pub enum Act {
    Says(Word),
    Passes { ms: u16 },
    PassesLong { s: u16 },
    Line { open: bool },
    Commands(u8),
}

/// A whole run.
#[derive(Arbitrary, Debug)]
pub struct Run {
    resume: u8,
    opened: bool,
    acts: Vec<Act>,
}

static STREAM: LazyLock<SegmentStream> = LazyLock::new(|| SegmentStream {
    knots: (0..KNOTS as i32)
        .map(|knot| Knot {
            // Large steps: some knots to a block.
            control: [
                knot * 91_007 % 70_001,
                knot * 50_021 % 90_001,
                0,
                0,
                0,
                knot,
                0,
            ],
            duration_ticks: 20,
        })
        .collect(),
    events: [3, 60]
        .map(|span| FlowEvent {
            span,
            offset_ticks: 0,
            action: FlowAction::Prime,
            volume_units: 1000,
            duration_ticks: Ticks(10),
        })
        .to_vec(),
    ..SegmentStream::default()
});

static FRAMES: LazyLock<WireFrames> =
    LazyLock::new(|| WireFrames::encode(&STREAM).expect("a stream of the wire"));

struct Talk {
    sender: Sender,
    patience: Patience,
    decoder: FrameDecoder,
    now_us: u64,
    is_open: bool,
    /// First sequence of the stream, as it was opened.
    first: Option<u32>,
    /// The newest control sequence.
    control: u16,
    /// Largest credit: knots and events.
    credit: (u32, u32),
    is_over: bool,
}

/// Runs it.
pub fn run(run: &Run) {
    let setup = SenderSetup {
        host_session: HOST_SESSION,
        machine_hash: MACHINE_HASH,
        solution: 0,
        servo_hz: 2000,
        resume: run.resume % 3 == 1,
    };
    let frames = FRAMES.clone();
    let sender = match run.resume % 3 {
        2 => Sender::resuming(frames, setup),
        _ => Sender::new(frames, setup),
    };
    let mut talk = Talk {
        sender,
        patience: Patience::new(&STREAM, 2000),
        decoder: FrameDecoder::new(),
        now_us: 0,
        is_open: true,
        first: None,
        control: 0,
        credit: (0, 0),
        is_over: false,
    };
    talk.poll();
    if run.opened {
        let stream = None;
        talk.say(&Word::Welcome {
            ours: true,
            session: 0,
            stream,
        });
        talk.pass(MS);
        talk.say(&Word::Ack {
            nak: false,
            session: 0,
            frames: 0,
            credit: 60,
            taken: 0,
        });
        talk.pass(MS);
    }
    let acts = &run.acts[..run.acts.len().min(ACTS_MAX)];
    for act in acts {
        talk.act(act);
    }
    // Over and over.
    let mut acts = acts.iter().cycle();
    let begun_us = talk.now_us;
    while !talk.is_over {
        let before_us = talk.now_us;
        for _ in 0..ACTS_MAX {
            match acts.next() {
                // A host commands now and then, not for ever.
                Some(Act::Commands(_)) | None => {}
                Some(act) => talk.act(act),
            }
        }
        let passed_us = talk.now_us - before_us;
        talk.pass(REPEAT_US.saturating_sub(passed_us).max(MS));
        assert!(
            talk.now_us - begun_us < END_US,
            "waits without end: {:?}, {}",
            talk.sender.state(),
            talk.sender.said_last()
        );
    }
}

impl Talk {
    fn act(&mut self, act: &Act) {
        if self.is_over {
            return;
        }
        match act {
            Act::Says(word) => self.say(word),
            Act::Passes { ms } => self.pass(u64::from(*ms) * MS),
            Act::PassesLong { s } => self.pass(u64::from(*s) * S),
            Act::Line { open } => self.is_open = *open,
            Act::Commands(number) => self.sender.command(match number % 5 {
                0 => Control::Abort,
                1 => Control::EmergencyStop,
                2 => Control::ClearFault,
                3 => Control::Pause,
                _ => Control::Resume,
            }),
        }
        self.poll();
    }

    fn pass(&mut self, us: u64) {
        self.now_us += us;
        self.poll();
    }

    fn poll(&mut self) {
        if self.is_open {
            self.transmit();
        }
        while self.sender.poll_event().is_some() {}
        let late = self.patience.look(self.now_us, &self.sender, self.is_open);
        if let Some(late) = &late {
            assert!(!late.to_string().is_empty());
        }
        let state = self.sender.state();
        let ends = matches!(state, SenderState::Done | SenderState::Failed(_));
        self.is_over = ends || late.is_some();
    }

    fn transmit(&mut self) {
        let mut out = [0u8; FRAME_BYTES_MAX];
        for _ in 0..FRAMES_AT_ONCE_MAX {
            let Some(length) = self.sender.poll_transmit(self.now_us, &mut out) else {
                return;
            };
            for &byte in &out[..length] {
                let Some(frame) = self.decoder.push(byte) else {
                    continue;
                };
                let frame = frame.expect("a whole frame");
                let message = HostMessage::decode(frame.payload).expect("a message");
                if let HostMessage::Start(start) = &message {
                    self.first = Some(start.first_sequence);
                }
                match message.is_stream() {
                    true => {
                        let sequence = frame.sequence;
                        check_credit(self.first, self.credit, sequence);
                    }
                    false => self.control = frame.sequence,
                }
            }
        }
        panic!("frames without end");
    }

    fn say(&mut self, word: &Word) {
        let mut out = [0u8; FRAME_BYTES_MAX];
        let message = match word {
            Word::Noise(bytes) => {
                self.take_unknown();
                self.sender.handle_bytes(self.now_us, bytes);
                return;
            }
            Word::Payload(bytes) => {
                self.take_unknown();
                if let Ok(length) = encode_payload(0, bytes, &mut out) {
                    self.sender.handle_bytes(self.now_us, &out[..length]);
                }
                return;
            }
            word => self.message(word),
        };
        if let DeviceMessage::Ack(ack) | DeviceMessage::Nak(ack) = &message {
            self.credit.0 = self.credit.0.max(ack.knot_limit);
            self.credit.1 = self.credit.1.max(ack.event_limit);
        }
        if let DeviceMessage::Welcome(Welcome {
            stream: Some(stream),
            ..
        }) = &message
        {
            // A stream that goes on has the board's numbers.
            self.first = self.first.or(Some(stream.first_sequence));
        }
        if let Ok(length) = encode_frame(0, &message, &mut out) {
            self.sender.handle_bytes(self.now_us, &out[..length]);
        }
    }

    /// It may have been any credit.
    fn take_unknown(&mut self) {
        self.credit = (u32::MAX, u32::MAX);
    }

    fn message(&self, word: &Word) -> DeviceMessage {
        let session = |by: u8| DEVICE_SESSION + u32::from(by >= 250);
        let first = self.first.unwrap_or(0);
        match *word {
            Word::Welcome {
                ours,
                session: by,
                stream,
            } => DeviceMessage::Welcome(Welcome {
                protocol_version: PROTOCOL_VERSION,
                schema_hash: SCHEMA_HASH,
                firmware_version: [0; 3],
                machine_hash: MACHINE_HASH,
                queue_knots: 256,
                queue_events: 64,
                servo_hz: 2000,
                step_hz: 200_000,
                session: session(by),
                host_session: HOST_SESSION + u32::from(!ours),
                stream: stream.map(|(ours, frames, knots)| {
                    let sent = usize::from(frames).checked_sub(1);
                    let right = sent.map_or(0, |last| FRAMES.totals_after(last).0);
                    OpenStream {
                        job: if ours { FRAMES.job() } else { 1 },
                        first_sequence: first,
                        next_sequence: first.wrapping_add(frames.into()),
                        knots_taken: if knots < 200 { right } else { knots.into() },
                        spans_done: 0,
                    }
                }),
                settings_hash: 0,
            }),
            Word::Ack {
                nak,
                session: by,
                frames,
                credit,
                taken,
            } => said(
                nak,
                Ack {
                    session: session(by),
                    next_sequence: first.wrapping_add(frames.into()),
                    knot_limit: credit.into(),
                    event_limit: credit.into(),
                    control_taken: self.control.wrapping_sub(u16::from(taken / 64)),
                },
            ),
            Word::Wild {
                nak,
                next,
                knots,
                events,
                taken,
            } => said(
                nak,
                Ack {
                    session: DEVICE_SESSION,
                    next_sequence: next,
                    knot_limit: knots,
                    event_limit: events,
                    control_taken: taken,
                },
            ),
            Word::Status {
                session: by,
                state,
                spans,
                percent,
                fault,
            } => DeviceMessage::Status(Status {
                session: session(by),
                state: STATES[usize::from(state) % STATES.len()],
                sigma_permille: 0,
                override_percent: percent,
                flow_percent: 100,
                spans_done: spans.into(),
                queue_knots: 0,
                queue_events: 0,
                referenced: 0,
                switches: 0,
                counts_steps: Default::default(),
                heaters: Default::default(),
                fan_permille: 0,
                fault: fault.then_some(FAULT),
                drivers: Default::default(),
                probe: Default::default(),
            }),
            Word::Refused { back, reason } => DeviceMessage::Refused(Refusal {
                sequence: self.control.wrapping_sub(u16::from(back / 64)),
                reason: match reason % 6 {
                    0 => RefusalReason::NoStream,
                    1 => RefusalReason::Busy,
                    2 => RefusalReason::Faulted,
                    3 => RefusalReason::Invalid,
                    4 => RefusalReason::Schema(1),
                    _ => RefusalReason::NoHello,
                },
            }),
            Word::Fault | Word::Payload(_) | Word::Noise(_) => DeviceMessage::Fault(FAULT),
        }
    }
}

const FAULT: Fault = Fault {
    cause: FaultCause::Emergency,
    index: 0,
    value: 0,
};

const STATES: [DeviceState; 12] = [
    DeviceState::Idle,
    DeviceState::Filling,
    DeviceState::Running,
    DeviceState::Paused,
    DeviceState::Starved,
    DeviceState::Aborting,
    DeviceState::Finished,
    DeviceState::Homing,
    DeviceState::Jogging,
    DeviceState::Faulted,
    DeviceState::Heating,
    DeviceState::Probing,
];

fn said(nak: bool, ack: Ack) -> DeviceMessage {
    match nak {
        true => DeviceMessage::Nak(ack),
        false => DeviceMessage::Ack(ack),
    }
}

fn check_credit(first: Option<u32>, credit: (u32, u32), sequence: u16) {
    let first = first.expect("a stream frame before a stream");
    let frame = usize::from(sequence.wrapping_sub(first as u16));
    assert!(frame < FRAMES.len(), "frame {frame} of {}", FRAMES.len());
    let (knots, events) = FRAMES.totals_after(frame);
    assert!(
        knots <= credit.0 && events <= credit.1,
        "{knots} knots and {events} events, with credit for {credit:?}"
    );
}
