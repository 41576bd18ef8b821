//! Loads and stores of one register in Thumb code: what QEMU's debugger stops before.
//!
//! Source: ARM DDI 0403 (ARMv7-M), A5.2.4, A5.3.7, A5.3.10 and A7.7. Left out: several registers, signed loads of parts
//! of a word, exclusive access: no access to a peripheral is one.

/// A load or store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ThumbAccess {
    /// Loads otherwise.
    pub is_store: bool,
    /// Register that is loaded or stored.
    pub target: u8,
    /// Bytes of the access: 1, 2 or 4.
    pub bytes: u32,
    pub base: u8,
    pub offset: Offset,
    /// What is added to the base afterwards.
    pub advance: i32,
    /// Bytes of the instruction.
    pub length: u32,
}

/// From the base.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offset {
    Bytes(i32),
    /// A register, shifted to the left.
    Register(u8, u32),
}

impl ThumbAccess {
    /// The instruction of two half words, where it is one of these.
    pub fn decode(first: u16, second: u16) -> Option<Self> {
        if first >> 11 >= 0b11101 {
            return wide(first, second);
        }
        let field = |shift: u32, width: u32| first >> shift & ((1 << width) - 1);
        let (target, base) = (field(0, 3) as u8, field(3, 3) as u8);
        let narrow = |is_store, bytes, offset| Self {
            is_store,
            target,
            bytes,
            base,
            offset,
            advance: 0,
            length: 2,
        };
        let scaled = |bytes: u32| Offset::Bytes(i32::from(field(6, 5)) * bytes as i32);
        let by_register = Offset::Register(field(6, 3) as u8, 0);
        match first >> 11 {
            0b01100 => Some(narrow(true, 4, scaled(4))),
            0b01101 => Some(narrow(false, 4, scaled(4))),
            0b01110 => Some(narrow(true, 1, scaled(1))),
            0b01111 => Some(narrow(false, 1, scaled(1))),
            0b10000 => Some(narrow(true, 2, scaled(2))),
            0b10001 => Some(narrow(false, 2, scaled(2))),
            0b01010 | 0b01011 => match first >> 9 & 7 {
                0b000 => Some(narrow(true, 4, by_register)),
                0b001 => Some(narrow(true, 2, by_register)),
                0b010 => Some(narrow(true, 1, by_register)),
                0b100 => Some(narrow(false, 4, by_register)),
                0b101 => Some(narrow(false, 2, by_register)),
                0b110 => Some(narrow(false, 1, by_register)),
                _ => None,
            },
            _ => None,
        }
    }

    /// The address that it accesses.
    pub fn address(&self, mut register: impl FnMut(u8) -> u32) -> u32 {
        let base = register(self.base);
        match self.offset {
            Offset::Bytes(bytes) => base.wrapping_add_signed(bytes),
            Offset::Register(number, shift) => base.wrapping_add(register(number) << shift),
        }
    }
}

/// `LDR.W`, `STR.W` and theirs of a byte and a half word.
fn wide(first: u16, second: u16) -> Option<ThumbAccess> {
    if first >> 9 != 0b111_1100 || first >> 8 & 1 != 0 {
        return None;
    }
    let bytes = match first >> 5 & 3 {
        0 => 1,
        1 => 2,
        2 => 4,
        _ => return None,
    };
    let (mut offset, mut advance) = (Offset::Bytes(i32::from(second & 0xfff)), 0);
    if first >> 7 & 1 == 0 {
        if second >> 11 & 1 == 1 {
            let size = i32::from(second & 0xff);
            let way = if second >> 9 & 1 == 1 { size } else { -size };
            let [is_before, goes_on] = [10, 8].map(|bit| second >> bit & 1 == 1);
            offset = Offset::Bytes(if is_before { way } else { 0 });
            advance = if goes_on { way } else { 0 };
        } else if second >> 6 & 0x1f == 0 {
            offset = Offset::Register((second & 0xf) as u8, u32::from(second >> 4 & 3));
        } else {
            return None;
        }
    }
    Some(ThumbAccess {
        is_store: first >> 4 & 1 == 0,
        target: (second >> 12) as u8,
        bytes,
        base: (first & 0xf) as u8,
        offset,
        advance,
        length: 4,
    })
}

#[cfg(test)]
mod tests {
    //! Goal: accesses are read as an assembler writes them. Method: instructions by hand, from the encodings' tables.
    use super::*;

    #[test]
    fn loads_and_stores_are_read_as_they_are_written() {
        let registers = |number: u8| 0x1000 * u32::from(number);
        for (code, is_store, target, bytes, address, length, advance) in [
            // ldr r3, [r2, #4]; str r1, [r0]; ldrb r5, [r4, #3]; strh r6, [r7, #2]
            ([0x6853, 0], false, 3, 4, 0x2004, 2, 0),
            ([0x6001, 0], true, 1, 4, 0, 2, 0),
            ([0x78e5, 0], false, 5, 1, 0x4003, 2, 0),
            ([0x807e, 0], true, 6, 2, 0x7002, 2, 0),
            // ldr r0, [r1, r2]; ldr.w r9, [r8, #0xffc]; str.w r10, [r3, #-8]
            ([0x5888, 0], false, 0, 4, 0x3000, 2, 0),
            ([0xf8d8, 0x9ffc], false, 9, 4, 0x8ffc, 4, 0),
            ([0xf843, 0xac08], true, 10, 4, 0x2ff8, 4, 0),
            // ldr.w r0, [r1, r2, lsl #2]; str r4, [r5], #4; strb.w r1, [r2, #20]
            ([0xf851, 0x0022], false, 0, 4, 0x9000, 4, 0),
            ([0xf845, 0x4b04], true, 4, 4, 0x5000, 4, 4),
            ([0xf882, 0x1014], true, 1, 1, 0x2014, 4, 0),
        ] {
            let found = ThumbAccess::decode(code[0], code[1]).expect("an access");
            let what = (
                found.is_store,
                found.target,
                found.bytes,
                found.length,
                found.advance,
            );
            assert_eq!(
                what,
                (is_store, target, bytes, length, advance),
                "{code:x?}"
            );
            assert_eq!(found.address(registers), address, "{code:x?}");
        }
        // movs r0, #1; dsb; b.n; bl; push; vldr
        for code in [
            [0x2001, 0],
            [0xf3bf, 0x8f4f],
            [0xe7fe, 0],
            [0xf000, 0xf800],
            [0xb510, 0],
            [0xed90, 0x0a00],
        ] {
            assert_eq!(ThumbAccess::decode(code[0], code[1]), None, "{code:x?}");
        }
    }
}
