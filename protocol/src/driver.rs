//! The state of a motor's driver in a status.

use serde::{Deserialize, Serialize};

/// A driver that the board speaks with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DriverStatus {
    /// Bits of [`DriverFlags`].
    pub flags: u16,
    /// Current scale in use, 0 to 31.
    pub scale: u8,
    /// Datagrams that had to be sent again since the start.
    pub retries: u16,
}

/// Bits of [`DriverStatus::flags`].
#[derive(Clone, Copy, Debug)]
pub struct DriverFlags;

impl DriverFlags {
    /// The board speaks with this driver; without it no other bit is set.
    pub const SPOKEN_WITH: u16 = 1;
    /// It is set up.
    pub const SET_UP: u16 = 1 << 1;
    /// Warm: it will switch off when it gets hotter.
    pub const WARM: u16 = 1 << 2;
    /// Switched off for heat.
    pub const HOT: u16 = 1 << 3;
    /// Switched off for a short.
    pub const SHORT: u16 = 1 << 4;
    /// No current flows through a coil. A hint: at rest or fast it may be wrong.
    pub const OPEN_LOAD: u16 = 1 << 5;
    /// Its supply is too low.
    pub const LOW_SUPPLY: u16 = 1 << 6;
    /// StealthChop is active.
    pub const STEALTH: u16 = 1 << 7;
    /// A temperature among the flags, °C from -40 to 214: bits 8 to 15, which are 0 without one.
    pub fn of_celsius(celsius: i16) -> u16 {
        ((celsius.clamp(-40, 214) + 41) as u16) << 8
    }
    /// Bits in order, by name.
    pub const NAMES: [&'static str; 8] = [
        "uart",
        "set up",
        "warm",
        "off for heat",
        "off for a short",
        "open load",
        "low supply",
        "stealth",
    ];
}

impl DriverStatus {
    /// Whether a bit of [`DriverFlags`] is set.
    pub const fn has(&self, flag: u16) -> bool {
        self.flags & flag != 0
    }

    /// Its temperature, °C, if it measures that.
    pub fn celsius(&self) -> Option<i16> {
        let steps = (self.flags >> 8) as i16;
        (steps > 0).then_some(steps - 41)
    }
}
