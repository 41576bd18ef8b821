//! Goal: an abandoned stream does not affect a later one, and every command ends in done or refused.
//! Method: a host without a line, whose frames come late, whose answers are lost.
use super::*;

/// What is under way when a stream is left: frames sent and not taken, as many as the credit allows.
fn late_frames(host: &mut Host, job: &Job, first: u16) {
    let (bytes, _) = encode_block(&mut KnotPredictor::new(job.start), &job.knots[..16]);
    for late in 0..320 {
        host.write(first.wrapping_add(late), &HostMessage::Knots(&bytes));
        host.poll();
    }
}

fn welcome(host: &mut Host) -> headway_protocol::message::Welcome {
    host.sequence += 1;
    let hello = HostMessage::Hello(Hello {
        protocol_version: PROTOCOL_VERSION,
        schema_hash: SCHEMA_HASH,
        host_session: 6,
    });
    host.write(host.sequence, &hello);
    let (mut out, mut found) = ([0; FRAME_BYTES_MAX], None);
    loop {
        let length = host.machine.poll_report(&mut out);
        if length == 0 {
            return found.unwrap();
        }
        for &byte in &out[..length] {
            if let Some(frame) = host.decoder.push(byte)
                && let DeviceMessage::Welcome(welcome) =
                    DeviceMessage::decode(frame.unwrap().payload).unwrap()
            {
                found = Some(welcome);
            }
        }
    }
}

fn open(host: &mut Host, job: &Job, first_sequence: u32) {
    host.stream_sequence = first_sequence as u16;
    host.predictor = KnotPredictor::new(job.start);
    (host.knots_sent, host.events_sent, host.finished) = (0, 0, false);
    host.control(HostMessage::Start(Start {
        solution: 0,
        units: Units::BASE,
        job: 2,
        machine_hash: hash_of(&planar()),
        first_sequence,
        position: job.start,
    }));
    host.poll();
}

#[test]
fn numbers_go_on_after_an_abort_and_a_fault_so_that_late_frames_are_old() {
    let (configuration, job) = (planar(), flower());
    for fault in [false, true] {
        let mut host = Host::new(&configuration, &job);
        host.send(&job, 4, 16);
        host.tick();
        let not_taken = host.stream_sequence;
        if fault {
            host.control(HostMessage::Control(Control::EmergencyStop));
            host.tick();
            host.control(HostMessage::Control(Control::ClearFault));
        } else {
            host.control(HostMessage::Control(Control::Abort));
        }
        for _ in 0..200 {
            host.tick();
        }
        let stream = welcome(&mut host).stream.expect("where numbers go on");
        assert_eq!(stream.job, headway_protocol::message::NO_JOB);
        assert_eq!(
            (stream.first_sequence, stream.knots_taken),
            (stream.next_sequence, 0)
        );
        if fault {
            // The position is lost: it is declared.
            let position = job.start;
            host.control(HostMessage::Control(Control::SetPosition(position)));
            host.poll();
        }
        host.refusals.clear();
        open(&mut host, &job, stream.next_sequence);
        assert_eq!(host.refusals, [], "fault {fault}");
        // The old host's frames arrive now: none of them is taken for one of the new stream.
        late_frames(&mut host, &job, not_taken);
        let ack = host.ack.unwrap();
        assert_eq!(ack.next_sequence, stream.next_sequence, "fault {fault}");
        let faults = host.faults.len();
        let before = host.machine.motion().counts();
        host.counter.counts = before;
        host.run(&job);
        assert_eq!(host.faults.len(), faults, "fault {fault}");
        let planned = final_steps(&configuration, &job);
        assert_eq!(host.counter.counts[..5], planned[..5], "fault {fault}");
    }
}

#[test]
fn numbers_go_on_after_a_finish_and_when_that_is_forgotten() {
    let (configuration, job) = (planar(), flower());
    let mut host = Host::new(&configuration, &job);
    host.run(&job);
    let end = host.stream_sequence;
    let finished = welcome(&mut host).stream.unwrap();
    assert_eq!((finished.job, finished.next_sequence), (1, end.into()));
    host.control(HostMessage::Control(Control::Abort));
    host.tick();
    let stream = welcome(&mut host).stream.unwrap();
    assert_eq!(stream.job, headway_protocol::message::NO_JOB);
    assert!(stream.next_sequence > finished.next_sequence);
}

#[test]
fn a_start_while_an_abort_comes_to_rest_is_repeated_and_not_refused() {
    let (configuration, job) = (planar(), flower());
    let mut host = Host::new(&configuration, &job);
    // Into the motion.
    while host.machine.motion().spans_done() < 60 {
        host.send(&job, 8, 16);
        host.tick();
    }
    host.control(HostMessage::Control(Control::Abort));
    host.poll();
    assert!(host.machine.motion().is_aborting());
    let mut tried = 0;
    host.sequence += 1;
    let sequence = host.sequence;
    loop {
        let start = HostMessage::Start(Start {
            solution: 0,
            units: Units::BASE,
            job: 2,
            machine_hash: hash_of(&configuration),
            first_sequence: 9000,
            position: job.start,
        });
        host.write(sequence, &start);
        host.poll();
        tried += 1;
        if host.ack.unwrap().control_taken == sequence || !host.refusals.is_empty() {
            break;
        }
        assert!(tried < 4000, "it never comes to rest");
        host.tick();
    }
    assert!(tried > 2, "{tried}");
    // It stands elsewhere: that is what is said, and not that it still moves.
    assert_eq!(host.refusals, [RefusalReason::Invalid]);
    assert_eq!(host.machine.motion().state(), DeviceState::Idle);
}

#[test]
fn a_refused_command_is_never_acknowledged_so_that_a_lost_refusal_comes_again() {
    let (configuration, job) = (planar(), flower());
    let mut host = Host::new(&configuration, &job);
    let jog = Control::Jog {
        joint: 0,
        distance_units: 10_000,
        speed_units_s: 10_000,
    };
    host.control(HostMessage::Control(jog));
    let refused = host.sequence;
    host.poll();
    assert_eq!(host.refusals, [RefusalReason::Busy]);
    // The refusal was lost: acknowledgements that come by themselves do not end it.
    for repeat in 2..5 {
        for _ in 0..300 {
            host.tick();
        }
        host.poll();
        assert_eq!(host.ack.unwrap().control_taken, refused - 1);
        host.write(refused, &HostMessage::Control(jog));
        host.poll();
        assert_eq!(host.refusals.len(), repeat);
    }
    // The next one that is followed is acknowledged.
    host.control(HostMessage::Control(Control::Pause));
    host.poll();
    assert_eq!(host.ack.unwrap().control_taken, host.sequence);
}
