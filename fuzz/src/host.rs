//! One host at one line of the controller, as the fuzzer drives it.

use crate::machines::Subject;
use headway_firmware::line::Conversation;
use headway_firmware::machine::Machine;
use headway_protocol::frame::{FRAME_BYTES_MAX, FrameDecoder};
use headway_protocol::knot_block::KnotPredictor;
use headway_protocol::message::{DeviceMessage, Welcome};
use headway_protocol::units::CHANNELS;

/// Reports of one kind each, and the refusals that may wait.
const REPORTS_MAX: usize = 8;
/// Reports that nobody has asked for: a fault, credit, a status.
const QUIET_REPORTS_MAX: usize = 3;

/// What a line has told since it was asked last.
#[derive(Debug, Default)]
pub struct Told {
    /// Sequence numbers of what was refused.
    pub refused: Vec<u16>,
    /// The newest command that was taken.
    pub taken: Option<u16>,
    pub welcome: Option<Welcome>,
}

/// A line and the host at it.
pub struct Host {
    pub talk: Conversation,
    decoder: FrameDecoder,
    pub predictor: KnotPredictor,
    pub position: [i32; CHANNELS],
    pub next_sequence: u32,
    pub control: u16,
    pub knots: u32,
    pub events: u32,
    /// The session that it has greeted with; `None` where bytes of any meaning came after it.
    pub session: Option<u32>,
    /// Something came since the last reports.
    pub heard: bool,
}

impl Host {
    /// Nobody has said anything.
    pub fn new(subject: &Subject, line: u8) -> Self {
        Host {
            talk: Conversation::new(&subject.configuration, line),
            decoder: FrameDecoder::new(),
            predictor: KnotPredictor::new(subject.centre),
            position: subject.centre,
            next_sequence: 0,
            control: 0,
            knots: 0,
            events: 0,
            session: None,
            heard: false,
        }
    }

    /// Bytes on its line.
    pub fn say(&mut self, machine: &mut Machine, bytes: &[u8]) {
        self.heard = true;
        machine.handle_line(&mut self.talk, bytes);
    }

    /// Everything that the controller reports on its line: frames of messages, and they end.
    pub fn listen(&mut self, machine: &Machine) -> Told {
        let mut told = Told::default();
        let mut out = [0u8; FRAME_BYTES_MAX];
        let most = match std::mem::take(&mut self.heard) {
            true => REPORTS_MAX,
            false => QUIET_REPORTS_MAX,
        };
        for _ in 0..=most {
            let length = machine.poll_line(&mut self.talk, &mut out);
            if length == 0 {
                return told;
            }
            for &byte in &out[..length] {
                let Some(frame) = self.decoder.push(byte) else {
                    continue;
                };
                let frame = frame.expect("a whole frame");
                let message = DeviceMessage::decode(frame.payload).expect("a message");
                match message {
                    DeviceMessage::Ack(ack) | DeviceMessage::Nak(ack) => {
                        self.next_sequence = ack.next_sequence;
                        told.taken = Some(ack.control_taken);
                    }
                    DeviceMessage::Refused(refusal) => told.refused.push(refusal.sequence),
                    DeviceMessage::Welcome(welcome) => told.welcome = Some(welcome),
                    DeviceMessage::Status(_)
                    | DeviceMessage::Fault(_)
                    | DeviceMessage::Measured(_)
                    | DeviceMessage::Crash(_) => {}
                }
            }
        }
        panic!("more than {most} reports at once");
    }
}
