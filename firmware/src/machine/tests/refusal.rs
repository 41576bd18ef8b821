//! Goal: no message of the host is dropped silently or executed where it was not meant: frames after an
//! end, fields out of range, bursts of refusals, and streams beyond the extruder's limits. Method: raw
//! frames to a controller; every answer and every step counted.
use super::*;
use headway_protocol::frame::encode_payload;

/// A frame of a payload as it is, whatever it means.
fn write_payload(host: &mut Host, sequence: u16, payload: &[u8]) {
    let mut frame = [0; FRAME_BYTES_MAX];
    let length = encode_payload(sequence, payload, &mut frame).unwrap();
    host.machine.handle_bytes(&frame[..length]);
}

fn event(span: u32, volume_units: u32, duration_ticks: u32) -> FlowEvent {
    FlowEvent {
        span,
        offset_ticks: 0,
        action: FlowAction::Prime,
        volume_units,
        duration_ticks: Ticks(duration_ticks),
    }
}

/// Runs until the machine rests with no stream, or has run a minute.
fn settle(host: &mut Host) {
    for _ in 0..120_000 {
        host.tick();
        let state = host.machine.motion().state();
        let over = matches!(
            state,
            DeviceState::Idle | DeviceState::Finished | DeviceState::Faulted
        );
        if over && host.machine.motion().is_at_rest() {
            break;
        }
    }
    for _ in 0..200 {
        host.tick();
    }
    host.poll();
}

/// A stream of rests on one place, with these events before its knots.
fn events_only(configuration: &MachineConfiguration, events: &[FlowEvent]) -> Host {
    let start = flower().start;
    let job = Job {
        start,
        knots: (0..120).map(|_| rest(start, 20)).collect(),
        events: events.to_vec(),
        units: Units::BASE,
    };
    let mut host = Host::new(configuration, &job);
    host.send(&job, 30, 16);
    settle(&mut host);
    host
}

#[test]
fn frames_after_the_end_are_refused_and_the_next_stream_begins_clean() {
    let (configuration, job) = (planar(), flower());
    for early in [true, false] {
        let mut host = Host::new(&configuration, &job);
        while !host.finished {
            host.send(&job, 8, 16);
            host.tick();
        }
        if !early {
            host.run(&job);
        }
        host.poll();
        // What an independent client sent: more knots, 2 mm away and back, and a prime.
        let mut far = *job.knots.last().unwrap();
        far.control[0] += 20_000;
        let (bytes, _) = encode_block(&mut host.predictor.clone(), &[far; 3]);
        let before = host.stream_sequence;
        host.stream(HostMessage::Knots(&bytes));
        host.poll();
        host.stream_sequence = before;
        host.stream(HostMessage::Flow(event(900, 1_000_000, 400)));
        host.poll();
        let no_stream = RefusalReason::NoStream;
        assert_eq!(host.refusals, [no_stream, no_stream], "early {early}");
        if early {
            host.run(&job);
        }
        let planned = final_steps(&configuration, &job);
        assert_eq!(host.counter.counts[..5], planned[..5]);
        // The next job stands where this one ended: it is over with its own spans.
        let end = job.knots.last().unwrap().control;
        host.control(HostMessage::Start(Start {
            solution: 0,
            units: Units::BASE,
            job: 2,
            machine_hash: hash_of(&configuration),
            first_sequence: 9000,
            position: end,
        }));
        host.stream_sequence = 9000;
        let still = Job {
            start: end,
            knots: (0..20).map(|_| rest(end, 10)).collect(),
            events: Vec::new(),
            units: Units::BASE,
        };
        host.predictor = KnotPredictor::new(end);
        (host.knots_sent, host.events_sent, host.finished) = (0, 0, false);
        host.poll();
        host.refusals.clear();
        let steps = host.counter.steps;
        host.run(&still);
        assert_eq!((host.refusals.len(), host.faults.len()), (0, 0));
        assert_eq!(host.machine.motion().spans_done(), 20);
        assert_eq!(host.counter.steps, steps, "it moved");
    }
}

#[test]
fn a_start_at_once_after_an_abort_runs_nothing_of_before() {
    let (configuration, job) = (planar(), flower());
    let mut host = Host::new(&configuration, &job);
    host.run(&job);
    host.control(HostMessage::Control(Control::Abort));
    host.control(HostMessage::Start(Start {
        solution: 0,
        units: Units::BASE,
        job: 2,
        machine_hash: hash_of(&configuration),
        first_sequence: 9000,
        position: job.knots.last().unwrap().control,
    }));
    host.poll();
    assert_eq!(host.refusals, []);
    host.tick();
    assert_eq!(host.machine.motion().state(), DeviceState::Filling);
}

#[test]
fn a_field_out_of_its_range_is_refused_or_a_fault_and_never_unanswered() {
    let (configuration, job) = (planar(), flower());
    // Override 500, report period 1 ms, a jog of joint 9, a command that does not exist.
    let payloads: [&[u8]; 4] = [&[5, 2, 0xf4, 3], &[5, 11, 1], &[5, 8, 9, 2, 5], &[5, 99]];
    for payload in payloads {
        let mut host = Host::new(&configuration, &job);
        host.sequence += 1;
        let sequence = host.sequence;
        write_payload(&mut host, sequence, payload);
        host.poll();
        assert_eq!(host.refusals, [RefusalReason::Invalid], "{payload:?}");
        // Only the refusal ends it.
        assert_eq!(host.ack.unwrap().control_taken, sequence - 1);
        // Its answer was lost: the repeat has the same one.
        write_payload(&mut host, sequence, payload);
        host.poll();
        assert_eq!(host.refusals.len(), 2);
    }
    // A message of a later protocol; a greeting that cannot be read.
    for (payload, reason) in [
        (&[77u8, 1, 2][..], RefusalReason::Invalid),
        (&[0, 1], RefusalReason::ProtocolVersion(PROTOCOL_VERSION)),
    ] {
        let mut host = Host::new(&configuration, &job);
        write_payload(&mut host, 9, payload);
        host.poll();
        assert_eq!(host.refusals, [reason]);
    }
    // A prime of 4·10⁹ units in the stream ends it, and each repeat of it is answered.
    let mut host = Host::new(&configuration, &job);
    let sequence = host.stream_sequence;
    for _ in 0..3 {
        host.ack = None;
        let payload = [3, 0, 0, 0, 0x80, 0xd0, 0xac, 0xf3, 0x0e, 100];
        write_payload(&mut host, sequence, &payload);
        host.poll();
        assert!(host.ack.is_some());
    }
    assert_eq!(host.faults.len(), 1);
    assert_eq!(host.faults[0].cause, FaultCause::BadSegment);
}

#[test]
fn a_burst_of_commands_is_answered_one_by_one_or_not_taken() {
    let (configuration, job) = (planar(), flower());
    let mut host = Host::new(&configuration, &job);
    let first = host.sequence;
    // A stream is open: each of them is refused.
    for _ in 0..9 {
        host.control(HostMessage::Control(Control::Jog {
            joint: 0,
            distance_units: 10_000,
            speed_units_s: 10_000,
        }));
    }
    host.poll();
    let taken = host.ack.unwrap().control_taken.wrapping_sub(first);
    // The last of them is not acknowledged, since it was refused.
    assert_eq!(usize::from(taken) + 1, host.refusals.len());
    assert!((1..8).contains(&taken), "{taken}");
}

#[test]
fn a_command_before_any_greeting_is_refused_as_such() {
    let machine = Machine::new(&planar(), 77).unwrap();
    let mut host = Host::greet(machine, &flower());
    host.machine = Machine::new(&planar(), 78).unwrap();
    host.control(HostMessage::Control(Control::StatusRequest));
    host.poll();
    assert_eq!(host.refusals, [RefusalReason::NoHello]);
}

#[test]
fn an_event_beyond_the_extruder_is_a_fault_of_its_motor_before_a_step_is_made() {
    // 1000 mm³ in one tick; 100 mm³ in half a second peak at 375 of 60 mm³/s; 3.2 mm³ in 60 ms at 100.
    for (volume_units, ticks) in [(1_000_000_000, 1), (100_000_000, 1000), (3_200_000, 120)] {
        let host = events_only(&planar(), &[event(3, volume_units, ticks)]);
        let fault = host.faults[0];
        assert_eq!((fault.cause, fault.index), (FaultCause::Limit, 4));
        assert!(fault.value > 1050, "{fault:?}");
        assert_eq!(host.counter.steps, 0);
        assert_eq!(host.counter.counts, host.machine.motion().counts());
    }
}

#[test]
fn primes_that_are_too_much_together_stop_before_the_limit() {
    let configuration = planar();
    // Each peaks at 37.5 of 60 mm³/s by itself.
    let one = event(3, 2_000_000, 200);
    let host = events_only(&configuration, &[one]);
    assert_eq!(host.faults, []);
    assert_eq!(host.counter.counts[4], 800);
    let host = events_only(&configuration, &[one; 60]);
    let fault = host.faults[0];
    assert_eq!((fault.cause, fault.index), (FaultCause::Limit, 4));
    assert!((1050..2000).contains(&fault.value), "{fault:?}");
    // The counts are those that were really made.
    assert_eq!(host.counter.counts, host.machine.motion().counts());
}

#[test]
fn flow_beyond_the_extruder_is_refused_by_its_span() {
    let configuration = planar();
    // 400 mm³/s, eased; 100 mm³/s at once.
    let fast = Job::of_curve(1.0, 12, |s| [0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 400.0 * s]);
    let start = fast.start;
    let mut jump = start;
    let mut knots: Vec<Knot> = (0..20).map(|_| rest(start, 12)).collect();
    for _ in 0..80 {
        jump[6] += 100 * 1_000_000 * 12 / 2000;
        knots.push(rest(jump, 12));
    }
    knots.extend((0..20).map(|_| rest(jump, 12)));
    let sudden = Job {
        start,
        knots,
        events: Vec::new(),
        units: Units::BASE,
    };
    for job in [fast, sudden] {
        let mut host = Host::new(&configuration, &job);
        let (mut last, mut fastest) = (0.0f64, 0.0f64);
        for _ in 0..8000 {
            host.send(&job, 8, 16);
            host.tick();
            let target = host.machine.motion().targets()[4];
            let at = target as f64 / crate::steps::STEP as f64 / 400.0;
            fastest = fastest.max((at - last).abs() * 2000.0);
            last = at;
        }
        host.poll();
        let fault = host.faults[0];
        assert_eq!((fault.cause, fault.index), (FaultCause::Limit, 4));
        assert!(fastest <= 60.0 * 1.05, "{fastest} mm³/s");
        assert_eq!(host.counter.counts, host.machine.motion().counts());
    }
}

#[test]
fn events_out_of_their_order_or_behind_the_last_span_are_a_fault() {
    let configuration = planar();
    for spans in [&[9, 3][..], &[500]] {
        let start = flower().start;
        let job = Job {
            start,
            knots: Vec::new(),
            events: Vec::new(),
            units: Units::BASE,
        };
        let mut host = Host::new(&configuration, &job);
        for span in spans {
            host.stream(HostMessage::Flow(event(*span, 1000, 100)));
        }
        let knots: Vec<Knot> = (0..20).map(|_| rest(start, 20)).collect();
        let (bytes, _) = encode_block(&mut host.predictor, &knots);
        host.stream(HostMessage::Knots(&bytes));
        host.stream(HostMessage::Finish(Finish {
            knots: 20,
            events: spans.len() as u32,
        }));
        settle(&mut host);
        assert_eq!(host.faults[0].cause, FaultCause::Sequence, "{spans:?}");
    }
}

#[test]
fn a_second_line_hears_and_stops_but_neither_streams_nor_moves() {
    let (configuration, job) = (planar(), flower());
    let mut host = Host::new(&configuration, &job);
    let mut watcher = Conversation::new(&configuration, 1);
    let mut sequence = 40;
    let mut ask = |host: &mut Host, message: HostMessage<'_>| {
        sequence += 1;
        let mut frame = [0; FRAME_BYTES_MAX];
        let length = encode_frame(sequence, &message, &mut frame).unwrap();
        host.machine.handle_line(&mut watcher, &frame[..length]);
        let mut said = Vec::new();
        let mut decoder = FrameDecoder::new();
        loop {
            let length = host.machine.poll_line(&mut watcher, &mut frame);
            if length == 0 {
                return said;
            }
            for &byte in &frame[..length] {
                if let Some(frame) = decoder.push(byte) {
                    said.push(DeviceMessage::decode(frame.unwrap().payload).unwrap());
                }
            }
        }
    };
    let hello = HostMessage::Hello(Hello {
        protocol_version: PROTOCOL_VERSION,
        schema_hash: SCHEMA_HASH,
        host_session: 9,
    });
    let streams = |message: &DeviceMessage| match message {
        DeviceMessage::Welcome(welcome) => welcome.stream.is_some(),
        _ => false,
    };
    let said = ask(&mut host, hello);
    assert!(said.iter().any(streams), "{said:?}");
    let is_busy = |message: &DeviceMessage| match message {
        DeviceMessage::Refused(refusal) => refusal.reason == RefusalReason::Busy,
        _ => false,
    };
    for message in [
        HostMessage::Start(Start {
            job: 8,
            machine_hash: hash_of(&configuration),
            first_sequence: 1,
            position: job.start,
            solution: 0,
            units: Units::BASE,
        }),
        HostMessage::Control(Control::Jog {
            joint: 0,
            distance_units: 1000,
            speed_units_s: 1000,
        }),
        HostMessage::Finish(Finish {
            knots: 0,
            events: 0,
        }),
        HostMessage::Control(Control::Fan(400)),
        HostMessage::Control(Control::Fan(0)),
        HostMessage::Control(Control::Heat {
            heater: 0,
            decidegrees: 10,
            wait: false,
        }),
        HostMessage::Control(Control::MotorsOff),
    ] {
        assert!(ask(&mut host, message).iter().any(is_busy), "{message:?}");
    }
    // Whatever stops or cools is taken.
    for control in [
        Control::Pause,
        Control::Resume,
        Control::Override(90),
        Control::FlowOverride(90),
        Control::StatusRequest,
    ] {
        let said = ask(&mut host, HostMessage::Control(control));
        assert!(!said.iter().any(is_busy), "{control:?}");
    }
    for _ in 0..2000 {
        host.send(&job, 8, 16);
        host.tick();
    }
    let steps = host.counter.steps;
    ask(&mut host, HostMessage::Control(Control::EmergencyStop));
    (0..50).for_each(|_| host.tick());
    host.poll();
    assert_eq!(host.faults[0].cause, FaultCause::Emergency);
    assert_eq!(host.counter.steps, steps);
}

#[test]
fn what_is_refused_leaves_a_machine_in_its_joint_solution_and_its_turns() {
    // Goal: an opening or a command that is refused moves nothing, on a machine that stands on its path. Method: a table
    // that can hold a pose in two ways, asked to open streams the other way and turned, and to go out of its range; each
    // refusal, then ticks without a step, then the opening that is right.
    let (configuration, job) = (units::trunnion(), units::cone());
    let start = |solution: u8, position| {
        HostMessage::Start(Start {
            job: 3,
            machine_hash: configuration.hash(),
            first_sequence: 7000,
            position,
            solution,
            units: Units::BASE,
        })
    };
    let leaning = |towards_rad: f64| {
        let mut position = job.start;
        position[3] = (-3e5 * towards_rad.sin()) as i32;
        position[4] = (3e5 * towards_rad.cos()) as i32;
        position
    };
    // The table turns from one side of its half turn to the other.
    let here = leaning(3.0);
    let far = |mut position: ChannelPoint| {
        position[0] = 9_000_000;
        position
    };
    let turned = [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0].map(leaning);
    let turned = turned.map(|position| {
        [
            start(1, position),
            HostMessage::Control(Control::GoTo(far(position))),
            HostMessage::Control(Control::SetPosition(far(position))),
        ]
    });
    let others = [[start(0, here), start(9, here), start(0, far(here))]];
    for (number, wrong) in others.into_iter().chain(turned).enumerate() {
        let machine = Machine::new(&configuration, 77).unwrap();
        let mut host = Host::greet(machine, &job);
        host.control(HostMessage::Control(Control::SetPosition(here)));
        (0..50).for_each(|_| host.tick());
        let steps = host.counter.steps;
        for (place, message) in wrong.into_iter().enumerate() {
            host.refusals.clear();
            host.control(message);
            host.poll();
            assert_eq!(host.refusals, [RefusalReason::Invalid], "{number} {place}");
            (0..50).for_each(|_| host.tick());
            let motion = host.machine.motion();
            assert_eq!(
                (host.counter.steps, motion.fault()),
                (steps, None),
                "{number} {place}"
            );
        }
        host.refusals.clear();
        host.control(start(1, here));
        host.poll();
        assert_eq!(host.refusals, [], "{number}");
    }
}
