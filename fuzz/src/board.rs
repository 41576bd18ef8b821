//! The controller with two lines, whatever comes over them.
//!
//! Besides what `target` holds:
//! 1. No step before a stream or a move was taken, and none in a tick that begins at rest with no
//!    stream open and nothing heard.
//! 2. Over any 20 ms no motor makes more steps than its speed limit and the stated margin allow.

use crate::attack::{Action, Attack, Kind};
use crate::target::Target;
use arbitrary::Arbitrary;

/// One thing that comes over a line, or time that passes.
#[derive(Arbitrary, Debug)]
pub enum Move {
    /// On the first line.
    First(Action),
    /// A payload in a whole frame on the second one.
    Second { sequence: u16, payload: Vec<u8> },
    /// A greeting there, then a command by its number.
    Stop { greets: bool, command: u8 },
    /// A line's bytes as they are.
    Noise { second: bool, bytes: Vec<u8> },
    /// Servo ticks.
    Ticks(u8),
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
    target.begin(&Attack {
        kind: siege.kind,
        opened: siege.opened,
        actions: Vec::new(),
    });
    for next in siege.moves.iter().take(MOVES_MAX) {
        match next {
            Move::First(action) => target.act(action),
            Move::Second { sequence, payload } => target.second_payload(*sequence, payload),
            Move::Stop { greets, command } => target.second_command(*greets, *command),
            Move::Noise { second, bytes } => target.noise(*second, bytes),
            Move::Ticks(ticks) => target.pass(u32::from(*ticks) * 8),
        }
    }
    target.pass(500);
    target.listen();
}
