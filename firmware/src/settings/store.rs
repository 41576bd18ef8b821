//! Keeps one record in flash, so that after a power failure at any time the old one or the new one is
//! complete.
//!
//! ```text
//! slot:  head (sequence u32, length u32, CRC-32 of both and the record u32, 0 u32) | record
//! put:   erase the slot that is not in force -> record -> head, the last write -> read it all back
//! take:  of the slots whose CRC is right, that with the newer sequence
//! ```
//! Two slots instead of a log of records (`sequential-storage`): there is one record, it changes seldom, and
//! this code needs neither futures nor a proof of absence of panics. In: bytes, at most
//! [`SETTINGS_BYTES_MAX`], over `embedded-storage`. A partly written head, a partly erased slot and one with
//! aged cells all fail the CRC. Not covered: wear, which is no concern at 10,000 erasures of a sector.

use super::Record;
use embedded_storage::nor_flash::NorFlash;
use headway_protocol::frame::checksum;
use headway_protocol::message::SETTINGS_BYTES_MAX;

/// Bytes before the record; a multiple of the word of every supported flash.
const HEAD_BYTES: usize = 16;
/// Bytes written at once.
const PIECE_BYTES: usize = 16;
/// Bytes that a slot must have at least.
pub const SLOT_BYTES_MIN: usize = HEAD_BYTES + SETTINGS_BYTES_MAX;
const SLOTS: u32 = 2;

/// Why a record was not stored. The previous one stays active.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreError {
    /// The flash is too small, or its words do not divide `PIECE_BYTES`.
    Unsuitable,
    /// The flash reports an error, or reads back otherwise.
    Flash,
}

/// The known state of a slot.
#[derive(Clone, Copy)]
struct Found {
    slot: u32,
    sequence: u32,
}

/// Two slots in a flash, each half of it.
#[derive(Debug)]
pub struct SettingsStore<F> {
    flash: F,
}

impl<F: NorFlash> SettingsStore<F> {
    /// Over a flash that is the store's alone.
    ///
    /// # Errors
    /// [`StoreError::Unsuitable`].
    pub fn new(flash: F) -> Result<Self, StoreError> {
        let slot_bytes = flash.capacity() / SLOTS as usize;
        let divides = |word: usize| word > 0 && PIECE_BYTES.checked_rem(word) == Some(0);
        let fits = divides(F::READ_SIZE)
            && divides(F::WRITE_SIZE)
            && slot_bytes >= SLOT_BYTES_MIN
            && slot_bytes.checked_rem(F::ERASE_SIZE) == Some(0)
            && u32::try_from(flash.capacity()).is_ok();
        if fits {
            Ok(Self { flash })
        } else {
            Err(StoreError::Unsuitable)
        }
    }

    /// The flash, when the store is done with.
    pub fn into_flash(self) -> F {
        self.flash
    }

    fn slot_start(&self, slot: u32) -> u32 {
        (self.flash.capacity() / SLOTS as usize) as u32 * slot
    }

    /// The active record; `None` if there is none.
    pub fn take(&mut self) -> Option<Record> {
        let found = self.newest()?;
        self.read(found.slot).map(|(_, record)| record)
    }

    /// Stores a record in the inactive slot.
    ///
    /// # Errors
    /// [`StoreError::Flash`]; the previous record stays active.
    pub fn put(&mut self, record: &[u8]) -> Result<(), StoreError> {
        if record.is_empty() || record.len() > SETTINGS_BYTES_MAX {
            return Err(StoreError::Unsuitable);
        }
        let newest = self.newest();
        let slot = newest.map_or(0, |found| 1 - found.slot.min(1));
        let sequence = newest.map_or(1, |found| found.sequence.wrapping_add(1));
        let start = self.slot_start(slot);
        let end = self.slot_start(slot + 1);
        self.flash
            .erase(start, end)
            .map_err(|_| StoreError::Flash)?;
        let mut at = start + HEAD_BYTES as u32;
        for piece in record.chunks(PIECE_BYTES) {
            let mut padded = [0xff; PIECE_BYTES];
            for (place, byte) in padded.iter_mut().zip(piece) {
                *place = *byte;
            }
            let written = self.flash.write(at, &padded);
            written.map_err(|_| StoreError::Flash)?;
            at += PIECE_BYTES as u32;
        }
        let head = head_of(sequence, record);
        let written = self.flash.write(start, &head);
        written.map_err(|_| StoreError::Flash)?;
        let kept = self.read(slot);
        let same = kept.is_some_and(|(kept, back)| kept == sequence && back == record);
        if same { Ok(()) } else { Err(StoreError::Flash) }
    }

    /// Stores a record so that the last slot has it: it survives if the first one is overwritten, as by
    /// new firmware stored around it.
    ///
    /// # Errors
    /// As for [`Self::put`]; if only the first slot has it, it is active nevertheless.
    pub fn put_last(&mut self, record: &[u8]) -> Result<(), StoreError> {
        self.put(record)?;
        if self.newest().is_some_and(|found| found.slot == 0) {
            self.put(record)?;
        }
        Ok(())
    }

    /// The active slot.
    fn newest(&mut self) -> Option<Found> {
        let mut newest: Option<Found> = None;
        for slot in 0..SLOTS {
            let Some((sequence, _)) = self.read(slot) else {
                continue;
            };
            let is_newer =
                newest.is_none_or(|known| (sequence.wrapping_sub(known.sequence) as i32) > 0);
            if is_newer {
                newest = Some(Found { slot, sequence });
            }
        }
        newest
    }

    /// Sequence and record of a slot, if they are whole.
    fn read(&mut self, slot: u32) -> Option<(u32, Record)> {
        let start = self.slot_start(slot);
        let mut head = [0u8; HEAD_BYTES];
        self.flash.read(start, &mut head).ok()?;
        let [sequence, length, ..] = words(&head);
        let length = usize::try_from(length).ok()?;
        let mut record = Record::new();
        record.resize(length, 0).ok()?;
        let mut at = start + HEAD_BYTES as u32;
        for piece in record.chunks_mut(PIECE_BYTES) {
            let mut whole = [0u8; PIECE_BYTES];
            self.flash.read(at, &mut whole).ok()?;
            for (place, byte) in piece.iter_mut().zip(whole) {
                *place = byte;
            }
            at += PIECE_BYTES as u32;
        }
        let is_whole = !record.is_empty() && head_of(sequence, &record) == head;
        is_whole.then_some((sequence, record))
    }
}

fn head_of(sequence: u32, record: &[u8]) -> [u8; HEAD_BYTES] {
    let sequence = sequence.to_le_bytes();
    let length = (record.len() as u32).to_le_bytes();
    let crc = checksum(&[&sequence, &length, record]).to_le_bytes();
    let mut head = [0u8; HEAD_BYTES];
    let words = sequence.iter().chain(&length).chain(&crc);
    for (place, byte) in head.iter_mut().zip(words) {
        *place = *byte;
    }
    head
}

fn words(head: &[u8; HEAD_BYTES]) -> [u32; 2] {
    let [a, b, c, d, e, f, g, h, ..] = *head;
    [
        u32::from_le_bytes([a, b, c, d]),
        u32::from_le_bytes([e, f, g, h]),
    ]
}
