//! Bytes of a datagram and their checksum.
//!
//! ```text
//! write: 05 | address | register + 80 | data, highest byte first (4) | CRC
//! read:  05 | address | register | CRC           reply: 05 | FF | register | data (4) | CRC
//! ```
//! CRC-8 of polynomial x⁸ + x² + x + 1 over the bits in the order in which they are sent, lowest of each byte
//! first, begun at 0 (data sheet, chapter 4.2).

const SYNC: u8 = 0x05;
/// Who is spoken to in a reply.
const MASTER: u8 = 0xff;
const WRITES: u8 = 0x80;
/// Of a write, and of a reply.
pub const WRITE_BYTES: usize = 8;
/// Of a read.
pub const READ_BYTES: usize = 4;

/// Checksum of these bytes.
pub fn crc8(bytes: &[u8]) -> u8 {
    let mut crc = 0u8;
    for &byte in bytes {
        let mut bits = byte;
        for _ in 0..8 {
            let flips = (crc >> 7) ^ (bits & 1) == 1;
            crc <<= 1;
            if flips {
                crc ^= 0x07;
            }
            bits >>= 1;
        }
    }
    crc
}

/// Asks for a register.
pub fn read(address: u8, register: u8) -> [u8; READ_BYTES] {
    let asked = [SYNC, address, register & !WRITES];
    let [sync, address, register] = asked;
    [sync, address, register, crc8(&asked)]
}

/// Writes one.
pub fn write(address: u8, register: u8, value: u32) -> [u8; WRITE_BYTES] {
    let [a, b, c, d] = value.to_be_bytes();
    let register = register | WRITES;
    let crc = crc8(&[SYNC, address, register, a, b, c, d]);
    [SYNC, address, register, a, b, c, d, crc]
}

/// The value of this register in a reply; `None` if any bit of it is wrong.
pub fn reply(bytes: &[u8; WRITE_BYTES], register: u8) -> Option<u32> {
    let [sync, to, of, a, b, c, d, crc] = *bytes;
    let is_right =
        sync == SYNC && to == MASTER && of == register && crc == crc8(&[sync, to, of, a, b, c, d]);
    is_right.then_some(u32::from_be_bytes([a, b, c, d]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datagrams_are_those_of_other_programs_and_no_flipped_bit_passes() {
        // As widely used libraries send them: requests for GCONF and IFCNT of node 0.
        assert_eq!(read(0, 0x00), [0x05, 0x00, 0x00, 0x48]);
        assert_eq!(read(0, 0x02), [0x05, 0x00, 0x02, 0x8f]);
        let mut right = [0x05, 0xff, 0x06, 0x21, 0x00, 0x01, 0x80, 0];
        right[7] = crc8(&right[..7]);
        assert_eq!(reply(&right, 0x06), Some(0x2100_0180));
        assert_eq!(reply(&right, 0x07), None);
        for bit in 0..64 {
            let mut wrong = right;
            wrong[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(reply(&wrong, 0x06), None, "bit {bit}");
        }
    }
}
