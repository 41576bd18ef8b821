//! Reports of a receiver -> bytes that are sent on a line in parts.
//!
//! In: a receiver, and read access to the motion. Out: bytes of one report after another.

use super::Receiver;
use headway_protocol::frame::FRAME_BYTES_MAX;
use headway_protocol::message::DeviceMessage;

/// A report on its way out. A host that does not listen holds it up, never the rest.
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

    /// What is to be sent now; gets the next report, which `report` takes of the receiver, when the last one is out.
    #[inline(always)]
    pub fn pending(
        &mut self,
        receiver: &mut Receiver,
        report: impl FnOnce(&mut Receiver) -> Option<DeviceMessage>,
    ) -> &[u8] {
        if self.sent >= self.length {
            self.sent = 0;
            let report = report(receiver);
            let length = report.map_or(0, |report| receiver.write_report(&report, &mut self.frame));
            self.length = length.min(FRAME_BYTES_MAX);
        }
        self.frame.get(self.sent..self.length).unwrap_or_default()
    }

    /// So many bytes of it are out.
    pub fn sent(&mut self, bytes: usize) {
        self.sent += bytes;
    }
}
