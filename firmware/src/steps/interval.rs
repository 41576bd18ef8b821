//! Constants of the servo interval that convert displacements and second differences to rates
//! without a division.
//!
//! In: step ticks of an interval. Out: reciprocals in fixed point, and the largest rate.

use super::track::{WAY_FRACTION_BITS, WAY_SHIFT};
use super::{INTERVAL_TICKS_MAX, INTERVAL_TICKS_MIN};
use crate::design::STEP_RATE_SHARE_MAX;

/// Scale of [`Interval::per_way`]: the largest that fits 32 bits for the shortest interval.
const WAY_SCALE_BITS: u32 = 28;

/// Numbers of the servo interval, N step ticks long.
#[derive(Clone, Copy, Debug)]
pub(super) struct Interval {
    pub(super) ticks: i32,
    /// 2^(28 + 9) / N.
    per_way: i32,
    /// 2^(32 + 9 - 2) / N².
    per_bend: i32,
    /// Half the displacement of the largest rate, 2^-22 steps per interval.
    pub(super) half_way_max: i32,
}

impl Interval {
    pub(super) fn new(ticks: u32) -> Self {
        let ticks = ticks.clamp(INTERVAL_TICKS_MIN, INTERVAL_TICKS_MAX);
        let n = u64::from(ticks);
        let per_way = ((1u64 << (WAY_SCALE_BITS + WAY_SHIFT)) + n / 2) / n;
        let per_bend = ((1u64 << (30 + WAY_SHIFT)) + n * n / 2) / (n * n);
        let steps_max = (f64::from(ticks) * STEP_RATE_SHARE_MAX) as u32;
        Self {
            ticks: ticks as i32,
            per_way: per_way as i32,
            per_bend: per_bend as i32,
            half_way_max: ((steps_max << (WAY_FRACTION_BITS - 1)) - 1) as i32,
        }
    }

    /// Half of the acceleration, A / 2 N², from twice the mean second difference.
    #[inline(always)]
    pub(super) fn half_acceleration(&self, twice_mean: i32) -> i32 {
        ((i64::from(twice_mean) * i64::from(self.per_bend)) >> 32) as i32
    }

    /// Mean velocity, displacement / N.
    #[inline(always)]
    pub(super) fn velocity(&self, way: i32) -> i32 {
        ((i64::from(way) * i64::from(self.per_way)) >> WAY_SCALE_BITS) as i32
    }
}
