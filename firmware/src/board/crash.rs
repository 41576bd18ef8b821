//! The record of a crash, in memory that a reset does not change.
//!
//! In: what a handler of the last resort knows. Out: bytes for the memory, and at the next start the crash again, if the
//! bytes are one: a magic number and a CRC keep the random contents after power-on apart.

use headway_protocol::frame::checksum;
use headway_protocol::message::Crash;

/// Postcard, zeros, and the CRC-32 of a magic number and these, lowest byte first.
pub type KeptCrash = [u8; 28];
const MAGIC: &[u8] = b"Crash";

/// For the memory; zeros if it did not fit.
pub fn kept_crash(crash: &Crash) -> KeptCrash {
    let mut kept = [0; 28];
    if let Some((body, crc)) = kept.split_last_chunk_mut::<4>()
        && postcard::to_slice(crash, body).is_ok()
    {
        *crc = checksum(&[MAGIC, body]).to_le_bytes();
    }
    kept
}

/// As it is found; `None` if the run before did not crash.
pub fn crash_of(kept: &KeptCrash) -> Option<Crash> {
    let (body, crc) = kept.split_last_chunk::<4>()?;
    let is_whole = *crc == checksum(&[MAGIC, body]).to_le_bytes();
    let (crash, _) = is_whole.then(|| postcard::take_from_bytes(body).ok())??;
    Some(crash)
}

#[cfg(test)]
mod tests {
    use super::*;
    use headway_protocol::message::CrashCause;

    #[test]
    fn a_record_comes_back_and_no_other_memory_is_one() {
        for cause in [
            CrashCause::HardFault(0x0100_0000),
            CrashCause::Panic(77),
            CrashCause::Interrupt(81),
        ] {
            let crash = Crash {
                cause,
                pc: 0x0801_2344,
                lr: 0x0801_2301,
                servo_tick: 5,
            };
            let kept = kept_crash(&crash);
            assert_eq!(crash_of(&kept), Some(crash));
            for bit in 0..8 * kept.len() {
                let mut wrong = kept;
                wrong[bit / 8] ^= 1 << (bit % 8);
                assert_eq!(crash_of(&wrong), None, "bit {bit}");
            }
        }
        for fill in 0..=u8::MAX {
            assert_eq!(crash_of(&[fill; 28]), None);
        }
    }
}
