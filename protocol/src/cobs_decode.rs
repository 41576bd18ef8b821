//! COBS decoding in place, without panics.
//!
//! The `cobs` crate, which is used for encoding, indexes its buffer where the compiler cannot prove
//! the index: the panics would stay in the controller's binary. Every access here is checked, and
//! one out of bounds is a result. Source: S. Cheshire and M. Baker, Consistent Overhead Byte
//! Stuffing (1999).

/// Longest sequence of bytes without a zero after it.
const FULL_RUN: u8 = 0xff;

/// Decodes the bytes between two zero bytes of the line, in place, and returns how many are left;
/// `None` if a code points outside or a zero is among them.
pub(crate) fn decode_in_place(bytes: &mut [u8]) -> Option<usize> {
    let (mut from, mut to) = (0, 0);
    while let Some(&code) = bytes.get(from) {
        from += 1;
        for _ in 0..code.checked_sub(1)? {
            let byte = *bytes.get(from)?;
            if byte == 0 {
                return None;
            }
            *bytes.get_mut(to)? = byte;
            from += 1;
            to += 1;
        }
        if code != FULL_RUN && from < bytes.len() {
            *bytes.get_mut(to)? = 0;
            to += 1;
        }
    }
    Some(to)
}

#[cfg(test)]
mod tests {
    //! Goal: what the crate encodes comes back, and damaged bytes give an answer, the crate's own
    //! where it has one. Method: random contents of all lengths around the run limit, then flips.
    use super::*;
    use std::vec::Vec;

    struct Random(u32);

    impl Random {
        fn below(&mut self, bound: u32) -> u32 {
            self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (self.0 >> 16) % bound
        }
    }

    #[test]
    fn what_the_crate_encodes_comes_back() {
        let mut random = Random(1);
        for case in 0..20_000u32 {
            let length = case % 600;
            let zeros = 1 + random.below(300);
            let content: Vec<u8> = (0..length)
                .map(|_| {
                    if random.below(zeros) == 0 {
                        0
                    } else {
                        1 + random.below(255) as u8
                    }
                })
                .collect();
            let mut line = std::vec![0; 700];
            let encoded = cobs::try_encode(&content, &mut line).unwrap();
            let decoded = decode_in_place(&mut line[..encoded]).unwrap();
            assert_eq!(&line[..decoded], &content[..], "case {case}");
        }
    }

    #[test]
    fn damaged_bytes_are_answered_as_the_crate_does() {
        let mut random = Random(7);
        let (mut refused, mut taken) = (0, 0);
        for _ in 0..50_000 {
            let length = 1 + random.below(300) as usize;
            let spread = 1 + random.below(255);
            let line: Vec<u8> = (0..length)
                .map(|_| 1 + random.below(spread) as u8)
                .collect();
            let (mut ours, mut theirs) = (line.clone(), line);
            let decoded = decode_in_place(&mut ours);
            match cobs::decode_in_place(&mut theirs) {
                Ok(count) => {
                    assert_eq!(decoded, Some(count));
                    assert_eq!(ours[..count], theirs[..count]);
                    taken += 1;
                }
                Err(_) => {
                    assert_eq!(decoded, None);
                    refused += 1;
                }
            }
        }
        assert!(refused > 1000 && taken > 1000, "{refused} {taken}");
    }
}
