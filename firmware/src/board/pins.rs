//! What a servo tick does at a board's pins. Bit m of a mask is motor m.

use crate::motion::inputs::Inputs;

/// Time from the pull-ups on until the inputs are believed: 100 nF of a filter at 40 kΩ, five times
/// over.
pub const INPUTS_SETTLE_MS: u32 = 20;

/// What the servo tick reads and writes at a board's pins.
pub trait BoardPins {
    /// Levels of the inputs.
    fn inputs(&mut self) -> Inputs;
    /// Lets drivers hold their motors, one bit each, and the others go.
    fn hold(&mut self, motors: u8);
    /// Levels of heaters and fans, a bit each; a board without them has nothing to do.
    #[inline(always)]
    fn put_heat(&mut self, _levels: u8) {}
}

/// A converter of the heaters' sensors, which never waits, and the supply; for the main loop.
pub trait HeatPort {
    /// A conversion that is there: heater, and 0 to 4095; begins the next one.
    fn poll(&mut self) -> Option<(usize, u16)>;
    /// The supply of heaters and motors, where the board can switch it.
    fn supply(&mut self, on: bool);
}
