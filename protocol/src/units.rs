//! Integer units of the motion channels, and the only place where they are converted.
//!
//! Positions are sent as integers so that nothing drifts: any integers give an exactly C² curve.

use serde::{Deserialize, Serialize};

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

/// Base units per mm, rad or mm³: 0.1 µm for lengths, 1 µrad for angles, 10⁻⁶ mm³ for volume. Commands and reports
/// count in these; a stream in its own [`Units`].
pub const UNITS_PER_NATURAL: [f64; CHANNELS] = [1e4, 1e4, 1e4, 1e6, 1e6, 1e6, 1e6];

/// Largest exponent of [`Units`].
pub const UNIT_EXPONENT_MAX: u8 = 24;

/// Units of a stream: the powers of two by which they are coarser than the base units. So the resolution of a stream
/// with a large nozzle suits that nozzle, and its volume does not wrap within a span.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Units {
    /// Of x, y and z: 0.1 µm times 2 to this power.
    pub length_exponent: u8,
    /// Of tilt and heading: 1 µrad times 2 to this power.
    pub angle_exponent: u8,
    /// Of the volume, events too: 10⁻⁶ mm³ times 2 to this power.
    pub volume_exponent: u8,
}

impl Units {
    /// The base units.
    pub const BASE: Self = Self {
        length_exponent: 0,
        angle_exponent: 0,
        volume_exponent: 0,
    };

    /// True if every exponent is at most [`UNIT_EXPONENT_MAX`].
    pub fn is_valid(&self) -> bool {
        let largest = self.length_exponent.max(self.angle_exponent);
        largest.max(self.volume_exponent) <= UNIT_EXPONENT_MAX
    }

    /// Exponent of a channel, at most [`UNIT_EXPONENT_MAX`].
    pub fn exponent(&self, channel: usize) -> u8 {
        let exponent = match channel {
            CHANNEL_X | CHANNEL_Y | CHANNEL_Z => self.length_exponent,
            CHANNEL_VOLUME => self.volume_exponent,
            _ => self.angle_exponent,
        };
        exponent.min(UNIT_EXPONENT_MAX)
    }

    /// Base units in a unit of a channel.
    pub fn base_units(&self, channel: usize) -> f64 {
        f64::from(1u32 << self.exponent(channel))
    }

    /// Units per mm, rad or mm³ of a channel.
    pub fn per_natural(&self, channel: usize) -> f64 {
        let base = UNITS_PER_NATURAL.get(channel).copied().unwrap_or(1.0);
        base / self.base_units(channel)
    }

    /// Rounds a pose in mm, rad and mm³ to these units (wrapping at 32 bits).
    pub fn of_natural(&self, natural: &[f64; CHANNELS]) -> ChannelPoint {
        let mut units = [0i32; CHANNELS];
        for channel in 0..CHANNELS {
            let scaled = natural[channel] * self.per_natural(channel);
            let rounded = if scaled >= 0.0 {
                scaled + 0.5
            } else {
                scaled - 0.5
            };
            units[channel] = rounded as i64 as i32;
        }
        units
    }

    /// A point in these units as mm, rad and mm³.
    pub fn to_natural(&self, point: &ChannelPoint) -> [f64; CHANNELS] {
        core::array::from_fn(|channel| f64::from(point[channel]) / self.per_natural(channel))
    }

    /// A point in these units in base units: the same place exactly (wrapping at 32 bits).
    pub fn to_base(&self, point: &ChannelPoint) -> ChannelPoint {
        core::array::from_fn(|channel| point[channel] << self.exponent(channel))
    }

    /// A point in base units, rounded to these units.
    pub fn of_base(&self, point: &ChannelPoint) -> ChannelPoint {
        core::array::from_fn(|channel| {
            let unit = 1i64 << self.exponent(channel);
            ((i64::from(point[channel]) + unit / 2) >> self.exponent(channel)) as i32
        })
    }
}

/// A point in channel space, in integer units: those of its stream, or base units. Values wrap at 32 bits: only
/// differences count, so heading and volume may grow without bound.
pub type ChannelPoint = [i32; CHANNELS];

/// A duration in servo ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ticks(pub u32);

/// Rounds a pose in mm, rad and mm³ to base units (wrapping at 32 bits).
pub fn to_units(natural: &[f64; CHANNELS]) -> ChannelPoint {
    Units::BASE.of_natural(natural)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: a place in coarse units is the very same place in base units, and back. Method: points at the ends of
    /// 32 bits and about zero, in units of several sizes.
    #[test]
    fn coarse_units_are_whole_numbers_of_base_units() {
        let units = Units {
            length_exponent: 5,
            angle_exponent: 1,
            volume_exponent: 17,
        };
        assert!(units.is_valid());
        for value in [-9000, -17, -1, 0, 1, 5, 8191] {
            let point = [value; CHANNELS];
            let base = units.to_base(&point);
            assert_eq!(base[CHANNEL_X], 32 * value);
            assert_eq!(base[CHANNEL_HEADING], 2 * value);
            assert_eq!(base[CHANNEL_VOLUME], 131_072 * value);
            assert_eq!(units.of_base(&base), point);
            assert_eq!(units.of_natural(&units.to_natural(&point)), point);
            assert_eq!(units.to_natural(&point), Units::BASE.to_natural(&base));
        }
        let too_coarse = Units {
            volume_exponent: UNIT_EXPONENT_MAX + 1,
            ..Units::BASE
        };
        assert!(!too_coarse.is_valid());
    }
}
