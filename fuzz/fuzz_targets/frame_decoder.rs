//! Frame decoder and message decoders on arbitrary bytes: no panic, bounds kept, and what is taken
//! is what is written again.
#![no_main]

use headway_protocol::frame::{FRAME_BYTES_MAX, FrameDecoder, MESSAGE_BYTES_MAX, encode_payload};
use headway_protocol::message::{DeviceMessage, HostMessage};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let mut decoder = FrameDecoder::new();
    for &byte in bytes {
        let Some(Ok(frame)) = decoder.push(byte) else {
            continue;
        };
        assert!(frame.payload.len() <= MESSAGE_BYTES_MAX + 2);
        let _ = HostMessage::decode(frame.payload);
        let _ = DeviceMessage::decode(frame.payload);
    }
    // The bytes as a payload: through the line and back.
    let payload = &bytes[..bytes.len().min(MESSAGE_BYTES_MAX)];
    let mut out = [0u8; FRAME_BYTES_MAX];
    let Ok(length) = encode_payload(0x5aa5, payload, &mut out) else {
        panic!("a payload of {} bytes fits", payload.len());
    };
    let mut whole = FrameDecoder::new();
    let mut seen = 0;
    for &byte in &out[..length] {
        if let Some(frame) = whole.push(byte) {
            let frame = frame.expect("our own frame");
            assert_eq!((frame.sequence, frame.payload), (0x5aa5, payload));
            let host = HostMessage::decode(frame.payload);
            if let Ok(message) = host {
                let mut again = [0u8; MESSAGE_BYTES_MAX];
                let written = postcard::to_slice(&message, &mut again).expect("it fitted before");
                assert_eq!(HostMessage::decode(written), Ok(message));
            }
            let _ = DeviceMessage::decode(frame.payload);
            seen += 1;
        }
    }
    assert_eq!(seen, 1);
});
