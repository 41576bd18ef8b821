//! Goal: a log gives the progress of its stream, whatever a power failure left of it. Method: conversations
//! written by hand.

use super::*;
use crate::drive::link_log::LinkLog;
use crate::drive::test_streams::SharedBytes;
use crate::settings::Settings;
use headway_protocol::frame::{FRAME_BYTES_MAX, encode_frame};
use headway_protocol::message::{Ack, ProbeResult, Status};

fn framed<M: serde::Serialize>(sequence: u16, message: &M) -> Vec<u8> {
    let mut out = [0; FRAME_BYTES_MAX];
    let length = encode_frame(sequence, message, &mut out).unwrap();
    out[..length].to_vec()
}

fn start(job: u32, first_sequence: u32) -> HostMessage<'static> {
    HostMessage::Start(Start {
        job,
        machine_hash: 1,
        first_sequence,
        position: [0; 7],
        solution: 0,
        units: headway_protocol::units::Units::BASE,
    })
}

fn ack(control_taken: u16) -> DeviceMessage {
    DeviceMessage::Ack(Ack {
        session: 1,
        next_sequence: 0,
        knot_limit: 500,
        event_limit: 100,
        control_taken,
    })
}

fn status(state: DeviceState, spans_done: u32) -> DeviceMessage {
    DeviceMessage::Status(Status {
        session: 1,
        state,
        sigma_permille: 1000,
        override_percent: 100,
        flow_percent: 100,
        spans_done,
        queue_knots: 0,
        queue_events: 0,
        referenced: 0,
        switches: 0,
        counts_steps: Default::default(),
        heaters: Default::default(),
        fan_permille: 0,
        fault: None,
        drivers: Default::default(),
        probe: ProbeResult::None,
    })
}

/// A stream of job 7 behind an older one, five frames sent, 30 spans done.
fn conversation() -> Vec<u8> {
    let file = SharedBytes::default();
    let mut log = LinkLog::new(Box::new(file.clone()), Some(&Settings::default().machine));
    log.bytes(1, Way::Up, &framed(0, &status(DeviceState::Finished, 900)));
    log.bytes(2, Way::Down, &framed(40, &start(7, 0xfffe)));
    log.bytes(3, Way::Up, &framed(1, &status(DeviceState::Finished, 900)));
    log.bytes(4, Way::Up, &framed(2, &ack(40)));
    // Sequence numbers run over.
    for frame in [0xfffeu16, 0xffff, 0, 1, 0xffff, 0, 1, 2] {
        log.bytes(5, Way::Down, &framed(frame, &HostMessage::Knots(&[0])));
    }
    log.bytes(6, Way::Up, &framed(3, &status(DeviceState::Running, 12)));
    log.event(7, "line lost");
    let split = framed(4, &status(DeviceState::Running, 30));
    log.bytes(8, Way::Up, &split[..9]);
    log.bytes(9, Way::Up, &split[9..]);
    log.finish().unwrap();
    file.0.lock().unwrap().clone()
}

fn read(text: &[u8]) -> Result<LoggedStream, LogError> {
    last_stream(&mut &*text)
}

#[test]
fn the_newest_stream_counts_from_its_start_on() {
    let found = read(&conversation()).unwrap();
    let expected = LoggedStream {
        job: 7,
        spans_done: 30,
        frames_sent: 5,
        flow_percent: Some(100),
        ..LoggedStream::default()
    };
    assert_eq!(found, expected);
}

#[test]
fn the_rest_of_a_job_says_so() {
    let text = conversation();
    let at = text.iter().position(|&byte| byte == b'\n').unwrap() + 1;
    let remark = format!("# {}\n", rest_remark(0x1a2b, 17));
    let text = [&text[..at], remark.as_bytes(), &text[at..]].concat();
    assert_eq!(read(&text).unwrap().rest_of, Some((0x1a2b, 17)));
}

#[test]
fn a_torn_end_is_an_end_and_damage_is_damage() {
    let text = conversation();
    // Cut anywhere behind the acknowledgement.
    let frames = b"\n5 > ";
    let ack_line = text.windows(frames.len()).position(|bytes| bytes == frames);
    let ack_line = ack_line.unwrap() + 1;
    let mut newest = 0;
    for length in ack_line..text.len() {
        let found = read(&text[..length]).unwrap();
        assert!(found.spans_done >= newest, "{length}");
        assert!(newest <= 30 && found.job == 7);
        newest = found.spans_done;
        assert_eq!(found.is_torn, text[length - 1] != b'\n', "{length}");
    }
    assert_eq!(newest, 12);
    // What a file system leaves: zeros.
    let zeros = [&text[..], &[0; 600]].concat();
    let found = read(&zeros).unwrap();
    assert!(found.is_torn && found.spans_done == 30);
    // A line in the middle that is no line.
    let lines: Vec<&[u8]> = text.split_inclusive(|&byte| byte == b'\n').collect();
    let middle = lines.len() / 2;
    let damaged = [
        &lines[..middle].concat(),
        &b"5 > 0x\n"[..],
        &lines[middle..].concat(),
    ]
    .concat();
    let refused = read(&damaged);
    assert!(
        matches!(refused, Err(LogError::Line { line, .. }) if line == middle + 1),
        "{refused:?}"
    );
    assert!(matches!(read(b"hello\n"), Err(LogError::NotALog)));
    assert!(matches!(read(b""), Err(LogError::NoStream)));
    assert!(matches!(
        read(format!("{HEAD}\n").as_bytes()),
        Err(LogError::NoStream)
    ));
}

#[test]
fn a_log_that_could_not_be_written_any_further_says_so() {
    let text = conversation();
    assert!(!read(&text).unwrap().went_on);
    let text = [&text[..], UNWRITTEN.as_bytes(), b"\n"].concat();
    let found = read(&text).unwrap();
    assert!(found.went_on && !found.is_torn && found.spans_done == 30);
}
