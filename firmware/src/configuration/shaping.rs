//! Input shapers of the joints: kind, frequency and damping.
//!
//! In: numbers of the machine file, Hz. Out: a [`Shaper`] of each joint, which `steps/shaping.rs` converts to
//! impulses.

use crate::configuration::JOINTS_MAX;
use serde::{Deserialize, Serialize};

/// How a joint is shaped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ShaperKind {
    /// Not at all.
    #[default]
    None,
    /// Two impulses, half a period long: 23 % are left where the frequency is 15 % off.
    Zv,
    /// Three impulses, three quarters of a period.
    Mzv,
    /// Three impulses, a period: the least left where the frequency is not well known.
    Ei,
    /// Two averages over a period, one after the other, two periods long: the least of all above it too.
    Smooth,
}

/// One joint's shaper.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shaper {
    /// How.
    pub kind: ShaperKind,
    /// Frequency of the vibration, Hz.
    pub frequency_hz: f64,
    /// Its damping ratio, 0 to 0.5.
    pub damping: f64,
}

/// No joint shaped.
pub const UNSHAPED: [Shaper; JOINTS_MAX] = [Shaper {
    kind: ShaperKind::None,
    frequency_hz: 0.0,
    damping: 0.0,
}; JOINTS_MAX];
