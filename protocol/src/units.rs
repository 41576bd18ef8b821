//! Integer units of the motion channels, and the only place where they are converted.
//!
//! Positions travel as integers so that nothing drifts: any integers give an exactly C² curve.

/// Motion channels: x, y, z, tilt x, tilt y, heading, deposited volume.
pub const CHANNELS: usize = 7;
/// Index of the tip's x position.
pub const CHANNEL_X: usize = 0;
/// Index of the tip's y position.
pub const CHANNEL_Y: usize = 1;
/// Index of the tip's z position.
pub const CHANNEL_Z: usize = 2;
/// Index of the tilt vector's x component.
pub const CHANNEL_TILT_X: usize = 3;
/// Index of the tilt vector's y component.
pub const CHANNEL_TILT_Y: usize = 4;
/// Index of the heading about the tool axis.
pub const CHANNEL_HEADING: usize = 5;
/// Index of the deposited volume.
pub const CHANNEL_VOLUME: usize = 6;

/// Integer units per mm, rad or mm³: 0.1 µm for lengths, 1 µrad for angles, 10⁻⁶ mm³ for volume.
pub const UNITS_PER_NATURAL: [f64; CHANNELS] = [1e4, 1e4, 1e4, 1e6, 1e6, 1e6, 1e6];

/// A point in channel space, in integer units. Values wrap at 32 bits: only differences count,
/// so heading and volume may grow without bound.
pub type ChannelPoint = [i32; CHANNELS];

/// A duration in servo ticks.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ticks(pub u32);

/// Rounds a pose in mm, rad and mm³ to integer units (wrapping at 32 bits).
pub fn to_units(natural: &[f64; CHANNELS]) -> ChannelPoint {
    let mut units = [0i32; CHANNELS];
    for channel in 0..CHANNELS {
        let scaled = natural[channel] * UNITS_PER_NATURAL[channel];
        let rounded = if scaled >= 0.0 {
            scaled + 0.5
        } else {
            scaled - 0.5
        };
        units[channel] = rounded as i64 as i32;
    }
    units
}

/// Converts unwrapped integer units to mm, rad and mm³.
pub fn from_units(units: &[i64; CHANNELS]) -> [f64; CHANNELS] {
    let mut natural = [0.0; CHANNELS];
    for channel in 0..CHANNELS {
        natural[channel] = units[channel] as f64 / UNITS_PER_NATURAL[channel];
    }
    natural
}
