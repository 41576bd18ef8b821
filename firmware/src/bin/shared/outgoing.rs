//! Reports of the receiver -> bytes for a line, in the main loop.

use super::{note_pass, with_motion};
use headway_firmware::line::Receiver;
use headway_protocol::frame::FRAME_BYTES_MAX;

/// A report on its way out. A host that does not listen holds it up, never the rest.
pub struct Outgoing {
    frame: [u8; FRAME_BYTES_MAX],
    length: usize,
    sent: usize,
}

impl Outgoing {
    pub const fn new() -> Self {
        Self {
            frame: [0; FRAME_BYTES_MAX],
            length: 0,
            sent: 0,
        }
    }

    /// What is to be sent now; gets the next report when the last one is out. One call per round of
    /// the main loop: it also tells the servo that the loop lives.
    #[inline(never)]
    pub fn pending(&mut self, receiver: &mut Receiver) -> &[u8] {
        note_pass();
        if self.sent >= self.length {
            self.sent = 0;
            let report = with_motion(|motion| receiver.take_report(motion)).flatten();
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
