//! Reports of a receiver -> bytes that are sent on a line in parts.
//!
//! In: a receiver, and read access to the motion. Out: bytes of one report after another.

use super::Conversation;
use headway_protocol::frame::FRAME_BYTES_MAX;
use headway_protocol::message::DeviceMessage;

/// A report that is being sent. A host that does not listen blocks this report, nothing else.
#[derive(Clone, Debug)]
pub struct Outgoing {
    frame: [u8; FRAME_BYTES_MAX],
    length: usize,
    sent: usize,
}

impl Default for Outgoing {
    fn default() -> Self {
        Self::new()
    }
}

impl Outgoing {
    /// Nothing.
    pub const fn new() -> Self {
        Self {
            frame: [0; FRAME_BYTES_MAX],
            length: 0,
            sent: 0,
        }
    }

    /// The bytes to send now; gets the line's next report by `report` when the last one has been sent.
    #[inline(always)]
    pub fn pending(
        &mut self,
        talk: &mut Conversation,
        report: impl FnOnce(&mut Conversation) -> Option<DeviceMessage>,
    ) -> &[u8] {
        if self.sent >= self.length {
            self.sent = 0;
            let report = report(talk);
            let length = report.map_or(0, |report| talk.write_report(&report, &mut self.frame));
            self.length = length.min(FRAME_BYTES_MAX);
        }
        self.frame.get(self.sent..self.length).unwrap_or_default()
    }

    /// A number of bytes have been sent.
    pub fn sent(&mut self, bytes: usize) {
        self.sent += bytes;
    }
}
