//! The sender against a loopback controller over the simulated link.

use super::*;
use crate::drive::link::{Line, LinkSpec};
use crate::drive::sender_state::SenderError;
use crate::job::SegmentStream;
use headway_protocol::frame::full_sequence;
use headway_protocol::knot_block::{KnotPredictor, decode_block};
use headway_protocol::message::{
    Ack, DeviceState, OpenStream, Refusal, RefusalReason, Status, Welcome,
};
use headway_protocol::segment::Knot;

const QUEUE_KNOTS: u32 = 256;
/// Knots that the loopback consumes per millisecond.
const KNOTS_PER_MS: u32 = 2;
/// Knots consumed before credit is given without being asked.
const CREDIT_KNOTS: u32 = 16;

/// The controller's side of the rules, without any motion.
struct Loopback {
    session: u32,
    decoder: FrameDecoder,
    predictor: Option<KnotPredictor>,
    expected: u32,
    control_taken: u16,
    knots: Vec<Knot>,
    done: u32,
    finished: bool,
    gap_told: bool,
    last_seen: u32,
    limit_told: u32,
    end_told: bool,
    first: u32,
    /// Identity that it says of its stream.
    job: u32,
    /// Says nothing but welcome, before it has said that.
    deaf: bool,
    out: Vec<Vec<u8>>,
}

impl Loopback {
    fn new(session: u32) -> Self {
        Loopback {
            session,
            decoder: FrameDecoder::new(),
            predictor: None,
            expected: 0,
            control_taken: 0,
            knots: Vec::new(),
            done: 0,
            finished: false,
            gap_told: false,
            last_seen: 0,
            limit_told: 0,
            end_told: false,
            job: 1,
            first: 0,
            deaf: false,
            out: Vec::new(),
        }
    }

    fn say(&mut self, message: &DeviceMessage) {
        let mut out = [0u8; FRAME_BYTES_MAX];
        let length = encode_frame(0, message, &mut out).unwrap();
        self.out.push(out[..length].to_vec());
    }

    fn ack(&self) -> Ack {
        Ack {
            session: self.session,
            next_sequence: self.expected,
            knot_limit: self.done + QUEUE_KNOTS,
            event_limit: 64,
            control_taken: self.control_taken,
        }
    }

    /// A millisecond passes: knots are consumed; credit and the end are told, as the controller
    /// does.
    fn consume(&mut self) {
        let queued = self.knots.len() as u32 - self.done;
        self.done += queued.min(KNOTS_PER_MS);
        if self.predictor.is_some() && self.done + QUEUE_KNOTS >= self.limit_told + CREDIT_KNOTS {
            self.limit_told = self.done + QUEUE_KNOTS;
            self.say(&DeviceMessage::Ack(self.ack()));
        }
        if self.has_ended() && !self.end_told {
            self.end_told = true;
            self.say(&DeviceMessage::Status(self.status()));
        }
    }

    fn has_ended(&self) -> bool {
        self.finished && self.done as usize == self.knots.len()
    }

    fn status(&self) -> Status {
        Status {
            session: self.session,
            state: if self.has_ended() {
                DeviceState::Finished
            } else {
                DeviceState::Running
            },
            sigma_permille: 1000,
            override_percent: 100,
            flow_percent: 100,
            referenced: 0,
            switches: 0,
            spans_done: self.done,
            queue_knots: 0,
            queue_events: 0,
            counts_steps: Default::default(),
            heaters: Default::default(),
            fan_permille: 0,
            drivers: Default::default(),
            probe: Default::default(),
            fault: None,
        }
    }

    fn handle(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            let Some(Ok(frame)) = self.decoder.push(byte) else {
                continue;
            };
            let payload = frame.payload.to_vec();
            let sequence = frame.sequence;
            let message = HostMessage::decode(&payload).unwrap();
            if message.is_stream() {
                self.handle_stream(sequence, &message);
            } else {
                self.handle_control(sequence, &message);
            }
        }
    }

    fn handle_stream(&mut self, sequence: u16, message: &HostMessage<'_>) {
        if self.deaf {
            return;
        }
        let Some(mut predictor) = self.predictor else {
            let reason = RefusalReason::NoStream;
            return self.say(&DeviceMessage::Refused(Refusal { sequence, reason }));
        };
        let full = full_sequence(self.expected, sequence);
        if full == self.expected {
            self.expected = self.expected.wrapping_add(1);
            self.gap_told = false;
            match message {
                HostMessage::Knots(block) => {
                    self.knots
                        .extend(decode_block(&mut predictor, block).unwrap());
                    assert!(
                        self.knots.len() as u32 <= self.done + QUEUE_KNOTS,
                        "credits"
                    );
                    self.predictor = Some(predictor);
                }
                HostMessage::Finish(finish) => {
                    assert_eq!(finish.knots as usize, self.knots.len());
                    self.finished = true;
                }
                _ => {}
            }
            self.say(&DeviceMessage::Ack(self.ack()));
        } else if (full.wrapping_sub(self.expected) as i32) < 0 {
            self.say(&DeviceMessage::Ack(self.ack()));
        } else {
            let repeats = (full.wrapping_sub(self.last_seen) as i32) <= 0;
            if !self.gap_told || repeats {
                self.gap_told = true;
                self.say(&DeviceMessage::Nak(self.ack()));
            }
        }
        self.last_seen = full;
    }

    fn handle_control(&mut self, sequence: u16, message: &HostMessage<'_>) {
        if let HostMessage::Hello(hello) = message {
            self.control_taken = sequence;
            self.deaf = false;
            let stream = self.predictor.map(|_| OpenStream {
                job: self.job,
                first_sequence: self.first,
                next_sequence: self.expected,
                knots_taken: self.knots.len() as u32,
                spans_done: self.done,
            });
            return self.say(&DeviceMessage::Welcome(Welcome {
                protocol_version: PROTOCOL_VERSION,
                schema_hash: SCHEMA_HASH,
                firmware_version: [0, 1, 0],
                machine_hash: 5,
                queue_knots: QUEUE_KNOTS as u16,
                queue_events: 64,
                servo_hz: 2000,
                step_hz: 200_000,
                session: self.session,
                host_session: hello.host_session,
                stream,
                settings_hash: 0,
            }));
        }
        if self.deaf {
            return;
        }
        if sequence.wrapping_sub(self.control_taken) as i16 > 0 {
            self.control_taken = sequence;
            if let HostMessage::Start(start) = message {
                self.predictor = Some(KnotPredictor::new(start.position));
                self.expected = start.first_sequence;
                self.first = start.first_sequence;
                self.job = start.job;
            }
        }
        if message == &HostMessage::Control(Control::StatusRequest) {
            self.say(&DeviceMessage::Status(self.status()));
        }
        self.say(&DeviceMessage::Ack(self.ack()));
    }
}

fn stream(knots: usize) -> SegmentStream {
    let mut stream = SegmentStream::default();
    for i in 0..knots as i32 {
        stream.knots.push(Knot {
            control: [i * 37, i * i, 0, 0, i % 7, -i, i * 3],
            duration_ticks: 10 + (i % 9) as u16,
        });
    }
    stream
}

const SETUP: SenderSetup = SenderSetup {
    host_session: 0xffff_fff0,
    machine_hash: 5,
    solution: 0,
    servo_hz: 2000,
    resume: false,
};

struct Run {
    sender: Sender,
    device: Loopback,
    ended_ms: u64,
}

/// Both ends over one link; `disturb` may meddle every millisecond.
fn run(
    spec: &LinkSpec,
    seed: u64,
    stream: &SegmentStream,
    mut disturb: impl FnMut(u64, &mut Sender, &mut Loopback),
) -> Run {
    let mut sender = Sender::new(WireFrames::encode(stream).unwrap(), SETUP);
    let mut device = Loopback::new(77);
    let mut down = Line::new(spec.clone(), seed);
    let mut up = Line::new(spec.clone(), seed + 1000);
    let mut out = [0u8; FRAME_BYTES_MAX];
    let mut bytes = Vec::new();
    for ms in 0..300_000u64 {
        let now_us = ms * 1000;
        disturb(ms, &mut sender, &mut device);
        bytes.clear();
        down.receive(now_us, &mut bytes);
        device.handle(&bytes);
        device.consume();
        for frame in device.out.drain(..) {
            up.send(now_us, &frame);
        }
        bytes.clear();
        up.receive(now_us, &mut bytes);
        sender.handle_bytes(now_us, &bytes);
        while down.backlog_us(now_us) < 2000 {
            let Some(length) = sender.poll_transmit(now_us, &mut out) else {
                break;
            };
            down.send(now_us, &out[..length]);
        }
        while sender.poll_event().is_some() {}
        if matches!(
            sender.state(),
            SenderState::Done | SenderState::Failed(_) | SenderState::Aborted
        ) {
            return Run {
                sender,
                device,
                ended_ms: ms,
            };
        }
    }
    panic!("seed {seed}: not done in time, state {:?}", sender.state());
}

#[test]
fn a_clean_line_carries_the_stream_once() {
    let stream = stream(3000);
    let run = run(&LinkSpec::default(), 1, &stream, |_, _, _| {});
    assert_eq!(run.sender.state(), &SenderState::Done);
    assert_eq!(run.device.knots, stream.knots);
    assert_eq!(run.sender.figures().frames_resent, 0);
    // 3000 knots at 2 a millisecond: the line is never what it waits for.
    assert!(run.ended_ms < 1700, "{} ms", run.ended_ms);
}

#[test]
fn every_knot_arrives_exactly_once_whatever_the_line_does() {
    let stream = stream(3000);
    let spec: LinkSpec = "drop=0.02,flip=2e-4,dup=0.02,reorder=0.02,truncate=0.01,\
                          stall=1s@500ms,pull=1s@3s,delay=3ms"
        .parse()
        .unwrap();
    let mut resent = 0;
    for seed in 0..40 {
        let run = run(&spec, seed, &stream, |_, _, _| {});
        assert_eq!(run.sender.state(), &SenderState::Done, "seed {seed}");
        assert!(run.device.knots == stream.knots, "seed {seed}");
        resent += run.sender.figures().frames_resent;
    }
    assert!(resent > 100, "the line was not bad enough: {resent}");
}

/// Goal: who ends a job hears that it is ended, not that another program did it. Method: an abort that the board has
/// done before its answer is heard: it refuses the frames that were under way.
#[test]
fn frames_that_an_abort_overtakes_are_no_loss_of_the_stream() {
    let run = run(
        &LinkSpec::default(),
        1,
        &stream(3000),
        |ms, sender, device| {
            if ms == 500 {
                sender.command(Control::Abort);
            }
            // The abort is on its way, a frame behind it is refused first.
            if ms == 501 {
                let (sequence, reason) = (device.expected as u16, RefusalReason::NoStream);
                device.predictor = None;
                device.say(&DeviceMessage::Refused(Refusal { sequence, reason }));
            }
        },
    );
    assert_eq!(run.sender.state(), &SenderState::Aborted);
}

#[test]
fn a_restarted_controller_is_noticed_and_never_fed() {
    let stream = stream(3000);
    let run = run(&LinkSpec::default(), 1, &stream, |ms, _, device| {
        if ms == 500 {
            *device = Loopback::new(78);
        }
    });
    let failed = SenderState::Failed(SenderError::DeviceRestarted {
        before: 77,
        now: 78,
    });
    let job = run.sender.frames().job();
    let lost = SenderState::Failed(SenderError::StreamLost { job });
    assert!([failed, lost].contains(run.sender.state()));
    assert!(run.device.knots.is_empty());
    assert!(run.ended_ms < 1500, "noticed after {} ms", run.ended_ms);
}

#[test]
fn a_controller_that_restarts_with_the_same_session_is_noticed() {
    // A host that hears nothing puts a greeting between its questions; the answer has no stream.
    let stream = stream(3000);
    for restart_ms in [300, 500, 1490] {
        let run = run(&LinkSpec::default(), 1, &stream, |ms, _, device| {
            if ms == restart_ms {
                *device = Loopback::new(77);
                // As the firmware: what has heard no greeting says nothing.
                device.deaf = true;
            }
        });
        let lost = SenderState::Failed(SenderError::StreamLost {
            job: run.sender.frames().job(),
        });
        assert_eq!(run.sender.state(), &lost, "at {restart_ms} ms");
        assert!(run.device.knots.is_empty());
        assert!(run.ended_ms < restart_ms + 3000, "{} ms", run.ended_ms);
    }
}

#[test]
fn another_machine_is_refused_with_both_values() {
    let frames = WireFrames::encode(&stream(10)).unwrap();
    let mut sender = Sender::new(
        frames,
        SenderSetup {
            machine_hash: 6,
            ..SETUP
        },
    );
    let mut device = Loopback::new(77);
    let mut out = [0u8; FRAME_BYTES_MAX];
    let length = sender.poll_transmit(0, &mut out).unwrap();
    device.handle(&out[..length]);
    sender.handle_bytes(10, &device.out.concat());
    let SenderState::Failed(error) = sender.state() else {
        panic!("{:?}", sender.state());
    };
    let text = error.to_string();
    assert!(
        text.contains("00000006") && text.contains("00000005"),
        "{text}"
    );
}

#[test]
fn commands_overtake_and_are_done_once() {
    let stream = stream(3000);
    let mut taken = Vec::new();
    let spec: LinkSpec = "drop=0.1,dup=0.1".parse().unwrap();
    let run = run(&spec, 3, &stream, |ms, sender, device| {
        if ms == 300 {
            sender.command(Control::Override(50));
            sender.command(Control::Pause);
        }
        taken.push(device.control_taken);
    });
    assert_eq!(run.device.knots, stream.knots);
    taken.dedup();
    // Numbers only go forward.
    assert!(
        taken
            .windows(2)
            .all(|pair| pair[1].wrapping_sub(pair[0]) as i16 > 0 || pair[0] == 0)
    );
    assert!(taken.len() > 4);
}

#[test]
fn a_stop_is_heard_after_half_a_frame_of_a_dead_host() {
    // Found by fuzzing: noise before the first stop took it along, and only its repeat was heard.
    let mut decoder = FrameDecoder::new();
    for byte in [112, 7, 7] {
        assert!(decoder.push(byte).is_none());
    }
    let mut sender = Sender::new(WireFrames::encode(&stream(10)).unwrap(), SETUP);
    sender.command(Control::EmergencyStop);
    let mut out = [0u8; FRAME_BYTES_MAX];
    let length = sender.poll_transmit(0, &mut out).expect("sent at once");
    let stop = HostMessage::Control(Control::EmergencyStop);
    let heard = out[..length].iter().any(|byte| match decoder.push(*byte) {
        Some(Ok(frame)) => HostMessage::decode(frame.payload).is_ok_and(|heard| heard == stop),
        _ => false,
    });
    assert!(heard, "{:?}", &out[..length]);
}

#[test]
fn frames_of_a_dead_host_that_arrive_after_the_greeting_do_no_harm() {
    // Found by 200 seeds of the restart campaign: the new host waited for credits for ever.
    let stream = stream(300);
    let frames = WireFrames::encode(&stream).unwrap();
    let mut device = Loopback::new(77);
    let mut out = [0u8; FRAME_BYTES_MAX];
    let mut first = Sender::new(frames.clone(), SETUP);
    let mut late = Vec::new();
    for ms in 0..20 {
        while let Some(length) = first.poll_transmit(ms * 1000, &mut out) {
            if first.figures().frames_sent > 3 {
                late.extend_from_slice(&out[..length]);
            } else {
                device.handle(&out[..length]);
            }
        }
        first.handle_bytes(
            ms * 1000,
            &device.out.drain(..).flatten().collect::<Vec<u8>>(),
        );
    }
    assert!(!late.is_empty());
    device.job = frames.job();
    let setup = SenderSetup {
        host_session: 5,
        resume: true,
        ..SETUP
    };
    let mut second = Sender::new(frames, setup);
    let mut late = Some(late);
    for ms in 20..2000 {
        let now_us = ms * 1000;
        while let Some(length) = second.poll_transmit(now_us, &mut out) {
            device.handle(&out[..length]);
            if let Some(late) = late.take() {
                // The greeting has been answered; now the dead host's frames arrive.
                device.handle(&late);
            }
        }
        device.consume();
        let answers: Vec<u8> = device.out.drain(..).flatten().collect();
        second.handle_bytes(now_us, &answers);
    }
    assert_eq!(second.state(), &SenderState::Done);
    assert!(device.knots == stream.knots);
}

#[test]
fn goodput_on_a_clean_line_is_above_ninety_per_cent() {
    // Goal: goodput. Method: a controller that takes everything at once, 1 Mbaud.
    let stream = stream(20_000);
    let run = run(&LinkSpec::default(), 1, &stream, |_, _, device| {
        device.done = device.knots.len() as u32;
    });
    let payload = WireFrames::encode(&stream).unwrap().line_bytes() as f64;
    let figures = run.sender.figures();
    assert!(payload / figures.bytes_sent as f64 > 0.98);
    let line_s = payload * 10.0 / 1e6;
    let took_s = run.ended_ms as f64 / 1e3;
    assert!(
        line_s / took_s > 0.9,
        "{line_s} s of line time in {took_s} s"
    );
}

#[path = "hostile_board_tests.rs"]
mod hostile_board;
