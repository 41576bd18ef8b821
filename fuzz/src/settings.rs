//! Records of settings: arbitrary bytes, bytes with a right checksum, and good records with some bytes changed.
//!
//! What is taken passes its check, is written again and read as the same, and runs: a machine of it homes, stops, and
//! steps no faster than its checks say.

use crate::machines::all;
use arbitrary::Arbitrary;
use headway_firmware::board::octopus;
use headway_firmware::configuration::board_name::BoardName;
use headway_firmware::configuration::drivers::DriversConfiguration;
use headway_firmware::configuration::wiring::Wiring;
use headway_firmware::line::Conversation;
use headway_firmware::machine::Machine;
use headway_firmware::settings::{BoardLimits, BoardSettings};
use headway_firmware::steps::output::NoOutput;
use headway_protocol::frame::{FRAME_BYTES_MAX, checksum, encode_frame};
use headway_protocol::message::{Control, HostMessage, JointOrder};

/// Servo ticks of a machine that homes.
const TICKS: u32 = 200;

/// A change of a record.
#[derive(Arbitrary, Debug)]
pub struct Change {
    at: u16,
    value: u8,
    /// Another byte comes in between.
    inserts: bool,
}

/// A record, before its checksum.
#[derive(Arbitrary, Debug)]
pub enum Input {
    /// Bytes as they are.
    Raw(Vec<u8>),
    /// Bytes, with a right checksum.
    Body(Vec<u8>),
    /// A machine's, with changes.
    Changed {
        machine: u8,
        changes: Vec<Change>,
        cut: u8,
    },
}

impl Input {
    fn record(&self) -> Vec<u8> {
        let mut body = match self {
            Input::Raw(bytes) => return bytes.clone(),
            Input::Body(bytes) => bytes.clone(),
            Input::Changed { machine, .. } => good(*machine),
        };
        if let Input::Changed { changes, cut, .. } = self {
            // Its checksum, and a little more.
            body.truncate(body.len() - 4 - usize::from(*cut & 3));
            for change in changes {
                let at = usize::from(change.at) % body.len().max(1);
                match body.get_mut(at) {
                    Some(_) if change.inserts => body.insert(at, change.value),
                    Some(byte) => *byte = change.value,
                    None => {}
                }
            }
        }
        let crc = checksum(&[&body]);
        body.extend_from_slice(&crc.to_le_bytes());
        body
    }
}

fn good(number: u8) -> Vec<u8> {
    let subject = &all()[usize::from(number) % all().len()];
    let settings = BoardSettings {
        machine: subject.configuration.clone(),
        switches: subject.switches.clone(),
        heaters: Some(subject.heat.clone()),
        drivers: DriversConfiguration::none(),
        wiring: Wiring::STANDARD,
        board: None,
    };
    let record = settings.encode().expect("settings of an example");
    record.to_vec()
}

/// Reads it.
pub fn run(input: &Input) {
    let Ok(settings) = BoardSettings::decode(&input.record()) else {
        return;
    };
    assert_eq!(settings.check(), Ok(()));
    let again = settings.encode().expect("what was read is written");
    assert_eq!(BoardSettings::decode(&again).as_ref(), Ok(&settings));
    let _ = settings.check_for(&BoardLimits {
        motors_max: 8,
        servo_hz: settings.machine.servo_hz,
        step_hz: settings.machine.step_hz,
        inputs: octopus::BOARD.board_inputs(),
        names: &[BoardName::Octopus10],
    });
    home(&settings);
}

fn home(settings: &BoardSettings) {
    let machine = Machine::with_switches(&settings.machine, &settings.switches, 1);
    let mut machine = machine.expect("what was checked runs");
    let heaters = settings.heaters.clone().unwrap_or_default();
    let mut service = machine.add_heaters(&settings.machine, &heaters);
    let mut line = Conversation::new(&settings.machine, 1);
    let (hello, start) = crate::machines::opening(&settings.machine, 1, &[0; 7], 0);
    let messages = [
        hello,
        HostMessage::Control(Control::Home(JointOrder::ALL)),
        HostMessage::Control(Control::Abort),
        start,
    ];
    for (sequence, message) in (1..).zip(&messages) {
        let mut out = [0u8; FRAME_BYTES_MAX];
        if let Ok(length) = encode_frame(sequence, message, &mut out) {
            machine.handle_line(&mut line, &out[..length]);
        }
        for _ in 0..TICKS {
            machine.run_servo_interval(&mut NoOutput);
            machine.serve_heat(&mut service, 0);
            machine.poll_line(&mut line, &mut out);
        }
    }
}
