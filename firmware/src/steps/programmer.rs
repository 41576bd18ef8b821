//! Targets of successive servo ticks -> one parabola per motor and interval.
//!
//! Everything that runs each tick is 32 bits wide: ways in 2^-22 steps, and the end of the last
//! program in 2^-31 steps modulo two, which is the engine's phase. The 64-bit position is put
//! together when it is asked for.

use super::{
    BIAS, INTERVAL_TICKS_MAX, INTERVAL_TICKS_MIN, POSITION_FRACTION_BITS, Rate, StepProgram,
    Stopped,
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

/// Bits that a way loses against a position: 2^-22 step remain, 512 steps fit 32 bits, so that a
/// sum of two ways in the longest interval does.
const WAY_SHIFT: u32 = 9;
const WAY_FRACTION_BITS: u32 = POSITION_FRACTION_BITS - WAY_SHIFT;
/// Scale of [`Interval::per_way`]: the largest that fits 32 bits for the shortest interval.
const WAY_SCALE_BITS: u32 = 28;
/// Largest change of a target's upper half in a tick, in two steps each: beyond it the 32 bits of
/// a way would wrap. A power of two, so that the jumps of all motors can be checked at once.
const JUMP_MAX: i32 = 128;

/// Numbers of the servo interval, N step ticks long.
#[derive(Clone, Copy, Debug)]
struct Interval {
    ticks: i32,
    /// 2^(28 + 9) / N.
    per_way: i32,
    /// 2^(32 + 9 - 2) / N².
    per_bend: i32,
    /// From here on the rate is refused, 2^-22 steps an interval.
    way_max: u32,
}

impl Interval {
    fn new(ticks: u32) -> Self {
        let ticks = ticks.clamp(INTERVAL_TICKS_MIN, INTERVAL_TICKS_MAX);
        let n = u64::from(ticks);
        let per_way = ((1u64 << (WAY_SCALE_BITS + WAY_SHIFT)) + n / 2) / n;
        let per_bend = ((1u64 << (30 + WAY_SHIFT)) + n * n / 2) / (n * n);
        let steps_max = (f64::from(ticks) * STEP_RATE_SHARE_MAX) as u32;
        Self {
            ticks: ticks as i32,
            per_way: per_way as i32,
            per_bend: per_bend as i32,
            way_max: steps_max << WAY_FRACTION_BITS,
        }
    }

    /// Half of the acceleration, A / 2 N², from twice the mean second difference.
    #[inline(always)]
    fn half_acceleration(&self, twice_mean: i32) -> i32 {
        ((i64::from(twice_mean) * i64::from(self.per_bend)) >> 32) as i32
    }

    /// Mean velocity way / N.
    #[inline(always)]
    fn velocity(&self, way: i32) -> i32 {
        ((i64::from(way) * i64::from(self.per_way)) >> WAY_SCALE_BITS) as i32
    }
}

/// One motor's targets of the last three servo ticks, and where it really is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MotorTrack {
    /// Where it is to be, 2^-31 steps and [`BIAS`]; kept from tick to tick.
    target: i64,
    /// q2, the newest target of which the program knows, 2^-22 steps, wrapping.
    newest: i32,
    /// Its upper half.
    newest_high: i32,
    /// q2 - q1, 2^-22 steps.
    last_way: i32,
    /// q1 - q0, 2^-22 steps.
    way_before: i32,
    /// Where the newest program ends, near q1: 2^-31 steps, wrapping.
    end: u32,
    /// What the newest program does.
    pub(super) rate: Rate,
    /// What the one before it did.
    rate_before: Rate,
}

impl MotorTrack {
    fn at_rest(position: i64) -> Self {
        let target = position.wrapping_add(BIAS);
        Self {
            target,
            newest: (target >> WAY_SHIFT) as i32,
            newest_high: (target >> 32) as i32,
            end: target as u32,
            ..Self::default()
        }
    }

    /// Where the newest program ends, 2^-31 steps.
    fn position(&self) -> i64 {
        let near = self.target >> WAY_SHIFT;
        let newest = near.wrapping_sub(i64::from((near as i32).wrapping_sub(self.newest)));
        let aim = newest.wrapping_sub(i64::from(self.last_way)) << WAY_SHIFT;
        aim.wrapping_add(i64::from(self.end.wrapping_sub(aim as u32) as i32))
            .wrapping_sub(BIAS)
    }
}

/// Targets -> programs, with the exact position of every motor.
#[derive(Clone, Debug)]
pub struct StepProgrammer {
    motors: usize,
    interval: Interval,
    program: StepProgram,
    /// Number of the program before it.
    serial_before: u32,
    directions: u8,
    phases_due: bool,
}

impl StepProgrammer {
    /// All motors at position 0, at rest. `interval_ticks` is limited to 65..=256.
    pub fn new(motors: usize, interval_ticks: u32) -> Self {
        Self {
            motors: motors.min(MOTORS_MAX),
            interval: Interval::new(interval_ticks),
            program: StepProgram {
                tracks: [MotorTrack::at_rest(0); MOTORS_MAX],
                ..StepProgram::default()
            },
            serial_before: 0,
            directions: 0,
            phases_due: true,
        }
    }

    /// Declares positions without a step. Only at rest.
    pub fn set_positions(&mut self, positions: &[i64; MOTORS_MAX]) {
        self.resume_from(positions);
        self.phases_due = true;
    }

    /// Goes on from where the motors really are, after the engine was stopped.
    fn resume_from(&mut self, positions: &[i64; MOTORS_MAX]) {
        self.program.tracks = positions.map(MotorTrack::at_rest);
        // The programs until now do not lead here: no stop is to be counted back through them.
        self.skip_serials();
    }

    fn skip_serials(&mut self) {
        self.program.serial = self.program.serial.wrapping_add(2);
        self.serial_before = self.program.serial;
    }

    /// Finds the motors after [`StepEngine::stop`] and goes on from there. False if the engine was
    /// not playing one of the last two programs, or the motors have been found before.
    ///
    /// [`StepEngine::stop`]: super::StepEngine::stop
    pub fn recover(&mut self, stopped: &Stopped) -> bool {
        let whole = self.interval.ticks;
        let played = stopped.ticks_played as i32;
        let newest = stopped.serial == self.program.serial;
        let found = newest || stopped.serial == self.serial_before;
        let positions = self.program.tracks.map(|track| {
            let mut position = track.position();
            if found {
                position = position.wrapping_sub(track.rate.way(whole));
                let stopped_in = if newest {
                    track.rate
                } else {
                    position = position.wrapping_sub(track.rate_before.way(whole));
                    track.rate_before
                };
                position = position.wrapping_add(stopped_in.way(played));
            }
            position
        });
        // If they are not found they stay where the newest program was to end.
        self.resume_from(&positions);
        found
    }

    /// Where the last program ends, in 2^-31 steps.
    pub fn positions(&self) -> [i64; MOTORS_MAX] {
        self.program.tracks.map(|track| track.position())
    }

    /// Where the motors are at the start of this servo tick, before [`Self::advance`]: the newest
    /// program is about to be played.
    pub fn present_positions(&self) -> [i64; MOTORS_MAX] {
        let ticks = self.interval.ticks;
        let tracks = &self.program.tracks;
        tracks.map(|track| track.position().wrapping_sub(track.rate.way(ticks)))
    }

    /// The targets that the last call of [`Self::advance`] was given.
    pub fn newest_targets(&self) -> [i64; MOTORS_MAX] {
        let tracks = &self.program.tracks;
        tracks.map(|track| track.target.wrapping_sub(BIAS))
    }

    /// True if the motors rest: the last targets are equal and were reached.
    pub fn is_at_rest(&self) -> bool {
        self.program.tracks.iter().all(|track| {
            // Bit 31 is the parity of the count.
            let counts_differ = ((track.newest << WAY_SHIFT) as u32 ^ track.end) >> 31 != 0;
            track.last_way == 0 && track.way_before == 0 && !counts_differ
        })
    }

    /// The newest program.
    pub fn newest(&self) -> &StepProgram {
        &self.program
    }

    /// The targets for the next [`Self::advance_to_targets`], 2^-31 steps and [`BIAS`].
    #[inline]
    pub(crate) fn targets_mut(&mut self) -> impl Iterator<Item = &mut i64> {
        let tracks = self.program.tracks.iter_mut();
        tracks.map(|track| &mut track.target)
    }

    /// One of them.
    #[inline]
    pub(crate) fn set_target(&mut self, motor: usize, target: i64) {
        self.program.tracks[motor % MOTORS_MAX].target = target;
    }

    /// Takes the next servo tick's targets and programs the interval that ends one tick before
    /// them ([`Self::newest`]).
    ///
    /// # Errors
    /// [`StepRateExceeded`] where a motor would need more than one step a tick.
    pub fn advance(&mut self, targets: &[i64; MOTORS_MAX]) -> Result<(), StepRateExceeded> {
        for (target, given) in self.targets_mut().zip(targets) {
            *target = given.wrapping_add(BIAS);
        }
        self.advance_to_targets()
    }

    /// The same with the targets written to [`Self::targets_mut`].
    pub(crate) fn advance_to_targets(&mut self) -> Result<(), StepRateExceeded> {
        // In registers or on the stack, nearer than behind a pointer.
        let interval = self.interval;
        let program = &mut self.program;
        program.phases = None;
        if self.phases_due {
            self.phases_due = false;
            program.phases = Some(program.tracks.map(|track| track.end));
        }
        let mut signs = Signs::default();
        // The last motor first, so that the first one's signs end in bit 0.
        let tracks = program.tracks.get_mut(..self.motors).unwrap_or_default();
        for track in tracks.iter_mut().rev() {
            track.advance(&interval, &mut signs);
        }
        self.serial_before = program.serial;
        program.serial = program.serial.wrapping_add(1);
        program.reversing = signs.reversing();
        program.active = signs.active();
        // A motor that only creeps within one count keeps its direction pin.
        let forward = program.active & !signs.backward();
        program.directions = (self.directions & !program.active) | forward;
        // What the engine will have on its pins when the interval ends.
        self.directions = program.directions ^ program.reversing;
        if signs.fastest >= interval.way_max || signs.jumps as u32 >= 2 * JUMP_MAX as u32 {
            return Err(self.refusal());
        }
        Ok(())
    }

    #[cold]
    fn refusal(&self) -> StepRateExceeded {
        let fastest = |track: &MotorTrack| {
            let bend = track.last_way.wrapping_sub(track.way_before);
            let bend = i64::from(bend.unsigned_abs());
            let jump = i64::from(track.last_way.unsigned_abs());
            (jump + bend) >> WAY_FRACTION_BITS
        };
        let tracks = self.program.tracks.iter().map(fastest).enumerate();
        let (motor, steps) = tracks.max_by_key(|(_, steps)| *steps).unwrap_or((0, 0));
        StepRateExceeded {
            motor: motor as u8,
            steps_per_interval: steps as u32,
        }
    }
}

impl Rate {
    /// What so many ticks make, 2^-31 steps.
    fn way(&self, ticks: i32) -> i64 {
        let triangle = i64::from(ticks * (ticks - 1) / 2);
        i64::from(self.velocity) * i64::from(ticks) + i64::from(self.acceleration) * triangle
    }
}

impl MotorTrack {
    /// Takes the next target and computes the rate for the interval between the last two.
    ///
    /// With m the mean velocity and the acceleration 2 h, the first tick has the velocity
    /// m - (N - 1) h and the last m + (N - 1) h; all N make N m exactly.
    #[inline(always)]
    fn advance(&mut self, interval: &Interval, signs: &mut Signs) {
        let high = (self.target >> 32) as i32;
        let jump = high.wrapping_sub(self.newest_high);
        let target = (self.target >> WAY_SHIFT) as i32;
        let new_way = target.wrapping_sub(self.newest);
        let twice_mean = new_way.wrapping_sub(self.way_before);
        // From where the last program ends, not from where it was to end.
        let aim = (self.newest.wrapping_sub(self.last_way) << WAY_SHIFT) as u32;
        let behind = aim.wrapping_sub(self.end) as i32 >> WAY_SHIFT;
        let way = self.last_way.wrapping_add(behind);
        self.newest = target;
        self.newest_high = high;
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
        self.rate_before = self.rate;
        self.rate = Rate {
            velocity: first,
            acceleration: half.wrapping_mul(2),
        };
        signs.take(
            first,
            first ^ last,
            (start ^ self.end) as i32,
            way,
            twice_mean,
        );
        signs.jumps |= jump.wrapping_add(JUMP_MAX);
    }
}

/// First bits of the masks in [`Signs`]; the mask of motors that begin backward is the first.
const REVERSING: u32 = 8;
const ACTIVE: u32 = 16;
/// Half a step as a way.
const HALF_STEP_WAY: i32 = 1 << (WAY_FRACTION_BITS - 1);

/// What the motors' velocities mean, without a branch.
#[derive(Clone, Copy, Debug, Default)]
struct Signs {
    /// Three masks; each motor moves them up by one.
    masks: u32,
    /// Speed at the faster end of the parabola at most: (|way| + |A|) of 2^-22 steps an interval.
    fastest: u32,
    /// All jumps of targets' upper halves, moved by [`JUMP_MAX`].
    jumps: i32,
}

impl Signs {
    /// Takes the next motor: velocity in the first tick, a number that is negative if it reverses,
    /// the bits in which the engine's phases at both ends differ, its way and 2 A.
    #[inline(always)]
    fn take(&mut self, first: i32, reversal: i32, difference: i32, way: i32, twice_mean: i32) {
        // One less than the absolute value of a negative number: fine for bounds.
        let (way, bend) = (way ^ (way >> 31), twice_mean ^ (twice_mean >> 31));
        let moves = HALF_STEP_WAY.wrapping_sub(way) | difference;
        let bit = |number: i32| number as u32 >> 31;
        let bits = bit(first) | bit(reversal) << REVERSING | bit(moves) << ACTIVE;
        self.masks = self.masks << 1 | bits;
        let fastest = (way as u32).wrapping_add(bend as u32);
        if fastest > self.fastest {
            self.fastest = fastest;
        }
    }

    fn backward(&self) -> u8 {
        self.masks as u8
    }

    fn reversing(&self) -> u8 {
        (self.masks >> REVERSING) as u8
    }

    /// Motors that take steps or reverse.
    fn active(&self) -> u8 {
        (self.masks >> ACTIVE) as u8 | self.reversing()
    }
}
