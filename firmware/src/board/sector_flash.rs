//! Flash sectors of an STM32F4 as `embedded-storage`, for the settings: unlock, erase, program, lock again.
//!
//! ```text
//! erase:   no BSY -> clear errors -> two keys -> SER | SNB | PSIZE -> STRT -> no BSY -> errors? -> lock
//! program: the same with PG, a word of 32 bits at a time -> caches of data emptied
//! ```
//! Two sectors of any size count as two erasable blocks of [`BLOCK_BYTES`], their first bytes. Source: ST RM0390
//! section 3 (STM32F446) and RM0090 section 3 (STM32F405), whose registers agree in this. In and out: bytes. **The
//! core stalls while a sector is erased** (up to 2 s for 128 KiB; every fetch from flash waits), so the caller has
//! to make sure that nothing moves or heats, and that the watchdog waits. Not covered: option bytes, mass erase,
//! words of other sizes than 32 bits (they need 2.7 V, which boards have).

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// Registers by their offset from the controller's first.
pub const ACCESS: usize = 0x00;
/// Takes the keys.
pub const KEY: usize = 0x04;
/// State and errors; a one written clears an error.
pub const STATE: usize = 0x0c;
/// What to do.
pub const CONTROL: usize = 0x10;

/// In this order they unlock [`CONTROL`]; anything else locks it until the next reset.
pub const KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];
/// Of [`STATE`].
pub const BUSY: u32 = 1 << 16;
/// End of operation, and all errors: operation, write protection, alignment, parallelism, sequence, read
/// protection.
pub const FLAGS: u32 = 0x1f3;
const ERRORS: u32 = FLAGS & !1;
/// Of [`CONTROL`].
pub const PROGRAM: u32 = 1;
/// A sector.
pub const ERASE: u32 = 1 << 1;
/// Where the number of the sector begins.
pub const SECTOR_SHIFT: u32 = 3;
/// 32 bits at a time.
pub const WORDS: u32 = 2 << 8;
/// Begins to erase.
pub const START: u32 = 1 << 16;
/// Nothing can be changed.
pub const LOCK: u32 = 1 << 31;
/// Of [`ACCESS`]: the data cache, and its reset, which works only while it is off.
pub const DATA_CACHE: u32 = 1 << 10;
/// As above.
pub const EMPTY_DATA_CACHE: u32 = 1 << 12;

/// Bytes of a sector that are used: the smallest sector.
pub const BLOCK_BYTES: usize = 16 * 1024;
const WORD_BYTES: usize = 4;
/// Polls of BSY before giving up: far more than 2 s of them, if the core does not stall.
pub const LOOKS_MAX: u32 = 1 << 27;

/// A sector: its number and its first address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sector {
    /// As the controller counts them.
    pub number: u32,
    /// First address.
    pub address: u32,
}

/// Access to the controller's registers and to flash, provided by a board.
pub trait FlashBus {
    /// Reads a register.
    fn register(&mut self, register: usize) -> u32;
    /// Writes a register.
    fn set_register(&mut self, register: usize, value: u32);
    /// Reads a word of flash.
    fn word(&mut self, address: u32) -> u32;
    /// Writes a word to flash.
    fn set_word(&mut self, address: u32, value: u32);
}

/// Why flash was not changed as requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashError {
    /// Outside of the two blocks, or not on words or blocks.
    Range,
    /// It stays locked.
    Locked,
    /// It stays busy.
    Busy,
    /// Error flags of [`STATE`].
    Refused(u32),
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Range => NorFlashErrorKind::OutOfBounds,
            _ => NorFlashErrorKind::Other,
        }
    }
}

/// Two sectors.
#[derive(Debug)]
pub struct SectorFlash<B> {
    bus: B,
    sectors: [Sector; 2],
    looks_max: u32,
}

impl<B: FlashBus> SectorFlash<B> {
    /// Of these sectors, which nothing else uses.
    pub const fn new(bus: B, sectors: [Sector; 2], looks_max: u32) -> Self {
        Self {
            bus,
            sectors,
            looks_max,
        }
    }

    /// The access, when the flash is done with.
    #[cfg(test)]
    pub fn into_bus(self) -> B {
        self.bus
    }

    /// Address of an offset whose word must be in a block.
    fn address(&self, offset: u32) -> Result<u32, FlashError> {
        let block = offset as usize / BLOCK_BYTES;
        let sector = self.sectors.get(block).ok_or(FlashError::Range)?;
        Ok(sector.address + offset % BLOCK_BYTES as u32)
    }

    fn wait(&mut self) -> Result<(), FlashError> {
        for _ in 0..self.looks_max {
            if self.bus.register(STATE) & BUSY == 0 {
                return Ok(());
            }
        }
        Err(FlashError::Busy)
    }

    /// Work while the flash is unlocked; it is locked again whatever the result.
    fn unlocked(
        &mut self,
        work: impl FnOnce(&mut Self) -> Result<(), FlashError>,
    ) -> Result<(), FlashError> {
        self.wait()?;
        // Earlier errors would refuse the next operation.
        self.bus.set_register(STATE, FLAGS);
        if self.bus.register(CONTROL) & LOCK != 0 {
            for key in KEYS {
                self.bus.set_register(KEY, key);
            }
        }
        if self.bus.register(CONTROL) & LOCK != 0 {
            return Err(FlashError::Locked);
        }
        let done = work(self);
        if done == Err(FlashError::Busy) {
            // The flash accepts no further command.
            return done;
        }
        self.bus.set_register(CONTROL, LOCK);
        // What the cache holds may be of before.
        let access = self.bus.register(ACCESS);
        self.bus.set_register(ACCESS, access & !DATA_CACHE);
        let emptying = access & !DATA_CACHE | EMPTY_DATA_CACHE;
        self.bus.set_register(ACCESS, emptying);
        self.bus.set_register(ACCESS, access);
        done
    }

    /// Waits for the end of the operation.
    fn finish(&mut self) -> Result<(), FlashError> {
        self.wait()?;
        match self.bus.register(STATE) & ERRORS {
            0 => Ok(()),
            errors => Err(FlashError::Refused(errors)),
        }
    }
}

impl<B> ErrorType for SectorFlash<B> {
    type Error = FlashError;
}

impl<B: FlashBus> ReadNorFlash for SectorFlash<B> {
    const READ_SIZE: usize = WORD_BYTES;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        check(offset, bytes.len(), WORD_BYTES)?;
        let words = bytes.chunks_exact_mut(WORD_BYTES);
        for (at, word) in (offset..).step_by(WORD_BYTES).zip(words) {
            let value = self.bus.word(self.address(at)?);
            word.copy_from_slice(&value.to_le_bytes());
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        2 * BLOCK_BYTES
    }
}

impl<B: FlashBus> NorFlash for SectorFlash<B> {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = BLOCK_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let bytes = to.checked_sub(from).ok_or(FlashError::Range)?;
        check(from, bytes as usize, BLOCK_BYTES)?;
        let blocks = from as usize / BLOCK_BYTES..to as usize / BLOCK_BYTES;
        for block in blocks {
            let sector = self.sectors.get(block).ok_or(FlashError::Range)?.number;
            self.unlocked(|flash| {
                let control = ERASE | sector << SECTOR_SHIFT | WORDS;
                flash.bus.set_register(CONTROL, control);
                flash.bus.set_register(CONTROL, control | START);
                flash.finish()
            })?;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check(offset, bytes.len(), WORD_BYTES)?;
        self.unlocked(|flash| {
            flash.bus.set_register(CONTROL, PROGRAM | WORDS);
            let (words, _) = bytes.as_chunks::<WORD_BYTES>();
            for (at, word) in (offset..).step_by(WORD_BYTES).zip(words) {
                let address = flash.address(at)?;
                flash.bus.set_word(address, u32::from_le_bytes(*word));
                flash.finish()?;
            }
            Ok(())
        })
    }
}

/// Within both blocks, and on multiples of `unit`.
fn check(offset: u32, bytes: usize, unit: usize) -> Result<(), FlashError> {
    let offset = offset as usize;
    let end = offset.checked_add(bytes).ok_or(FlashError::Range)?;
    let on_units = [offset, bytes].map(|number| number.checked_rem(unit) == Some(0));
    if end <= 2 * BLOCK_BYTES && on_units == [true; 2] {
        Ok(())
    } else {
        Err(FlashError::Range)
    }
}

#[cfg(test)]
#[path = "sector_flash_tests.rs"]
mod tests;
