//! Goal: whatever a board sends, a streaming host ends within the bound of its current wait, and reports
//! the board's last message. Method: a correct controller whose messages are falsified in many ways;
//! both ends on a virtual clock with the host's own time limits.
use super::*;
use crate::drive::patience::{ANSWER_US, GONE_US, LINE_US, PAUSE_US, PROGRESS_US, Patience, Wait};
use crate::drive::patience::{COMMAND_US, REST_US};
use headway_protocol::frame::encode_payload;
use headway_protocol::message::{Fault, FaultCause};

/// What is left of a message: whole frames, or bytes.
type Said = Vec<Vec<u8>>;
type Liar = Box<dyn FnMut(u64, DeviceMessage) -> Said>;

fn frame(message: &DeviceMessage) -> Vec<u8> {
    let mut out = [0u8; FRAME_BYTES_MAX];
    let length = encode_frame(0, message, &mut out).unwrap();
    out[..length].to_vec()
}

/// A frame with a right CRC and a payload that is no message of ours.
fn raw(payload: &[u8]) -> Vec<u8> {
    let mut out = [0u8; FRAME_BYTES_MAX];
    let length = encode_payload(0, payload, &mut out).unwrap();
    out[..length].to_vec()
}

/// A liar that changes acknowledgements, in `Ack` and `Nak`.
fn acks(mut change: impl FnMut(&mut Ack) + 'static) -> Liar {
    Box::new(move |_, mut message| {
        if let DeviceMessage::Ack(ack) | DeviceMessage::Nak(ack) = &mut message {
            change(ack);
        }
        vec![frame(&message)]
    })
}

fn welcomes(change: impl Fn(&mut Welcome) + 'static) -> Liar {
    Box::new(move |_, mut message| {
        if let DeviceMessage::Welcome(welcome) = &mut message {
            change(welcome);
        }
        vec![frame(&message)]
    })
}

fn statuses(mut change: impl FnMut(u64, &mut Status) + 'static) -> Liar {
    Box::new(move |ms, mut message| {
        if let DeviceMessage::Status(status) = &mut message {
            change(ms, status);
        }
        vec![frame(&message)]
    })
}

/// Something else in the place of all messages that `of` picks.
fn instead(of: impl Fn(&DeviceMessage) -> bool + 'static, said: Said) -> Liar {
    Box::new(move |_, message| match of(&message) {
        true => said.clone(),
        false => vec![frame(&message)],
    })
}

fn refused(sequence: u16, reason: RefusalReason) -> Vec<u8> {
    frame(&DeviceMessage::Refused(Refusal { sequence, reason }))
}

fn is_ack(message: &DeviceMessage) -> bool {
    matches!(message, DeviceMessage::Ack(_) | DeviceMessage::Nak(_))
}

fn is_status(message: &DeviceMessage) -> bool {
    matches!(message, DeviceMessage::Status(_))
}

fn is_welcome(message: &DeviceMessage) -> bool {
    matches!(message, DeviceMessage::Welcome(_))
}

/// Everything after so many milliseconds of conversation goes through another liar.
fn after(begin_ms: u64, mut liar: Liar) -> Liar {
    Box::new(move |ms, message| match ms >= begin_ms {
        true => liar(ms, message),
        false => vec![frame(&message)],
    })
}

fn state(state: DeviceState) -> Liar {
    statuses(move |_, status| status.state = state)
}

/// How it has to end: within its own time, or as an error of the conversation itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ends {
    Overdue(Wait),
    Failed,
    Done,
}

fn bound_us(ends: Ends) -> u64 {
    match ends {
        // The job itself takes 2 s.
        Ends::Failed | Ends::Done => 5_000_000,
        Ends::Overdue(wait) => {
            let bound_us = match wait {
                Wait::Welcome | Wait::Opening => ANSWER_US,
                Wait::Command => COMMAND_US,
                Wait::Progress | Wait::End => PROGRESS_US,
                Wait::Stream => GONE_US,
                Wait::Rest => REST_US,
                Wait::Line => LINE_US,
                Wait::Resume => PAUSE_US,
            };
            bound_us + 5_000_000
        }
    }
}

fn honest() -> Liar {
    Box::new(|_, message| vec![frame(&message)])
}

fn kinds() -> Vec<(&'static str, Ends, Liar)> {
    use Ends::{Done, Failed, Overdue};
    use Wait::{Command, End, Opening, Progress, Resume, Stream, Welcome as Greeting};
    let silence = || -> Liar { Box::new(|_, _| Vec::new()) };
    let flood = |bytes: Vec<u8>| -> Liar { Box::new(move |_, _| vec![bytes.clone(); 50]) };
    let unknown_refusal = raw(&[1, 9, 99]);
    let unknown_state = raw(&[4, 77, 77, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    let no_stream = refused(3, RefusalReason::NoStream);
    vec![
        ("honest", Done, honest()),
        ("silent", Overdue(Greeting), silence()),
        ("noise", Overdue(Greeting), flood(vec![0xa5; 200])),
        ("zeros", Overdue(Greeting), flood(vec![0; 200])),
        (
            "a frame without an end",
            Overdue(Greeting),
            flood(vec![7; 64]),
        ),
        (
            "unknown messages",
            Overdue(Greeting),
            flood(raw(&[99, 1, 2])),
        ),
        (
            "a message and bytes behind it",
            Overdue(Greeting),
            flood(raw(&[5, 0, 0, 0, 9, 9])),
        ),
        (
            "acknowledges instead of a welcome",
            Overdue(Greeting),
            instead(
                is_welcome,
                vec![frame(&DeviceMessage::Ack(Loopback::new(77).ack()))],
            ),
        ),
        (
            "status instead of a welcome",
            Overdue(Greeting),
            instead(
                is_welcome,
                vec![frame(&DeviceMessage::Status(Loopback::new(77).status()))],
            ),
        ),
        (
            "welcome of another host",
            Overdue(Greeting),
            welcomes(|w| w.host_session = 9),
        ),
        (
            "greeting refused, unknown reason",
            Overdue(Greeting),
            instead(is_welcome, vec![unknown_refusal.clone()]),
        ),
        (
            "greeting refused, another number",
            Overdue(Greeting),
            instead(is_welcome, vec![refused(9, RefusalReason::Busy)]),
        ),
        (
            "no greeting heard, for ever",
            Overdue(Greeting),
            instead(is_welcome, vec![refused(0xfff1, RefusalReason::NoHello)]),
        ),
        (
            "another protocol",
            Failed,
            welcomes(|w| w.protocol_version = PROTOCOL_VERSION + 1),
        ),
        ("another schema", Failed, welcomes(|w| w.schema_hash = 9)),
        ("another machine", Failed, welcomes(|w| w.machine_hash = 9)),
        ("another servo", Failed, welcomes(|w| w.servo_hz = 9)),
        ("a queue too small", Failed, welcomes(|w| w.queue_knots = 9)),
        (
            "no room for events",
            Failed,
            welcomes(|w| w.queue_events = 0),
        ),
        (
            "silent after its welcome",
            Overdue(Opening),
            instead(|m| !is_welcome(m), Vec::new()),
        ),
        (
            "opening never acknowledged",
            Overdue(Opening),
            acks(|a| a.control_taken = 0xfff1),
        ),
        (
            "commands acknowledged ahead",
            Overdue(Opening),
            acks(|a| a.control_taken = a.control_taken.wrapping_add(100)),
        ),
        (
            "opening refused, unknown reason",
            Overdue(Opening),
            instead(is_ack, vec![unknown_refusal.clone()]),
        ),
        (
            "opening refused, another number",
            Overdue(Opening),
            instead(is_ack, vec![refused(9, RefusalReason::Busy)]),
        ),
        (
            "opening refused",
            Failed,
            instead(is_ack, vec![refused(0xfff2, RefusalReason::Faulted)]),
        ),
        ("no credits", Overdue(Progress), acks(|a| a.knot_limit = 0)),
        (
            "credit for one block",
            Overdue(Progress),
            acks(|a| a.knot_limit = a.knot_limit.min(32)),
        ),
        (
            "credit taken back",
            Overdue(Progress),
            after(100, acks(|a| a.knot_limit = 0)),
        ),
        (
            "endless requests to repeat",
            Overdue(Progress),
            Box::new(|_, message| match message {
                DeviceMessage::Ack(mut ack) if ack.next_sequence != 0 => {
                    ack.next_sequence = 77u32.wrapping_mul(0x9e37_79b9);
                    vec![frame(&DeviceMessage::Nak(ack)); 3]
                }
                other => vec![frame(&other)],
            }),
        ),
        (
            "a gap at every frame",
            Done,
            Box::new(|_, message| match message {
                DeviceMessage::Ack(ack) => vec![frame(&DeviceMessage::Nak(ack))],
                other => vec![frame(&other)],
            }),
        ),
        (
            "frames of the future",
            Overdue(Progress),
            after(
                100,
                acks(|a| a.next_sequence = a.next_sequence.wrapping_add(1000)),
            ),
        ),
        (
            "frames of the past",
            Overdue(Progress),
            after(
                100,
                acks(|a| a.next_sequence = a.next_sequence.wrapping_sub(1000)),
            ),
        ),
        (
            "future and past in turn",
            Overdue(Progress),
            after(100, {
                let mut turn = 0u32;
                acks(move |a| {
                    turn += 1;
                    let far = if turn & 1 == 0 {
                        500
                    } else {
                        0u32.wrapping_sub(500)
                    };
                    a.next_sequence = a.next_sequence.wrapping_add(far);
                })
            }),
        ),
        ("frames frozen", Overdue(Progress), {
            let mut frozen = None;
            after(
                100,
                acks(move |a| a.next_sequence = *frozen.get_or_insert(a.next_sequence)),
            )
        }),
        (
            "a session of another start in acknowledgements",
            Failed,
            after(100, acks(|a| a.session = 9)),
        ),
        (
            "a session of another start in its status",
            Failed,
            after(100, statuses(|_, s| s.session = 9)),
        ),
        (
            "a welcome of another start",
            Failed,
            after(
                100,
                Box::new(|_, message| {
                    let mut welcome = None;
                    if let DeviceMessage::Ack(ack) = &message {
                        welcome = Some(Welcome {
                            protocol_version: PROTOCOL_VERSION,
                            schema_hash: SCHEMA_HASH,
                            firmware_version: [0; 3],
                            machine_hash: 5,
                            queue_knots: 256,
                            queue_events: 64,
                            servo_hz: 2000,
                            step_hz: 200_000,
                            session: ack.session + 1,
                            host_session: SETUP.host_session,
                            stream: None,
                            settings_hash: 0,
                        });
                    }
                    welcome.map_or(Vec::new(), |w| vec![frame(&DeviceMessage::Welcome(w))])
                }),
            ),
        ),
        (
            "no stream, all of a sudden",
            Failed,
            after(100, instead(is_ack, vec![no_stream])),
        ),
        (
            "busy, all of a sudden",
            Overdue(Progress),
            after(100, instead(is_ack, vec![refused(3, RefusalReason::Busy)])),
        ),
        (
            "unknown refusals, all of a sudden",
            Overdue(Progress),
            after(100, instead(is_ack, vec![unknown_refusal])),
        ),
        (
            "silent in mid-job",
            Overdue(Progress),
            after(100, silence()),
        ),
        (
            "running for ever, no span done",
            Overdue(Progress),
            statuses(|_, s| {
                s.spans_done = 0;
                s.state = DeviceState::Running;
            }),
        ),
        (
            "running for ever, half of the spans done",
            Overdue(Progress),
            statuses(|_, s| {
                s.spans_done = s.spans_done.min(1500);
                s.state = DeviceState::Running;
            }),
        ),
        (
            "running for ever, all spans done",
            Overdue(End),
            state(DeviceState::Running),
        ),
        (
            "more spans done than there are",
            Overdue(End),
            statuses(|_, s| {
                s.spans_done = u32::MAX;
                s.state = DeviceState::Running;
            }),
        ),
        (
            "spans to and fro",
            Overdue(Progress),
            statuses(|ms, s| {
                s.spans_done = (ms % 7) as u32;
                s.state = DeviceState::Running;
            }),
        ),
        ("finished too early", Done, state(DeviceState::Finished)),
        (
            "finished after a few spans",
            Overdue(Stream),
            statuses(|_, s| {
                s.spans_done = s.spans_done.min(3);
                s.state = DeviceState::Finished;
            }),
        ),
        ("idle in mid-job", Overdue(Stream), state(DeviceState::Idle)),
        (
            "homing in mid-job",
            Overdue(Stream),
            state(DeviceState::Homing),
        ),
        (
            "jogging in mid-job",
            Overdue(Stream),
            state(DeviceState::Jogging),
        ),
        (
            "probing in mid-job",
            Overdue(Stream),
            state(DeviceState::Probing),
        ),
        (
            "filling for ever",
            Overdue(Progress),
            statuses(|_, s| {
                s.spans_done = 0;
                s.state = DeviceState::Filling;
            }),
        ),
        (
            "starved for ever",
            Overdue(Progress),
            statuses(|_, s| {
                s.spans_done = 0;
                s.state = DeviceState::Starved;
            }),
        ),
        (
            "aborting for ever",
            Overdue(Progress),
            statuses(|_, s| {
                s.spans_done = 0;
                s.state = DeviceState::Aborting;
            }),
        ),
        (
            "faulted, it says, with no fault",
            Overdue(Progress),
            statuses(|_, s| {
                s.spans_done = 0;
                s.state = DeviceState::Faulted;
            }),
        ),
        (
            "paused, and nobody asked",
            Overdue(Resume),
            statuses(|_, s| {
                s.spans_done = 0;
                s.state = DeviceState::Paused;
            }),
        ),
        (
            "paused on and off",
            Overdue(Resume),
            statuses(|ms, s| {
                s.spans_done = 0;
                s.state = if ms / 3000 % 2 == 0 {
                    DeviceState::Paused
                } else {
                    DeviceState::Running
                };
            }),
        ),
        (
            "unknown states",
            Overdue(Progress),
            instead(is_status, vec![unknown_state]),
        ),
        (
            "an unknown fault, then silence",
            Overdue(Progress),
            after(100, instead(|_| true, vec![raw(&[5, 99, 0, 0])])),
        ),
        (
            "a fault",
            Failed,
            after(
                100,
                instead(
                    |_| true,
                    vec![frame(&DeviceMessage::Fault(Fault {
                        cause: FaultCause::Watchdog,
                        index: 0,
                        value: 0,
                    }))],
                ),
            ),
        ),
        (
            "a fault in its status",
            Failed,
            statuses(|_, s| {
                s.fault = Some(Fault {
                    cause: FaultCause::Watchdog,
                    index: 0,
                    value: 0,
                })
            }),
        ),
        (
            "commands never taken, the stream goes on",
            Overdue(Command),
            Box::new(|ms, mut message| {
                // It gets on by a span a second, so that the stream itself has no reason to end.
                if let DeviceMessage::Ack(ack) | DeviceMessage::Nak(ack) = &mut message
                    && ms > 100
                {
                    ack.control_taken = 0xfff2;
                }
                if let DeviceMessage::Status(status) = &mut message {
                    status.spans_done = (ms / 1000) as u32;
                    status.state = DeviceState::Running;
                }
                vec![frame(&message)]
            }),
        ),
        (
            "the same status a thousand times",
            Overdue(Progress),
            after(
                100,
                flood(frame(&DeviceMessage::Status(
                    Loopback::new(77).status_running(),
                ))),
            ),
        ),
    ]
}

impl Loopback {
    fn status_running(&self) -> Status {
        Status {
            state: DeviceState::Running,
            ..self.status()
        }
    }
}

/// Streams until the host gives up, or does not.
fn meet(
    liar: &mut Liar,
    line_open: impl Fn(u64) -> bool,
    abort_at_ms: Option<u64>,
) -> (Ends, u64, String) {
    let stream = stream(3000);
    let mut sender = Sender::new(WireFrames::encode(&stream).unwrap(), SETUP);
    let mut patience = Patience::new(&stream, SETUP.servo_hz);
    let mut device = Loopback::new(77);
    let mut out = [0u8; FRAME_BYTES_MAX];
    let mut asked = 0;
    let mut aborted = false;
    let mut ms = 0u64;
    while ms < 14 * 3600 * 1000 {
        let now_us = ms * 1000;
        device.consume();
        if ms >= asked {
            // Like a real board: a status ten times a second.
            asked = ms + 100;
            let status = device.status();
            device.say(&DeviceMessage::Status(status));
        }
        if abort_at_ms.is_some_and(|at| ms >= at) && !aborted {
            aborted = true;
            sender.command(Control::Abort);
        }
        let open = line_open(ms);
        for said in std::mem::take(&mut device.out) {
            let mut decoder = FrameDecoder::new();
            let message = said.iter().find_map(|&byte| {
                decoder
                    .push(byte)
                    .map(|f| DeviceMessage::decode(f.unwrap().payload).unwrap())
            });
            for bytes in liar(ms, message.unwrap()) {
                if open {
                    sender.handle_bytes(now_us, &bytes);
                }
            }
        }
        for _ in 0..8 {
            let Some(length) = sender.poll_transmit(now_us, &mut out) else {
                break;
            };
            if open {
                device.handle(&out[..length]);
            }
        }
        while sender.poll_event().is_some() {}
        match sender.state() {
            SenderState::Done => return (Ends::Done, ms, String::new()),
            SenderState::Failed(error) => return (Ends::Failed, ms, error.to_string()),
            _ => {}
        }
        if let Some(overdue) = patience.look(now_us, &sender, open) {
            return (Ends::Overdue(overdue.wait), ms, overdue.to_string());
        }
        // Coarser where nothing new is to be expected.
        ms += if ms < 5000 { 1 } else { 100 };
    }
    (Ends::Done, u64::MAX, "never".to_string())
}

#[test]
fn no_wait_for_a_hostile_board_is_over_its_bound() {
    let mut kinds = kinds();
    assert!(kinds.len() >= 50, "{}", kinds.len());
    let mut wrong = Vec::new();
    for (name, ends, liar) in &mut kinds {
        let (ended, ms, words) = meet(liar, |_| true, None);
        println!(
            "| {name} | {ended:?} | {:.1} s | {words} |",
            ms as f64 / 1000.0
        );
        if ended != *ends || ms.saturating_mul(1000) > bound_us(*ends) {
            wrong.push(format!(
                "{name}: {ended:?} after {ms} ms, not {ends:?}: {words}"
            ));
        }
        if matches!(ended, Ends::Overdue(_)) && !words.contains("it said last: ") {
            wrong.push(format!("{name}: {words}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_line_that_never_comes_back_and_an_abort_that_never_rests_end_too() {
    let (ended, ms, _) = meet(&mut honest(), |ms| ms < 500, None);
    assert_eq!(ended, Ends::Overdue(Wait::Line));
    assert!(ms * 1000 < LINE_US + 5_000_000);
    // One that comes and goes is none that is gone.
    let (ended, _, words) = meet(&mut honest(), |ms| ms % 400 < 200, None);
    assert_eq!(ended, Ends::Done, "{words}");
    let (ended, ms, _) = meet(&mut state(DeviceState::Aborting), |_| true, Some(300));
    assert_eq!(ended, Ends::Overdue(Wait::Rest));
    assert!(ms * 1000 < REST_US + 5_000_000);
}

/// Goal: a line that opens and closes at once is as gone as one that never comes back, at whatever moment
/// of the job that begins. Method: a silent line that is there for 50 ms four times a second.
#[test]
fn a_line_that_opens_and_closes_at_once_ends_as_one_that_is_gone() {
    for begins_ms in [0, 5, 500] {
        let silent_line = Box::new(|_, _| Vec::new());
        let (ended, ms, words) = meet(
            &mut after(begins_ms, silent_line),
            move |ms| ms < begins_ms || ms % 250 < 50,
            None,
        );
        assert_eq!(ended, Ends::Overdue(Wait::Line), "{begins_ms}: {words}");
        // Within a reopening of the bound.
        assert!(ms * 1000 < LINE_US + 5_000_000, "{begins_ms}: {ms}");
    }
}
