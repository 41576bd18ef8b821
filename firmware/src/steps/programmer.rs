//! Targets of successive servo ticks -> one parabola per motor and interval.

use super::{
    INTERVAL_TICKS_MAX, INTERVAL_TICKS_MIN, POSITION_FRACTION_BITS, StepProgram, Stopped, biased,
    count, phase,
};
use crate::configuration::MOTORS_MAX;
use crate::design::STEP_RATE_SHARE_MAX;

/// A motor would need more than one step a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepRateExceeded {
    /// Which motor.
    pub motor: u8,
    /// Steps that it would need in a servo interval, at its fastest.
    pub steps_per_interval: u32,
}

/// Bits that a way (2^-31 steps) loses before it is divided: 2^-23 step remain.
const WAY_SHIFT: u32 = 8;
/// The same for twice the mean second difference.
const BEND_SHIFT: u32 = 12;
/// Scale of the reciprocals.
const RECIPROCAL_BITS: u32 = 29;

/// Numbers of the servo interval, N step ticks long.
#[derive(Clone, Copy, Debug)]
struct Interval {
    ticks: i32,
    /// 2^(29 + 8) / N.
    reciprocal: i32,
    /// 2^(29 + 12) / 2 N².
    reciprocal_squared: i32,
    /// N (N - 1) / 2.
    triangle: i32,
    /// Whole steps of an interval from which on the rate is refused.
    steps_max: u32,
}

impl Interval {
    fn new(ticks: u32) -> Self {
        let ticks = ticks.clamp(INTERVAL_TICKS_MIN, INTERVAL_TICKS_MAX);
        let n = u64::from(ticks);
        let way = 1u64 << (RECIPROCAL_BITS + WAY_SHIFT);
        let bend = 1u64 << (RECIPROCAL_BITS + BEND_SHIFT - 1);
        Self {
            ticks: ticks as i32,
            reciprocal: ((way + n / 2) / n) as i32,
            reciprocal_squared: ((bend + n * n / 2) / (n * n)) as i32,
            triangle: (ticks * (ticks - 1) / 2) as i32,
            steps_max: (f64::from(ticks) * STEP_RATE_SHARE_MAX) as u32,
        }
    }

    /// A / N² from twice the mean second difference.
    #[inline]
    fn acceleration(&self, twice_mean: i64) -> i32 {
        scaled((twice_mean >> BEND_SHIFT) as i32, self.reciprocal_squared)
    }

    /// way / N, rounded.
    #[inline]
    fn velocity(&self, way: i64) -> i32 {
        scaled((way >> WAY_SHIFT) as i32, self.reciprocal)
    }

    /// Whole steps that the fastest tick would make in an interval, rounded up: the speed at the
    /// ends of the parabola is (way ± A/2) / N.
    #[inline]
    fn steps_of_fastest(way: i64, twice_mean: i64) -> u32 {
        let whole = ((way >> POSITION_FRACTION_BITS) as i32).unsigned_abs();
        let bend = ((twice_mean >> (POSITION_FRACTION_BITS + 2)) as i32).unsigned_abs();
        whole + bend
    }
}

#[inline]
fn scaled(value: i32, reciprocal: i32) -> i32 {
    let product = i64::from(value) * i64::from(reciprocal);
    ((product + (1 << (RECIPROCAL_BITS - 1))) >> RECIPROCAL_BITS) as i32
}

/// One motor's targets of the last three servo ticks, and where it really is.
#[derive(Clone, Copy, Debug, Default)]
struct MotorTrack {
    /// q2, the newest.
    newest: i64,
    /// q2 - q1.
    last_way: i64,
    /// q1 - q0.
    way_before: i64,
    /// Where the last program ends.
    end: i64,
}

impl MotorTrack {
    fn at_rest(position: i64) -> Self {
        Self {
            newest: position,
            end: position,
            ..Self::default()
        }
    }
}

/// Targets -> programs, with the exact position of every motor.
#[derive(Clone, Debug)]
pub struct StepProgrammer {
    motors: usize,
    interval: Interval,
    tracks: [MotorTrack; MOTORS_MAX],
    directions: u8,
    phases_due: bool,
    serial: u32,
    /// The last two programs with the positions at their starts.
    recent: [Recent; 2],
    newer: bool,
}

/// A program and where it starts.
#[derive(Clone, Debug, Default)]
struct Recent {
    starts: [i64; MOTORS_MAX],
    program: StepProgram,
}

impl StepProgrammer {
    /// All motors at position 0, at rest. `interval_ticks` is limited to 65..=256.
    pub fn new(motors: usize, interval_ticks: u32) -> Self {
        Self {
            motors: motors.min(MOTORS_MAX),
            interval: Interval::new(interval_ticks),
            tracks: [MotorTrack::default(); MOTORS_MAX],
            directions: 0,
            phases_due: true,
            serial: 0,
            recent: Default::default(),
            newer: false,
        }
    }

    /// Declares positions without a step. Only at rest.
    pub fn set_positions(&mut self, positions: &[i64; MOTORS_MAX]) {
        self.resume_from(positions);
        self.phases_due = true;
    }

    /// Goes on from where the motors really are, after the engine was stopped.
    fn resume_from(&mut self, positions: &[i64; MOTORS_MAX]) {
        self.tracks = positions.map(MotorTrack::at_rest);
    }

    /// Finds the motors after [`StepEngine::stop`] and goes on from there. False if the engine was
    /// not playing one of the last two programs, so the position is lost.
    pub fn recover(&mut self, stopped: &Stopped) -> bool {
        let Some(recent) = self
            .recent
            .iter()
            .find(|recent| recent.program.serial == stopped.serial)
        else {
            return false;
        };
        let ticks = i64::from(stopped.ticks_played);
        let program = &recent.program;
        let positions = core::array::from_fn(|motor| {
            recent.starts[motor]
                + i64::from(program.velocity[motor]) * ticks
                + i64::from(program.acceleration[motor]) * (ticks * (ticks - 1) / 2)
        });
        self.resume_from(&positions);
        true
    }

    /// Where the last program ends, in 2^-31 steps.
    pub fn positions(&self) -> [i64; MOTORS_MAX] {
        self.tracks.map(|track| track.end)
    }

    /// Where the motors are at the start of this servo tick, before [`Self::advance`]: the newest
    /// program is about to be played.
    pub fn present_positions(&self) -> [i64; MOTORS_MAX] {
        self.recent[usize::from(self.newer)].starts
    }

    /// The target that the last call of [`Self::advance`] was given.
    pub fn newest_targets(&self) -> [i64; MOTORS_MAX] {
        self.tracks.map(|track| track.newest)
    }

    /// True if the motors rest: the last targets are equal and were reached.
    pub fn is_at_rest(&self) -> bool {
        self.tracks.iter().all(|track| {
            track.last_way == 0 && track.way_before == 0 && count(track.newest) == count(track.end)
        })
    }

    /// The newest program.
    pub fn newest(&self) -> &StepProgram {
        &self.recent[usize::from(self.newer)].program
    }

    /// Takes the next servo tick's targets and programs the interval that ends one tick before
    /// them ([`Self::newest`]).
    ///
    /// # Errors
    /// [`StepRateExceeded`] where a motor would need more than one step a tick.
    pub fn advance(&mut self, targets: &[i64; MOTORS_MAX]) -> Result<(), StepRateExceeded> {
        let interval = self.interval;
        self.serial = self.serial.wrapping_add(1);
        self.newer = !self.newer;
        // Written in place, over the older of the last two.
        let recent = &mut self.recent[usize::from(self.newer)];
        let program = &mut recent.program;
        program.begin(self.serial);
        let tracks = self.tracks.iter_mut().zip(&mut recent.starts);
        for (motor, ((track, start), &target)) in tracks.zip(targets).enumerate().take(self.motors)
        {
            *start = track.end;
            let way = track.newest.wrapping_sub(track.end);
            let new_way = target.wrapping_sub(track.newest);
            let twice_mean = new_way.wrapping_sub(track.way_before);
            track.way_before = track.last_way;
            track.last_way = new_way;
            track.newest = target;
            if way == 0 && twice_mean == 0 {
                program.velocity[motor] = 0;
                program.acceleration[motor] = 0;
                continue;
            }
            let fastest = Interval::steps_of_fastest(way, twice_mean);
            if fastest >= interval.steps_max {
                return Err(StepRateExceeded {
                    motor: motor as u8,
                    steps_per_interval: fastest,
                });
            }
            let acceleration = interval.acceleration(twice_mean);
            let bend = i64::from(acceleration) * i64::from(interval.triangle);
            let velocity = interval.velocity(way - bend);
            let last = velocity + acceleration * (interval.ticks - 1);
            track.end = *start + i64::from(velocity) * i64::from(interval.ticks) + bend;
            program.velocity[motor] = velocity;
            program.acceleration[motor] = acceleration;
            let moves = (biased(*start) ^ biased(track.end)) >> POSITION_FRACTION_BITS != 0;
            program.set_direction(&mut self.directions, motor, (velocity, last), moves);
        }
        program.directions = self.directions;
        // What the engine will have on its pins when the interval ends.
        self.directions ^= program.reversing;
        if self.phases_due {
            self.phases_due = false;
            program.phases = Some(recent.starts.map(phase));
        }
        Ok(())
    }
}
