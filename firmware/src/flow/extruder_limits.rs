//! The extruder's limits of rate and acceleration, checked on its motor's targets.
//!
//! Path flow, pressure advance, primes and retracts share one motor: each is bounded by itself where it
//! arrives ([`event_peaks`], `path/load.rs`), their sum in every servo tick ([`ExtruderGuard`]), before the
//! program that would exceed it is handed over. Units: mm³, s; displacements in 2^-22 steps per servo tick.
//! Not covered: the joints, which `path/load.rs` and `motion/time_warp.rs` limit together with the time
//! warp.

use crate::configuration::{ExtruderConfiguration, MachineConfiguration};
use crate::design::{LIMIT_MARGIN, RAMP_MARGIN};
use crate::steps::ONE_STEP_WAY;

/// Peak rate of a prime or retract over volume / duration: of x³ (10 - 15 x + 6 x²).
const EVENT_PEAK_RATE: f64 = 1.875;
/// Its peak acceleration over volume / duration²: 10 / sqrt(3).
const EVENT_PEAK_ACCELERATION: f64 = 5.773_502_691_896_258;

/// Peak rate, mm³/s, and peak acceleration, mm³/s², of a prime or retract.
pub fn event_peaks(volume_mm3: f64, duration_s: f64) -> [f64; 2] {
    let rate = EVENT_PEAK_RATE * volume_mm3 / duration_s;
    let acceleration = EVENT_PEAK_ACCELERATION * volume_mm3 / (duration_s * duration_s);
    [rate, acceleration]
}

/// The larger share of the extruder's limits, rate or acceleration, that a prime or retract uses by
/// itself.
pub fn event_ratio(extruder: &ExtruderConfiguration, volume_mm3: f64, duration_s: f64) -> f64 {
    let [rate, acceleration] = event_peaks(volume_mm3, duration_s);
    let rate_share = rate / extruder.speed_max_mm3_s;
    let acceleration_share = acceleration / extruder.acceleration_max_mm3_s2;
    if rate_share > acceleration_share {
        rate_share
    } else {
        acceleration_share
    }
}

/// What rounding adds to a second difference of targets, 2^-22 steps: four roundings of a target, and of
/// the pressure advance, which counts the flow in 2^-16 steps, as often times its gain.
fn rounding(extruder: &ExtruderConfiguration, servo_hz: f64) -> f64 {
    let window_s = (extruder.pressure_advance_window_ms * 1e-3).max(1.0 / servo_hz);
    let gain = extruder.pressure_advance_s / window_s;
    4.0 * (64.0 * gain + 32.0)
}

/// Watches the extruder's motor.
#[derive(Clone, Copy, Debug)]
pub struct ExtruderGuard {
    /// Distance of a servo tick at the rate limit.
    way_limit: u32,
    /// Change of it at the acceleration limit.
    bend_limit: u32,
    way_max: u32,
    bend_max: u32,
    /// The same at a path rate that no plan knew.
    ramp_way_max: u32,
    ramp_bend_max: u32,
}

impl ExtruderGuard {
    /// From the machine's configuration.
    pub fn new(configuration: &MachineConfiguration) -> Self {
        let extruder = &configuration.extruder;
        let servo_hz = f64::from(configuration.servo_hz.max(1));
        let way = extruder.speed_max_mm3_s * extruder.steps_per_mm3 / servo_hz * ONE_STEP_WAY;
        let bend = extruder.acceleration_max_mm3_s2 * extruder.steps_per_mm3
            / (servo_hz * servo_hz)
            * ONE_STEP_WAY;
        let slack = rounding(extruder, servo_hz);
        // Conversions saturate: a limit beyond the range of a displacement cannot be exceeded.
        let most = |limit: f64, margin: f64| ((limit * margin + slack) as u32).min(i32::MAX as u32);
        Self {
            way_limit: (way as u32).max(1),
            bend_limit: (bend as u32).max(1),
            way_max: most(way, LIMIT_MARGIN),
            bend_max: most(bend, LIMIT_MARGIN),
            ramp_way_max: most(way, RAMP_MARGIN),
            ramp_bend_max: most(bend, RAMP_MARGIN),
        }
    }

    /// True if the displacements of the newest servo tick and the previous one are within the
    /// limits of a plan.
    #[inline(always)]
    pub fn is_kept(&self, ways: [i32; 2]) -> bool {
        // Both bounds at once: |a| <= b where a + b, as an unsigned number, is at most 2 b.
        let within = |a: i32, b: u32| (a as u32).wrapping_add(b) <= b.wrapping_mul(2);
        within(ways[0].wrapping_sub(ways[1]), self.bend_max) && within(ways[0], self.way_max)
    }

    /// Where that is not so: the share of the limit in thousandths, unless it is excused. `in_ramp`:
    /// see [`RAMP_MARGIN`].
    #[cold]
    pub fn exceeded(&self, ways: [i32; 2], in_ramp: bool) -> Option<i32> {
        let way = ways[0].unsigned_abs();
        let bend = ways[0].wrapping_sub(ways[1]).unsigned_abs();
        if in_ramp && way <= self.ramp_way_max && bend <= self.ramp_bend_max {
            return None;
        }
        let permille = |value: u32, limit: u32| u64::from(value) * 1000 / u64::from(limit.max(1));
        let most = permille(way, self.way_limit).max(permille(bend, self.bend_limit));
        Some(most.min(i32::MAX as u64) as i32)
    }
}
