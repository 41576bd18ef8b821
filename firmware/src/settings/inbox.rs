//! Incoming settings: parts from the line, in order -> a checked record that waits to be stored.
//!
//! In: the messages `SettingsBegin`, `SettingsPart`, `SettingsEnd`. Out: the record, for a board with flash.
//! Not covered: whether the board may accept settings now, which the receiver checks with the motion.

use super::{BoardLimits, BoardSettings, Record, SettingsProblem, SettingsRefusal, refusal};
use headway_protocol::message::SETTINGS_PART_BYTES;

/// The received part of a record.
#[derive(Clone, Debug, Default)]
pub struct SettingsInbox {
    /// Of a board that has a store.
    keeps: Option<BoardLimits>,
    length: usize,
    record: Record,
    is_checked: bool,
}

impl SettingsInbox {
    /// The board has a store.
    pub fn keep(&mut self, board: BoardLimits) {
        self.keeps = Some(board);
    }

    /// Begins a new record; an incomplete one is dropped.
    ///
    /// # Errors
    /// `NoStore`.
    pub fn begin(&mut self, length: u16) -> Result<(), SettingsRefusal> {
        if self.keeps.is_none() {
            return Err(refusal(SettingsProblem::NoStore, 0));
        }
        self.length = length.into();
        self.record.clear();
        self.is_checked = false;
        Ok(())
    }

    /// The next part.
    ///
    /// # Errors
    /// `Incomplete` if it is not the next one.
    pub fn part(
        &mut self,
        offset: u16,
        bytes: &[u8; SETTINGS_PART_BYTES],
    ) -> Result<(), SettingsRefusal> {
        let missing = self.length.saturating_sub(self.record.len());
        let wanted = missing.min(SETTINGS_PART_BYTES);
        let is_next = usize::from(offset) == self.record.len() && wanted > 0 && !self.is_checked;
        let part = bytes.get(..wanted).filter(|_| is_next);
        part.and_then(|part| self.record.extend_from_slice(part).ok())
            .ok_or(refusal(SettingsProblem::Incomplete, 0))
    }

    /// The record is complete: checks it.
    ///
    /// # Errors
    /// The error of the record.
    pub fn end(&mut self) -> Result<(), SettingsRefusal> {
        if self.length == 0 || self.record.len() != self.length {
            return Err(refusal(SettingsProblem::Incomplete, 0));
        }
        let settings = BoardSettings::decode(&self.record)?;
        if let Some(board) = &self.keeps {
            settings.check_for(board)?;
        }
        self.is_checked = true;
        Ok(())
    }

    /// The record to be stored now, once.
    pub fn take(&mut self) -> Option<&[u8]> {
        if !self.is_checked {
            return None;
        }
        self.is_checked = false;
        self.length = 0;
        Some(&self.record)
    }
}
