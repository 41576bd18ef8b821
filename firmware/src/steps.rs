//! Joint targets at the servo rate -> steps at the step rate, in fixed point.
//!
//! Positions are i64 in 2^-31 steps. Every servo tick a [`StepProgrammer`] turns the targets of
//! four successive servo ticks into a [`StepProgram`]: one parabola per motor for the interval
//! between the middle two,
//! p(t) = q1 + (q2 - q1) t + A/2 t (t - 1), A = the mean of the second differences at both ends,
//! so that speed is nearly continuous and the ends are hit. The [`StepEngine`] plays it with two
//! additions per motor and step tick: `phase += v; v += a`, a step where bit 31 toggles. A step is
//! due when the position crosses n + 1/2 and comes in the last tick before that, half a tick early
//! on average; that half tick belongs to the constant delay (`design::motion_delay_s`).
//!
//! No counter runs in the step tick: the programmer knows the exact count by formula, and aims
//! every interval from where the last one really ended, so rounding never adds up.
//!
//! Source: the parabola is the quadratic through the averaged second difference (Catmull-Rom
//! slopes give the same to second order); phase accumulators as in direct digital synthesis.

use crate::configuration::MOTORS_MAX;
use crate::design::{STEP_RATE_SHARE_MAX, STEP_THRESHOLD_BIAS};
use crate::output::StepOutput;

/// Fraction bits of a position in steps.
pub const POSITION_FRACTION_BITS: u32 = 31;
/// One step.
pub const STEP: i64 = 1 << POSITION_FRACTION_BITS;
/// Most step ticks of a servo interval: its way, cut by [`WAY_SHIFT`], fits 32 bits.
pub const INTERVAL_TICKS_MAX: u32 = 256;
/// Fewest: the reciprocals fit 32 bits.
pub const INTERVAL_TICKS_MIN: u32 = 65;

/// Converts channel units to positions in 2^-31 steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepScale {
    /// Steps per channel unit, 60 fraction bits.
    per_unit_q60: i64,
    /// The same for offsets.
    per_unit: f32,
}

impl StepScale {
    /// `steps_per_unit`: motor steps per channel unit (0.1 µm, µrad, 10⁻⁶ mm³), below 4.
    pub fn new(steps_per_unit: f64) -> Self {
        const ONE_Q60: f64 = (1u64 << 60) as f64;
        let scaled = steps_per_unit * ONE_Q60;
        let half = if scaled < 0.0 { -0.5 } else { 0.5 };
        Self {
            per_unit_q60: (scaled + half) as i64,
            per_unit: steps_per_unit as f32,
        }
    }

    /// Exact position of an integer number of units, to the last of its 31 fraction bits.
    pub fn position(&self, units: i64) -> i64 {
        let product = i128::from(units) * i128::from(self.per_unit_q60);
        (product >> (60 - POSITION_FRACTION_BITS)) as i64
    }

    /// Position of a small offset in units.
    #[inline]
    pub fn offset(&self, units: f32) -> i64 {
        steps_to_position(units * self.per_unit)
    }
}

/// A number of steps as a position. Whole and fraction go separately, because the conversion to
/// 64 bits is slow software on a Cortex-M4F.
#[inline]
pub fn steps_to_position(steps: f32) -> i64 {
    let whole = steps as i32;
    let fraction = steps - whole as f32;
    (i64::from(whole) << POSITION_FRACTION_BITS) + i64::from((fraction * STEP as f32) as i32)
}

/// The whole number of steps at a position: rounded to nearest, halves up.
pub fn count(position: i64) -> i64 {
    biased(position) >> POSITION_FRACTION_BITS
}

/// The position whose whole part is the count.
#[inline]
fn biased(position: i64) -> i64 {
    position + (STEP / 2 + STEP_THRESHOLD_BIAS)
}

/// The engine's phase at a position: bit 31 is the parity of the count.
fn phase(position: i64) -> u32 {
    biased(position) as u32
}

/// A motor would need more than one step a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepRateExceeded {
    /// Which motor.
    pub motor: u8,
    /// Steps that it would need in a servo interval, at its fastest.
    pub steps_per_interval: u32,
}

/// One servo interval for all motors, in 2^-31 steps and step ticks.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StepProgram {
    velocity: [i32; MOTORS_MAX],
    acceleration: [i32; MOTORS_MAX],
    /// Direction bits at the interval's start.
    directions: u8,
    /// Motors whose direction changes within the interval.
    reversing: u8,
    /// Motors that take steps or reverse.
    active: u8,
    /// Phases to take over at the start: the position was declared anew, at rest.
    phases: Option<[u32; MOTORS_MAX]>,
    /// Number of the program, to find it again after a stop.
    serial: u32,
}

/// Where the engine was stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stopped {
    /// Ticks of the interval that were played.
    pub ticks_played: u32,
    /// Program that was being played.
    serial: u32,
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

impl StepProgram {
    /// Cleared for a new interval; velocities and accelerations are all written anew.
    fn begin(&mut self, serial: u32) {
        self.serial = serial;
        self.reversing = 0;
        self.active = 0;
        self.phases = None;
    }

    #[inline]
    fn set_direction(
        &mut self,
        directions: &mut u8,
        motor: usize,
        (velocity, last): (i32, i32),
        moves: bool,
    ) {
        let bit = 1u8 << motor;
        let reversing = (velocity ^ last) < 0;
        if reversing {
            self.reversing |= bit;
        }
        // A motor that only creeps within one count keeps its direction pin.
        if reversing || moves {
            self.active |= bit;
            if velocity < 0 {
                *directions &= !bit;
            } else {
                *directions |= bit;
            }
        }
    }
}

/// One motor's second-order integrator, in 2^-31 steps.
#[derive(Clone, Copy, Debug, Default)]
struct Integrator {
    phase: u32,
    velocity: i32,
    acceleration: i32,
}

impl Integrator {
    /// One step tick; bit 31 of the result says that a step is due.
    #[inline(always)]
    fn advance(&mut self) -> u32 {
        let old = self.phase;
        let new = old.wrapping_add(self.velocity as u32);
        self.phase = new;
        self.velocity = self.velocity.wrapping_add(self.acceleration);
        old ^ new
    }
}

/// Plays programs, one step tick at a time. On a board it belongs to the step interrupt.
#[derive(Clone, Debug)]
pub struct StepEngine {
    integrators: [Integrator; MOTORS_MAX],
    ticks_left: u32,
    reversing: u8,
    active: u8,
    directions: u8,
    next: Option<StepProgram>,
    serial: u32,
    /// Ticks that the last program was played for, if it is not playing any more.
    stopped_at: Option<u32>,
    interval_ticks: u32,
    /// Step tick at which the interval ends.
    interval_end_tick: u64,
    overruns: u32,
}

impl StepEngine {
    /// At rest; plays one idle interval first.
    pub fn new(interval_ticks: u32) -> Self {
        let interval_ticks = interval_ticks.clamp(INTERVAL_TICKS_MIN, INTERVAL_TICKS_MAX);
        Self {
            integrators: [Integrator::default(); MOTORS_MAX],
            ticks_left: interval_ticks,
            reversing: 0,
            active: 0,
            directions: 0,
            next: None,
            serial: 0,
            stopped_at: None,
            interval_ticks,
            interval_end_tick: u64::from(interval_ticks),
            overruns: 0,
        }
    }

    /// Hands over the next interval. It starts when the one that plays now has ended.
    pub fn load(&mut self, program: &StepProgram) {
        self.next = Some(program.clone());
    }

    /// How often an interval ended with no next one: the servo was late, or step ticks were lost.
    pub fn overruns(&self) -> u32 {
        self.overruns
    }

    /// True if a motor turns round within the interval that plays now.
    pub fn reverses(&self) -> bool {
        self.reversing != 0
    }

    /// Step ticks since start-up.
    pub fn now_tick(&self) -> u64 {
        self.interval_end_tick - u64::from(self.ticks_left)
    }

    /// Stops at once, in the middle of an interval.
    pub fn stop(&mut self) -> Stopped {
        for integrator in &mut self.integrators {
            integrator.velocity = 0;
            integrator.acceleration = 0;
        }
        self.reversing = 0;
        self.active = 0;
        self.next = None;
        let played = self.interval_ticks - self.ticks_left;
        Stopped {
            ticks_played: *self.stopped_at.get_or_insert(played),
            serial: self.serial,
        }
    }

    /// One step tick. Deadline on a board: one step period; nothing here waits or loops further
    /// than the motors.
    #[inline]
    pub fn tick<O: StepOutput>(&mut self, output: &mut O) {
        // Each motor's toggle enters at bit 31 and moves down: motor 0 ends in bit 24.
        let mut toggles = 0u32;
        for integrator in &mut self.integrators {
            toggles = (toggles >> 1) | (integrator.advance() & 0x8000_0000);
        }
        let motors = toggles >> 24;
        if motors != 0 {
            output.step(self.now_tick(), motors as u8);
        }
        self.ticks_left -= 1;
        if self.ticks_left == 0 {
            self.next_interval(output);
        } else if self.reversing != 0 {
            let mut forward = 0u32;
            for integrator in &self.integrators {
                forward = (forward >> 1) | (!(integrator.velocity as u32) & 0x8000_0000);
            }
            let forward = (forward >> 24) as u8;
            let turned = (forward ^ self.directions) & self.reversing;
            if turned != 0 {
                self.directions ^= turned;
                output.set_directions(self.directions);
            }
        }
    }

    /// The rest of the interval at once, with the same calls as [`Self::tick`] would make: for the
    /// simulator, many times faster.
    pub fn run_interval<O: StepOutput>(&mut self, output: &mut O) {
        if self.reversing != 0 {
            for _ in 0..self.ticks_left {
                self.tick(output);
            }
            return;
        }
        let mut due = [0u8; INTERVAL_TICKS_MAX as usize];
        let ticks = self.ticks_left as usize;
        let due = due.get_mut(..ticks).unwrap_or_default();
        for motor in 0..MOTORS_MAX {
            self.play_motor(motor, due);
        }
        let first_tick = self.now_tick();
        if self.active != 0 {
            for (tick, &motors) in due.iter().enumerate() {
                if motors != 0 {
                    output.step(first_tick + tick as u64, motors);
                }
            }
        }
        self.next_interval(output);
    }

    /// All remaining ticks of one motor; sets its bit in the ticks where a step is due.
    fn play_motor(&mut self, motor: usize, due: &mut [u8]) {
        let Some(integrator) = self.integrators.get_mut(motor) else {
            return;
        };
        if self.active >> motor & 1 == 0 {
            let ticks = due.len() as u32;
            let triangle = ticks.wrapping_mul(ticks.wrapping_sub(1)) / 2;
            integrator.phase = integrator
                .phase
                .wrapping_add((integrator.velocity as u32).wrapping_mul(ticks))
                .wrapping_add((integrator.acceleration as u32).wrapping_mul(triangle));
            return;
        }
        let mut local = *integrator;
        for slot in due {
            *slot |= ((local.advance() >> 31) as u8) << motor;
        }
        *integrator = local;
    }

    fn next_interval<O: StepOutput>(&mut self, output: &mut O) {
        self.ticks_left = self.interval_ticks;
        self.interval_end_tick += u64::from(self.interval_ticks);
        let Some(program) = self.next.take() else {
            self.stopped_at.get_or_insert(self.interval_ticks);
            self.stop();
            self.overruns = self.overruns.saturating_add(1);
            return;
        };
        self.serial = program.serial;
        self.stopped_at = None;
        for (motor, integrator) in self.integrators.iter_mut().enumerate() {
            integrator.velocity = program.velocity[motor];
            integrator.acceleration = program.acceleration[motor];
        }
        if let Some(phases) = program.phases {
            for (integrator, phase) in self.integrators.iter_mut().zip(phases) {
                integrator.phase = phase;
            }
        }
        self.reversing = program.reversing;
        self.active = program.active;
        if self.directions != program.directions {
            self.directions = program.directions;
            output.set_directions(self.directions);
        }
    }
}

#[cfg(test)]
#[path = "steps_tests.rs"]
mod tests;
