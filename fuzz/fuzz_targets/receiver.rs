//! The controller's receiver on arbitrary bytes, raw and as payloads of whole frames, after a
//! greeting: no panic, and nothing moves that no stream was opened for.
#![no_main]

use headway_firmware::steps::output::NoOutput;
use headway_fuzz::attack::Kind;
use headway_fuzz::machines::subject_of;
use headway_protocol::frame::{FRAME_BYTES_MAX, encode_payload};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let mut machine = subject_of(Kind::Planar).machine.clone();
    let mut out = [0u8; FRAME_BYTES_MAX];
    let mut rest = bytes;
    // Chunks: length and kind in one byte, sequence number in the next.
    while let [head, sequence, tail @ ..] = rest {
        let length = usize::from(head >> 1).min(tail.len());
        let (chunk, after) = tail.split_at(length);
        if head & 1 == 0 {
            machine.handle_bytes(chunk);
        } else if let Ok(length) = encode_payload((*sequence).into(), chunk, &mut out) {
            machine.handle_bytes(&out[..length]);
        }
        machine.run_servo_interval(&mut NoOutput);
        for _ in 0..10 {
            if machine.poll_report(&mut out) == 0 {
                break;
            }
        }
        assert_eq!(machine.poll_report(&mut out), 0, "reports without end");
        rest = after;
    }
});
