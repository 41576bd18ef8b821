//! The controller with two lines, heaters and switches, whatever comes over them: the invariants of `target`, and over
//! any 20 ms no motor makes more steps than its speed limit and the stated margin allow.

use crate::attack::{Action, Kind};
use crate::target::Target;
use arbitrary::Arbitrary;
use headway_protocol::message::{Control, HostMessage, SETTINGS_PART_BYTES};

/// One thing that comes over a line, or to the board, or time that passes.
#[derive(Arbitrary, Debug)]
pub enum Move {
    /// On one of the lines.
    On { line: u8, action: Action },
    /// A command that `Action` has not.
    Order { line: u8, order: Order },
    /// A line's bytes as they are.
    Noise { line: u8, bytes: Vec<u8> },
    /// A connection ends.
    HangUp(u8),
    /// Levels of the switches, and of the emergency input.
    Press { switches: u8, emergency: bool },
    /// Servo ticks.
    Ticks(u8),
}

/// Commands about heat, motors and settings.
#[derive(Arbitrary, Debug)]
pub enum Order {
    Heat { heater: u8, tens: u8, wait: bool },
    Fan(u16),
    ExtrudeCold(bool),
    Measure(bool),
    GoTo([i32; 7]),
    MotorsOff,
    SettingsBegin(u16),
    SettingsPart { offset: u16, byte: u8 },
    SettingsEnd,
}

impl Order {
    fn control(&self) -> Control {
        match *self {
            Order::Heat { heater, tens, wait } => Control::Heat {
                heater: heater % 4,
                decidegrees: u16::from(tens % 32) * 100,
                wait,
            },
            Order::Fan(permille) => Control::Fan(permille),
            Order::ExtrudeCold(allowed) => Control::ExtrudeCold(allowed),
            Order::Measure(on) => Control::Measure(on),
            Order::GoTo(place) => Control::GoTo(place),
            Order::MotorsOff => Control::MotorsOff,
            Order::SettingsBegin(length) => Control::SettingsBegin { length },
            Order::SettingsPart { offset, byte } => Control::SettingsPart {
                offset,
                bytes: [byte; SETTINGS_PART_BYTES],
            },
            Order::SettingsEnd => Control::SettingsEnd,
        }
    }
}

/// A whole run.
#[derive(Arbitrary, Debug)]
pub struct Siege {
    pub kind: Kind,
    pub opened: bool,
    pub moves: Vec<Move>,
}

/// Moves of one run that are followed.
const MOVES_MAX: usize = 96;

/// Runs it.
pub fn run(siege: &Siege) {
    let mut target = Target::new(siege.kind);
    target.hold_limits();
    if siege.opened {
        target.begin();
    }
    for next in siege.moves.iter().take(MOVES_MAX) {
        match next {
            Move::On { line, action } => target.act((*line).into(), action),
            Move::Order { line, order } => {
                target.turn_to((*line).into());
                target.send_control(&HostMessage::Control(order.control()));
            }
            Move::Noise { line, bytes } => target.noise((*line).into(), bytes),
            Move::HangUp(line) => target.hang_up((*line).into()),
            Move::Press {
                switches,
                emergency,
            } => target.press(*switches, *emergency),
            Move::Ticks(ticks) => target.pass(u32::from(*ticks) * 8),
        }
    }
    target.end();
}
