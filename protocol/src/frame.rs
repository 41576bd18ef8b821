//! Frames: COBS around sequence number, postcard message and CRC-32, ended by a zero byte.
//!
//! `COBS(sequence u16 LE | postcard bytes | CRC-32 u32 LE of all before it) 00`. The decoder reads
//! bytes one by one, resynchronises at every zero byte and never uses data that the CRC did not
//! cover. CRC-32/ISO-HDLC (the polynomial of Ethernet and zip). The receiver interprets sequence
//! numbers; [`full_sequence`] widens the 16 bits on the wire.

use crate::cobs_decode::decode_in_place;
use crc::{CRC_32_ISO_HDLC, Crc};
use serde::Serialize;

/// The CRC of frames, schema and machine configuration.
pub const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
/// Table in flash, not rebuilt for each use.
static CRC_TABLE: Crc<u32> = CRC;

/// CRC-32 of the concatenation of these bytes.
pub fn checksum(parts: &[&[u8]]) -> u32 {
    let mut digest = CRC_TABLE.digest();
    for part in parts {
        digest.update(part);
    }
    digest.finalize()
}

/// Longest postcard message: a full knot block with its tag and length.
pub const MESSAGE_BYTES_MAX: usize = 248;
/// Sequence number and CRC.
pub const FRAME_OVERHEAD_BYTES: usize = 6;
/// Longest frame content before COBS; at 254 bytes COBS adds exactly one byte.
pub const CONTENT_BYTES_MAX: usize = MESSAGE_BYTES_MAX + FRAME_OVERHEAD_BYTES;
/// Longest frame on the line: content, COBS code byte (two for the limit case), zero.
pub const FRAME_BYTES_MAX: usize = CONTENT_BYTES_MAX + 3;

/// Why bytes are not a frame, or a message does not fit into one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrameError {
    /// More bytes than any frame has.
    TooLong,
    /// Fewer bytes than any frame has.
    TooShort,
    /// COBS codes point outside the frame.
    Cobs,
    /// The CRC does not match.
    Crc,
    /// The message does not fit.
    MessageTooLong,
    /// The output buffer is smaller than the frame.
    BufferTooSmall,
}

/// A completely received frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Sequence number, low 16 bits.
    pub sequence: u16,
    /// Postcard message.
    pub payload: &'a [u8],
}

/// Writes a message as one frame and returns the frame's length in bytes.
/// `out` should hold [`FRAME_BYTES_MAX`].
pub fn encode_frame<M: Serialize>(
    sequence: u16,
    message: &M,
    out: &mut [u8],
) -> Result<usize, FrameError> {
    let mut payload = [0u8; MESSAGE_BYTES_MAX];
    let written =
        postcard::to_slice(message, &mut payload).map_err(|_| FrameError::MessageTooLong)?;
    encode_payload(sequence, written, out)
}

/// Writes the bytes of a postcard message as one frame and returns the frame's length in bytes.
pub fn encode_payload(sequence: u16, payload: &[u8], out: &mut [u8]) -> Result<usize, FrameError> {
    let mut content = [0u8; CONTENT_BYTES_MAX];
    let body_bytes = payload.len() + 2;
    let (body, rest) = content
        .split_at_mut_checked(body_bytes)
        .ok_or(FrameError::MessageTooLong)?;
    let (head, tail) = body.split_at_mut(2);
    head.copy_from_slice(&sequence.to_le_bytes());
    tail.copy_from_slice(payload);
    let checksum = CRC_TABLE.checksum(body).to_le_bytes();
    rest.get_mut(..4)
        .ok_or(FrameError::MessageTooLong)?
        .copy_from_slice(&checksum);
    let content = content
        .get(..body_bytes + 4)
        .ok_or(FrameError::MessageTooLong)?;
    let encoded = cobs::try_encode(content, out).map_err(|_| FrameError::BufferTooSmall)?;
    *out.get_mut(encoded).ok_or(FrameError::BufferTooSmall)? = 0;
    Ok(encoded + 1)
}

/// Collects bytes of the line into frames.
#[derive(Clone, Debug)]
pub struct FrameDecoder {
    buffer: [u8; FRAME_BYTES_MAX],
    length: usize,
    overflow: bool,
}

impl Default for FrameDecoder {
    fn default() -> Self {
        Self::new()
    }
}

impl FrameDecoder {
    /// Empty, between frames.
    pub const fn new() -> Self {
        FrameDecoder {
            buffer: [0; FRAME_BYTES_MAX],
            length: 0,
            overflow: false,
        }
    }

    /// Adds one byte of the line. `Some` at the zero byte that ends a frame: the frame, or why
    /// these bytes are not one. Repeated zero bytes are an idle line and yield nothing.
    pub fn push(&mut self, byte: u8) -> Option<Result<Frame<'_>, FrameError>> {
        if byte != 0 {
            match self.buffer.get_mut(self.length) {
                Some(slot) => {
                    *slot = byte;
                    self.length += 1;
                }
                None => self.overflow = true,
            }
            return None;
        }
        let length = core::mem::take(&mut self.length);
        if core::mem::take(&mut self.overflow) {
            return Some(Err(FrameError::TooLong));
        }
        if length == 0 {
            return None;
        }
        Some(self.finish(length))
    }

    fn finish(&mut self, length: usize) -> Result<Frame<'_>, FrameError> {
        let raw = self.buffer.get_mut(..length).ok_or(FrameError::TooLong)?;
        let content_bytes = decode_in_place(raw).ok_or(FrameError::Cobs)?;
        let content = raw.get(..content_bytes).ok_or(FrameError::Cobs)?;
        let (body, checksum) = content
            .split_last_chunk::<4>()
            .ok_or(FrameError::TooShort)?;
        if CRC_TABLE.checksum(body) != u32::from_le_bytes(*checksum) {
            return Err(FrameError::Crc);
        }
        let (sequence, payload) = body.split_first_chunk::<2>().ok_or(FrameError::TooShort)?;
        Ok(Frame {
            sequence: u16::from_le_bytes(*sequence),
            payload,
        })
    }
}

/// The full sequence number nearest to `expected` whose low 16 bits are `wire`.
pub fn full_sequence(expected: u32, wire: u16) -> u32 {
    let difference = wire.wrapping_sub(expected as u16) as i16;
    expected.wrapping_add_signed(i32::from(difference))
}

/// CRC-32 of a value's postcard bytes, without a buffer (machine hash, job identity).
pub fn hash_of<T: Serialize>(value: &T) -> u32 {
    struct Digest<'a>(crc::Digest<'a, u32>);
    impl postcard::ser_flavors::Flavor for Digest<'_> {
        type Output = u32;
        fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
            self.0.update(&[byte]);
            Ok(())
        }
        fn try_extend(&mut self, bytes: &[u8]) -> postcard::Result<()> {
            self.0.update(bytes);
            Ok(())
        }
        fn finalize(self) -> postcard::Result<u32> {
            Ok(self.0.finalize())
        }
    }
    // The flavour never fails; only a type that refuses to serialise could, and ours do not.
    postcard::serialize_with_flavor(value, Digest(CRC_TABLE.digest())).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{Control, DeviceMessage, HostMessage};

    #[test]
    fn a_frame_survives_the_line_whatever_came_before_it() {
        // Goal: resynchronisation at the next zero byte. Method: garbage, then a frame.
        let message = HostMessage::Control(Control::Override(150));
        let mut out = [0u8; FRAME_BYTES_MAX];
        let length = encode_frame(0xbeef, &message, &mut out).unwrap();
        let mut decoder = FrameDecoder::new();
        for byte in (0..2000u32).map(|i| (i % 255 + 1) as u8) {
            assert!(decoder.push(byte).is_none());
        }
        assert_eq!(decoder.push(0), Some(Err(FrameError::TooLong)));
        let mut seen = 0;
        for &byte in &out[..length] {
            if let Some(frame) = decoder.push(byte) {
                let frame = frame.unwrap();
                assert_eq!(frame.sequence, 0xbeef);
                assert_eq!(HostMessage::decode(frame.payload), Ok(message));
                seen += 1;
            }
        }
        assert_eq!(seen, 1);
    }

    #[test]
    fn any_single_bit_flip_is_noticed() {
        let message = HostMessage::Control(Control::Pause);
        let mut out = [0u8; FRAME_BYTES_MAX];
        let length = encode_frame(7, &message, &mut out).unwrap();
        for bit in 0..length * 8 {
            let mut line = out;
            line[bit / 8] ^= 1 << (bit % 8);
            let mut decoder = FrameDecoder::new();
            for &byte in &line[..length] {
                if let Some(Ok(frame)) = decoder.push(byte) {
                    panic!("bit {bit} flipped, yet {frame:?} was taken");
                }
            }
        }
    }

    #[test]
    fn the_longest_message_fits_and_a_longer_one_does_not() {
        let mut out = [0u8; FRAME_BYTES_MAX];
        for filler in [0u8, 1, 255] {
            let payload = [filler; MESSAGE_BYTES_MAX];
            let length = encode_payload(0xffff, &payload, &mut out).unwrap();
            let mut decoder = FrameDecoder::new();
            let mut seen = 0;
            for &byte in &out[..length] {
                if let Some(frame) = decoder.push(byte) {
                    assert_eq!(frame.unwrap().payload, payload);
                    seen += 1;
                }
            }
            assert_eq!(seen, 1);
        }
        let payload = [1; MESSAGE_BYTES_MAX + 1];
        assert_eq!(
            encode_payload(0, &payload, &mut out),
            Err(FrameError::MessageTooLong)
        );
    }

    #[test]
    fn sequence_numbers_widen_across_the_wrap() {
        assert_eq!(full_sequence(0x1_0002, 0xffff), 0xffff);
        assert_eq!(full_sequence(0x1_fffe, 1), 0x2_0001);
        assert_eq!(full_sequence(5, 5), 5);
        assert_eq!(full_sequence(0, 0xffff), u32::MAX);
    }

    #[test]
    fn the_hash_is_the_crc_of_the_postcard_bytes() {
        let message = HostMessage::Control(Control::Override(150));
        let mut buffer = [0u8; 16];
        let bytes = postcard::to_slice(&message, &mut buffer).unwrap();
        assert_eq!(hash_of(&message), CRC.checksum(bytes));
    }

    #[test]
    fn trailing_bytes_and_fields_out_of_range_are_refused() {
        use crate::message::MessageError;
        assert_eq!(
            HostMessage::decode(&[5, 0, 0]),
            Err(MessageError::TrailingBytes)
        );
        assert_eq!(
            HostMessage::decode(&[5, 2, 0]),
            Err(MessageError::FieldRange)
        );
        assert_eq!(HostMessage::decode(&[99]), Err(MessageError::Malformed));
        assert_eq!(DeviceMessage::decode(&[]), Err(MessageError::Malformed));
    }
}
