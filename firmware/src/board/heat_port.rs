//! The main loop's interface to the heaters; the servo interrupt drives the levels.
//!
//! `embedded-hal` 1.0 has no trait for converters; this one never waits.

/// A converter of the heaters' sensors, and the supply.
pub trait HeatPort {
    /// A conversion that is there: heater, and 0 to 4095; begins the next one.
    fn poll(&mut self) -> Option<(usize, u16)>;
    /// The supply of heaters and motors, where the board can switch it.
    fn supply(&mut self, on: bool);
}

/// Of a board without heaters.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoHeat;

impl HeatPort for NoHeat {
    fn poll(&mut self) -> Option<(usize, u16)> {
        None
    }

    fn supply(&mut self, _on: bool) {}
}
