//! The probe of a machine: where it is beside the nozzle, and how a point is probed.

use super::Settings;
use super::check::in_range;
use super::groups::ProbeKeys;
use crate::text::refusal::Refusal;

/// The axis along which a probe goes down.
const Z: usize = 2;

/// `[probe]` of a machine file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeSettings {
    /// Where the probe touches, from the nozzle, mm.
    pub offset_mm: [f64; 2],
    /// How high above the bed the nozzle is when the probe trips, mm.
    pub z_offset_mm: f64,
    /// Speed of the search, mm/s.
    pub fast_mm_s: f64,
    /// Speed of the touch that counts, mm/s.
    pub slow_mm_s: f64,
    /// Way back before that touch, mm.
    pub back_off_mm: f64,
    /// How high above the last point's height the head goes to the next one, mm.
    pub lift_mm: f64,
    /// Touches of a point, whose mean counts.
    pub samples: u32,
    /// What they may lie apart, mm.
    pub tolerance_mm: f64,
}

impl Default for ProbeSettings {
    /// A nozzle that is the probe. The search as Klipper's default; the touch moves 0.5 µm a servo tick.
    fn default() -> Self {
        Self {
            offset_mm: [0.0, 0.0],
            z_offset_mm: 0.0,
            fast_mm_s: 5.0,
            slow_mm_s: 1.0,
            back_off_mm: 1.0,
            lift_mm: 3.0,
            samples: 2,
            tolerance_mm: 0.02,
        }
    }
}

impl Settings {
    /// Every number of `[probe]`, if it is there.
    pub(super) fn check_probe(&self) -> Result<(), Refusal> {
        let Some(probe) = &self.probe else {
            return Ok(());
        };
        let z = self.linear_joint(Z);
        let fastest = z.map_or(self.travel_speed_mm_s, |z| z.speed_max);
        ProbeKeys::check(probe)?;
        in_range("probe.fast_mm_s", probe.fast_mm_s, 0.1, fastest)?;
        in_range("probe.slow_mm_s", probe.slow_mm_s, 0.01, fastest)?;
        in_range("probe.lift_mm", probe.lift_mm, probe.back_off_mm, 100.0)
    }
}
