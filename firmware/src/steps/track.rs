//! One motor from target to target: its true position, and the parabola of its next interval.
//!
//! In: targets from the delay line, 2^-22 steps. Out: phase, velocity and acceleration for the engine, whether
//! its direction pin changes, and whether it can follow at all.

use super::bank::Motor;
use super::interval::Interval;
use super::{TARGET_FRACTION_BITS, TARGET_SHIFT, Target};
use crate::configuration::MOTORS_MAX;
use crate::steps::waiting_targets::position_near;

/// A displacement is a difference of targets: 512 steps fit 32 bits, so that a sum of two
/// displacements in the longest interval does.
pub(super) const WAY_SHIFT: u32 = TARGET_SHIFT;
pub(super) const WAY_FRACTION_BITS: u32 = TARGET_FRACTION_BITS;

/// One motor's targets of the last three servo ticks, and where it really is.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct MotorTrack {
    /// The newest target of the joint; kept from tick to tick.
    pub(super) target: Target,
    /// q2, what of the target that it waited for the program knows: 2^-22 steps.
    pub(super) newest: i32,
    /// q2 - q1, 2^-22 steps.
    pub(super) last_way: i32,
    /// q1 - q0, 2^-22 steps.
    pub(super) way_before: i32,
    /// Where the newest program ends, near q1: 2^-31 steps, wrapping.
    pub(super) end: u32,
    /// The same for all; here it needs no address of its own.
    pub(super) interval: Interval,
    /// Mean velocity of the newest program, 2^-31 steps a tick: N of it are exactly its
    /// displacement.
    pub(super) mean: i32,
    /// Negative if its direction pin will be backward at the end of the newest program.
    pub(super) facing: i32,
    /// The motor's in masks.
    pub(super) bit: u8,
}

impl MotorTrack {
    /// `directions`: the pins of all motors.
    pub(super) fn at_rest(position: i64, motor: usize, directions: u8, interval: Interval) -> Self {
        let bit = 1 << (motor % MOTORS_MAX);
        let newest = Target::of_position(position);
        Self {
            target: newest,
            newest: newest.fine,
            last_way: 0,
            way_before: 0,
            end: position.wrapping_add(super::BIAS) as u32,
            interval,
            mean: 0,
            facing: if directions & bit == 0 { -1 } else { 0 },
            bit,
        }
    }

    /// What the newest program moves, 2^-31 steps.
    pub(super) fn way(&self, ticks: i32) -> i64 {
        i64::from(self.mean) * i64::from(ticks)
    }

    /// q2, 2^-31 steps; `about` is near it by less than 512 steps.
    pub(super) fn told(&self, about: i64) -> i64 {
        position_near(about, self.newest)
    }

    /// Where the newest program ends, 2^-31 steps.
    pub(super) fn position(&self, about: i64) -> i64 {
        let way = i64::from(self.last_way) << WAY_SHIFT;
        let aim = self.told(about).wrapping_sub(way);
        let behind = self.end.wrapping_sub(aim.wrapping_add(super::BIAS) as u32);
        aim.wrapping_add(i64::from(behind as i32))
    }
}

impl MotorTrack {
    /// Takes the next target, the fine part of it, and computes the rate for the interval between the last two. The
    /// result is negative where more than one step a tick would be needed.
    ///
    /// With m the mean velocity and the acceleration 2 h, the first tick has the velocity
    /// m - (N - 1) h and the last m + (N - 1) h; all N make N m exactly.
    #[inline(always)]
    pub(super) fn advance(&mut self, due: i32, motor: &mut Motor, turns: &mut Turns) -> i32 {
        let interval = self.interval;
        let new_way = due.wrapping_sub(self.newest);
        let twice_mean = new_way.wrapping_sub(self.way_before);
        // From where the last program ends, not from where it was to end.
        let aim = (self.newest.wrapping_sub(self.last_way) << WAY_SHIFT) as u32;
        let behind = aim.wrapping_sub(self.end) as i32 >> WAY_SHIFT;
        let way = self.last_way.wrapping_add(behind);
        self.newest = due;
        self.way_before = self.last_way;
        self.last_way = new_way;
        let half = interval.half_acceleration(twice_mean);
        let mean = interval.velocity(way);
        let first = mean
            .wrapping_sub(half.wrapping_mul(interval.ticks))
            .wrapping_add(half);
        let last = mean.wrapping_mul(2).wrapping_sub(first);
        let start = self.end;
        self.end = start.wrapping_add((mean as u32).wrapping_mul(interval.ticks as u32));
        self.mean = mean;
        *motor = Motor {
            phase: start,
            velocity: first,
            acceleration: half.wrapping_mul(2),
        };
        // One less than the absolute value of a negative number: fine for bounds. Halved, so that no
        // sum is too long.
        let halves = |value: i32| (value ^ (value >> 31)) >> 1;
        let way_and_bend = halves(way) + halves(twice_mean);
        // The speed at the ends of the parabola is (way ± A/2) / N, and A half of twice_mean.
        let spare = interval.half_way_max - way_and_bend;
        let (before, within) = (first ^ self.facing, first ^ last);
        if (before | within) < 0 {
            // A motor that only creeps within one count keeps its direction pin; one that rests is to
            // face forward, so that this is not asked again. A creeping one gets no further than
            // `way_and_bend` from its start: does that take it out of its count? From the middle of
            // the count, 2^-31 steps, and in halves of ways.
            let off_middle = (start << 1) as i32 ^ i32::MIN;
            let off_middle = (off_middle ^ (off_middle >> 31)) >> (WAY_SHIFT + 2);
            let inside = QUARTER_STEP_WAY - off_middle - way_and_bend;
            if inside < 0 || (first | last) == 0 {
                self.facing = last;
                turns.before |= self.bit & (before >> 31) as u8;
                turns.within |= self.bit & (within >> 31) as u8;
            }
        }
        spare
    }
}

/// Half of half a step as a displacement, minus more than rounding may hide; a constant that an
/// instruction has.
const QUARTER_STEP_WAY: i32 = (1 << (WAY_FRACTION_BITS - 2)) - (1 << 12);

/// Motors whose direction pins change: masks, bit m is motor m.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Turns {
    /// When the interval begins.
    pub(super) before: u8,
    /// Within it.
    pub(super) within: u8,
}
